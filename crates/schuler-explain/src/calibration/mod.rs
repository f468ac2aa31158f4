//! Calibration of inertial sensors with thermal models, from one run at changing temperature [TMP-11]..[TMP-15].
//!
//! | part | does |
//! | --- | --- |
//! | [`experiment`] | the run as recorded, and what is known beforehand |
//! | `recorded` | the run that a case and its recording describe |
//! | [`thermometer`] | temperature and rate with hindsight, from a quantised thermometer |
//! | `kinematics` | attitude with its sensitivities to the gyros' coefficients |
//! | `filter` | square-root filter of many constant parameters and three attitude errors |
//! | `estimator` | the passes: a complete unit against gravity and Earth rate, or gyros against a table's angle |
//! | [`observability`] | what the run can determine, and what it cannot and why |
//! | [`result`] | coefficients with sigma and unit, reports, verdicts, and the block to fly with |
//!
//! Sources: I. Tarygin's dissertation on extended thermal models (2024); Tarygin, Gyroscopy and Navigation 11(1), 2020.
//! SI units, radians, degC; local frame east, north, up.
mod attitude;
mod estimator;
pub mod experiment;
mod filter;
mod kinematics;
mod layout;
pub mod observability;
mod recorded;
pub mod result;
pub mod thermometer;

use estimator::{Estimator, Outcome};
pub use experiment::{
    Arrangement, AttitudePrior, CalibrationError, Cycle, Experiment, FeatureSet, Noise, PriorSigma, Priors,
    Site,
};
use layout::Layout;
pub use observability::ThermalProgramme;
use observability::{combination, worst};
pub use result::{
    Calibration, Coefficient, CycleReport, Determination, Element, ElementReport, Feature, Verdict,
};
pub use thermometer::{ThermalPoint, Thermometry};

/// Normalised innovation squared further from one than this means a wrong model; three sigmas of 10 000 measurements.
const NIS_TOLERANCE: f64 = 0.05;
/// A last pass that moves a coefficient further, in sigmas, has not converged: the next one would move it by a tenth of a
/// sigma or more.
const SHIFT_TOLERANCE: f64 = 2.0;

/// Determines every coefficient of the error model from one run.
///
/// # Errors
/// An experiment that contradicts itself, with the field; a filter that failed, with the second. A run that says little
/// is no error: its verdicts say so.
pub fn calibrate(experiment: &Experiment) -> Result<Calibration, CalibrationError> {
    calibrate_watched(experiment, &|_, _| true)
}

/// The same; `watch` is told the seconds of data worked through and to be worked through, and may end the work by `false`.
///
/// # Errors
/// As [`calibrate`], and when `watch` ends the work.
pub fn calibrate_watched(
    experiment: &Experiment,
    watch: &dyn Fn(usize, usize) -> bool,
) -> Result<Calibration, CalibrationError> {
    experiment.check()?;
    let samples = experiment.samples_per_second();
    let points: Vec<Vec<ThermalPoint>> =
        experiment.cycles.iter().map(|c| c.thermometry.points(c.rate.len() / samples)).collect();
    let np = experiment.features.count();
    let features: Vec<Vec<Vec<f64>>> =
        points.iter().map(|cycle| cycle.iter().map(|p| scaled(p)[..np].to_vec()).collect()).collect();
    let outcome = Estimator::new(experiment, &features, watch)?.run()?;
    Ok(report(experiment, &points, &features, &outcome))
}

/// Scaled features [TMP-11].
fn scaled(point: &ThermalPoint) -> [f64; 6] {
    let [gx, gy, gz] = point.gradient.map(|g| g / Feature::GradientX.scale());
    let temperature = (point.temperature - Feature::REFERENCE_TEMPERATURE) / Feature::Temperature.scale();
    [1.0, temperature, point.rate / Feature::Rate.scale(), gx, gy, gz]
}

