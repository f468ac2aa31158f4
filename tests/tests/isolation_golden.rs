//! Published and closed-form numbers of the five-gyro isolation.

use crate::isolation_common::{
    SKEWED, argmax, axes_of_the_paper, cone, fault, generator, noise, noise_of_the_paper, skewed,
};
use nalgebra::{Matrix2, Matrix3, Matrix4, Matrix5, SMatrix, Vector2, Vector3, Vector5};
use proptest::prelude::*;
use schuler_core::config::Problem;
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::isolation::rate::RateEstimator;
use schuler_core::isolation::thresholds::Thresholds;

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

/// Projector `G = VᵀV`.
fn projector(space: &ParitySpace<f64>) -> Matrix5<f64> {
    space.matrix().tr_mul(space.matrix())
}

#[test]
fn fdi_2_facts_of_the_cone() {
    let axes = axes_of_the_paper();
    for row in axes.row_iter() {
        assert!(close(row.norm(), 1.0, 2e-5));
    }
    let information = axes.tr_mul(&axes);
    // Half a unit of the fifth digit in each element: 2 · 5e-6 · Σ|a| of a column.
    assert!((information - Matrix3::identity() * (5.0 / 3.0)).amax() < 2.5e-5);
    for (j, k) in (0..5).flat_map(|j| (0..j).map(move |k| (j, k))) {
        let dot = axes.row(j).dot(&axes.row(k)).abs();
        assert!(close(dot, 0.53934, 2e-5) || close(dot, 0.20601, 2e-5), "{j} {k}: {dot}");
    }

    let space = cone();
    assert!((space.matrix() * axes).norm() <= 1e-14);
    assert!((space.matrix() * space.matrix().transpose() - Matrix2::identity()).amax() <= 1e-14);
    assert!(close(space.geometry().volume(), 2.15164, 2e-5));
    assert!(close(space.geometry().volume(), information.determinant().sqrt(), 1e-12));
    for k in 0..5 {
        assert!(close(projector(&space)[(k, k)], 0.4, 2e-5));
        let angle = |j: usize| {
            let dot: f64 = space.directions()[k].dot(&space.directions()[j % 5]);
            dot.abs().acos().to_degrees()
        };
        assert!(close(angle(k + 1), 36.0, 0.01) && close(angle(k + 4), 36.0, 0.01));
        assert!(close(angle(k + 2), 72.0, 0.01) && close(angle(k + 3), 72.0, 0.01));
    }
}

#[test]
fn fdi_2_parity_matrix_is_the_published_one() {
    let published = SMatrix::<f64, 2, 5>::from_row_slice(&[
        0.632454, 0.511669, 0.195436, 0.195436, 0.511669, //
        0.0, 0.371747, 0.601502, -0.601502, -0.371747,
    ]);
    assert!((cone().matrix() - published).amax() < 2e-5);
    assert!((projector(&cone()) - cone().geometry().projector()).amax() < 1e-15);
}

#[test]
fn fdi_9_rate_from_five_and_from_four() {
    let space = cone();
    let estimator = RateEstimator::new(&space);
    assert!(close(estimator.covariance(&space, None).trace(), 1.8, 2e-5));
    for k in 0..5 {
        let rate = Vector3::new(1.0, -2.0, 3.0);
        let mut measured = axes_of_the_paper() * rate;
        measured[k] = 1e6;
        assert!(
            (estimator.rate(&space, &measured, Some(k)) - rate).amax() < 1e-14,
            "gyro {k} is not left out"
        );
        assert!(close(estimator.covariance(&space, Some(k)).trace(), 2.7, 1e-4));
    }
    // The determinant without gyro 1 weighs the remaining four as the published parity equation does.
    let determinants = FiveDeterminants::normalised(&space);
    let weights =
        SMatrix::<f64, 5, 5>::from_columns(&[0, 1, 2, 3, 4].map(|i| determinants.of(&Vector5::ith(i, 1.0))));
    let expected = [0.0, 0.37175, 0.6015, 0.6015, 0.37175];
    for (weight, expected) in weights.row(0).iter().zip(expected) {
        assert!(close(weight.abs(), expected, 2e-5));
    }
}

