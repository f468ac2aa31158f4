//! The isolation methods against the optimum, as the host compares them.
use host_sim::compare_isolation::rule::{RuleComparison, compare_rule, rule, threshold};
use host_sim::compare_isolation::tables::{PaperTables, differing};
use host_sim::compare_isolation::{
    ComparisonRow, IsolationComparison, IsolationMethod, compare_isolation, cone,
};
use nalgebra::SVector;
use rayon::prelude::*;
use schuler_core::config::Problem;
use schuler_core::isolation::sequential::{Recursion, SequentialFilter};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::isolation_common;

fn row(rows: &[ComparisonRow], method: IsolationMethod, fault: f64) -> ComparisonRow {
    *rows.iter().find(|row| row.method == method && row.fault == fault).expect("is in the table")
}

fn print(rows: &[ComparisonRow]) {
    for row in rows {
        println!(
            "{:32} f {:4} P {:.4} ± {:.4}  ratio {:.4} ± {:.4}  differs {:.5}",
            row.method.name(),
            row.fault,
            row.probability,
            row.standard_error,
            row.ratio,
            row.ratio_error,
            row.differing
        );
    }
}

#[test]
fn fdi_4_all_methods_against_the_optimum() {
    // Probabilities at f/σ = 2, 3, 4, 6, 8, 10.
    let optimum = [0.3291, 0.4480, 0.5666, 0.7591, 0.8821, 0.9493];
    let published_recursion = [0.3283, 0.4461, 0.5624, 0.7461, 0.8671, 0.9349];
    let condition_number = [0.3241, 0.4352, 0.5424, 0.7044, 0.8006, 0.8549];
    let faults = vec![2.0, 3.0, 4.0, 6.0, 8.0, 10.0];
    let comparison = IsolationComparison { faults: faults.clone(), ..IsolationComparison::default() };
    let rows = compare_isolation(&comparison).expect("makes sense");
    print(&rows);
    assert_eq!(rows.len(), faults.len() * IsolationMethod::ALL.len());
    for (index, &fault) in faults.iter().enumerate() {
        use IsolationMethod as M;
        // 2e5 trials: one standard error of a share is 0.0011 at most; the bar on the ratio is 0.006.
        for method in [
            M::Likelihood,
            M::Determinants,
            M::Projector,
            M::ProjectorBySvd,
            M::SequentialFilter,
            M::RawDeterminants,
        ] {
            let found = row(&rows, method, fault);
            assert!((found.probability / optimum[index] - 1.0).abs() <= 0.006, "{found:?}");
            // On the cone the raw determinants are normalised already, within the five digits of its axes.
            let bar = if method == M::RawDeterminants { 1e-4 } else { 1e-5 };
            assert!(found.differing <= bar, "{found:?}");
        }
        // Both the table and the run have a standard error of up to 0.0011: four of their difference.
        for (method, table) in
            [(M::PublishedRecursion, published_recursion), (M::ConditionNumber, condition_number)]
        {
            let found = row(&rows, method, fault);
            assert!((found.probability - table[index]).abs() < 0.0062, "{found:?} {}", table[index]);
        }
        assert!((row(&rows, M::ConditionNumberOfResidual, fault).ratio - 1.0).abs() < 0.002);
    }
}

#[test]
fn fdi_3_5_condition_number_depends_on_the_rate() {
    let faults = vec![4.0, 8.0];
    for (rate, table) in [(10.0, [0.5529, 0.8311]), (1000.0, [0.5656, 0.8773])] {
        let comparison = IsolationComparison {
            faults: faults.clone(),
            rate,
            trials: 100_000,
            ..IsolationComparison::default()
        };
        let rows = compare_isolation(&comparison).expect("makes sense");
        print(&rows);
        for (fault, table) in faults.iter().zip(table) {
            let found = row(&rows, IsolationMethod::ConditionNumber, *fault);
            assert!((found.probability - table).abs() < 0.008, "{found:?} {table}");
            assert!(row(&rows, IsolationMethod::SequentialFilter, *fault).differing <= 1e-5);
        }
    }
}

