//! The Python package, installed into a virtual environment under `target`, passes its own tests there. What these compare
//! with bit for bit is computed here, by the same crates on the same machine.
//!
//! Installed is the library that Cargo has built for this test, with the package's files beside it: a wheel of its own
//! would build every crate once more. `SCHULER_WHEEL=PATH` installs and tries a wheel instead.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use host_sim::identify::{Options as IdentifyOptions, identify};
use nalgebra::{RealField, SVector};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_core::filter::{DiscreteModel, ErrorFilter, FilterConfig, Gaussian};
use schuler_core::identification::{
    ChannelStatus, EXPONENTIAL_FLOOR, NoiseEstimate, fit_exponential, fit_exponential_cosine,
};
use schuler_core::isolation::determinants::FiveDeterminants;
use schuler_core::isolation::parity::ParitySpace;
use schuler_core::isolation::projector::OrthogonalProjector;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use schuler_core::isolation::{FaultIsolation, IsolationConfig, Verdict};
use schuler_core::module::{FlightModule, ModuleConfig, Status, StepInput, StepOutput};
use schuler_core::reading::Reading;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_recording::{Recording, table};
use schuler_tests::golden_records::{MinimalStandard, mistuned, record_k1, scenario_r1};
use schuler_tests::python::{environment, install, project};
use serde_json::{Value, json};

/// Rows of the adaptive filter that are compared: every so many.
const EVERY: usize = 50;

fn scratch() -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("python")
}

#[test]
fn the_package_passes_its_own_tests_and_gives_the_same_bits() {
    fs::create_dir_all(scratch()).expect("writable");
    let reference = json!({
        "filter": filter(),
        "adaptive": adaptive(),
        "block": block(),
        "isolation": isolation(),
        "noise": noise(),
        "cases": [case("quiet", 0.0), case("warm", 0.02), case("hot", 0.2)],
    });
    let path = scratch().join("reference.json");
    fs::write(&path, reference.to_string()).expect("writable");

    let package = project().join("crates/schuler-python");
    let python = environment("python-venv", "crates/schuler-python/tests/requirements.txt");
    for (what, requirements) in [
        ("schuler.fleet", "crates/schuler-python/tests/requirements-fleet.txt"),
        ("the notebook", "crates/schuler-python/tests/requirements-notebook.txt"),
    ] {
        if let Err(error) = install(&python, requirements) {
            eprintln!("SKIPPED: {what} is not tested: {error}");
        }
    }
    let site = site_packages(&python);
    let _ = fs::remove_dir_all(site.join("schuler"));
    if let Some(wheel) = std::env::var_os("SCHULER_WHEEL") {
        let mut pip = Command::new(&python);
        pip.args(["-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall"]).arg(wheel);
        succeed(&mut pip);
    } else {
        install_built(&package.join("python/schuler"), &site.join("schuler"));
    }
    let mut tests = Command::new(&python);
    tests.args(["-m", "pytest", "-p", "no:cacheprovider", "--basetemp"]).arg(scratch().join("pytest"));
    tests.env("SCHULER_REFERENCE", &path).env("PYTHONDONTWRITEBYTECODE", "1").current_dir(&package);
    succeed(&mut tests);
}