fn report(
    experiment: &Experiment,
    points: &[Vec<ThermalPoint>],
    features: &[Vec<Vec<f64>>],
    outcome: &Outcome,
) -> Calibration {
    let cycles: Vec<CycleReport> = experiment
        .cycles
        .iter()
        .zip(features)
        .zip(&outcome.agreement)
        .map(|((cycle, rows), agreement)| CycleReport {
            axis: cycle.axis,
            seconds: agreement.seconds,
            missing: rows.len() - agreement.seconds,
            nis: agreement.sum / agreement.count.max(1) as f64,
            programme: ThermalProgramme::of(rows),
        })
        .collect();
    let (coefficients, elements) = coefficients(experiment, &cycles, outcome);
    let sum: f64 = outcome.agreement.iter().map(|a| a.sum).sum();
    let measurements: usize = outcome.agreement.iter().map(|a| a.count).sum();
    let all = || points.iter().flatten();
    let extreme = |f: fn(f64, f64) -> f64, start: f64| all().map(|p| p.temperature).fold(start, f);
    let mut calibration = Calibration {
        coefficients,
        elements,
        cycles,
        nis: sum / measurements.max(1) as f64,
        measurements,
        last_shift: outcome.last_shift,
        temperature_range: [extreme(f64::min, f64::INFINITY), extreme(f64::max, f64::NEG_INFINITY)],
        rate_limit: all().map(|p| p.rate.abs()).fold(0.0, f64::max),
        gradient_limit: all().flat_map(|p| p.gradient).map(f64::abs).fold(0.0, f64::max),
        verdicts: Vec::new(),
    };
    calibration.verdicts = verdicts(&calibration);
    calibration
}

fn coefficients(
    experiment: &Experiment,
    cycles: &[CycleReport],
    outcome: &Outcome,
) -> (Vec<Coefficient>, Vec<ElementReport>) {
    let layout = Layout::of(experiment);
    let prior = layout.prior(experiment);
    let np = layout.features;
    let gyro = Element::gyro().enumerate().map(|(slot, e)| (layout.gyro + slot * np, e));
    let accelerometer = layout
        .accelerometer
        .into_iter()
        .flat_map(|first| Element::accelerometer().enumerate().map(move |(slot, e)| (first + slot * np, e)));
    let (mut coefficients, mut elements) = (Vec::new(), Vec::new());
    for (first, element) in gyro.chain(accelerometer) {
        for (f, feature) in Feature::ALL.into_iter().enumerate().take(np) {
            let k = first + f;
            let sigma = outcome.covariance[(k, k)].sqrt();
            coefficients.push(Coefficient {
                element,
                feature,
                value: outcome.parameters[k],
                sigma,
                prior_sigma: prior[k],
                determination: Determination::of(sigma / prior[k]),
            });
        }
        let block = outcome.covariance.view((first, first), (np, np)).into_owned();
        let worst = worst(&block, &prior[first..first + np]);
        let determination = Determination::of(worst.ratio);
        let words = match determination {
            Determination::Determined => String::new(),
            _ => explain(&worst.combination, worst.ratio, cycles),
        };
        elements.push(ElementReport {
            element,
            worst_ratio: worst.ratio,
            worst_combination: worst.combination,
            determination,
            words,
        });
    }
    (coefficients, elements)
}

/// Why a combination of an element's parts was not determined.
fn explain(weights: &[(Feature, f64)], ratio: f64, cycles: &[CycleReport]) -> String {
    let poor: Vec<String> = cycles
        .iter()
        .enumerate()
        .filter(|(_, c)| !c.programme.sufficient)
        .map(|(k, _)| (k + 1).to_string())
        .collect();
    let reason = if !poor.is_empty() {
        format!("the features of temperature are dependent in cycle {}", poor.join(", "))
    } else if let Some(axis) = (0..3).find(|axis| cycles.iter().all(|c| c.axis != *axis)) {
        format!("no cycle turned the unit about its {} axis", ["x", "y", "z"][axis])
    } else {
        "the motion, the length or the repeatability of the run do not tell it apart from other errors"
            .to_owned()
    };
    format!(
        "its combination {} keeps {:.0} % of the prior sigma: {reason}",
        combination(weights),
        100.0 * ratio
    )
}

fn verdicts(calibration: &Calibration) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    if (calibration.nis - 1.0).abs() > NIS_TOLERANCE {
        verdicts.push(Verdict::ModelDoesNotFit { nis: calibration.nis });
    }
    if calibration.last_shift > SHIFT_TOLERANCE {
        verdicts.push(Verdict::NotConverged { shift: calibration.last_shift });
    }
    for (k, cycle) in calibration.cycles.iter().enumerate() {
        if !cycle.programme.sufficient {
            let words = cycle.programme.words.clone();
            verdicts.push(Verdict::ProgrammeTooPoor {
                cycle: k + 1,
                smallest: cycle.programme.smallest(),
                words,
            });
        }
    }
    for axis in 0..3 {
        if calibration.cycles.iter().all(|c| c.axis != axis) {
            verdicts.push(Verdict::AxisNotTurned { axis });
        }
    }
    let undetermined = calibration.elements.iter().filter(|e| e.determination == Determination::Undetermined);
    verdicts.extend(
        undetermined.map(|e| Verdict::ElementUndetermined { element: e.element, words: e.words.clone() }),
    );
    if verdicts.is_empty() {
        verdicts.push(Verdict::Sound);
    }
    verdicts
}
