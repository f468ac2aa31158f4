//! The engine on records whose truth is known: noises with nothing concealed, late gyros, what is simply wrong, a reference
//! that is not ideal, a level of noise that changes.
mod delays;
mod nulls;
mod reference;
mod setups;
mod turning;

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use schuler_explain::config::Config;
use schuler_explain::explain::explain;
use schuler_explain::explanation::{Explanation, Finding};
use schuler_recording::Recording;

fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

fn explained(table: &str, case: &str) -> Explanation {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("case.toml");
    std::fs::write(folder.path().join("recording.csv"), table).expect("the table is written");
    std::fs::write(&path, case).expect("the case is written");
    let recording = Recording::read(&path).expect("the recording is read");
    explain(&recording, &Config { hold_out: false, ..Config::default() }).expect("an explanation")
}

/// What of an explanation says more than that the noise is another.
fn physics(explanation: &Explanation) -> Vec<&Finding> {
    explanation.findings.iter().filter(|finding| !finding.effect.starts_with("noise_")).collect()
}

/// The one finding that is physics or a fault of the case.
fn only(explanation: &Explanation) -> (&str, &str) {
    match physics(explanation).as_slice() {
        [finding] => (&finding.sensor, &finding.effect),
        told => panic!("{told:#?}"),
    }
}

fn delay_of(explanation: &Explanation) -> (f64, f64) {
    let delays = explanation.findings.iter().flat_map(|finding| &finding.parameters);
    let delay = delays.into_iter().find(|it| it.name == "delay_s").expect("a delay");
    (delay.value.expect("a value"), delay.sigma.expect("a sigma"))
}
