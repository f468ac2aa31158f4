//! Records like real ones, through the whole catalogue: a late instrument off the reference point, and readings that are
//! coarser than their noise on a large unknown constant.
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_recording::Recording;

fn explained(name: &str, case: &str, table: &str) -> Explanation {
    let recording = recorded(name, case, table);
    explain(&recording, &Config::default()).expect("it can be explained")
}

fn recorded(name: &str, case: &str, table: &str) -> Recording {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    fs::write(folder.join(format!("{name}.csv")), table).expect("the folder is writable");
    let path = folder.join(format!("{name}.toml"));
    fs::write(&path, case).expect("the folder is writable");
    Recording::read(&path).expect("the case can be read")
}

fn value(finding: &Finding, name: &str) -> (f64, f64) {
    let parameter = finding.parameters.iter().find(|parameter| parameter.name == name);
    let parameter = parameter.unwrap_or_else(|| panic!("{name} of {finding:?}"));
    (parameter.value.unwrap_or(f64::NAN), parameter.sigma.unwrap_or(f64::NAN))
}

/// What a log behind the reference point reads of a vessel that sways, early: v(t − d) + ω(t − d) × r.
struct Log {
    delay_s: f64,
    arm_x_m: f64,
    white: f64,
    /// Yaw and its rate.
    yaw: Box<dyn Fn(f64) -> f64>,
    rate: Box<dyn Fn(f64) -> f64>,
}

impl Log {
    fn explained(&self, name: &str, seed: u64) -> Explanation {
        let mut random = Pcg64::seed_from_u64(seed);
        let speed = |t: f64| 1.5 + 0.3 * (t / 17.0).sin() + 0.2 * (t / 6.1).cos();
        let mut table = "t,vn,ve,vd,roll,pitch,yaw,x,y\n".to_owned();
        for row in 0..500 {
            let t = f64::from(row);
            let read_s = t - self.delay_s;
            let mut noise =
                || -> f64 { self.white * Distribution::<f64>::sample(&StandardNormal, &mut random) };
            let (x, y) = (speed(read_s) + noise(), (self.rate)(read_s) * self.arm_x_m + noise());
            let yaw = (self.yaw)(t);
            let (north, east) = (speed(t) * yaw.cos(), speed(t) * yaw.sin());
            let _ = writeln!(table, "{t},{north},{east},0,0,0,{yaw},{x},{y}");
        }
        let mut case = format!(
            "format = \"schuler-case/1\"\ntitle = \"log\"\n[recording]\npath = \"{name}.csv\"\ntime = \"t\"\n\
             step_s = 1.0\n[site]\nlatitude_deg = 30.0\naltitude_m = 0.0\n[motion]\nkind = \"recorded\"\n\
             velocity_ned = [\"vn\", \"ve\", \"vd\"]\nattitude_rad = [\"roll\", \"pitch\", \"yaw\"]\n"
        );
        for (id, axis) in [("x", "1.0, 0.0, 0.0"), ("y", "0.0, 1.0, 0.0")] {
            let _ = writeln!(
                case,
                "[[sensor]]\nid = \"{id}\"\nkind = \"doppler\"\ncolumn = \"{id}\"\nunit = \"m/s\"\naxis = [{axis}]\n\
                 group = \"log\"\n[sensor.nominal]\nbias = 0.0\nwhite = {}",
                self.white
            );
        }
        let recording = recorded(name, &case, &table);
        explain(&recording, &Config::default()).expect("it can be explained")
    }
}

