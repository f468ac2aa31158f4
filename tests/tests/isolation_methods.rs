//! The paper's isolation methods against its tables and against each other, for five gyros and more.

use crate::isolation_common::{
    Rates, SKEWED, argmax, axes_of_the_paper, cone, generator, noise, noise_of_the_paper, skewed,
};
use nalgebra::{SMatrix, SVector, Vector3, Vector5};
use rand::RngExt;
use rayon::prelude::*;
use schuler_core::isolation::IsolationConfig;
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::geometry::BlockGeometry;
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};

/// Table 1 of the paper: row i, column r.
const TABLE_1: [[f64; 5]; 5] = [
    [0.2849, 0.0303, 0.3440, 1.4821, 367.6578],
    [0.0091, 0.2664, 1.1265, 24.3626, 0.6189],
    [0.6098, 3.5288, 5.7698, 0.0232, 0.1194],
    [2.8948, 10.2930, 0.0438, 0.0988, 0.5483],
    [58.3723, 0.1144, 0.0634, 0.4445, 2.0705],
];

/// The same with the gain of the Kalman filter.
const KALMAN_TABLE: [[f64; 5]; 5] = [
    [2.187242, 0.131542, 0.082933, 1.645912, 876.375768],
    [0.237128, 0.031318, 1.075036, 51.087913, 3.526409],
    [0.353468, 5.408498, 19.584406, 0.770035, 0.008498],
    [4.187324, 32.456869, 0.93542, 0.019975, 0.281668],
    [160.956535, 1.370245, 0.057575, 0.171684, 2.664405],
];

/// Row i of the tables has the fault in gyro 6 − i, column r has gyro r + 1 last (counted from one).
fn table(recursion: Recursion, rate: Vector3<f64>) -> [[f64; 5]; 5] {
    let filter = SequentialFilter::new(cone().geometry(), recursion);
    std::array::from_fn(|i| {
        let measured = axes_of_the_paper() * rate + noise_of_the_paper() + Vector5::ith(4 - i, 1.0);
        std::array::from_fn(|r| filter.statistics(r, &measured).last_ratio())
    })
}

#[test]
fn fdi_3_4_table_1_of_the_paper() {
    for rate in [Vector3::zeros(), Vector3::new(1.0, -2.0, 3.0)] {
        let found = table(Recursion::CovarianceFirst, rate);
        for (found, published) in found.iter().flatten().zip(TABLE_1.iter().flatten()) {
            // Four decimals: half a unit of the last, and the deviation that the five-digit matrix leaves.
            assert!((found - published).abs() <= 5.1e-5 * published.max(1.0), "{found} {published}");
        }
        for (i, row) in found.into_iter().enumerate() {
            assert_eq!(argmax(row), 4 - i, "the largest names the gyro");
        }
    }
}

#[test]
fn fdi_3_3_table_of_the_kalman_filter() {
    for rate in [Vector3::zeros(), Vector3::new(1.0, -2.0, 3.0)] {
        let found = table(Recursion::Kalman, rate);
        for (found, expected) in found.iter().flatten().zip(KALMAN_TABLE.iter().flatten()) {
            assert!((found - expected).abs() <= 1e-5 * expected.max(1.0), "{found} {expected}");
        }
    }
}

#[test]
fn fdi_3_3_innovations_add_up_to_the_parity_in_every_order() {
    for space in [cone(), skewed()] {
        let filter = SequentialFilter::new(space.geometry(), Recursion::Kalman);
        for trial in 0..200 {
            let mut rng = generator(303, trial);
            let measured = noise::<5>(&mut rng) + space.geometry().matrix() * noise::<3>(&mut rng);
            let parity = space.parity(&measured);
            let likelihood = space.likelihood(&parity, 1.0);
            for (gyro, q) in likelihood.into_iter().enumerate() {
                let statistics = filter.statistics(gyro, &measured);
                assert!((statistics.total - parity.norm_squared()).abs() < 1e-10);
                assert!((statistics.last - q).abs() < 1e-10);
                // λ = cot² of the angle to the line of the gyro.
                let cross = parity.norm_squared() - q;
                assert!((statistics.ratio() * cross - q).abs() < 1e-9 * (1.0 + statistics.ratio()));
            }
        }
    }
}