#[test]
fn fdi_8_unequal_gyros_are_whitened() {
    // Measurements over their σ have a parity without the rate and, as V Vᵀ = I, of unit covariance.
    let sigma = [1e-7, 2e-7, 1.5e-7, 3e-7, 1e-7];
    let space = ParitySpace::try_build(&SKEWED, &sigma).expect("can be flown");
    let rate = Vector3::new(0.1, -0.2, 0.3);
    let measured = Vector5::from_fn(|k, _| Vector3::from(SKEWED[k]).dot(&rate) / sigma[k]);
    assert!(space.parity(&measured).norm() < 1e-14 * measured.norm());
    assert!((space.matrix() * space.matrix().transpose() - Matrix2::identity()).amax() < 1e-14);
    // Only the ratios of the σ matter.
    let larger = ParitySpace::try_build(&SKEWED, &sigma.map(|s| s * 1e7)).expect("can be flown");
    assert!((space.matrix() - larger.matrix()).amax() < 1e-14);
    assert!((space.geometry().reference_sigma() - 1e-7).abs() < 1e-22);
}

#[test]
fn fdi_9_second_fault_is_less_visible() {
    // Of a fault of one σ the five-gyro parity holds 0.632 σ, the four-gyro parity 1.05 to 1.7 times less.
    let space = cone();
    let determinants = FiveDeterminants::normalised(&space);
    for excluded in 0..5 {
        for faulty in (0..5).filter(|gyro| *gyro != excluded) {
            let seen = determinants.of(&Vector5::ith(faulty, 1.0))[excluded].abs();
            let less = space.sensitivity()[faulty] / seen;
            assert!((1.05..1.71).contains(&less), "{excluded} {faulty}: {less}");
        }
    }
}

#[test]
fn fdi_9_covariance_of_unequal_gyros_is_that_of_weighted_least_squares() {
    let sigma = [1e-7, 2e-7, 1.5e-7, 3e-7, 1e-7];
    let space = ParitySpace::try_build(&SKEWED, &sigma).expect("can be flown");
    let estimator = RateEstimator::new(&space);
    for excluded in [None, Some(0), Some(1), Some(2), Some(3), Some(4)] {
        let mut information = Matrix3::zeros();
        for (k, axis) in SKEWED.iter().enumerate().filter(|(k, _)| Some(*k) != excluded) {
            let axis = Vector3::from(*axis) / sigma[k];
            information += axis * axis.transpose();
        }
        let expected = information.try_inverse().expect("regular");
        let covariance = estimator.covariance(&space, excluded);
        assert!((covariance - expected).amax() < 1e-9 * expected.amax());
    }
}

#[test]
fn fdi_2_geometries_that_cannot_serve_are_rejected_with_the_reason() {
    let third = 1.0 / f64::sqrt(3.0);
    let reason = |axes: [[f64; 3]; 5], sigma: [f64; 5]| {
        let error = ParitySpace::try_build(&axes, &sigma).expect_err("must be rejected");
        (error.field, error.problem)
    };
    let cone = IsolationConfig::CONE.axes;
    let with = |k: usize, axis: [f64; 3]| {
        let mut axes = cone;
        axes[k] = axis;
        axes
    };
    let ones = [1.0; 5];

    let (field, problem) = reason(
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [third, third, third], [third, -third, third]],
        ones,
    );
    assert_eq!(field, "isolation.axes[0]");
    assert!(matches!(problem, Problem::Geometry(text) if text.contains("axes[2]")), "{problem}");

    let (field, problem) = reason(with(2, [0.0, 0.48092, 0.87831]), ones);
    assert_eq!(field, "isolation.axes[2]");
    assert!(matches!(problem, Problem::Geometry(text) if text.contains("unit vector")));

    let flat = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.8, 0.6, 0.0], [-0.6, 0.8, 0.0]];
    assert!(
        matches!(reason(flat, ones), ("isolation.axes", Problem::Geometry(text)) if text.contains("span"))
    );

    // Only gyro 5 sees the third axis: its fault is a rate.
    let lonely = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.8, -0.6, 0.0], [0.0, 0.0, 1.0]];
    assert!(
        matches!(reason(lonely, ones), ("isolation.axes[4]", Problem::Geometry(text)) if text.contains("seen"))
    );

    assert_eq!(reason(with(1, [f64::NAN, 0.0, 1.0]), ones), ("isolation.axes[1]", Problem::NotFinite));
    assert_eq!(reason(cone, [1.0, 1.0, 0.0, 1.0, 1.0]), ("isolation.sigma", Problem::NotPositive));
    assert_eq!(reason(cone, [1.0, 1.0, -1.0, 1.0, 1.0]), ("isolation.sigma", Problem::NotPositive));
    assert_eq!(reason(cone, [1.0, f64::INFINITY, 1.0, 1.0, 1.0]), ("isolation.sigma", Problem::NotFinite));
}