#[test]
fn the_arm_of_a_late_instrument_is_seen_as_late_as_its_readings() {
    let log = Log {
        delay_s: -1.5,
        arm_x_m: -1.9,
        white: 0.005,
        yaw: Box::new(|t| 0.9 * (t / 9.0).sin() + 0.5 * (t / 5.3 + 1.0).cos()),
        rate: Box::new(|t| 0.1 * (t / 9.0).cos() - 0.5 / 5.3 * (t / 5.3 + 1.0).sin()),
    };
    let explanation = log.explained("late", 20);
    let of = |effect: &str| {
        let found = explanation.findings.iter().filter(|finding| finding.effect == effect);
        let found: Vec<&Finding> = found.collect();
        assert_eq!(found.len(), 1, "{effect} in {:?}", explanation.findings);
        found[0].clone()
    };
    let expected: [(&str, &str, f64); 2] =
        [("time_delay", "delay_s", log.delay_s), ("lever_arm", "arm_x_m", log.arm_x_m)];
    for (effect, name, truth) in expected {
        let (found, sigma) = value(&of(effect), name);
        // Central differences at 1 Hz lack (1/5.3)²/6 = 0.6 % of the rate of the faster swing.
        let of_rate = if effect == "lever_arm" { 0.006 * truth.abs() } else { 0.0 };
        assert!((found - truth).abs() < 3.0 * sigma + of_rate, "{name}: {found} ± {sigma}, not {truth}");
    }
}

/// The last readings of a log that comes early are of a time that the reference does not have. What is said of them is nothing: neither
/// a drift, nor that they are predicted worse than the noise is.
#[test]
fn what_is_read_beyond_the_record_is_not_explained() {
    const TRIALS: u32 = 8;
    const WHITE: f64 = 0.02;
    let slow = |t: f64| t / 9.0 + 2.0 * (t / 70.0).sin();
    let fast = |t: f64, phase: f64| 1.7 * t + 5.0 * (t / 50.0).cos() + phase;
    let (mut excess, mut samples) = (0.0, 0.0);
    for trial in 0..TRIALS {
        let phase = 0.25 * std::f64::consts::PI * f64::from(trial);
        let log = Log {
            delay_s: -1.45,
            arm_x_m: -1.8,
            white: WHITE,
            yaw: Box::new(move |t| 0.3 * slow(t).sin() + 0.03 * fast(t, phase).sin()),
            rate: Box::new(move |t| {
                let slowly = 0.3 * (1.0 / 9.0 + 2.0 / 70.0 * (t / 70.0).cos()) * slow(t).cos();
                slowly + 0.03 * (1.7 - 0.1 * (t / 50.0).sin()) * fast(t, phase).cos()
            }),
        };
        let explanation = log.explained(&format!("beyond_{trial}"), 40 + u64::from(trial));
        let mut names: Vec<&str> =
            explanation.findings.iter().map(|finding| finding.effect.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["lever_arm", "time_delay"], "trial {trial}");
        let of_noise = 0.5 * (std::f64::consts::TAU * WHITE * WHITE).ln() + 0.5;
        let held_out = &explanation.fit.held_out;
        excess += held_out.after.nll_per_sample - of_noise;
        samples += held_out.samples as f64;
    }
    // A sample of normal noise has a variance of ½ nat².
    let (mean, sigma) = (excess / f64::from(TRIALS), (0.5 / samples).sqrt());
    assert!(mean < 3.0 * sigma, "{mean} ± {sigma} nats a sample more than noise has");
}

/// Readings of a gravimeter: steps of 10 nm/s² on 0.026 m/s², noise of half a step, a random walk, and a temperature that
/// does nothing. The sum of squares is 10¹⁶; what rounding leaves of it must not be taken for a gain.
#[test]
fn coarse_readings_on_a_large_constant_leave_the_likelihood_sound() {
    for (name, quantisation) in [("stated", "quantisation = 1e-8\n"), ("not_stated", "")] {
        let mut random = Pcg64::seed_from_u64(7);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let (mut walk, mut temperature) = (0.0, 0.0);
        let mut table = "t,g,T\n".to_owned();
        for row in 0..1184 {
            walk += 6e-10 * noise();
            temperature += 1e-6 * noise();
            let reading = ((0.026_392_32 + walk + 5e-9 * noise()) / 1e-8).round() * 1e-8;
            let _ = writeln!(table, "{},{reading:.8},{:.5}", 66 * row, temperature - 0.002);
        }
        let case = format!(
            "format = \"schuler-case/1\"\ntitle = \"gravimeter\"\n[recording]\npath = \"{name}.csv\"\ntime = \"t\"\n\
             step_s = 66.0\n[site]\nlatitude_deg = 10.0\naltitude_m = 400.0\n[motion]\nkind = \"static\"\n\
             attitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 0.0 }}\n[[sensor]]\nid = \"spring\"\n\
             kind = \"accelerometer\"\ncolumn = \"g\"\nunit = \"m/s^2\"\naxis = [0.0, 0.0, 1.0]\nrelative = true\n\
             {quantisation}[sensor.nominal]\nbias = 0.0\nwhite = 7e-9\n[[aux]]\ncolumn = \"T\"\n\
             quantity = \"temperature\"\nunit = \"K\"\nnear = \"spring\"\n"
        );
        let explanation = explained(name, &case, &table);
        for finding in &explanation.findings {
            assert!(finding.evidence.gain_nats < 5e3, "{name}: {finding:?}");
        }
    }
}