#[test]
fn fdi_10_ratio_of_nothing_is_not_a_division() {
    let filter = SequentialFilter::new(cone().geometry(), Recursion::Kalman);
    assert_eq!(filter.ratios(&Rates::zeros()), Rates::zeros());
    // Without noise the block agrees perfectly without the faulty gyro.
    let ratios = filter.ratios(&Rates::ith(2, 1.0));
    assert_eq!(argmax(ratios.iter().copied()), 2);
    assert!(ratios[2] <= 1e12 && ratios[2] > 1e11, "{}", ratios[2]);
}

#[test]
fn fdi_3_all_methods_decide_alike() {
    let blocks = [cone(), skewed()];
    let methods = blocks.map(|space| {
        (
            FiveDeterminants::normalised(&space),
            OrthogonalProjector::new(space.geometry()),
            SequentialFilter::new(space.geometry(), Recursion::Kalman),
        )
    });
    let trials = 100_000_u64;
    let differing = (0..trials)
        .into_par_iter()
        .filter(|trial| {
            let mut rng = generator(3, *trial);
            let block = (trial % 2) as usize;
            let (space, (determinants, projector, filter)) = (&blocks[block], &methods[block]);
            let mut measured: Rates = noise(&mut rng);
            measured[(trial / 2 % 5) as usize] += rng.random_range(-10.0..10.0);
            measured += space.geometry().matrix() * noise::<3>(&mut rng) * 100.0;
            let glt = argmax(space.likelihood(&space.parity(&measured), 1.0));
            let decisions = [
                argmax(determinants.of(&measured).iter().map(|d| -d.abs())),
                argmax(projector.project(&measured).unexplained.iter().map(|j| -j)),
                argmax(filter.ratios(&measured).iter().copied()),
            ];
            decisions.into_iter().any(|decision| decision != glt)
        })
        .count();
    println!("decisions that differ: {differing} of {trials}");
    assert!(differing as f64 <= 1e-5 * trials as f64);
}

#[test]
fn fdi_3_5_condition_number_decides_as_the_others_only_without_the_rate() {
    // On the residual G y instead of y the condition number follows the determinant.
    let space = cone();
    let condition = |measured: &Rates, removed: usize| {
        let augmented = SMatrix::<f64, 5, 4>::from_fn(|row, column| {
            if column == 3 { measured[row] } else { space.geometry().matrix()[(row, column)] }
        });
        let singular = augmented.remove_row(removed).singular_values();
        singular.max() / singular.min()
    };
    let mut differs = [0_u32; 2];
    for trial in 0..2000 {
        let mut rng = generator(305, trial);
        let mut measured: Rates = noise(&mut rng) * 0.1;
        measured[(trial % 5) as usize] += 0.8;
        let residual = space.geometry().projector() * measured;
        let glt = argmax(space.likelihood(&space.parity(&measured), 1.0));
        for (count, vector) in differs.iter_mut().zip([measured, residual * 1e-3]) {
            *count += u32::from(argmax((0..5).map(|removed| condition(&vector, removed))) != glt);
        }
    }
    println!(
        "condition number differs from the likelihood: on y {}, on G y {} of 2000",
        differs[0], differs[1]
    );
    assert!(differs[0] > 100, "{differs:?}");
    assert_eq!(differs[1], 0, "{differs:?}");
}

/// Six axes through the faces of a dodecahedron.
fn dodecahedron() -> [[f64; 3]; 6] {
    let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
    let norm = (1.0 + golden * golden).sqrt();
    let (short, long) = (1.0 / norm, golden / norm);
    [
        [short, long, 0.0],
        [-short, long, 0.0],
        [0.0, short, long],
        [0.0, -short, long],
        [long, 0.0, short],
        [long, 0.0, -short],
    ]
}

