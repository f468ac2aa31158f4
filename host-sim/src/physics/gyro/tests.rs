//! The gyro against closed forms, experiments on a table and the full-rate integration.
use super::*;
use crate::physics::earth::STANDARD_GRAVITY as G;

const DEG_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;

fn run(
    design: &GyroDesign,
    rate: Vector3<f64>,
    force: Vector3<f64>,
    around: &Surroundings,
    n: usize,
) -> [f64; 2] {
    let mut gyro = Gyro::new(design.clone(), 1, "gyro").unwrap();
    let mut last = [0.0; 2];
    for _ in 0..n {
        last = gyro.step(&[rate, rate], &[force, force], around, 1.0).rate;
    }
    last
}

#[test]
fn an_ideal_gyro_tells_the_rate() {
    let design = GyroDesign::ideal(100.0);
    let rate = Vector3::new(0.01, -0.02, 0.0);
    let told = run(&design, rate, Vector3::new(1.0, 2.0, -9.8), &Surroundings::default(), 3);
    assert!((told[0] - 0.01).abs() < 1e-9 && (told[1] + 0.02).abs() < 1e-9, "{told:?}");
    // A rate about the spin axis: the torque is ω × L with L = (A ωx, A ωy, C (N + ωs)), which adds (C − A) ωi ωs.
    let told = run(&design, Vector3::new(0.01, 0.0, 0.5), Vector3::zeros(), &Surroundings::default(), 3);
    let r = &design.rotor;
    let added = (r.rotor_polar - r.rotor_equatorial) * 0.01 * 0.5 / r.angular_momentum();
    // The gimbal's share is a few per cent of that.
    assert!(((told[0] - 0.01) / added - 1.0).abs() < 0.03, "{told:?} {added}");
}

#[test]
fn six_position_tumble_recovers_the_static_error_coefficients() {
    let mut design = GyroDesign::ideal(100.0);
    let h = design.calibration.norm();
    let (z, q) = (4.0e-8, 7.0e-9);
    design.axial_unbalance = z;
    design.flexure_twist = q;
    design.reaction_torque = [2.0e-8, -3.0e-8];
    let (radial, axial) = (2.0e-8, 1.4e-8);
    design.compliance = nalgebra::Matrix3::from_diagonal(&Vector3::new(radial, radial, axial));
    // Positions: each axis up and down, and one at 45° for the g² term.
    let tell = |f: Vector3<f64>| run(&design, Vector3::zeros(), f, &Surroundings::default(), 2)[0];
    let (x, y, s) = (Vector3::x() * G, Vector3::y() * G, Vector3::z() * G);
    let bias = (tell(x) + tell(-x) + tell(y) + tell(-y)) / 4.0;
    let (along_x, along_y, along_s) =
        ((tell(x) - tell(-x)) / 2.0, (tell(y) - tell(-y)) / 2.0, (tell(s) - tell(-s)) / 2.0);
    // Against a torque M the loop gives −M, told as i(−M)/H: x of that is My/H.
    let m = design.mass;
    assert!((bias - design.reaction_torque[1] / h).abs() < 1e-4 * bias.abs());
    assert!((along_x - -m * z * G / h).abs() < 1e-4 * along_x.abs(), "{along_x}");
    assert!((along_y - m * q * G / h).abs() < 1e-4 * along_y.abs(), "{along_y}");
    assert!(along_s.abs() < 1e-14);
    let d = (x + s) * std::f64::consts::FRAC_1_SQRT_2;
    let product = tell(d) - bias - along_x * std::f64::consts::FRAC_1_SQRT_2;
    let expected = -m * m * (radial - axial) * 0.5 * G * G / h;
    assert!((product / expected - 1.0).abs() < 1e-3, "{product} {expected}");
    // In the field's unit these are the usual sizes.
    assert!((0.1..2.0).contains(&(along_x.abs() / DEG_PER_HOUR)));
}

#[test]
fn a_warm_detuned_rotor_turns_its_pickoff_offset_into_a_drift() {
    let mut design = GyroDesign::ideal(100.0);
    design.pickoff_offset = [2e-5, 0.0];
    design.stiffness_temperature = -2.4e-4;
    let warm = Surroundings { temperature: REFERENCE_TEMPERATURE + 15.0, ..Surroundings::default() };
    let zero = Vector3::zeros();
    let at = |around| run(&design, zero, zero, around, 2);
    let (cold, warm) = (at(&Surroundings::default()), at(&warm));
    // K changes by 0.36 %, held at −offset: the loop's torque is −δK · offset about x, told as y: Re(…)/H.
    let spring = -2.4e-4 * 15.0 * design.rotor.stiffness[0];
    let expected = -spring * 2e-5 / design.rebalance.design_momentum;
    assert!(((warm[1] - cold[1]) / expected - 1.0).abs() < 0.05, "{cold:?} {warm:?} {expected}");
}

