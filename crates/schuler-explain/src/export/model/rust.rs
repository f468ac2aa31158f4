//! The model as a Rust module without the standard library: no heap, no panic; the caller brings `exp`, `cos` and `sin`.
use std::fmt::Write;

use super::code::{Language, comment, head, number, plain, sum, word_of, words};
use super::signal::{Memory, Outside};
use super::{Model, Term};

/// What every module has: elementary functions, and a value of a row.
const COMMON: &str = "
/// Elementary functions: those of `std`, or of the crate `libm` where there is none.
pub trait Maths {
    fn exp(x: f64) -> f64;
    fn cos(x: f64) -> f64;
    fn sin(x: f64) -> f64;
}

/// A value of a row; not a number beyond the end.
fn at(values: &[f64], k: usize) -> f64 {
    values.get(k).copied().unwrap_or(f64::NAN)
}

/// Adds to a value of a row.
fn add_to(out: &mut [f64], k: usize, value: f64) {
    if let Some(sum) = out.get_mut(k) {
        *sum += value;
    }
}
";

const LAG: &str = "
/// First-order lag that starts at rest on the first value; exact for a straight line from row to row.
fn add_lagged<M: Maths>(of: Signal, inputs: &Inputs<'_>, tau_s: f64, gain: f64, out: &mut [f64]) {
    let t = inputs.time_s;
    let mut state = of(inputs, 0);
    let mut before = state;
    for k in 0..t.len() {
        let step = if k > 0 { (at(t, k) - at(t, k - 1)) / tau_s } else { 0.0 };
        let (decay, x) = (M::exp(-step), of(inputs, k));
        let now = if step < 1e-4 { 0.5 * step } else { 1.0 - (1.0 - decay) / step };
        state = decay * state + (1.0 - decay - now) * before + now * x;
        before = x;
        add_to(out, k, gain * state);
    }
}
";

const BANDWIDTH: &str = "
fn quotient(of: Signal, inputs: &Inputs<'_>, a: usize, b: usize) -> f64 {
    let t = inputs.time_s;
    if b > a { (of(inputs, b) - of(inputs, a)) / (at(t, b) - at(t, a)) } else { 0.0 }
}

/// Rate of change: central differences of fourth order where the steps are even.
fn slope_at(of: Signal, inputs: &Inputs<'_>, k: usize) -> f64 {
    let (t, n) = (inputs.time_s, inputs.time_s.len());
    if k < 2 || k + 2 >= n {
        return quotient(of, inputs, k.saturating_sub(1), (k + 1).min(n.saturating_sub(1)));
    }
    let (span, near) = (at(t, k + 2) - at(t, k - 2), quotient(of, inputs, k - 1, k + 1));
    let off = |j: usize| (at(t, k + j - 2) - at(t, k + j - 3) - span / 4.0).abs();
    let even = off(2) < 0.01 * span && off(3) < 0.01 * span && off(4) < 0.01 * span;
    if even && (at(t, k - 1) - at(t, k - 2) - span / 4.0).abs() < 0.01 * span {
        (4.0 * near - quotient(of, inputs, k - 2, k + 2)) / 3.0
    } else {
        near
    }
}

/// First-order lag of x less x; exact for the cubic with the values and slopes of both rows.
fn add_less_bandwidth<M: Maths>(of: Signal, inputs: &Inputs<'_>, tau_s: f64, gain: f64, out: &mut [f64]) {
    let t = inputs.time_s;
    let (mut x0, mut s0) = (of(inputs, 0), slope_at(of, inputs, 0));
    let mut state = x0;
    for k in 1..t.len() {
        let h = at(t, k) - at(t, k - 1);
        let decay = M::exp(-h / tau_s);
        let (x1, s1) = (of(inputs, k), slope_at(of, inputs, k));
        let rise = (x1 - x0) / h;
        let third = 6.0 * (s0 + s1 - 2.0 * rise) / (h * h);
        let second = 2.0 * (3.0 * rise - 2.0 * s0 - s1) / h;
        let end = -tau_s * (s1 - tau_s * (second + third * h - tau_s * third));
        let begin = -tau_s * (s0 - tau_s * (second - tau_s * third));
        state = decay * state + x1 - decay * x0 + end - decay * begin;
        add_to(out, k, gain * (state - x1));
        (x0, s0) = (x1, s1);
    }
}
";

