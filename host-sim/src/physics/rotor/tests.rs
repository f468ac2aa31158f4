//! The rotor against its Lagrangian, closed forms and the full-rate integration.
use super::equations::{I, Inputs, system};
use super::*;
use std::f64::consts::TAU;

fn rotor() -> Rotor {
    let spin = TAU * 100.0;
    let gimbal = [2.0e-7, 2.1e-7, 3.3e-7];
    let tuned = 0.5 * spin * spin * (gimbal[0] + gimbal[1] - gimbal[2]);
    Rotor {
        spin,
        rotor_polar: 9.0e-6,
        rotor_equatorial: 5.2e-6,
        gimbal,
        stiffness: [tuned * 1.03, tuned * 0.97],
        flexure_damping: [2e-7, 1.5e-7],
        gas_damping: 5e-8,
    }
}

fn rebalance(rotor: &Rotor) -> Rebalance {
    Rebalance {
        bandwidth: TAU * 8.0,
        integral: 10.0,
        pickoff: TAU * 60.0,
        torquer: TAU * 60.0,
        phase: 0.0,
        design_momentum: rotor.angular_momentum(),
    }
}

/// Kinetic minus potential energy of gimbal and rotor with the joint's exact kinematics; the shaft's inertial rate
/// in shaft axes is (wx, wy, n).
fn lagrangian(r: &Rotor, q: [f64; 2], v: [f64; 2], w: [f64; 2], n: f64) -> f64 {
    let (a, c) = (r.rotor_equatorial, r.rotor_polar);
    let (s, cos) = q[0].sin_cos();
    let g = [w[0] + v[0], cos * w[1] + s * n, cos * n - s * w[1]];
    let (s, cos) = q[1].sin_cos();
    let b = [cos * g[0] - s * g[2], g[1] + v[1], s * g[0] + cos * g[2]];
    0.5 * (r.gimbal[0] * g[0] * g[0] + r.gimbal[1] * g[1] * g[1] + r.gimbal[2] * g[2] * g[2])
        + 0.5 * (a * (b[0] * b[0] + b[1] * b[1]) + c * b[2] * b[2])
        - 0.5 * (r.stiffness[0] * q[0] * q[0] + r.stiffness[1] * q[1] * q[1])
}

#[test]
fn equations_agree_with_the_lagrangian_of_the_joint() {
    // Euler–Lagrange expressions by central differences of the exact Lagrangian, against the linear equations.
    let r = Rotor { flexure_damping: [0.0; 2], gas_damping: 0.0, ..rotor() };
    let (n, spin_axis_rate) = (r.spin + 0.4, 0.4);
    let (q, v, acc) = ([2e-6, -3e-6], [4e-4, 7e-4], [0.3, -0.2]);
    let (w, w_dot) = ([2e-3, -1e-3], [0.05, 0.08]);
    let along = |e: f64| {
        // A trajectory with these derivatives at e = 0.
        let at = |i: usize| q[i] + v[i] * e + 0.5 * acc[i] * e * e;
        let speed = |i: usize| v[i] + acc[i] * e;
        ([at(0), at(1)], [speed(0), speed(1)], [w[0] + w_dot[0] * e, w[1] + w_dot[1] * e])
    };
    let partial = |e: f64, wrt_speed: bool, i: usize| {
        let (q, v, w) = along(e);
        // The Lagrangian is exactly quadratic in the speeds.
        let h = if wrt_speed { 10.0 } else { 1e-4 };
        let shifted = |d: f64| {
            let (mut q, mut v) = (q, v);
            if wrt_speed {
                v[i] += d;
            } else {
                q[i] += d;
            }
            lagrangian(&r, q, v, w, n)
        };
        (shifted(h) - shifted(-h)) / (2.0 * h)
    };
    let loop_ = rebalance(&r);
    let system = system(&r, &loop_, spin_axis_rate);
    let inputs = Inputs::new(&r, &loop_, spin_axis_rate);
    let mut state = State::zeros();
    (state[0], state[1], state[2], state[3]) = (q[0], q[1], v[0], v[1]);
    let linear = system * state
        + inputs.rate[0] * w[0]
        + inputs.rate[1] * w[1]
        + inputs.rate_derivative[0] * w_dot[0]
        + inputs.rate_derivative[1] * w_dot[1];
    for i in 0..2 {
        let h = 1e-4;
        let exact = (partial(h, true, i) - partial(-h, true, i)) / (2.0 * h) - partial(0.0, false, i);
        let inertia = r.rotor_equatorial + if i == 0 { r.gimbal[0] } else { 0.0 };
        // Exact: inertia·(q̈ − linear acceleration) = Euler–Lagrange expression = 0 for the free joint.
        let from_linear = inertia * (acc[i] - linear[2 + i]);
        let scale = inertia * linear[2 + i].abs();
        assert!((exact - from_linear).abs() < 1e-4 * scale, "axis {i}: {exact:e} against {from_linear:e}");
    }
}