#[test]
fn torquer_heats_its_magnet() {
    let mut design = GyroDesign::ideal(100.0);
    design.torquer_temperature = -4e-4;
    design.torquer_power = 2.0;
    design.magnet_resistance = 5.0;
    design.magnet_lag_s = 100.0;
    let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
    let (w, f) = ([Vector3::new(0.5, 0.0, 0.0); 2], [Vector3::zeros(); 2]);
    let around = Surroundings::default();
    let mut last = 0.0;
    for k in 0..1000 {
        last = gyro.step(&w, &f, &around, 1.0).rate[0];
        if k == 99 {
            let rise = 2.0 * 5.0 * 0.25 * (1.0 - (-1.0f64).exp());
            assert!((last / (0.5 * (1.0 + 4e-4 * rise)) - 1.0).abs() < 2e-5, "{last}");
        }
    }
    assert!((last / (0.5 * (1.0 + 4e-4 * 2.5)) - 1.0).abs() < 2e-5, "{last}");
}

#[test]
fn a_gradient_across_the_housing_pulls_at_the_rotor() {
    let mut design = GyroDesign::ideal(100.0);
    design.reaction_torque_gradient = [0.0, 1e-9];
    let h = design.calibration.norm();
    let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
    let mut drift = |gradient: f64| {
        let around = Surroundings { gradient, ..Surroundings::default() };
        let rest = [Vector3::zeros(); 2];
        (0..10).map(|_| gyro.step(&rest, &rest, &around, 1.0).rate[0]).last().unwrap()
    };
    assert!(drift(0.0).abs() < 1e-15);
    let expected = 1e-9 * 5.0 / h;
    let found = drift(5.0);
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
}

#[test]
fn a_warm_magnet_pulls_at_the_rotor() {
    let mut design = GyroDesign::ideal(100.0);
    design.torquer_power = 2.0;
    design.magnet_resistance = 5.0;
    design.magnet_lag_s = 100.0;
    design.reaction_torque_rise = [0.0, 1e-9];
    let h = design.calibration.norm();
    let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
    let (f, around) = ([Vector3::zeros(); 2], Surroundings::default());
    let mut tell = |rate: f64, n: usize| {
        let w = [Vector3::new(0.0, rate, 0.0); 2];
        (0..n).map(|_| gyro.step(&w, &f, &around, 1.0).rate[0]).last().unwrap()
    };
    // Power in the other coil: 2.5 K after long, and e⁻¹ of it left a time constant after the table has stopped.
    let hot = tell(0.5, 2000);
    let cooling = tell(0.0, 101);
    assert!((hot / (1e-9 * 2.5 / h) - 1.0).abs() < 1e-3, "{hot}");
    assert!((cooling / hot - (-1.0f64).exp()).abs() < 0.005, "{cooling} {hot}");
}

#[test]
fn a_gyro_for_large_rates_tells_them_while_they_change_and_while_it_turns_about_its_spin_axis() {
    let design = GyroDesign::strapdown(200.0);
    let rotor = &design.rotor;
    assert!((rotor.rotor_equatorial / rotor.rotor_polar - 1.0).abs() < 0.05, "{rotor:?}");
    let worst = |design: &GyroDesign| {
        let mut gyro = Gyro::new(design.clone(), 1, "gyro").unwrap();
        let w = std::f64::consts::TAU * 0.01;
        let at = |t: f64| Vector3::new(0.03 * (w * t).sin(), 0.04 * (w * t).cos(), 0.3 * (0.7 * w * t).sin());
        let mut worst = 0.0f64;
        for k in 0..200 {
            let t = f64::from(k);
            let rate = [at(t), at(t + 0.5), at(t + 1.0)];
            let said = gyro.step(&rate, &[Vector3::zeros(); 3], &Surroundings::default(), 1.0);
            // The network knows no slope before its second step.
            for axis in (0..2).filter(|_| k > 1) {
                worst = worst.max((said.rate[axis] - said.true_rate[axis]).abs() / DEG_PER_HOUR);
            }
        }
        worst
    };
    // What is left: the loop's answer to the rate's second derivative, and the rate about a spin axis that leans while the
    // loop catches up, both over bandwidth × integral rate.
    let ideal = worst(&design);
    let left = (0.3 * 0.04 * std::f64::consts::TAU * 0.01 + 0.04 * (std::f64::consts::TAU * 0.01).powi(2))
        / (design.rebalance.bandwidth * design.rebalance.integral);
    assert!(ideal < left / DEG_PER_HOUR, "{ideal} deg/h");
    // Without its network, and with the rotor of a slower gyro, it does not.
    let bare = worst(&GyroDesign { network: Complex::from(0.0), ..design.clone() });
    // A/H of the rotor times the largest angular acceleration.
    let answer = 0.04 * std::f64::consts::TAU * 0.01 / rotor.spin / DEG_PER_HOUR;
    assert!((bare / answer - 1.0).abs() < 0.25, "{bare} {answer}");
    assert!(worst(&GyroDesign::ideal(200.0)) > 5.0 * ideal);
}