const DELAY: &str = "
#[allow(dead_code)]
#[derive(Clone, Copy, PartialEq)]
enum Outside {
    Now,
    First,
    StraightOn,
}

fn beyond(of: Signal, inputs: &Inputs<'_>, k: usize, delay_s: f64, outside: Outside) -> f64 {
    let (t, n) = (inputs.time_s, inputs.time_s.len());
    if outside == Outside::Now || n < 2 {
        return of(inputs, k);
    }
    if outside == Outside::First {
        return of(inputs, 0);
    }
    let end = if delay_s < 0.0 { n - 2 } else { 0 };
    let own = at(t, end + 1) - at(t, end);
    let last = if delay_s < 0.0 { own } else { 0.0 };
    let slope = if own > 0.0 { (of(inputs, end + 1) - of(inputs, end)) / own } else { 0.0 };
    of(inputs, end) + slope * (at(t, k) - delay_s - at(t, end)).max(last - 2.0 * own).min(last + 2.0 * own)
}

/// How late, through how many rows on either side, what there is outside of the record, and whether the signal of now is taken off.
struct Late {
    delay_s: f64,
    reach: usize,
    outside: Outside,
    less_now: bool,
}

/// A signal as it was before, by Lagrange's interpolation.
fn add_delayed(of: Signal, inputs: &Inputs<'_>, by: &Late, gain: f64, out: &mut [f64]) {
    let (t, n) = (inputs.time_s, inputs.time_s.len());
    let step = if n > 1 { (at(t, n - 1) - at(t, 0)) / (n - 1) as f64 } else { 0.0 };
    // The first row that is later than what is wanted.
    let mut after = 0;
    for k in 0..n {
        let wanted = at(t, k) - by.delay_s;
        while after < n && at(t, after) <= wanted + 1e-9 * step {
            after += 1;
        }
        let late = if after > 0 && (wanted - at(t, after - 1)).abs() <= 1e-9 * step {
            of(inputs, after - 1)
        } else if after == 0 || after == n {
            beyond(of, inputs, k, by.delay_s, by.outside)
        } else {
            let sides = after.min(n - after).min(by.reach);
            let nodes = after - sides..after + sides;
            let mut late = 0.0;
            for i in nodes.clone() {
                let mut weight = 1.0;
                for j in nodes.clone().filter(|j| *j != i) {
                    weight *= (wanted - at(t, j)) / (at(t, i) - at(t, j));
                }
                late += weight * of(inputs, i);
            }
            late
        };
        add_to(out, k, gain * if by.less_now { late - of(inputs, k) } else { late });
    }
}
";

const BRANCH: &str = "
/// Branch, -1 to 1, of a play of a half-width; it starts in the middle.
fn add_branch(of: Signal, inputs: &Inputs<'_>, half_width: f64, gain: f64, out: &mut [f64]) {
    let mut output = of(inputs, 0);
    for k in 0..inputs.time_s.len() {
        let x = of(inputs, k);
        output = output.max(x - half_width).min(x + half_width);
        add_to(out, k, gain * (x - output) / half_width);
    }
}
";

struct Rust;

impl Language for Rust {
    fn input(&self, name: &str) -> String {
        format!("at(inputs.{name}, k)")
    }
    fn magnitude(&self, x: &str) -> String {
        format!("{x}.abs()")
    }
    fn sign(&self, x: &str) -> String {
        format!("(f64::from(u8::from({x} > 0.0)) - f64::from(u8::from({x} < 0.0)))")
    }
    fn step(&self, x: &str) -> String {
        format!("f64::from(u8::from({x} >= 0.0))")
    }
    fn larger(&self, x: &str, y: &str) -> String {
        format!("{x}.max({y})")
    }
    fn smaller(&self, x: &str, y: &str) -> String {
        format!("{x}.min({y})")
    }
    fn dead_zone(&self, x: &str, threshold: &str) -> String {
        format!("(if {x}.abs() < {threshold} {{ -{x} }} else {{ 0.0 }})")
    }
    fn library(&self, name: &str, x: &str) -> String {
        format!("M::{name}({x})")
    }
}

