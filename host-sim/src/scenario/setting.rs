//! Reading what surrounds the instruments: time, site, motion, temperature, the loop, the case.
use nalgebra::Unit as UnitVector;
use schuler_recording::case::SchulerLoop as NominalLoop;
use schuler_recording::document::Node;

use super::fields::Fields;
use super::instruments::{markov, processes};
use super::{Channel, ErrorSource, LoopEntry, Recorded, ThermometerEntry, Told};
use crate::physics::earth;
use crate::physics::environment::{EnvironmentDesign, Thermal};
use crate::physics::heat::Bar;
use crate::physics::motion::{Attitude, Motion, Site, Sway, TableStep, Vehicle, VehicleStep};
use crate::physics::readout::{REFERENCE_TEMPERATURE, REFERENCE_VOLTAGE};

/// Most rows of a recording: a year at 1 Hz.
const MOST_STEPS: f64 = 3.2e7;

pub(super) fn time(node: &Node<'_>) -> Option<(f64, f64, usize)> {
    let fields = Fields(node);
    let duration_s = node
        .required("duration_s", "a number greater than zero")
        .and_then(|f| f.number_where("a number greater than zero", |n| n > 0.0));
    let step_s = fields.positive("step_s", 1.0);
    let parts = fields.whole("parts", 1).clamp(1, 10_000) as usize;
    let duration_s = duration_s?;
    if !(1.0..=MOST_STEPS).contains(&(duration_s / step_s).round()) {
        return node.problem_at(
            "duration_s",
            &format!("found {duration_s} s of {step_s} s; expected 1 to {MOST_STEPS:e} steps"),
        );
    }
    Some((duration_s, step_s, parts))
}

pub(super) fn site(node: &Node<'_>) -> Option<Site> {
    let latitude = node
        .required("latitude_deg", "degrees, -90 to 90")
        .and_then(|f| f.number_where("degrees, -90 to 90", |n| n.abs() <= 90.0));
    let height = Fields(node).number("altitude_m", 0.0);
    let gravity_anomaly = Fields(node).number("gravity_anomaly_mGal", 0.0) * 1e-5;
    Some(Site { latitude: latitude?.to_radians(), height, gravity_anomaly })
}

fn attitude(fields: Fields<'_, '_>) -> Attitude {
    let angle = |key| fields.number(key, 0.0).to_radians();
    Attitude { roll: angle("roll"), pitch: angle("pitch"), heading: angle("heading") }
}

pub(super) fn motion(node: &Node<'_>) -> Option<Motion> {
    #[derive(Clone, Copy)]
    enum Kind {
        Static,
        Table,
        Vehicle,
    }
    let fields = Fields(node);
    let kind = node.required("kind", "static, table or vehicle").and_then(|f| {
        f.one_of(&[("static", Kind::Static), ("table", Kind::Table), ("vehicle", Kind::Vehicle)])
    })?;
    match kind {
        Kind::Static => Some(Motion::Static(fields.section("attitude_deg", attitude).unwrap_or_default())),
        Kind::Table => {
            let start = fields.section("attitude_deg", attitude).unwrap_or_default();
            Some(Motion::Table { start, steps: node.tables("step", table_step)? })
        }
        Kind::Vehicle => {
            let sway = fields.section("sway", |fields| Sway {
                roll: fields.number("roll_deg", 0.0).to_radians(),
                pitch: fields.number("pitch_deg", 0.0).to_radians(),
                period_s: fields.positive("period_s", 8.0),
            });
            Some(Motion::Vehicle(Vehicle {
                speed: fields.number("speed", 0.0),
                heading: fields.number("heading_deg", 0.0).to_radians(),
                bank_share: fields.share("bank_share", 0.0),
                sway: sway.unwrap_or_default(),
                level_platform: fields.flag("level_platform"),
                steps: node.tables("leg", leg)?,
            }))
        }
    }
}

fn required_duration(node: &Node<'_>) -> Option<f64> {
    node.required("duration_s", "a number greater than zero")
        .and_then(|f| f.number_where("a number greater than zero", |n| n > 0.0))
}