/// A unit at rest in poses, whose mounting is beyond doubt by its accelerometers: on a gyro that does not turn a mounting leaves nothing
/// over, and a constant of some nats is the gyro's own.
#[test]
fn what_a_mounting_cannot_leave_over_is_told() {
    let mut random = Pcg64::seed_from_u64(3);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let mut table = "t,wx,wy,wz,fx,fy,fz,gx,ax,ay,az\n".to_owned();
    let (turned, constant) = ([0.003, -0.002, 0.004], 0.15);
    for row in 0..3000 {
        let mut force = [0.0; 3];
        force[row / 500 % 3] = if row / 1500 == 0 { 9.8 } else { -9.8 };
        let [fx, fy, fz] = force;
        let [ex, ey, ez] = turned;
        // f × e beside f.
        let (ax, ay, az) = (fx + fy * ez - fz * ey, fy + fz * ex - fx * ez, fz + fx * ey - fy * ex);
        let _ = writeln!(
            table,
            "{row},0,0,0,{fx},{fy},{fz},{},{},{},{}",
            constant + noise(),
            ax + 1e-3 * noise(),
            ay + 1e-3 * noise(),
            az + 1e-3 * noise()
        );
    }
    let mut case =
        "format = \"schuler-case/1\"\ntitle = \"poses\"\n[recording]\npath = \"poses.csv\"\ntime = \"t\"\n\
                    step_s = 1.0\n[motion]\nkind = \"recorded\"\nrate = [\"wx\", \"wy\", \"wz\"]\n\
                    specific_force = [\"fx\", \"fy\", \"fz\"]\n"
            .to_owned();
    for (id, kind, unit, axis, white) in [
        ("gx", "mems_gyro", "deg/h", "1.0, 0.0, 0.0", 1.0),
        ("ax", "accelerometer", "m/s^2", "1.0, 0.0, 0.0", 1e-3),
        ("ay", "accelerometer", "m/s^2", "0.0, 1.0, 0.0", 1e-3),
        ("az", "accelerometer", "m/s^2", "0.0, 0.0, 1.0", 1e-3),
    ] {
        let _ = writeln!(
            case,
            "[[sensor]]\nid = \"{id}\"\nkind = \"{kind}\"\ncolumn = \"{id}\"\nunit = \"{unit}\"\naxis = [{axis}]\n\
             group = \"imu\"\n[sensor.nominal]\nbias = 0.0\nwhite = {white}"
        );
    }
    let explanation = explained("poses", &case, &table);
    let gain = |sensor: &str, effect: &str| {
        let found =
            explanation.findings.iter().find(|finding| finding.sensor == sensor && finding.effect == effect);
        found.unwrap_or_else(|| panic!("{sensor} {effect} in {:?}", explanation.findings)).evidence.gain_nats
    };
    let (mounting, constant) = (gain("imu", "misalignment"), gain("gx", "bias_constant"));
    // Otherwise nothing would have been set aside.
    assert!(0.01 * mounting > constant, "{mounting} {constant}");
}