#[test]
fn fdi_11_table_2_of_the_paper() {
    const TABLE: [[f64; 5]; 5] = [
        [0.0814, 0.6730, 1.0075, 0.9572, 0.5413],
        [0.4245, 0.1671, 0.6949, 0.9572, 0.8539],
        [0.7371, 0.3388, 0.1890, 0.6446, 0.8539],
        [0.8999, 0.9857, 0.6949, 0.1387, 0.4705],
        [0.5873, 0.9857, 1.0075, 0.6446, 0.0354],
    ];
    let determinants = FiveDeterminants::new(&IsolationConfig::CONE.axes.map(Vector3::from));
    for rate in [Vector3::zeros(), Vector3::new(1.0, -2.0, 3.0)] {
        for (faulty, row) in TABLE.iter().enumerate() {
            let measured = axes_of_the_paper() * rate + noise_of_the_paper() + Vector5::ith(faulty, 1.0);
            let found = determinants.of(&measured);
            for (found, published) in found.iter().zip(row) {
                assert!(close(found.abs(), *published, 5.1e-5), "gyro {faulty}: {found} {published}");
            }
            assert_eq!(argmax(found.iter().map(|d| -d.abs())), faulty);
        }
    }
}

#[test]
fn fdi_3_minors_give_the_determinants_of_an_lu_factorisation() {
    let determinants = FiveDeterminants::new(&IsolationConfig::CONE.axes.map(Vector3::from));
    let measured = Vector5::new(0.3, -1.2, 0.7, 2.0, -0.4);
    for removed in 0..5 {
        let augmented = axes_of_the_paper().insert_column(3, 0.0);
        let augmented =
            SMatrix::<f64, 5, 4>::from_fn(|r, c| if c == 3 { measured[r] } else { augmented[(r, c)] });
        let square: Matrix4<f64> = augmented.remove_row(removed);
        assert!(close(determinants.of(&measured)[removed], square.determinant(), 1e-14));
    }
}

#[test]
fn fdi_11_numbers_of_the_example() {
    let space = cone();
    let sigma = 0.1;
    let noise = noise_of_the_paper();
    assert!(close(space.parity(&noise).norm(), 0.14003, 1e-5));

    let t = [57.975, 50.469, 39.712, 54.107, 59.365];
    let size = [1.2002, 1.1063, 0.9719, 1.1518, 1.2176];
    for k in 0..5 {
        let parity = space.parity(&(noise + Vector5::ith(k, 1.0))) / sigma;
        assert!(close(parity.norm_squared(), t[k], 1e-3));
        let estimate = space.directions()[k].dot(&parity) / space.sensitivity()[k] * sigma;
        assert!(close(estimate, size[k], 1e-4));
        assert!(close(1.0 / space.sensitivity()[k], 1.581, 5e-4));
    }
    let q = space.likelihood(&(space.parity(&(noise + Vector5::ith(0, 1.0))) / sigma), 1.0);
    for (found, expected) in q.into_iter().zip([57.617, 33.515, 3.156, 8.495, 42.154]) {
        assert!(close(found, expected, 1e-3));
    }

    let conditions = [21.9045, 5.0112, 2.8703, 3.1676, 6.1987];
    let measured = noise + Vector5::ith(0, 1.0);
    for (removed, expected) in conditions.into_iter().enumerate() {
        let augmented =
            SMatrix::<f64, 5, 4>::from_fn(
                |r, c| if c == 3 { measured[r] } else { axes_of_the_paper()[(r, c)] },
            );
        let singular = augmented.remove_row(removed).singular_values();
        assert!(close(singular.max() / singular.min(), expected, 1e-4));
    }
}