fn table_step(node: &Node<'_>) -> Option<TableStep> {
    #[derive(Clone, Copy)]
    enum Kind {
        Dwell,
        Turn,
        Spin,
        Swing,
        Cone,
    }
    let fields = Fields(node);
    let kind = node.required("kind", "dwell, turn, spin, swing or cone").and_then(|f| {
        f.one_of(&[
            ("dwell", Kind::Dwell),
            ("turn", Kind::Turn),
            ("spin", Kind::Spin),
            ("swing", Kind::Swing),
            ("cone", Kind::Cone),
        ])
    });
    let duration_s = required_duration(node);
    let axis = || UnitVector::new_normalize(fields.direction("axis", [0.0, 0.0, 1.0]));
    let needed = |key, expected: &str| node.required(key, expected).and_then(|f| f.number());
    match kind? {
        Kind::Dwell => Some(TableStep::Dwell { duration_s: duration_s? }),
        Kind::Turn => {
            let angle = needed("angle_deg", "the angle to turn by, degrees");
            Some(TableStep::Turn { axis: axis(), angle: angle?.to_radians(), duration_s: duration_s? })
        }
        Kind::Spin => {
            let rate = needed("rate_deg_s", "the rate, deg/s");
            let duration_s = duration_s?;
            let ramp_s = fields.not_negative("ramp_s", 1.0);
            if 2.0 * ramp_s > duration_s {
                return node
                    .problem_at("ramp_s", &format!("found {ramp_s}; expected at most half the duration"));
            }
            Some(TableStep::Spin { axis: axis(), rate: rate?.to_radians(), duration_s, ramp_s })
        }
        kind @ (Kind::Swing | Kind::Cone) => {
            let amplitude = needed("amplitude_deg", "the amplitude, degrees");
            let frequency_hz = fields.positive("frequency_hz", 1.0);
            let duration_s = duration_s?;
            if duration_s * frequency_hz < 2.0 {
                return node
                    .problem_at("duration_s", &format!("found {duration_s}; expected at least two cycles"));
            }
            let amplitude = amplitude?.to_radians();
            let axis = axis();
            Some(match kind {
                Kind::Cone => TableStep::Cone { axis, amplitude, frequency_hz, duration_s },
                _ => TableStep::Swing { axis, amplitude, frequency_hz, duration_s },
            })
        }
    }
}

fn leg(node: &Node<'_>) -> Option<VehicleStep> {
    let fields = Fields(node);
    let duration_s = required_duration(node);
    let speed_change = fields.number("speed_change", 0.0);
    let heading_change = fields.number("heading_change_deg", 0.0).to_radians();
    let height_change = fields.number("height_change_m", 0.0);
    Some(VehicleStep { duration_s: duration_s?, speed_change, heading_change, height_change })
}

pub(super) fn environment(node: &Node<'_>) -> EnvironmentDesign {
    let fields = Fields(node);
    let mut design = EnvironmentDesign::default();
    fields.section("thermal", |fields| {
        let ambient = fields.profile("ambient_degC", REFERENCE_TEMPERATURE);
        let initial = fields.number("initial_degC", ambient.at(0.0));
        let heaters = fields.0.tables("heater", |node| {
            let fields = Fields(node);
            Some((fields.not_negative("position_m", 0.0), fields.profile("power_W", 0.0)))
        });
        design.electronics_position_m = fields.0.optional("electronics_position_m").and_then(|f| f.number());
        design.thermal = match fields.section("bar", bar) {
            Some(bar) => Thermal::Bar { bar, initial, ambient, heaters: heaters.unwrap_or_default() },
            None => Thermal::Uniform(ambient),
        };
    });
    design.voltage = fields.profile("supply_V", REFERENCE_VOLTAGE);
    design.magnetic_field = fields.vector("magnetic_field_ned_T", [0.0; 3]);
    fields.section("vibration", |fields| {
        design.vibration_direction = fields.direction("direction", [0.0, 0.0, 1.0]);
        design.vibration_hz = fields.positive("frequency_hz", 50.0);
        design.vibration_rms = fields.profile("rms", 0.0);
    });
    design
}