/// The rotor with a gimbal lighter by a factor, everything else in proportion.
fn with_gimbal(factor: f64) -> Rotor {
    let r = rotor();
    Rotor {
        gimbal: r.gimbal.map(|j| j * factor),
        stiffness: r.stiffness.map(|k| k * factor),
        flexure_damping: r.flexure_damping.map(|d| d * factor),
        gas_damping: r.gas_damping * factor,
        ..r
    }
}

#[test]
fn precession_under_a_torque_is_torque_over_momentum() {
    // To hold a rate ω the loop must give M = −iHω, to hold against a torque its opposite. The gimbal's anisotropy moves
    // that by second order: a tenth of the gimbal, a hundredth of the shift.
    let shift = |factor: f64| {
        let r = with_gimbal(factor);
        let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
        let response = loop_.response(0.0, &Harmonics::default(), 1.0);
        let rate = Complex::new(1e-3, -2e-3);
        let answer = response.constant_torque(&Excitation { rate, ..Excitation::default() });
        (answer / (-I * r.angular_momentum() * rate) - 1.0).norm()
    };
    let (full, tenth) = (shift(1.0), shift(0.1));
    assert!(full < 5e-4 && tenth < full / 50.0, "{full:e} {tenth:e}");
    // Against a torque it gives exactly its opposite.
    let r = rotor();
    let response = ClosedLoop::new(r, rebalance(&r)).unwrap().response(0.0, &Harmonics::default(), 1.0);
    let torque = Complex::new(2e-8, 1e-8);
    let answer = response.constant_torque(&Excitation { torque, ..Excitation::default() });
    assert!((answer / -torque - 1.0).norm() < 1e-9);
}

#[test]
fn tuned_speed_is_where_the_spring_vanishes() {
    // The loop holds the rotor at −offset against the spring: M = −K · offset.
    let spring = |r: Rotor| {
        let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
        let response = loop_.response(0.0, &Harmonics::default(), 1.0);
        let offset = Excitation { pickoff: Complex::from(1e-5), ..Excitation::default() };
        (response.constant_torque(&offset) / -1e-5).re
    };
    let r = rotor();
    assert!((r.tuned_speed() / r.spin - 1.0).abs() < 1e-12);
    // Closed form to first order in the gimbal: the leftover at the nominal tuned speed falls with its square.
    let leftover = |factor: f64| spring(with_gimbal(factor)) / with_gimbal(factor).stiffness[0];
    assert!(leftover(1.0).abs() < 0.03 && leftover(0.1).abs() < 0.003, "{} {}", leftover(1.0), leftover(0.1));
    // Trimmed on the bench it is gone, and detuning brings back ½(Kx + Ky) − ½n²(Ag + Bg − Cg).
    let tuned = rebalance(&r).tune(&r);
    assert!(spring(tuned).abs() < 1e-9 * tuned.stiffness[0], "{}", spring(tuned));
    for detuning in [-2e-3, -5e-4, 5e-4, 2e-3] {
        let off = Rotor { spin: tuned.spin * (1.0 + detuning), ..tuned };
        let expected = off.residual_stiffness() - tuned.residual_stiffness();
        assert!(
            (spring(off) / expected - 1.0).abs() < 0.05,
            "{detuning}: {} against {expected}",
            spring(off)
        );
    }
}

#[test]
fn flexure_damping_turns_an_offset_into_a_torque_at_right_angles() {
    let r = with_gimbal(0.1);
    let loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
    let response = loop_.response(0.0, &Harmonics::default(), 1.0);
    let offset = Excitation { pickoff: Complex::from(1e-5), ..Excitation::default() };
    let torque = response.constant_torque(&offset);
    // In shaft axes a tilt −offset fixed in the case turns at −N: mean damping torque −D(−iN)(−offset), which the loop
    // balances: iDN·offset. The gas, at rest in the case, gives none.
    let damping = 0.5 * (r.flexure_damping[0] + r.flexure_damping[1]);
    let expected = damping * r.spin * 1e-5;
    assert!((torque.im / expected - 1.0).abs() < 0.02, "{torque} against {expected}");
}