#[test]
fn fdi_6_thresholds_of_the_table_and_their_growth() {
    // Simulated thresholds for 10⁵ samples: c = 25.22, h = 12.9 and 53.
    let at = |interval| Thresholds::<f64>::five(interval, 1);
    let (c, fast, slow) = (at(1e5).single, at(1e5).fast, at(1e5).slow);
    assert!(close(c, 25.22, 0.005), "{c}");
    assert!(close(fast, 12.9, 0.05), "{fast}");
    assert!(close(slow, 53.0, 0.1), "{slow}");
    // Per factor of ten: ln 10 over half the weight of the statistic in its exponent, reached from above.
    let decade = 10_f64.ln();
    assert!(close(at(1e6).single - c, 2.0 * decade, 1e-9));
    assert!(close(at(1e6).fast - fast, decade, 0.01));
    assert!(close(at(1e6).slow - slow, 5.0 * decade, 0.3));
    assert!(close(slow - at(1e4).slow, 5.0 * decade, 0.3));
}

#[test]
fn fdi_9_single_sample_threshold_of_four_is_the_normal_quantile() {
    use statrs::distribution::{ContinuousCDF, Normal};
    let normal = Normal::standard();
    for interval in [1e4, 1e5, 1e6, 1e7] {
        let threshold: f64 = Thresholds::four(interval, 1).single;
        let expected = normal.inverse_cdf(1.0 - 1.0 / (6.0 * interval)).powi(2);
        assert!(close(threshold, expected, 0.01), "{interval}: {threshold} {expected}");
    }
}

#[test]
fn fdi_3_2_raw_determinants_decide_otherwise_on_an_asymmetric_block_and_normalised_ones_do_not() {
    let space = skewed();
    let raw = FiveDeterminants::new(space.geometry().axes());
    let normalised = FiveDeterminants::normalised(&space);
    let trials = 20_000;
    let mut raw_differs = 0;
    for trial in 0..trials {
        let mut rng = generator(32, trial);
        let measured = noise::<5>(&mut rng) + Vector5::ith((trial % 5) as usize, 6.0);
        let glt = argmax(space.likelihood(&space.parity(&measured), 1.0));
        raw_differs += u32::from(argmax(raw.of(&measured).iter().map(|d| -d.abs())) != glt);
        assert_eq!(argmax(normalised.of(&measured).iter().map(|d| -d.abs())), glt);
    }
    let share = f64::from(raw_differs) / trials as f64;
    assert!((0.07..0.11).contains(&share), "{share}");
}