fn site_packages(python: &Path) -> PathBuf {
    let code = "import sysconfig; print(sysconfig.get_path('platlib'), end='')";
    let output = Command::new(python).args(["-c", code]).output().expect("the environment's Python runs");
    PathBuf::from(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// What maturin puts into the wheel: the files of the package, and the library under the name that Python looks for.
fn install_built(package: &Path, to: &Path) {
    fs::create_dir_all(to).expect("writable");
    for file in fs::read_dir(package).expect("the package") {
        let file = file.expect("readable").path();
        if file.is_file() {
            fs::copy(&file, to.join(file.file_name().unwrap_or_default())).expect("writable");
        }
    }
    let here = std::env::current_exe().expect("this test is a file");
    let library = here.with_file_name("lib_schuler.so");
    fs::copy(&library, to.join("_schuler.abi3.so"))
        .unwrap_or_else(|error| panic!("{}: {error}", library.display()));
}

/// Runs a program and shows what it says.
fn succeed(command: &mut Command) {
    let output = command.output().expect("the environment's Python runs");
    let (said, complained) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    println!("{said}{complained}");
    assert!(output.status.success(), "{command:?}: {}\n{said}{complained}", output.status);
}

fn config_of(config: &FilterConfig<f64>) -> Value {
    let noise = |sigma: f64, tau_s: f64| json!({ "sigma": sigma, "tau_s": tau_s });
    json!({
        "accelerometer": noise(config.accelerometer.sigma, config.accelerometer.tau_s),
        "gyro": noise(config.gyro.sigma, config.gyro.tau_s),
        "velocity_noise": config.velocity_noise,
        "step_s": config.step_s,
        "radius_m": config.radius_m,
        "gravity": config.gravity,
        "initial_velocity_sigma": config.initial_velocity_sigma,
        "initial_vertical_sigma": config.initial_vertical_sigma,
        "gate_sigma": config.gate_sigma,
    })
}

/// Record K1 with gaps, an outlier, and a jump that the filter has to follow.
fn filter() -> Value {
    let config = FilterConfig { gate_sigma: 6.0, ..scenario_r1() };
    let mut measured: Vec<f64> = record_k1().measured.into_iter().take(3000).collect();
    for (row, value) in measured.iter_mut().enumerate() {
        match row {
            row if row % 37 == 5 => *value = f64::NAN,
            700 => *value += 50.0,
            1500.. => *value += 20.0,
            _ => {}
        }
    }
    let single = single(&config);
    json!({
        "config": config_of(&config),
        "velocity_error": measured,
        "double_exact": run(&config, config.model(&config.accelerometer, &config.gyro, 1.0), &measured),
        "double_third_order": run(&config, DiscreteModel::third_order(&config), &measured),
        "single_exact": run(&single, single.model(&single.accelerometer, &single.gyro, 1.0), &measured),
        "single_third_order": run(&single, DiscreteModel::third_order(&single), &measured),
    })
}

fn single(config: &FilterConfig<f64>) -> FilterConfig<f32> {
    let single = |noise: schuler_core::filter::MarkovNoise<f64>| schuler_core::filter::MarkovNoise {
        sigma: noise.sigma as f32,
        tau_s: noise.tau_s as f32,
    };
    FilterConfig {
        radius_m: config.radius_m as f32,
        gravity: config.gravity as f32,
        step_s: config.step_s as f32,
        accelerometer: single(config.accelerometer),
        gyro: single(config.gyro),
        velocity_noise: config.velocity_noise as f32,
        initial_velocity_sigma: config.initial_velocity_sigma as f32,
        initial_vertical_sigma: config.initial_vertical_sigma as f32,
        gate_sigma: config.gate_sigma as f32,
    }
}

fn run<T: RealField + Copy + Into<f64>>(
    config: &FilterConfig<T>,
    model: DiscreteModel<T>,
    measured: &[f64],
) -> Value {
    let mut filter = ErrorFilter::<T, Gaussian<T>>::with_model(config, model, config.prior());
    let rows: Vec<_> = measured
        .iter()
        .map(|&z| {
            let z = z.is_finite().then(|| nalgebra::convert::<f64, T>(z));
            let step = filter.step(z);
            (filter.output(&step), step, z.is_some())
        })
        .collect();
    let wide = |values: [T; 4]| values.map(Into::<f64>::into);
    let measured = |pick: &dyn Fn(&(_, _, bool)) -> T| -> Vec<f64> {
        rows.iter().map(|row| if row.2 { pick(row).into() } else { f64::NAN }).collect()
    };
    json!({
        "estimate": rows.iter().map(|row| wide(row.0.estimate)).collect::<Vec<_>>(),
        "sigma": rows.iter().map(|row| wide(row.0.sigma)).collect::<Vec<_>>(),
        "innovation": measured(&|row| row.0.innovation),
        "innovation_variance": rows.iter().map(|row| row.0.innovation_variance.into()).collect::<Vec<f64>>(),
        "nis": measured(&|row| row.0.nis),
        "log_likelihood": measured(&|row: &(schuler_core::filter::FilterOutput<T>, schuler_core::filter::FilterStep<T>, bool)| row.1.innovation.log_likelihood()),
        "gated": rows.iter().map(|row| row.1.gated).collect::<Vec<_>>(),
        "reacquired": rows.iter().map(|row| row.1.reacquired).collect::<Vec<_>>(),
        "reset": rows.iter().map(|row| row.1.reset).collect::<Vec<_>>(),
    })
}

/// Record K1 through the flight module, from a data sheet that is wrong by ten.
fn adaptive() -> Value {
    let flown = FilterConfig { gate_sigma: 6.0, ..scenario_r1() };
    let config = mistuned(&flown, [0.1; 2], [0.1; 2]);
    let mut measured: Vec<f64> = record_k1().measured.into_iter().take(12_600).collect();
    measured.iter_mut().skip(100).step_by(211).for_each(|value| *value = f64::NAN);
    let mut module = Box::new(FlightModule::new());
    module
        .configure(&ModuleConfig { filter: single(&config), ..ModuleConfig::default() })
        .expect("can be flown");
    let outputs: Vec<StepOutput> = (1..)
        .zip(&measured)
        .map(|(second, &velocity)| {
            let velocity_error = Reading::good(velocity as f32);
            module.step(&StepInput { time_ms: 1000 * second, velocity_error, ..StepInput::default() })
        })
        .collect();
    let retuned: Vec<usize> =
        (0..outputs.len()).filter(|&row| outputs[row].status.contains(Status::RETUNED)).collect();
    let every = || outputs.iter().step_by(EVERY);
    let noise = |estimate: NoiseEstimate| [estimate.noise.sigma, estimate.noise.alpha, estimate.noise.beta];
    let status = |estimate: NoiseEstimate| match estimate.status {
        ChannelStatus::DataSheet => 0,
        ChannelStatus::Determined => 1,
        ChannelStatus::Weak => 2,
        ChannelStatus::Indeterminate => 3,
        ChannelStatus::Unobserved => 4,
    };
    json!({
        "truth": config_of(&flown),
        "config": config_of(&config),
        "velocity_error": measured,
        "every": EVERY,
        "retuned": retuned,
        "estimate": every().map(|it| it.filter.estimate).collect::<Vec<_>>(),
        "sigma": every().map(|it| it.filter.sigma).collect::<Vec<_>>(),
        "averaged": every().map(|it| it.identification.averaged.estimate).collect::<Vec<_>>(),
        "averaged_sigma": every().map(|it| it.identification.averaged.sigma).collect::<Vec<_>>(),
        "accelerometer_noise": every().map(|it| noise(it.identification.accelerometer)).collect::<Vec<_>>(),
        "gyro_noise": every().map(|it| noise(it.identification.gyro)).collect::<Vec<_>>(),
        "accelerometer_status": every().map(|it| status(it.identification.accelerometer)).collect::<Vec<_>>(),
        "gyro_status": every().map(|it| status(it.identification.gyro)).collect::<Vec<_>>(),
    })
}

fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

/// An asymmetric block of unequal gyros.
fn block() -> Value {
    let axes = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [-0.4708, -0.27389, 0.83865],
        [0.85097, -0.30999, -0.42398],
    ];
    let sigma = [1e-7, 2e-7, 1.5e-7, 3e-7, 1e-7];
    let space = ParitySpace::try_build(&axes, &sigma).expect("can be flown");
    let mut random = Pcg64::seed_from_u64(5);
    let rates: Vec<SVector<f64, 5>> =
        (0..200).map(|_| SVector::from_fn(|_, _| 1e-6 * normal(&mut random))).collect();
    let whitened: Vec<SVector<f64, 5>> =
        rates.iter().map(|y| y.component_div(&SVector::from(sigma))).collect();
    let (normalised, raw) =
        (FiveDeterminants::normalised(&space), FiveDeterminants::new(&axes.map(nalgebra::Vector3::from)));
    let projector = OrthogonalProjector::new(space.geometry());
    let kalman = SequentialFilter::new(space.geometry(), Recursion::Kalman);
    let published = SequentialFilter::new(space.geometry(), Recursion::CovarianceFirst);
    let five = |of: &dyn Fn(usize, &SVector<f64, 5>) -> f64| -> Vec<[f64; 5]> {
        whitened.iter().map(|y| std::array::from_fn(|gyro| of(gyro, y))).collect()
    };
    let matrix = |rows: usize, of: &dyn Fn(usize, usize) -> f64| -> Vec<[f64; 5]> {
        (0..rows).map(|row| std::array::from_fn(|column| of(row, column))).collect()
    };
    json!({
        "axes": axes,
        "sigma": sigma,
        "rates": rates.iter().map(|y| y.data.0[0]).collect::<Vec<_>>(),
        "parity_matrix": matrix(2, &|row, column| space.matrix()[(row, column)]),
        "projector": matrix(5, &|row, column| space.geometry().projector()[(row, column)]),
        "parity": whitened.iter().map(|y| space.parity(y).data.0[0]).collect::<Vec<_>>(),
        "likelihood": whitened.iter().map(|y| space.likelihood(&space.parity(y), 1.0)).collect::<Vec<_>>(),
        "determinants": five(&|gyro, y| normalised.of(y)[gyro]),
        "raw_determinants": rates.iter().map(|y| raw.of(y).data.0[0]).collect::<Vec<_>>(),
        "total": whitened.iter().map(|y| projector.project(y).total).collect::<Vec<_>>(),
        "unexplained": five(&|gyro, y| projector.project(y).unexplained[gyro]),
        "kalman_last": five(&|gyro, y| kalman.statistics(gyro, y).last),
        "kalman_previous": five(&|gyro, y| kalman.statistics(gyro, y).previous),
        "covariance_first_last": five(&|gyro, y| published.statistics(gyro, y).last),
    })
}

/// The isolation that flies, on a gyro that fails, with readings missing.
fn isolation() -> Value {
    const FAILED: usize = 3;
    let config = IsolationConfig::CONE;
    let mut isolation = FaultIsolation::try_build(&config).expect("can be flown");
    let mut random = Pcg64::seed_from_u64(6);
    let rates: Vec<[f64; 5]> = (0..2000)
        .map(|row| {
            let mut rates: [f64; 5] = std::array::from_fn(|_| 1e-7 * normal(&mut random));
            if row >= 800 {
                rates[FAILED] += 4e-7;
            }
            match row {
                300 => rates[FAILED] = f64::NAN,
                1500 => rates = [f64::NAN; 5],
                _ => {}
            }
            rates
        })
        .collect();
    let outputs: Vec<_> = rates.iter().map(|y| isolation.step(&y.map(Reading::good), None)).collect();
    let verdict = |verdict: Verdict| match verdict {
        Verdict::NoFault => (0, -1),
        Verdict::DetectedNotIsolated => (1, -1),
        Verdict::Fault(gyro) => (2, i32::from(gyro)),
        Verdict::BlockUntrusted => (3, -1),
    };
    json!({
        "rates": rates,
        "failed": FAILED,
        "verdict": outputs.iter().map(|it| verdict(it.verdict).0).collect::<Vec<_>>(),
        "faulty": outputs.iter().map(|it| verdict(it.verdict).1).collect::<Vec<_>>(),
        "flags": outputs.iter().map(|it| it.flags.bits()).collect::<Vec<_>>(),
        "excluded": outputs.iter().map(|it| it.excluded).collect::<Vec<_>>(),
        "rate": outputs.iter().map(|it| it.rate).collect::<Vec<_>>(),
        "parity": outputs.iter().map(|it| it.parity).collect::<Vec<_>>(),
        "determinants": outputs.iter().map(|it| it.determinants).collect::<Vec<_>>(),
        "alarm_level": outputs.iter().map(|it| it.alarm_level).collect::<Vec<_>>(),
        "margin": outputs.iter().map(|it| it.margin).collect::<Vec<_>>(),
        "fault_size": outputs.iter().map(|it| it.fault_size).collect::<Vec<_>>(),
        "fault_sigma": outputs.iter().map(|it| it.fault_sigma).collect::<Vec<_>>(),
    })
}

/// An exponential-cosine series with gaps.
fn noise() -> Value {
    use host_sim::identify::autocorrelation::{Centre, autocorrelation};

    let spacing_s = 10.0_f64;
    let (alpha, beta) = (1.0_f64 / 600.0, std::f64::consts::TAU / 1800.0);
    let mut random = MinimalStandard::new(54_321);
    let mut pair = [random.normal(), random.normal()];
    let decay = (-alpha * spacing_s).exp();
    let (sine, cosine) = (beta * spacing_s).sin_cos();
    let driving = (1.0 - decay * decay).sqrt();
    let mut series: Vec<f64> = (0..2048)
        .map(|_| {
            let [x, y] = pair;
            pair = [
                decay * (cosine * x - sine * y) + driving * random.normal(),
                decay * (sine * x + cosine * y) + driving * random.normal(),
            ];
            pair[0]
        })
        .collect();
    series.iter_mut().step_by(17).for_each(|value| *value = f64::NAN);
    let covariance = autocorrelation(&series, 400, Centre::Zero).values;
    let exponential = fit_exponential(&covariance, spacing_s, EXPONENTIAL_FLOOR).expect("it decays");
    let cosine = fit_exponential_cosine(&covariance, spacing_s).expect("it crosses zero");
    json!({
        "series": series,
        "spacing_s": spacing_s,
        "covariance": covariance,
        "exponential": [json!(exponential.variance), json!(exponential.alpha), json!(exponential.lags)],
        "exponential_cosine": [cosine.variance, cosine.alpha, cosine.beta, cosine.crossing_s],
    })
}

/// A gyro with Markov noise and a bias that follows the temperature, and what `explain` and `identify` say of it.
fn case(name: &str, coefficient: f64) -> Value {
    let mut random = MinimalStandard::new(20_261_122);
    let rows = 1500;
    let time: Vec<f64> = (0..rows).map(f64::from).collect();
    let temperature: Vec<f64> =
        time.iter().map(|t| 20.0 + 4.0 * (t / 90.0).sin() + 0.01 * random.normal()).collect();
    let decay = (-1.0_f64 / 30.0).exp();
    let mut markov = random.normal();
    let gyro: Vec<f64> = temperature
        .iter()
        .map(|temperature| {
            markov = decay * markov + (1.0 - decay * decay).sqrt() * random.normal();
            0.1 * markov + 0.2 * random.normal() + coefficient * (temperature - 20.0)
        })
        .collect();
    let directory = scratch();
    let columns = [("t", &time), ("gyro", &gyro), ("temperature", &temperature)];
    table::write(
        &directory.join(format!("{name}.csv")),
        &columns.map(|(name, values)| (name, values.as_slice())),
    )
    .expect("writable");
    let text = format!(
        "format = \"schuler-case/1\"\ntitle = \"{name}\"\n\
         [recording]\npath = \"{name}.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
         [site]\nlatitude_deg = 55.0\n\
         [motion]\nkind = \"static\"\nattitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 0.0 }}\n\
         [[sensor]]\nid = \"gyro\"\nkind = \"fog\"\ncolumn = \"gyro\"\nunit = \"deg/h\"\naxis = [0.0, 1.0, 0.0]\n\
         relative = true\nnominal = {{ white = 0.2, markov = {{ sigma = 0.1, tau_s = 30.0 }} }}\n\
         [[aux]]\ncolumn = \"temperature\"\nquantity = \"temperature\"\nunit = \"degC\"\nnear = \"gyro\"\n"
    );
    let path = directory.join(format!("{name}.toml"));
    fs::write(&path, text).expect("writable");
    let recording = Recording::read(&path).unwrap_or_else(|error| panic!("{error:#}"));
    let explained = explain(&recording, &Config::default()).expect("can be explained");
    let identified = identify(&recording, IdentifyOptions::default());
    let write = |what: &str, text: serde_json::Result<String>| -> PathBuf {
        let path = directory.join(format!("{name}.{what}.json"));
        fs::write(&path, text.expect("an answer is JSON")).expect("writable");
        path
    };
    json!({
        "case": absolute(&path),
        "explain": absolute(&write("explain", serde_json::to_string(&explained))),
        "identify": absolute(&write("identify", serde_json::to_string(&identified))),
    })
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).expect("a path")
}
