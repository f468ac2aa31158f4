//! Reading the instruments: gyros, the five-gyro block, accelerometers, their noise and nominal values.
use nalgebra::{Complex, Matrix3, Vector3};
use schuler_recording::case::{ExponentialCosine, Markov, Nominal, TemperatureBias};
use schuler_recording::document::Node;
use schuler_recording::unit::{Dimension, Unit};

use super::fields::Fields;
use super::{AccelerometerEntry, DopplerEntry, GyroEntry};
use crate::physics::doppler::DopplerDesign;
use crate::physics::environment::Profile;
use crate::physics::gyro::GyroDesign;
use crate::physics::pendulum::AccelerometerDesign;
use crate::physics::random::Process;
use crate::physics::readout::{Conversion, Nonlinearity, ReadoutDesign};
use crate::physics::rotor::ClosedLoop;

/// Input axes of the symmetric block of five: a cone of half-angle arccos 1/√3, FDI §2.
pub(crate) const CONE: [[f64; 3]; 5] = [
    [0.97204, 0.0, -0.23482],
    [-0.60075, -0.77653, -0.18997],
    [0.0, 0.47992, 0.87731],
    [0.0, -0.47992, 0.87731],
    [-0.60075, 0.77653, -0.18997],
];

const ARC_SECOND: f64 = std::f64::consts::PI / 180.0 / 3600.0;

pub(super) fn gyro(node: &Node<'_>) -> Option<GyroEntry> {
    let fields = Fields(node);
    let id = node.required("id", "the id of the output about x").and_then(|f| f.text());
    let second = fields.text("second_id");
    let input = fields.direction("input_axis", [1.0, 0.0, 0.0]);
    let spin = fields.direction("spin_axis", [0.0, 0.0, 1.0]);
    if input.dot(&spin).abs() > 1e-6 {
        return node
            .problem_at("spin_axis", "not at right angles to input_axis; expected a spin axis that is");
    }
    let mut entry = gyro_of(node)?;
    entry.ids = (id?, second);
    entry.design.input_axis = input;
    entry.design.spin_axis = spin;
    Some(entry)
}

/// Five gyros of one design on a cone; `id` is the beginning of their ids.
pub(super) fn block(node: &Node<'_>) -> Option<Vec<GyroEntry>> {
    let fields = Fields(node);
    let name = fields.text("id").unwrap_or_else(|| "gyro".to_owned());
    let template = gyro_of(node)?;
    let five = CONE.iter().enumerate().map(|(index, axis)| {
        let input = Vector3::from(*axis).normalize();
        // The spin axis as near to the block's z as it can be.
        let spin = (Vector3::z() - input * input.z).normalize();
        let mut entry = template.clone();
        entry.ids = (format!("{name}_{}", index + 1), None);
        entry.design.input_axis = input;
        entry.design.spin_axis = spin;
        entry
    });
    Some(five.collect())
}