/// Axes drawn at random, kept when they can be flown.
fn geometry() -> impl Strategy<Value = ParitySpace<f64>> {
    let axis = (-1.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(z, azimuth)| {
        let radius = (1.0 - z * z).sqrt();
        [radius * azimuth.cos(), radius * azimuth.sin(), z]
    });
    let sigma = proptest::array::uniform5(0.3..3.0f64);
    (proptest::array::uniform5(axis), sigma)
        .prop_filter_map("cannot be flown", |(axes, sigma)| ParitySpace::try_build(&axes, &sigma).ok())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
    /// `d_j = √det(AᵀA) |v_j × p|`, hence `d_j²/(det(AᵀA) G_jj) = ‖p‖² − (v_jᵀp)²/‖v_j‖²`, on any geometry.
    #[test]
    fn fdi_3_1_determinants_are_the_cross_products_with_the_parity_lines(
        space in geometry(),
        measured in proptest::array::uniform5(-5.0..5.0f64),
    ) {
        let measured = Vector5::from(measured);
        let parity = space.parity(&measured);
        let raw = FiveDeterminants::new(space.geometry().axes()).of(&measured);
        let normalised = FiveDeterminants::normalised(&space).of(&measured);
        let scale = parity.norm_squared() + measured.norm_squared();
        for j in 0..5 {
            let column: Vector2<f64> = space.matrix().column(j).into_owned();
            let cross = column.perp(&parity).abs() * space.geometry().volume();
            prop_assert!(close(raw[j].abs(), cross, 1e-12 * scale));
            let along = space.directions()[j].dot(&parity);
            let least_residual = parity.norm_squared() - along * along;
            prop_assert!(close(normalised[j] * normalised[j], least_residual, 1e-12 * scale / space.sensitivity()[j]));
        }
    }

    /// The parity and the determinants do not contain the rate.
    #[test]
    fn fdi_1_parity_is_independent_of_the_rate(
        space in geometry(),
        rate in proptest::array::uniform3(-10.0..10.0f64),
    ) {
        let measured = space.geometry().matrix() * Vector3::from(rate);
        prop_assert!(space.parity(&measured).norm() < 1e-13 * (1.0 + measured.norm()) * 10.0);
        prop_assert!(FiveDeterminants::normalised(&space).of(&measured).norm() < 1e-12 * (1.0 + measured.norm()) * 10.0);
    }

    /// V is orthonormal and orthogonal to the axes for every geometry that passes the guards.
    #[test]
    fn fdi_2_parity_matrix_is_orthonormal(space in geometry()) {
        let v = space.matrix();
        prop_assert!((v * v.transpose() - Matrix2::identity()).amax() < 1e-13);
        prop_assert!((v * space.geometry().matrix()).amax() < 1e-13);
        let gram = space.geometry().matrix().tr_mul(&space.geometry().matrix()).determinant().sqrt();
        prop_assert!(close(space.geometry().volume(), gram, 1e-10 * gram));
    }

    /// Element j of the normalised determinants does not contain the reading of gyro j.
    #[test]
    fn fdi_9_determinant_is_blind_to_its_own_gyro(space in geometry(), size in -1e6..1e6f64) {
        let determinants = FiveDeterminants::normalised(&space);
        for j in 0..5 {
            prop_assert_eq!(determinants.of(&Vector5::ith(j, size))[j], 0.0);
        }
    }
}

#[test]
fn fdi_2_axes_along_the_coordinates_do_not_upset_the_factorisation() {
    // Columns that are already triangular leave the reflections of the QR nothing to do.
    let space = skewed();
    assert!((space.matrix() * space.geometry().matrix()).amax() < 1e-14);
    assert!((space.matrix() * space.matrix().transpose() - Matrix2::identity()).amax() < 1e-14);
    let estimator = RateEstimator::new(&space);
    let rate = Vector3::new(0.1, -0.2, 0.3);
    for excluded in [None, Some(0), Some(1), Some(2), Some(3), Some(4)] {
        let fitted = estimator.rate(&space, &(space.geometry().matrix() * rate), excluded);
        assert!((fitted - rate).amax() < 1e-13);
    }
}

#[test]
fn fdi_2_single_precision_parity_matrix() {
    let axes = IsolationConfig::CONE.axes.map(|axis| axis.map(|x| x as f32));
    let space = ParitySpace::<f32>::try_build(&axes, &[1.0; 5]).expect("can be flown");
    assert!((space.matrix() * space.geometry().matrix()).norm() <= 1e-6);
    let double = fault(&cone(), 0, 1.0).norm();
    assert!(close(f64::from(space.sensitivity()[0]), double, 1e-6));
}