#[test]
fn fdi_3_2_raw_determinants_on_an_asymmetric_block() {
    let comparison = IsolationComparison {
        axes: vec![
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [-0.4708, -0.27389, 0.83865],
            [0.85097, -0.30999, -0.42398],
        ],
        faults: vec![4.0, 6.0, 10.0],
        trials: 100_000,
        ..IsolationComparison::default()
    };
    let rows = compare_isolation(&comparison).expect("makes sense");
    print(&rows);
    for (fault, raw, likelihood) in [(4.0, 0.528, 0.546), (6.0, 0.708, 0.723), (10.0, 0.910, 0.908)] {
        let found = row(&rows, IsolationMethod::RawDeterminants, fault);
        assert!((found.probability - raw).abs() < 0.007, "{found:?}");
        assert!((row(&rows, IsolationMethod::Likelihood, fault).probability - likelihood).abs() < 0.007);
        assert!(row(&rows, IsolationMethod::Determinants, fault).differing == 0.0);
    }
}

/// From six to twelve gyros: the projector by QR and by singular values and the sequential filter with cyclic permutation
/// decide as the likelihood test in a parity space that neither of them forms, on the cone and with unequal noise.
#[test]
fn fdi_3_methods_agree_for_any_number_of_gyros() {
    use IsolationMethod as M;
    for gyros in 6..=12 {
        for unequal in [false, true] {
            let sigma = (0..gyros).map(|k| if unequal && k % 2 == 0 { 2.0 } else { 1.0 }).collect();
            let comparison = IsolationComparison {
                axes: cone(gyros),
                sigma,
                faults: vec![4.0],
                rate: 1e3,
                trials: 10_000,
                ..IsolationComparison::default()
            };
            let rows = compare_isolation(&comparison).expect("makes sense");
            print(&rows);
            let optimum = row(&rows, M::Likelihood, 4.0).probability;
            assert!(optimum > 0.6, "{gyros} gyros: {optimum}");
            for method in [M::Projector, M::ProjectorBySvd, M::SequentialFilter] {
                let found = row(&rows, method, 4.0);
                assert!(found.differing <= 2e-4, "{gyros} gyros: {found:?}");
            }
            assert!(row(&rows, M::ConditionNumberOfResidual, 4.0).ratio > 0.98, "{gyros} gyros");
            assert!(rows.iter().all(|r| r.method != M::Determinants && r.method != M::RawDeterminants));
        }
    }
}

#[test]
fn comparison_is_reproducible_and_rejects_nonsense() {
    let comparison =
        IsolationComparison { faults: vec![6.0], trials: 2000, ..IsolationComparison::default() };
    let rows = compare_isolation(&comparison).expect("makes sense");
    assert_eq!(rows, compare_isolation(&comparison).expect("makes sense"));
    let other =
        compare_isolation(&IsolationComparison { seed: 2, ..comparison.clone() }).expect("makes sense");
    assert_ne!(rows, other);
    for (field, problem, comparison) in [
        ("comparison.trials", Problem::NotPositive, IsolationComparison { trials: 0, ..comparison.clone() }),
        (
            "comparison.faults",
            Problem::NotFinite,
            IsolationComparison { faults: vec![f64::NAN], ..comparison.clone() },
        ),
        (
            "comparison.rate",
            Problem::NotFinite,
            IsolationComparison { rate: f64::INFINITY, ..comparison.clone() },
        ),
        (
            "comparison.condition_unit",
            Problem::NotPositive,
            IsolationComparison { condition_unit: 0.0, ..comparison.clone() },
        ),
        (
            "isolation.sigma",
            Problem::NotPositive,
            IsolationComparison { sigma: vec![0.0; 5], ..comparison.clone() },
        ),
    ] {
        let error = compare_isolation(&comparison).expect_err("makes no sense");
        assert_eq!((error.field, error.problem), (field, problem));
    }
}