/// A noisy reference looks like a late instrument with a scale factor: it is told, and of a noisy gyro it is not.
#[test]
fn noise_of_the_reference_is_said() {
    let mut random = Pcg64::seed_from_u64(11);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let mut motion = 0.0;
    let rows: Vec<[f64; 3]> = (0..4000)
        .map(|_| {
            motion += 0.3 * (3.0 * noise() - motion);
            [motion, noise(), noise()]
        })
        .collect();
    let told = |name: &str, [of_reference, of_reading]: [f64; 2]| -> Vec<String> {
        let mut table = "t,wx,wy,wz,gx\n".to_owned();
        for (row, [motion, a, b]) in rows.iter().enumerate() {
            let (reference, reading) = (motion + of_reference * a, motion + of_reading * b);
            let _ = writeln!(table, "{row},{reference},0,0,{reading}");
        }
        let case = format!(
            "format = \"schuler-case/1\"\ntitle = \"reference\"\n[recording]\npath = \"{name}.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
             [motion]\nkind = \"recorded\"\nrate = [\"wx\", \"wy\", \"wz\"]\n[[sensor]]\nid = \"gx\"\nkind = \"mems_gyro\"\n\
             column = \"gx\"\nunit = \"rad/s\"\naxis = [1.0, 0.0, 0.0]\n[sensor.nominal]\nbias = 0.0\nwhite = 0.2\n"
        );
        explained(name, &case, &table).findings.into_iter().map(|finding| finding.effect).collect()
    };
    let (reference, gyro) = (told("noisy_reference", [0.3, 0.03]), told("noisy_gyro", [0.03, 0.3]));
    assert_eq!(reference.first().map(String::as_str), Some("reference_noise"));
    assert!(!gyro.contains(&"reference_noise".to_owned()), "{gyro:?}");
}

/// A temperature that comes a little late is, to the first order, the temperature and its rate: the lag is told, and of the two together
/// that they are as good.
#[test]
fn heat_that_comes_late_is_a_lag_or_temperature_with_its_rate() {
    const LAG_S: f64 = 90.0;
    let mut random = Pcg64::seed_from_u64(21);
    let temperature = |t: f64| 25.0 + 6.0 * (t / 700.0).sin() + 3.0 * (t / 310.0).cos();
    let rate = |t: f64| 6.0 / 700.0 * (t / 700.0).cos() - 3.0 / 310.0 * (t / 310.0).sin();
    let mut table = "t,gyro,temperature\n".to_owned();
    for row in 0..6000 {
        let t = f64::from(row);
        let noise: f64 = StandardNormal.sample(&mut random);
        let reading = 0.05 * (temperature(t) - LAG_S * rate(t) - 25.0) + 0.5 * noise;
        let _ = writeln!(table, "{t},{reading},{}", temperature(t));
    }
    let case = "format = \"schuler-case/1\"\ntitle = \"oven\"\n[recording]\npath = \"late_heat.csv\"\ntime = \"t\"\n\
        step_s = 1.0\n[site]\nlatitude_deg = 0.0\naltitude_m = 0.0\n[motion]\nkind = \"static\"\n\
        attitude_deg = { roll = 0.0, pitch = 0.0, heading = 90.0 }\n[[sensor]]\nid = \"gyro\"\nkind = \"dtg\"\n\
        column = \"gyro\"\nunit = \"deg/h\"\naxis = [1.0, 0.0, 0.0]\n[sensor.nominal]\nbias = 0.0\nwhite = 0.5\n\
        [[aux]]\ncolumn = \"temperature\"\nquantity = \"temperature\"\nunit = \"degC\"\n";
    let explanation = explained("late_heat", case, &table);
    let told = |effect: &str| explanation.findings.iter().find(|finding| finding.effect == effect);
    // The one does what the two do together.
    let as_two = told("bias_temperature").is_some() && told("bias_temperature_rate").is_some();
    assert!(told("bias_thermal_lag").is_some() || as_two, "{:?}", explanation.findings);
}
