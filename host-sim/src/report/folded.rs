//! What is folded below the findings: the noise of every sensor, and what could still hide.
use maud::{Markup, html};
use schuler_explain::explanation::{Bound, Explanation};

use super::page::table;
use super::told;

/// The noise of every sensor: stated, found, and how far its spectrum holds.
pub(super) fn noise(explanation: &Explanation) -> Markup {
    if explanation.noise.is_empty() {
        return html! {};
    }
    html! {
        details.below {
            summary { "Noise of every sensor" }
            (table(&["Sensor", "Stated", "Found", "Holds to within"], &html! {
                @for it in &explanation.noise {
                    tr {
                        th scope="row" { (it.sensor) }
                        td {
                            @match &it.stated {
                                Some(stated) => { (told::noise(stated, &it.unit)) },
                                None => "nothing",
                            }
                        }
                        td { (told::noise(&it.found, &it.unit)) }
                        td { (told::holds(it)) }
                    }
                }
            }))
        }
    }
}

/// The largest effects that would not have been found.
pub(super) fn certificate(explanation: &Explanation) -> Markup {
    if explanation.certificate.is_empty() {
        return html! {};
    }
    html! {
        details.below {
            summary { "What could still hide" }
            p {
                "The largest effect of each kind that would not have been found: one of this size is found in 99 of 100 recordings \
                 like this, for nine tenths of the onsets, frequencies or time constants that it may have."
            }
            @for (sensor, bounds) in told::certified(explanation) {
                details {
                    summary { (told::certified_line(sensor, &bounds)) "." }
                    (table(&["Effect", "Could be as large as", "Adds, root mean square"], &html! {
                        @for (it, value) in bounds.iter().filter_map(|it| Some((it, told::bound(it)?))) {
                            tr {
                                th scope="row" { code { (told::bounded(it)) } }
                                td { (value) }
                                td { (told::adds(it)) }
                            }
                        }
                    }))
                    (unknown(&bounds))
                }
            }
        }
    }
}

/// Effects of which the recording cannot tell, by the reason.
fn unknown(bounds: &[&Bound]) -> Markup {
    let mut reasons: Vec<(&str, Vec<String>)> = Vec::new();
    for bound in bounds {
        let Some(because) = bound.because.as_deref() else { continue };
        match reasons.iter_mut().find(|(reason, _)| *reason == because) {
            Some((_, effects)) => effects.push(told::bounded(bound)),
            None => reasons.push((because, vec![told::bounded(bound)])),
        }
    }
    if reasons.is_empty() {
        return html! {};
    }
    html! {
        p { "The recording cannot tell:" }
        ul { @for (because, effects) in reasons { li { code { (effects.join(", ")) } ": " (because) } } }
    }
}