fn gyro_of(node: &Node<'_>) -> Option<GyroEntry> {
    let fields = Fields(node);
    let unit = unit(node, Dimension::AngularRate, Unit::DegreePerHour);
    let si = unit.in_si();
    let mut design = GyroDesign::ideal(fields.positive("spin_hz", 100.0));
    design.full_rate = fields.flag("full_rate");
    design.misalignment = fields.vector("misalignment_arcsec", [0.0; 3]) * ARC_SECOND;
    design.mass = fields.positive("rotor_mass_kg", design.mass);

    fields.section("rotor", |f| rotor(f, &mut design));
    fields.section("loop", |f| {
        let hertz =
            |key, default: f64| f.positive(key, default / std::f64::consts::TAU) * std::f64::consts::TAU;
        let r = &mut design.rebalance;
        r.bandwidth = hertz("bandwidth_hz", r.bandwidth);
        r.integral = hertz("integral_hz", r.integral);
        r.pickoff = hertz("filter_hz", r.pickoff);
        r.torquer = hertz("torquer_hz", r.torquer);
        r.phase = f.number("phase_deg", 0.0).to_radians();
        let [along, across] = f.pair("network_s");
        design.network = Complex::new(along, across);
    });
    if let Err(unstable) = ClosedLoop::new(design.rotor, design.rebalance) {
        return node.problem_at("loop", &unstable.to_string());
    }
    // Tuned and calibrated on the bench with the loop it has; then detuned as the scenario says.
    design.rotor = design.rebalance.tune(&design.rotor);
    let mut detuning = 0.0;
    fields.section("tuning", |f| detuning = f.number("detuning_ppm", 0.0) * 1e-6);
    design.calibrate();
    design.rotor.stiffness = design.rotor.stiffness.map(|k| k * (1.0 + detuning).powi(2));

    fields.section("torque", |f| torques(f, &mut design));
    let mut pickoff_command = [Profile::constant(0.0), Profile::constant(0.0)];
    fields.section("pickoff", |f| {
        pickoff_command = [f.profile("command_x_rad", 0.0), f.profile("command_y_rad", 0.0)];
        design.pickoff_offset = f.pair("offset_rad");
        design.pickoff_offset_temperature = f.pair("offset_rad_per_K");
        design.pickoff_offset_gradient = f.pair("offset_rad_per_K_per_m");
        design.pickoff_noise = f.not_negative("noise_rad_per_rtHz", 0.0);
        let complex = |key| {
            let [re, im] = f.pair(key);
            Complex::new(re, im)
        };
        design.harmonics.runout_1n = complex("runout_1n_rad");
        design.harmonics.runout_2n = complex("runout_2n_rad");
        design.harmonics.vibration_2n = complex("vibration_2n_rad_s");
    });
    fields.section("torquer", |f| {
        let [gain_x, gain_y] = f.pair("scale_factor_ppm");
        let common = Nonlinearity {
            gain: 0.0,
            asymmetry: f.number("asymmetry_ppm", 0.0) * 1e-6,
            quadratic: f.number("quadratic_per_rad_s", 0.0),
            odd_quadratic: f.number("odd_quadratic_per_rad_s", 0.0),
            cubic: f.number("cubic_per_rad2_s2", 0.0),
        };
        // The scale factor of the reading is the inverse of the torquer's gain.
        let with = |ppm: f64| Nonlinearity { gain: 1.0 / (1.0 + ppm * 1e-6) - 1.0, ..common };
        design.torquer = [with(gain_x), with(gain_y)];
        design.torquer_temperature = f.number("gain_per_K", 0.0);
        design.torquer_power = f.not_negative("power_W_s2_per_rad2", 0.0);
        design.magnet_resistance = f.not_negative("magnet_K_per_W", 0.0);
        design.magnet_lag_s = f.not_negative("magnet_lag_s", 300.0);
    });
    let readout = readout(node, si);
    design.readout = [readout.clone(), readout];
    Some(GyroEntry {
        ids: (String::new(), None),
        group: fields.text("group"),
        unit,
        design,
        position_m: fields.not_negative("position_m", 0.0),
        pickoff_command,
        nominal: fields.section("nominal", nominal).unwrap_or_default(),
        relative: fields.flag("relative"),
        recorded: fields.flag_or("recorded", true),
    })
}

fn rotor(f: Fields<'_, '_>, design: &mut GyroDesign) {
    let r = &mut design.rotor;
    r.rotor_polar = f.positive("polar_inertia", r.rotor_polar);
    r.rotor_equatorial = f.positive("equatorial_inertia", r.rotor_equatorial);
    r.gimbal = f.vector("gimbal_inertia", r.gimbal).into();
    let [ag, bg, cg] = r.gimbal;
    let stiffness = 0.5 * r.spin * r.spin * (ag + bg - cg);
    if stiffness <= 0.0 {
        let expected = "expected Ag + Bg > Cg, without which no spring can tune the rotor";
        f.0.problem_at::<()>("gimbal_inertia", &format!("found {:?}; {expected}", r.gimbal));
        return;
    }
    let anisotropy = f.number("stiffness_anisotropy", 0.0);
    r.stiffness = [stiffness * (1.0 + anisotropy), stiffness * (1.0 - anisotropy)];
    r.flexure_damping = [f.not_negative("flexure_damping", 0.0); 2];
    r.gas_damping = f.not_negative("gas_damping", r.gas_damping);
    design.stiffness_temperature = f.number("stiffness_per_K", 0.0);
    design.rotor_lag_s = f.not_negative("lag_s", 0.0);
    design.rebalance.design_momentum = design.rotor.angular_momentum();
}

fn torques(f: Fields<'_, '_>, design: &mut GyroDesign) {
    design.axial_unbalance = f.number("axial_unbalance_m", 0.0);
    design.axial_unbalance_temperature = f.number("axial_unbalance_m_per_K", 0.0);
    design.flexure_twist = f.number("flexure_twist_m", 0.0);
    let radial = f.number("radial_compliance_m_per_N", 0.0);
    let axial = f.number("axial_compliance_m_per_N", radial);
    let [xz, yz] = f.pair("cross_compliance_m_per_N");
    let xy = f.number("radial_cross_compliance_m_per_N", 0.0);
    design.compliance = Matrix3::new(radial, xy, xz, xy, radial, yz, xz, yz, axial);
    design.axial_reaction = f.pair("axial_reaction_m");
    design.reaction_torque = f.pair("reaction_Nm");
    design.reaction_torque_temperature = f.pair("reaction_Nm_per_K");
    design.reaction_torque_rise = f.pair("reaction_Nm_per_K_rise");
    design.reaction_torque_gradient = f.pair("reaction_Nm_per_K_per_m");
    design.magnetic_moment = f.number("magnetic_moment_Am2", 0.0);
}