fn bar(fields: Fields<'_, '_>) -> Bar {
    let film = |key, default| fields.not_negative(key, default);
    // An aluminium casting of about 3 kg, cooled from its left end.
    Bar {
        length_m: fields.positive("length_m", 0.2),
        section_m2: fields.positive("section_m2", 6e-3),
        conductivity: fields.positive("conductivity", 160.0),
        capacity: fields.positive("capacity", 2.43e6),
        film_left: film("film_left", 60.0),
        film_right: film("film_right", 0.0),
        side: film("side", 0.0),
        cells: fields.whole("cells", 20).clamp(3, 500) as usize,
    }
}

pub(super) fn thermometer(node: &Node<'_>) -> Option<ThermometerEntry> {
    let fields = Fields(node);
    let column = node.required("column", "the name of its column").and_then(|f| f.text());
    Some(ThermometerEntry {
        near: fields.text("near"),
        position_m: fields.not_negative("position_m", 0.0),
        tau_s: fields.not_negative("tau_s", 0.0),
        white: fields.not_negative("white", 0.0),
        quantisation: fields.not_negative("quantisation", 0.0),
        column: column?,
    })
}

pub(super) fn interval(node: &Node<'_>) -> Option<(f64, f64)> {
    let start_s = Fields(node).not_negative("start_s", 0.0);
    Some((start_s, required_duration(node)?))
}

pub(super) fn schuler_loop(fields: Fields<'_, '_>) -> LoopEntry {
    let node = fields.0;
    let velocity_white = fields.not_negative("velocity_white", 0.1);
    let radius_m = fields.positive("radius_m", earth::MEAN_RADIUS);
    let gravity = fields.positive("gravity", earth::STANDARD_GRAVITY);
    let source = |instrument: &'static str, process: &'static str| {
        if let Some(id) = fields.text(instrument) {
            return ErrorSource::Instrument(id);
        }
        fields
            .section(process, |fields| {
                let white = fields.not_negative("white", 0.0);
                ErrorSource::Process { drift: processes(fields.0, 1.0), white }
            })
            .unwrap_or(ErrorSource::Process { drift: vec![], white: 0.0 })
    };
    let nominal = fields.section("nominal", |fields| NominalLoop {
        radius_m,
        gravity,
        accelerometer: fields.table("accelerometer", |node| markov(node, 1.0)),
        gyro: fields.table("gyro", |node| markov(node, 1.0)),
        velocity_white: fields.positive("velocity_white", velocity_white.max(1e-3)),
    });
    let channel = node
        .optional("channel")
        .and_then(|f| f.one_of(&[("north", Channel::North), ("east", Channel::East)]));
    LoopEntry {
        id: fields.text("id").unwrap_or_else(|| "velocity_error".to_owned()),
        radius_m,
        gravity,
        velocity_error: fields.number("velocity_error", 0.0),
        tilt: fields.number("tilt_rad", 0.0),
        accelerometer: source("accelerometer", "accelerometer_error"),
        gyro: source("gyro", "gyro_error"),
        velocity_white,
        delay_s: fields.not_negative("delay_s", 0.0),
        outages: node.tables("outage", interval).unwrap_or_default(),
        absolute: false,
        channel: channel.unwrap_or(Channel::North),
        nominal: nominal.unwrap_or(NominalLoop {
            radius_m,
            gravity,
            accelerometer: None,
            gyro: None,
            velocity_white,
        }),
    }
}

pub(super) fn case(fields: Fields<'_, '_>) -> (Option<Told>, Recorded) {
    let told = fields.0.optional("motion").and_then(|f| {
        f.one_of(&[
            ("static", Told::Static),
            ("recorded", Told::Recorded),
            ("navigation", Told::Navigation),
            ("unknown", Told::Unknown),
            ("velocity_error", Told::VelocityError),
        ])
    });
    let recorded = Recorded {
        thermometers: vec![],
        quantities: vec![],
        voltage: fields.flag("voltage"),
        magnetic_field: fields.flag("magnetic_field"),
        vibration: fields.flag("vibration"),
        specific_force: fields.flag("specific_force"),
        attitude: fields.flag("attitude"),
        pickoff: fields.text("pickoff"),
    };
    (told, recorded)
}
