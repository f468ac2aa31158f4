//! Calibration of gyros alone against a table's angle sensor (TMP-14).
use schuler_explain::calibration::{
    Calibration, CalibrationError, Coefficient, Element, Feature, FeatureSet, Priors, Verdict, calibrate,
};
use schuler_tests::calibration_run::{
    ARC_SECOND, Known, UP_AND_DOWN, draw_errors, experiment, gyro_block, normalised_errors, rms,
};

/// Calibrations of runs with this repeatability of the mounting, rad, and the errors of all in sigmas.
fn runs(mounting: f64, seeds: std::ops::Range<u64>) -> (Vec<Calibration>, Vec<f64>) {
    let (mut calibrations, mut errors) = (Vec::new(), Vec::new());
    for seed in seeds {
        let mut table = gyro_block(UP_AND_DOWN, mounting);
        draw_errors(&mut table, &Priors::default(), FeatureSet::TemperatureRate, seed);
        let mut experiment = experiment(&table, &table.run(seed), FeatureSet::TemperatureRate, Known::Truth);
        experiment.passes = 3;
        let calibration = calibrate(&experiment).expect("a calibration");
        errors.extend(normalised_errors(&table, &calibration));
        calibrations.push(calibration);
    }
    (calibrations, errors)
}

fn largest_ratio(calibration: &Calibration, pick: impl Fn(&Coefficient) -> bool) -> f64 {
    let picked = calibration.coefficients.iter().filter(|c| pick(c));
    picked.map(|c| c.sigma / c.prior_sigma).fold(0.0, f64::max)
}

fn constant_off_diagonal(c: &Coefficient) -> bool {
    matches!(c.element, Element::GyroMatrix(i, j) if i != j) && c.feature == Feature::Constant
}

/// Estimates agree with their sigmas whatever the mounting; everything but the constant misalignments is determined by the
/// table, and those as well as the mounting repeats.
///
/// The specification gives 0.0011 of the prior for the constant scale factors at every mounting. That holds only if the
/// sensitivities leave out `(I + M)⁻¹`: a rotation by the undetermined misalignment, 0.7e-3 rad at 180 arcsec, times
/// misalignments of 3e-3 is 2 ppm of scale factor, 0.001 of the prior, and more for a worse unit; with it left out, errors
/// reached 6.9 sigma.
#[test]
fn tmp_14_estimates_agree_with_their_sigmas() {
    for (arc_seconds, misalignment, scale_factor) in
        [(10.0, 0.024, 0.0011), (60.0, 0.141, 0.0015), (180.0, 0.360, 0.0035)]
    {
        let (calibrations, errors) = runs(arc_seconds * ARC_SECOND, 0..5);
        let nis = calibrations.iter().map(|c| c.nis).sum::<f64>() / calibrations.len() as f64;
        let beyond = errors.iter().filter(|z| z.abs() > 3.0).count() as f64 / errors.len() as f64;
        println!(
            "mounting {arc_seconds} arcsec: rms of error/sigma {:.3}, beyond 3 sigma {beyond:.4}, NIS {nis:.4}",
            rms(&errors)
        );
        assert!((0.85..=1.15).contains(&rms(&errors)), "{arc_seconds}: rms of error/sigma {}", rms(&errors));
        assert!(beyond <= 0.015 && (0.98..=1.02).contains(&nis), "{arc_seconds}: {beyond}, NIS {nis}");
        for calibration in &calibrations {
            assert_eq!(calibration.verdicts, [Verdict::Sound]);
            let rest = largest_ratio(calibration, |c| !constant_off_diagonal(c));
            assert!(rest <= 0.007, "{arc_seconds}: posterior/prior {rest}");
            let scale = largest_ratio(calibration, |c| {
                matches!(c.element, Element::GyroMatrix(i, j) if i == j) && c.feature == Feature::Constant
            });
            println!("    scale factor, posterior/prior {scale:.5}");
            assert!(scale <= scale_factor, "{arc_seconds}: scale factor, posterior/prior {scale}");
            let off = largest_ratio(calibration, constant_off_diagonal);
            assert!(
                (off / misalignment - 1.0).abs() < 0.05,
                "{arc_seconds}: misalignment, posterior/prior {off}"
            );
        }
    }
}

/// A mounting that repeats to one degree: linear filters are far from valid at first, the passes still converge, and the
/// scale factors are found, to the cosine of a mounting that is known to its own misalignment only: 0.017 times 2e-3 rad is
/// 35 ppm, 0.02 of the prior, for each of two axes.
#[test]
fn tmp_14_a_poor_mounting_still_gives_scale_factors() {
    let (calibrations, errors) = runs(1.0f64.to_radians(), 0..3);
    println!("mounting 1 deg: rms of error/sigma {:.3}", rms(&errors));
    assert!(rms(&errors) < 1.15, "{}", rms(&errors));
    for calibration in &calibrations {
        assert!(calibration.last_shift < 2.0, "{}", calibration.last_shift);
        let scale = largest_ratio(calibration, |c| {
            matches!(c.element, Element::GyroMatrix(i, j) if i == j) && c.feature == Feature::Constant
        });
        println!("    scale factor, posterior/prior {scale:.4}");
        assert!(scale <= 0.05, "posterior/prior {scale}");
    }
}

#[test]
fn tmp_14_errors_name_the_field() {
    let mut table = gyro_block(UP_AND_DOWN, 60.0 * ARC_SECOND);
    table.cycle_s = 120;
    let record = table.run(1);
    let good = experiment(&table, &record, FeatureSet::TemperatureRate, Known::Truth);
    let mut short = good.clone();
    short.cycles[1].table_angle.pop();
    let mut start = good.clone();
    start.cycles[2].table_angle[0] = f64::NAN;
    for (experiment, expected) in [(short, "cycles[1].table_angle"), (start, "cycles[2].table_angle[0]")] {
        match calibrate(&experiment) {
            Err(CalibrationError::Invalid { field, .. }) => assert_eq!(field, expected),
            other => panic!("{expected}: {:?}", other.map(|c| c.verdicts)),
        }
    }
    // Angles missing later on are measurements missing.
    let mut gap = good;
    gap.cycles[0].table_angle[50] = f64::NAN;
    let calibration = calibrate(&gap).expect("a calibration");
    assert_eq!(calibration.cycles[0].missing, 1);
}