#[test]
fn nutation_of_the_free_rotor_is_at_polar_over_equatorial_times_spin() {
    // Without gimbal, flexures and loop: case-frame nutation at N C/A.
    let r = Rotor {
        gimbal: [0.0; 3],
        stiffness: [0.0; 2],
        flexure_damping: [0.0; 2],
        gas_damping: 0.0,
        ..rotor()
    };
    let free = system(&r, &Rebalance { bandwidth: 0.0, ..rebalance(&r) }, 0.0);
    let frequencies: Vec<f64> =
        free.fixed_view::<4, 4>(0, 0).clone_owned().complex_eigenvalues().iter().map(|e| e.im).collect();
    // In shaft axes: N (C/A − 1) and N.
    let nutation = r.spin * (r.rotor_polar / r.rotor_equatorial - 1.0);
    assert!(frequencies.iter().any(|f| (f - nutation).abs() < 1e-6 * nutation), "{frequencies:?}");
    assert!(frequencies.iter().any(|f| (f - r.spin).abs() < 1e-6 * r.spin), "{frequencies:?}");
}

#[test]
fn exact_response_agrees_with_the_full_rate_integration() {
    let r = rotor();
    let harmonics = Harmonics {
        runout_1n: Complex::new(2e-6, 1e-6),
        runout_2n: Complex::new(-1e-6, 2e-6),
        vibration_2n: Complex::new(1e-3, 2e-3),
    };
    let spin_axis_rate = 0.05;
    let at = |k: f64| Excitation {
        rate: Complex::new(2e-3 * (0.7 * k).sin(), 1e-3 * k),
        torque: Complex::new(1e-8 * k, -2e-8),
        pickoff: Complex::new(1e-5, 2e-6 * k),
    };
    for step_s in [1.0, 0.05, 0.0123] {
        let mut exact = ClosedLoop::new(r, rebalance(&r)).unwrap();
        let mut full = exact.clone();
        let response = exact.response(spin_axis_rate, &harmonics, step_s);
        for k in 0..4 {
            let (start, end) = (at(f64::from(k)), at(f64::from(k + 1)));
            let mean = exact.advance(&response, &start, &end);
            let reference = full.integrate(spin_axis_rate, &harmonics, step_s, 128, |t| {
                let mix = |a: Complex<f64>, b: Complex<f64>| a + (b - a) * (t / step_s);
                let now = Excitation {
                    rate: mix(start.rate, end.rate),
                    torque: mix(start.torque, end.torque),
                    pickoff: mix(start.pickoff, end.pickoff),
                };
                (now, (end.rate - start.rate) / step_s)
            });
            let scale = r.angular_momentum() * 2e-3;
            assert!(
                (mean - reference).norm() < 2e-5 * scale,
                "step {step_s} k {k}: {mean} against {reference}"
            );
            assert!(
                (exact.pickoff() - full.pickoff()).norm() < 1e-8,
                "{} {}",
                exact.pickoff(),
                full.pickoff()
            );
        }
    }
}

#[test]
fn an_unstable_loop_is_refused() {
    let r = rotor();
    // Without lag the nutation is driven, not damped.
    let wide = Rebalance { pickoff: TAU * 5000.0, torquer: TAU * 5000.0, ..rebalance(&r) };
    assert!(ClosedLoop::new(r, wide).is_err());
    let nonsense = Rebalance { bandwidth: f64::INFINITY, ..rebalance(&r) };
    assert!(ClosedLoop::new(r, nonsense).is_err());
    assert!(ClosedLoop::new(r, rebalance(&r)).is_ok());
}

#[test]
fn pickoff_noise_variance_agrees_with_simulation() {
    let r = rotor();
    let mut loop_ = ClosedLoop::new(r, rebalance(&r)).unwrap();
    let density = 1e-8;
    let theory = loop_.pickoff_noise_variance(density);
    // White noise held over short intervals: variance density²/(2Δ).
    let (held, n) = (2e-4, 100_000);
    let sigma = density / (2.0f64 * held).sqrt();
    let mut stream = crate::physics::random::Stream::new(3, "pickoff");
    let mut sum = 0.0;
    for k in 0..n {
        let noise = Complex::new(stream.normal(), stream.normal()) * sigma;
        let e = Excitation { pickoff: noise, ..Excitation::default() };
        let zero = Complex::from(0.0);
        loop_.integrate(0.0, &Harmonics::default(), held, 128, |_| (e, zero));
        if k > n / 20 {
            sum += 0.5 * loop_.pickoff().norm_sqr();
        }
    }
    let measured = sum / (f64::from(n) * 0.95);
    assert!((measured / theory - 1.0).abs() < 0.08, "{measured:e} against {theory:e}");
}
