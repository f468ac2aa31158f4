//! Acceptance of the health monitor on recordings drawn from its model [HLT-8], [HLT-11].
use rayon::prelude::*;
use schuler_tests::health_reference::comparison::{Gpb1, Imm, NominalKalman};
use schuler_tests::health_reference::generator::Generator;
use schuler_tests::health_reference::mixture::Mixture;
use schuler_tests::health_reference::model::{Filter, Model};
use schuler_tests::health_reference::monitored::Monitored;
use schuler_tests::health_reference::scoring::{Score, ratio_of_sums};

const STEPS: usize = 1800;

/// Scores of some filters on the same runs: one row a run.
fn scores(
    model: &Model,
    seeds: std::ops::Range<u64>,
    filters: impl Fn(u64) -> Vec<Box<dyn Filter>> + Sync,
) -> Vec<Vec<Score>> {
    seeds
        .into_par_iter()
        .map(|seed| {
            let samples = Generator::new(model, seed).natural(STEPS);
            filters(seed).iter_mut().map(|filter| Score::of(model, filter.as_mut(), &samples)).collect()
        })
        .collect()
}

fn print_table(names: &[&str], runs: &[Vec<Score>]) {
    println!("{} runs of {STEPS} s", runs.len());
    println!("| filter | jump | noise | fault | wrong | eps | xi | NEES |");
    for (column, name) in names.iter().enumerate() {
        let s = runs.iter().fold(Score::default(), |sum, run| sum.plus(&run[column]));
        println!(
            "| {name} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} | {:.4} | {:.2} |",
            s.brier_jump(),
            s.brier_noise(),
            s.brier_fault(),
            s.error_rate(),
            s.rmse_eps(),
            s.rmse_xi(),
            s.nees()
        );
    }
}

/// Ratio of two filters' means over all runs and its standard deviation.
fn ratio(runs: &[Vec<Score>], ours: usize, other: usize, figure: fn(&Score) -> f64) -> (f64, f64) {
    let pairs: Vec<_> = runs.iter().map(|run| (figure(&run[ours]), figure(&run[other]))).collect();
    ratio_of_sums(&pairs)
}

fn mean_square_eps(score: &Score) -> f64 {
    score.rmse_eps().powi(2)
}

#[test]
fn hlt_11_against_nominal_kalman_gpb1_and_imm() {
    let model = Model::doppler();
    let runs = scores(&model, 0..1000, |_| {
        vec![
            Box::new(NominalKalman::new(&model)),
            Box::new(Gpb1::new(&model)),
            Box::new(Imm::new(&model)),
            Box::new(Monitored::<f32, 2>::delivered()),
        ]
    });
    print_table(&["nominal Kalman", "GPB1", "IMM", "GPB2"], &runs);
    let bars: [(&str, (f64, f64), f64); 4] = [
        ("Brier(P_fault) GPB2 / Kalman", ratio(&runs, 3, 0, Score::brier_fault), 0.32),
        ("Brier(P_jump) GPB2 / IMM", ratio(&runs, 3, 2, Score::brier_jump), 0.88),
        ("mean square eps GPB2 / Kalman", ratio(&runs, 3, 0, mean_square_eps), 0.62 * 0.62),
        ("mean square eps GPB2 / IMM", ratio(&runs, 3, 2, mean_square_eps), 1.0),
    ];
    for (name, (found, sigma), bar) in bars {
        println!("{name}: {found:.3} ± {sigma:.3}, bar {bar:.3}");
        assert!(found <= bar, "{name}: {found} ± {sigma}, bar {bar}");
    }
    let total = runs.iter().fold(Score::default(), |sum, run| sum.plus(&run[3]));
    assert!((0.9..=1.1).contains(&total.nees()), "NEES {}", total.nees());
}

/// With exactly the model's parameters, so that only the merging differs.
#[test]
fn hlt_11_against_the_rao_blackwellised_reference() {
    let model = Model::doppler();
    let runs = scores(&model, 0..100, |seed| {
        vec![
            Box::new(Imm::new(&model)),
            Box::new(Monitored::<f32, 2>::new(&model)),
            Box::new(Mixture::bounded(&model, 200, seed)),
        ]
    });
    print_table(&["IMM", "GPB2", "mixture-200"], &runs);
    let (found, sigma) = ratio(&runs, 1, 2, Score::brier_jump);
    println!("Brier(P_jump) GPB2 / mixture-200: {found:.3} ± {sigma:.3}");
    assert!((0.93..=1.05).contains(&found), "{found} ± {sigma}");
}

/// Brier score over all modes, a run.
fn brier_of_modes(model: &Model, filter: &mut dyn Filter, seed: u64) -> f64 {
    let samples = Generator::new(model, seed).natural(STEPS);
    let mut sum = 0.0;
    for sample in &samples {
        let posterior = filter.step(Some(sample.d));
        for (r, p) in posterior.modes.iter().enumerate() {
            let truth = f64::from(u8::from(model.mode(r) == sample.mode));
            sum += (p - truth).powi(2);
        }
    }
    sum / samples.len() as f64
}

#[test]
fn hlt_8_three_levels_against_other_filters() {
    let model = Model::doppler_three_levels();
    let pairs = |runs: u64, other: &(dyn Fn(u64) -> Box<dyn Filter> + Sync)| {
        let pairs: Vec<_> = (0..runs)
            .into_par_iter()
            .map(|seed| {
                let ours = brier_of_modes(&model, &mut Monitored::<f32, 3>::three_levels(&model), seed);
                (ours, brier_of_modes(&model, &mut *other(seed), seed))
            })
            .collect();
        ratio_of_sums(&pairs)
    };
    let imm = pairs(200, &|_| Box::new(Imm::new(&model)));
    let gpb1 = pairs(200, &|_| Box::new(Gpb1::new(&model)));
    let reference = pairs(40, &|seed| Box::new(Mixture::bounded(&model, 200, seed)));
    for (name, (ratio, sigma)) in [("IMM", imm), ("GPB1", gpb1), ("mixture-200", reference)] {
        println!("three levels, Brier of all modes, GPB2 / {name}: {ratio:.3} ± {sigma:.3}");
    }
    assert!(imm.0 <= 0.88 && gpb1.0 <= 0.88);
    assert!((0.93..=1.05).contains(&reference.0));
}