pub(super) fn accelerometer(node: &Node<'_>) -> Option<AccelerometerEntry> {
    let fields = Fields(node);
    let id = node.required("id", "the id of the output").and_then(|f| f.text());
    let unit = unit(node, Dimension::Acceleration, Unit::MetrePerSecondSquared);
    let mut design = AccelerometerDesign::ideal();
    design.input_axis = fields.direction("input_axis", [1.0, 0.0, 0.0]);
    design.pendulum_axis = fields.direction("pendulum_axis", [0.0, 0.0, 1.0]);
    if design.input_axis.dot(&design.pendulum_axis).abs() > 1e-6 {
        let expected = "expected a direction that is";
        return node.problem_at("pendulum_axis", &format!("not at right angles to input_axis; {expected}"));
    }
    design.misalignment = fields.vector("misalignment_arcsec", [0.0; 3]) * ARC_SECOND;
    design.arm = fields.vector("arm_m", [0.0; 3]);
    design.full_rate = fields.flag("full_rate");
    fields.section("pendulum", |f| {
        let p = &mut design.pendulum;
        p.pendulosity = f.positive("pendulosity", p.pendulosity);
        p.inertia = f.positive("inertia", p.inertia);
        p.damping = f.positive("damping", p.damping);
        p.hinge = f.not_negative("hinge_stiffness", p.hinge);
        p.servo = f.positive("servo_stiffness", p.servo);
        p.integrator = f.not_negative("integrator_gain", p.integrator);
        p.integrator_rate = f.positive("integrator_rate", p.integrator_rate);
        p.torquer = f.positive("torquer_rate", p.torquer);
        design.hinge_torque = f.number("hinge_Nm", 0.0);
        design.hinge_torque_temperature = f.number("hinge_Nm_per_K", 0.0);
        design.hinge_torque_gradient = f.number("hinge_Nm_per_K_per_m", 0.0);
    });
    fields.section("pickoff", |f| {
        design.pickoff_offset = f.number("offset_rad", 0.0);
        design.pickoff_offset_temperature = f.number("offset_rad_per_K", 0.0);
    });
    fields.section("torquer", |f| {
        design.torquer = Nonlinearity {
            gain: 1.0 / (1.0 + f.number("scale_factor_ppm", 0.0) * 1e-6) - 1.0,
            asymmetry: f.number("asymmetry_ppm", 0.0) * 1e-6,
            quadratic: f.number("quadratic_s2_per_m", 0.0),
            odd_quadratic: f.number("odd_quadratic_s2_per_m", 0.0),
            cubic: f.number("cubic_s4_per_m2", 0.0),
        };
        design.torquer_temperature = f.number("gain_per_K", 0.0);
        design.torquer_power = f.not_negative("power_W_s4_per_m2", 0.0);
        design.magnet_resistance = f.not_negative("magnet_K_per_W", 0.0);
        design.magnet_lag_s = f.not_negative("magnet_lag_s", 300.0);
    });
    design.readout = readout(node, unit.in_si());
    if let Err(unstable) = crate::physics::pendulum::Accelerometer::new(design.clone(), 0, "") {
        return node.problem_at("pendulum", &unstable.to_string().replace("rebalance loop", "servo"));
    }
    Some(AccelerometerEntry {
        id: id?,
        group: fields.text("group"),
        unit,
        design,
        position_m: fields.not_negative("position_m", 0.0),
        nominal: fields.section("nominal", nominal).unwrap_or_default(),
        relative: fields.flag("relative"),
        recorded: fields.flag_or("recorded", true),
    })
}

pub(super) fn doppler(node: &Node<'_>) -> Option<DopplerEntry> {
    let fields = Fields(node);
    let id = node.required("id", "the id of the output").and_then(|f| f.text());
    let design = DopplerDesign {
        axis: fields.direction("axis", [1.0, 0.0, 0.0]),
        misalignment: fields.vector("misalignment_deg", [0.0; 3]).map(f64::to_radians),
        arm: fields.vector("arm_m", [0.0; 3]),
        delay_s: fields.not_negative("delay_s", 0.0),
        scale_factor: fields.number("scale_factor_ppm", 0.0) * 1e-6,
        readout: readout(node, 1.0),
    };
    Some(DopplerEntry {
        id: id?,
        group: fields.text("group"),
        design,
        nominal: fields.section("nominal", nominal).unwrap_or_default(),
    })
}