/// The source text of the module.
pub fn source(model: &Model) -> String {
    let words = words(model);
    let mut text = String::new();
    for line in head(model) {
        let _ = writeln!(text, "{}", format!("//! {line}").trim_end());
    }
    text.push_str("//!\n//! [`add`] adds to the slices of [`Outputs`], which may hold zeros or what a simulation says.\n");
    text.push_str("\n/// Inputs, one value a row.\npub struct Inputs<'a> {\n");
    for input in &model.inputs {
        let _ = writeln!(text, "    /// {}: {}", plain(&input.unit), plain(&input.is));
        let _ = writeln!(text, "    pub {}: &'a [f64],", input.name);
    }
    text.push_str("}\n\n/// Outputs, one value a row.\npub struct Outputs<'a> {\n");
    for output in &model.outputs {
        let (word, sensor) = (word_of(&words, &output.sensor), plain(&output.sensor));
        let _ = writeln!(text, "    /// {sensor}, {}: {}", plain(output.unit), output.enters);
        let _ = writeln!(text, "    pub {word}: &'a mut [f64],");
    }
    if model.outputs.is_empty() {
        text.push_str("    /// Nothing is added.\n    pub none: &'a mut [f64],\n");
    }
    text.push_str("}\n");
    text.push_str(COMMON);
    let helpers = super::code::helpers(model, [LAG, BANDWIDTH, DELAY, BRANCH]);
    if !helpers.is_empty() {
        text.push_str("\ntype Signal = fn(&Inputs<'_>, usize) -> f64;\n");
    }
    for helper in helpers {
        text.push_str(helper);
    }
    for (index, term) in model.terms.iter().enumerate() {
        let (head, x) = (comment(term), sum(&term.signal, &Rust));
        let _ = write!(
            text,
            "\n/// {head}\n#[allow(unused_variables, unused_parens)]\nfn signal_{index}<M: Maths>(inputs: &Inputs<'_>, k: usize) -> f64 {{\n    {x}\n}}\n"
        );
    }
    text.push_str("\n/// Adds what the simulation leaves out.\n#[allow(unused_variables)]\npub fn add<M: Maths>(inputs: &Inputs<'_>, out: &mut Outputs<'_>) {\n");
    for (index, term) in model.terms.iter().enumerate() {
        let _ = writeln!(text, "    {}", call(index, term, word_of(&words, &term.output)));
    }
    text.push_str("}\n");
    text
}

fn call(index: usize, term: &Term, output: &str) -> String {
    let (gain, signal) = (number(term.amplitude), format!("signal_{index}::<M>"));
    let to = format!("{gain}, out.{output});");
    match term.signal.memory {
        None => format!(
            "for k in 0..inputs.time_s.len() {{\n        add_to(out.{output}, k, {gain} * {signal}(inputs, k));\n    }}"
        ),
        Some(Memory::Lag { tau_s }) => format!("add_lagged::<M>({signal}, inputs, {}, {to}", number(tau_s)),
        Some(Memory::Bandwidth { tau_s }) => {
            format!("add_less_bandwidth::<M>({signal}, inputs, {}, {to}", number(tau_s))
        }
        Some(Memory::Branch { half_width }) => {
            format!("add_branch({signal}, inputs, {}, {to}", number(half_width))
        }
        Some(Memory::Delay { delay_s, reach, outside, less_now }) => {
            let outside = match outside {
                Outside::Now => "Now",
                Outside::First => "First",
                Outside::StraightOn => "StraightOn",
            };
            let delay = number(delay_s);
            let by = format!(
                "Late {{ delay_s: {delay}, reach: {reach}, outside: Outside::{outside}, less_now: {less_now} }}"
            );
            format!("add_delayed({signal}, inputs, &{by}, {to}")
        }
    }
}