/// Checks projector and sequential filter on a block of N gyros against least squares by singular values. A macro,
/// because a decomposition asks for bounds that are met by every number but not by all numbers.
macro_rules! check_block {
    ($n:literal, $axes:expr, $sigma:expr, $seed:expr) => {{
        let geometry = BlockGeometry::<f64, $n>::try_build(&$axes, &$sigma).expect("can be flown");
        let projector = OrthogonalProjector::new(&geometry);
        let filter = SequentialFilter::new(&geometry, Recursion::Kalman);

        // The projector by singular value decomposition of the axes.
        let left = geometry.matrix().svd(true, false).u.expect("asked for");
        let by_svd = SMatrix::<f64, $n, $n>::identity() - left * left.transpose();
        assert!((by_svd - geometry.projector()).amax() < 1e-13);

        for trial in 0..300 {
            let mut rng = generator($seed, trial);
            let mut measured: SVector<f64, $n> = noise(&mut rng);
            measured[trial as usize % $n] += 7.0;
            measured += geometry.matrix() * noise::<3>(&mut rng) * 50.0;
            let projection = projector.project(&measured);
            for gyro in 0..$n {
                // Least squares for the rate and a fault of this gyro together.
                let model = SMatrix::<f64, $n, 4>::from_fn(|row, column| {
                    if column == 3 {
                        f64::from(u8::from(row == gyro))
                    } else {
                        geometry.matrix()[(row, column)]
                    }
                });
                let solution = model.svd(true, true).solve(&measured, 1e-12).expect("regular");
                let residual = (model * solution - measured).norm_squared();
                assert!((projection.unexplained[gyro] - residual).abs() < 1e-8);
                assert!((projection.sizes[gyro] - solution[3]).abs() < 1e-8);
                let statistics = filter.statistics(gyro, &measured);
                assert!((statistics.total - projection.total).abs() < 1e-8 * projection.total);
                assert!((statistics.last - (projection.total - residual)).abs() < 1e-8 * projection.total);
            }
            let by_projector = argmax(projection.unexplained.iter().map(|j| -j));
            assert_eq!(argmax(filter.ratios(&measured).iter().copied()), by_projector);
        }
    }};
}

#[test]
fn fdi_3_projector_and_filter_for_five_and_more_gyros() {
    check_block!(5, IsolationConfig::CONE.axes, [1.0; 5], 351);
    check_block!(5, SKEWED, [1.0, 2.0, 0.7, 1.5, 1.0], 352);
    check_block!(6, dodecahedron(), [1.0; 6], 361);
    check_block!(6, dodecahedron(), [1.0, 0.5, 2.0, 1.0, 1.3, 0.8], 362);
    let eight: [[f64; 3]; 8] = std::array::from_fn(|k| {
        let azimuth = k as f64 * std::f64::consts::TAU / 8.0;
        let height = if k % 2 == 0 { 0.3_f64 } else { 0.8 };
        let radius = (1.0 - height * height).sqrt();
        [radius * azimuth.cos(), radius * azimuth.sin(), height]
    });
    check_block!(8, eight, [1.0; 8], 381);
}

#[test]
fn fdi_3_3_filter_starts_with_axes_that_span_space() {
    // The first three of the cyclic order lie in one plane for one of the candidates.
    let half = 0.5_f64.sqrt();
    let axes = [
        [0.6, 0.0, 0.8],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [half, half, 0.0],
        [0.0, -0.6, 0.8],
        [-0.48, 0.36, 0.8],
    ];
    check_block!(6, axes, [1.0; 6], 371);
}

#[test]
fn fdi_2_fewer_than_five_gyros_cannot_be_told_apart() {
    let tetrahedron = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
        .map(|axis: [f64; 3]| axis.map(|x| x / 3.0_f64.sqrt()));
    assert!(BlockGeometry::try_build(&tetrahedron, &[1.0; 4]).is_err());
}