#[test]
fn fdi_11_both_tables_beside_the_printed_digits() {
    for rate in [[0.0; 3], [1.0, -2.0, 3.0]] {
        let tables = PaperTables::try_build(rate).expect("the paper's block serves");
        assert_eq!(differing(&tables.ratios, &tables.published_ratios), 0, "{:?}", tables.ratios);
        assert_eq!(differing(&tables.determinants, &tables.published_determinants), 0);
        // The Kalman filter's ratios are other numbers, and the count says so.
        assert_eq!(differing(&tables.kalman_ratios, &tables.published_ratios), 25);
        let mut wrong = tables.determinants;
        wrong[3][1] += 1e-4;
        assert_eq!(differing(&wrong, &tables.published_determinants), 1);
    }
    let rest = PaperTables::try_build([0.0; 3]).expect("the paper's block serves");
    let moving = PaperTables::try_build([1.0, -2.0, 3.0]).expect("the paper's block serves");
    for (found, expected) in rest.conditions[0].iter().zip([21.9045, 5.0112, 2.8703, 3.1676, 6.1987]) {
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
    // Only G y is without the rate.
    let change = |a: &[[f64; 5]; 5], b: &[[f64; 5]; 5]| {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
    };
    assert!(change(&rest.residual_conditions, &moving.residual_conditions) < 1e-9);
    assert!(change(&rest.conditions, &moving.conditions) > 0.1);
}

/// Share of the samples on which the rule declares a step of this size in this gyro: the two innovations are normal and
/// independent, with the means that the step alone gives them.
fn declared(filter: &SequentialFilter<f64, 5>, limit: f64, gyro: usize, size: f64) -> f64 {
    let normal = Normal::standard();
    let means = filter.statistics(4, &(SVector::<f64, 5>::ith(gyro, size)));
    let below = |statistic: f64| {
        let (mean, edge) = (statistic.sqrt(), limit.sqrt());
        normal.cdf(edge - mean) - normal.cdf(-edge - mean)
    };
    1.0 - below(means.last) * below(means.previous)
}

#[test]
fn fdi_3_3_rule_of_the_paper_has_the_stated_false_alarms() {
    let filter = SequentialFilter::new(isolation_common::cone().geometry(), Recursion::Kalman);
    for interval in [1e2, 1e3] {
        let limit = threshold(interval);
        assert!((declared(&filter, limit, 0, 0.0) * interval - 1.0).abs() < 1e-6);
        let samples = 400_000_u64;
        let alarms = (0..samples)
            .into_par_iter()
            .filter(|sample| {
                let mut rng = isolation_common::generator(35, *sample);
                rule(&filter, limit, &isolation_common::noise(&mut rng)).is_some()
            })
            .count() as f64;
        // Four standard errors of the count.
        let expected = samples as f64 / interval;
        assert!((alarms - expected).abs() < 4.0 * expected.sqrt(), "{interval}: {alarms} {expected}");
    }
}

#[test]
fn fdi_6_sequential_detector_is_faster_than_the_rule_of_the_paper_for_small_steps() {
    let comparison = RuleComparison { faults: vec![2.0, 4.0, 8.0], ..RuleComparison::default() };
    let rows = compare_rule(&comparison, |_| Ok(())).expect("makes sense");
    assert_eq!(rows, compare_rule(&comparison, |_| Ok(())).expect("makes sense"), "the seed decides");
    let filter = SequentialFilter::new(isolation_common::cone().geometry(), Recursion::Kalman);
    let limit = threshold(comparison.false_alarm_interval);
    for row in &rows {
        println!("{row:?}");
        let expected = (0..5).map(|gyro| 1.0 / declared(&filter, limit, gyro, row.fault)).sum::<f64>() / 5.0;
        // The waiting time has a standard deviation of its mean: five standard errors of 500 runs, and some for the spread
        // between the gyros.
        assert!((row.rule_delay / expected - 1.0).abs() < 0.3, "{row:?} {expected}");
        assert!(row.detector_right >= 0.95, "{row:?}");
        assert!(row.detector_right >= row.rule_right, "{row:?}");
        assert!(row.isolation_delay >= row.detector_delay);
        if row.fault < 8.0 {
            assert!(row.detector_delay < 0.5 * row.rule_delay, "{row:?}");
        }
    }
    for (field, comparison) in [
        ("comparison.runs", RuleComparison { runs: 0, ..comparison.clone() }),
        ("comparison.faults", RuleComparison { faults: vec![f64::NAN], ..comparison.clone() }),
        (
            "comparison.false_alarm_interval",
            RuleComparison { false_alarm_interval: 0.0, ..comparison.clone() },
        ),
    ] {
        let error = compare_rule(&comparison, |_| Ok(())).expect_err("makes no sense");
        assert!(error.to_string().contains(field), "{error}");
    }
}