fn unit(node: &Node<'_>, dimension: Dimension, default: Unit) -> Unit {
    let Some(field) = node.optional("unit") else { return default };
    let Some(unit) = field.one_of(&Unit::NAMES) else { return default };
    if unit.dimension() == dimension {
        return unit;
    }
    let what = if dimension == Dimension::AngularRate { "angular rate" } else { "acceleration" };
    let units: Vec<&str> = dimension.units().map(Unit::name).collect();
    field.wrong::<()>(&format!("a unit of {what}: {}", units.join(", ")));
    default
}

/// Electronics, noise, converter and range of an output whose unit has this SI value.
fn readout(node: &Node<'_>, si: f64) -> ReadoutDesign {
    let fields = Fields(node);
    let mut design = ReadoutDesign { range: f64::INFINITY, ..ReadoutDesign::default() };
    fields.section("electronics", |f| {
        design.offset = f.number("offset", 0.0) * si;
        design.offset_temperature = f.number("offset_per_K", 0.0) * si;
        design.offset_voltage = f.number("offset_per_V", 0.0) * si;
    });
    fields.section("noise", |f| {
        design.white = f.not_negative("white", 0.0) * si;
        design.drift = processes(f.0, si);
    });
    design.range = fields.positive("range", f64::INFINITY) * si;
    let (step, pulse) =
        (fields.not_negative("quantisation", 0.0) * si, fields.not_negative("pulse", 0.0) * si);
    design.conversion = match (step > 0.0, pulse > 0.0) {
        (true, true) => {
            node.problem_at::<()>("pulse", "found beside quantisation; expected one of them");
            Conversion::Exact
        }
        (true, false) => Conversion::Rounding(step),
        (false, true) => Conversion::Pulses(pulse),
        (false, false) => Conversion::Exact,
    };
    design
}

/// The random drifts of a table: `markov`, `second_markov`, `exp_cos`, `random_walk`, `flicker`.
pub(super) fn processes(node: &Node<'_>, si: f64) -> Vec<Process> {
    let fields = Fields(node);
    let mut all = Vec::new();
    for key in ["markov", "second_markov"] {
        all.extend(
            fields
                .table(key, |node| markov(node, si))
                .map(|m| Process::Markov { sigma: m.sigma, tau_s: m.tau_s }),
        );
    }
    all.extend(
        fields.table("exp_cos", |node| exponential_cosine(node, si)).map(|n| Process::ExponentialCosine {
            sigma: n.sigma,
            alpha: n.alpha,
            beta: n.beta,
        }),
    );
    let walk = fields.not_negative("random_walk", 0.0) * si;
    if walk > 0.0 {
        all.push(Process::RandomWalk { rate: walk });
    }
    all.extend(fields.section("flicker", |f| {
        let instability = f.not_negative("instability", 0.0) * si;
        let shortest_s = f.positive("shortest_s", 10.0);
        let longest_s = f.positive("longest_s", 1e5).max(shortest_s);
        Process::Flicker { instability, shortest_s, longest_s }
    }));
    all
}

pub(super) fn markov(node: &Node<'_>, si: f64) -> Option<Markov> {
    let sigma = node
        .required("sigma", "a standard deviation")
        .and_then(|f| f.number_where("a number not less than zero", |n| n >= 0.0));
    let tau_s = node
        .required("tau_s", "a correlation time in seconds")
        .and_then(|f| f.number_where("a number greater than zero", |n| n > 0.0));
    Some(Markov { sigma: sigma? * si, tau_s: tau_s? })
}

fn exponential_cosine(node: &Node<'_>, si: f64) -> Option<ExponentialCosine> {
    let f = Fields(node);
    let sigma = node
        .required("sigma", "a standard deviation")
        .and_then(|f| f.number_where("a number not less than zero", |n| n >= 0.0));
    let alpha = f.positive("alpha", 1.0 / 600.0);
    let beta = f.not_negative("beta", std::f64::consts::TAU / 1800.0);
    Some(ExponentialCosine { sigma: sigma? * si, alpha, beta })
}

/// What the case shall believe, in the output's unit.
fn nominal(f: Fields<'_, '_>) -> Nominal {
    let temperature_bias = f.table("temperature_bias", |node| {
        let column = node.required("column", "the name of a temperature column").and_then(|f| f.text());
        let coefficients = node.required("coefficients", "an array of numbers").and_then(|f| f.number_list());
        Some(TemperatureBias {
            column: column?,
            reference_deg_c: Fields(node).number("reference_degC", 20.0),
            coefficients: coefficients?,
        })
    });
    Nominal {
        bias: f.number("bias", 0.0),
        scale_factor_ppm: f.number("scale_factor_ppm", 0.0),
        white: f.not_negative("white", 0.0),
        markov: f.table("markov", |node| markov(node, 1.0)),
        exp_cos: f.table("exp_cos", |node| exponential_cosine(node, 1.0)),
        random_walk: f.not_negative("random_walk", 0.0),
        temperature_bias,
    }
}
