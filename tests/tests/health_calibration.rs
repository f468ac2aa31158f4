//! Do the monitor's probabilities mean what they say? Reliability diagrams on recordings drawn from its model.
use rayon::prelude::*;
use schuler_tests::health_reference::comparison::Imm;
use schuler_tests::health_reference::generator::Generator;
use schuler_tests::health_reference::model::{Filter, Model};
use schuler_tests::health_reference::monitored::Monitored;
use schuler_tests::health_reference::scoring::{FaultProbabilities, Reliability, ReliabilityBin};

const STEPS: usize = 1800;
const EDGES: [f64; 10] = [0.0, 0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1.0 + 1e-6];

/// Diagrams of P(jump), P(noise) and P(fault).
fn diagrams(
    filter: impl Fn(&Model) -> Box<dyn Filter> + Sync,
    seeds: std::ops::Range<u64>,
) -> [Reliability; 3] {
    let model = Model::doppler();
    let runs: Vec<Vec<_>> = seeds
        .into_par_iter()
        .map(|seed| {
            let mut filter = filter(&model);
            let steps = Generator::new(&model, seed).natural(STEPS);
            steps
                .iter()
                .map(|sample| {
                    let p = FaultProbabilities::of(&model, &filter.step(Some(sample.d)).modes);
                    let (jump, noise) = (sample.mode.jump, sample.mode.level >= model.normal_levels);
                    [(p.jump, jump), (p.noise, noise), (p.fault, jump || noise)]
                })
                .collect()
        })
        .collect();
    [0, 1, 2].map(|which| {
        let mut diagram = Reliability::new(&EDGES);
        for run in &runs {
            diagram.add_run(run.iter().map(|step: &[(f64, bool); 3]| step[which]));
        }
        diagram
    })
}

fn print(name: &str, bins: &[ReliabilityBin]) {
    println!("{name}: predicted → observed ± 2σ (steps)");
    for bin in bins {
        let ReliabilityBin { steps, predicted, observed, sigma } = bin;
        println!("  {predicted:.4} → {observed:.4} ± {:.4} ({steps:.0})", 2.0 * sigma);
    }
}

/// Whether observation and prediction disagree beyond the scatter between runs. Two points of probability are
/// granted to the merging of Gaussians.
fn is_biased(bin: &ReliabilityBin) -> bool {
    (bin.observed - bin.predicted).abs() > 3.5 * bin.sigma + 0.02
}

#[test]
fn hlt_8_probabilities_are_calibrated() {
    let found = diagrams(|_| Box::new(Monitored::<f32, 2>::delivered()), 10_000..12_000);
    for (name, diagram) in ["P(jump)", "P(noise)", "P(fault)"].iter().zip(&found) {
        let bins = diagram.bins();
        print(name, &bins);
        for bin in bins {
            assert!(!is_biased(&bin), "{name}: {bin:?}");
        }
    }
}

/// The same check rejects the interacting-multiple-model filter, which merges before the residual has weighed.
#[test]
fn hlt_8_imm_is_overconfident() {
    let [jump, ..] = diagrams(|model| Box::new(Imm::new(model)), 10_000..10_500);
    let bins = jump.bins();
    print("IMM P(jump)", &bins);
    let certain: Vec<_> = bins.iter().filter(|bin| bin.predicted > 0.75).collect();
    assert!(certain.iter().all(|bin| bin.observed < bin.predicted));
    assert!(certain.iter().any(|bin| is_biased(bin)));
}