#[test]
fn a_rotor_is_held_where_it_is_told_to_be_and_costs_nothing_while_it_is_tuned() {
    let tell = |detuning: f64| {
        let mut design = GyroDesign::strapdown(200.0);
        let spring = design.rotor.stiffness[0] * detuning / design.calibration.norm();
        design.rotor.stiffness = design.rotor.stiffness.map(|k| k * (1.0 + detuning));
        let mut gyro = Gyro::new(design, 1, "gyro").unwrap();
        let around = Surroundings { pickoff_command: [3e-4, 1e-4], ..Surroundings::default() };
        let zero = [Vector3::zeros(); 2];
        let said = (0..3).map(|_| gyro.step(&zero, &zero, &around, 1.0)).last().unwrap();
        // But for the gimbal's anisotropy, which shakes it twice a turn.
        assert!((said.pickoff[0] - 3e-4).abs() < 1e-5 && (said.pickoff[1] - 1e-4).abs() < 1e-5, "{said:?}");
        (said.rate[0], spring * 1e-4)
    };
    assert!(tell(0.0).0.abs() < 0.005 * DEG_PER_HOUR, "{:?}", tell(0.0));
    // The loop holds the rotor against the spring: K θy/H about x.
    let (said, expected) = tell(1e-3);
    assert!((said.abs() / expected - 1.0).abs() < 0.05, "{said} {expected}");
}

#[test]
fn the_fast_gyro_agrees_with_the_full_rate_one() {
    let mut design = GyroDesign::ideal(100.0);
    design.axial_unbalance = 4e-8;
    design.network = Complex::new(1e-5, 4e-4);
    design.pickoff_offset = [1e-5, -2e-5];
    design.rotor.flexure_damping = [2e-7; 2];
    design.misalignment = Vector3::new(1e-4, -2e-4, 3e-4);
    let mut fast = Gyro::new(design.clone(), 1, "gyro").unwrap();
    let mut full = Gyro::new(GyroDesign { full_rate: true, ..design }, 1, "gyro").unwrap();
    let at = |t: f64| {
        (
            Vector3::new(0.02 * (0.8 * t).sin(), 0.01 * t, 0.05 * (0.5 * t).cos()),
            Vector3::new((0.3 * t).sin(), 0.5, -9.8),
        )
    };
    let mut worst = 0.0f64;
    for k in 0..6 {
        let points: Vec<_> = (0..=10).map(|j| at(f64::from(k) + f64::from(j) / 10.0)).collect();
        let (w, f): (Vec<_>, Vec<_>) = points.into_iter().unzip();
        let around = Surroundings { temperature: 20.0 + f64::from(k), ..Surroundings::default() };
        let (a, b) = (fast.step(&w, &f, &around, 1.0), full.step(&w, &f, &around, 1.0));
        if k > 1 {
            // The first steps differ: the fast gyro starts settled.
            worst = worst.max((a.rate[0] - b.rate[0]).abs()).max((a.rate[1] - b.rate[1]).abs());
            assert!((a.pickoff[0] - b.pickoff[0]).abs() < 1e-8, "{a:?} {b:?}");
        }
    }
    assert!(worst < 0.002 * DEG_PER_HOUR, "{} deg/h", worst / DEG_PER_HOUR);
}

#[test]
fn pickoff_noise_looks_like_differenced_angle_noise() {
    let mut design = GyroDesign::ideal(100.0);
    design.pickoff_noise = 1e-8;
    let mut gyro = Gyro::new(design, 5, "gyro").unwrap();
    let sigma = gyro.pickoff_noise.sigma;
    let (w, f) = ([Vector3::zeros(); 2], [Vector3::zeros(); 2]);
    let told: Vec<f64> =
        (0..20_000).map(|_| gyro.step(&w, &f, &Surroundings::default(), 1.0).rate[0]).collect();
    let n = told.len() as f64;
    let variance = told.iter().map(|x| x * x).sum::<f64>() / n;
    let lag_one = told.windows(2).map(|x| x[0] * x[1]).sum::<f64>() / n;
    assert!((variance / (2.0 * sigma * sigma) - 1.0).abs() < 0.05);
    assert!((lag_one / variance + 0.5).abs() < 0.03);
}
