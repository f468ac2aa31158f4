//! The model as a Python module that needs numpy alone.
use std::fmt::Write;

use super::code::{Language, comment, head, number, plain, sum, word_of, words};
use super::signal::{Memory, Outside};
use super::{Model, Term};

/// Functions with a memory.
const LAG: &str = r#"
def _lagged(time_s, x, tau_s):
    """First-order lag that starts at rest on the first value; exact for a straight line from row to row."""
    y = np.empty(len(x))
    state = before = x[0] if len(x) else 0.0
    time_before = time_s[0] if len(x) else 0.0
    for k in range(len(x)):
        step = (time_s[k] - time_before) / tau_s
        decay = np.exp(-step)
        now = 0.5 * step if step < 1e-4 else 1.0 - (1.0 - decay) / step
        state = decay * state + (1.0 - decay - now) * before + now * x[k]
        y[k], before, time_before = state, x[k], time_s[k]
    return y
"#;

const BANDWIDTH: &str = r#"
def _slopes(time_s, x):
    """Rate of change: central differences of fourth order where the steps are even."""
    n = len(x)
    slopes = np.zeros(n)
    def quotient(a, b):
        return (x[b] - x[a]) / (time_s[b] - time_s[a]) if b > a else 0.0
    for k in range(n):
        if k < 2 or k + 2 >= n:
            slopes[k] = quotient(max(k - 1, 0), min(k + 1, n - 1))
            continue
        span = time_s[k + 2] - time_s[k - 2]
        even = all(abs(time_s[k + j - 2] - time_s[k + j - 3] - span / 4.0) < 0.01 * span for j in range(1, 5))
        near = quotient(k - 1, k + 1)
        slopes[k] = (4.0 * near - quotient(k - 2, k + 2)) / 3.0 if even else near
    return slopes


def _less_bandwidth(time_s, x, tau_s):
    """First-order lag of x less x; exact for the cubic with the values and slopes of both rows."""
    slopes = _slopes(time_s, x)
    lost = np.zeros(len(x))
    state = x[0] if len(x) else 0.0
    for k in range(1, len(x)):
        h = time_s[k] - time_s[k - 1]
        decay = np.exp(-h / tau_s)
        rise = (x[k] - x[k - 1]) / h
        third = 6.0 * (slopes[k - 1] + slopes[k] - 2.0 * rise) / (h * h)
        second = 2.0 * (3.0 * rise - 2.0 * slopes[k - 1] - slopes[k]) / h
        def particular(first, second):
            return -tau_s * (first - tau_s * (second - tau_s * third))
        driven = particular(slopes[k], second + third * h) - decay * particular(slopes[k - 1], second)
        state = decay * state + x[k] - decay * x[k - 1] + driven
        lost[k] = state - x[k]
    return lost
"#;

const DELAY: &str = r#"
def _delayed(time_s, x, delay_s, reach, outside):
    """x as it was delay_s before, by Lagrange's interpolation through up to `reach` rows on either side."""
    n = len(x)
    if n < 2:
        return x.copy()
    step = (time_s[-1] - time_s[0]) / (n - 1)
    wanted = time_s - delay_s
    place = np.searchsorted(time_s, wanted + 1e-9 * step, side="right") - 1
    exact = (place >= 0) & (np.abs(wanted - time_s[np.maximum(place, 0)]) <= 1e-9 * step)
    late = np.full(n, np.nan)
    late[exact] = x[place[exact]]
    on_sides = np.where(exact, 0, np.minimum(np.minimum(place + 1, n - 1 - place), reach))
    for sides in np.unique(on_sides[on_sides > 0]):
        rows = np.flatnonzero(on_sides == sides)
        nodes = place[rows][:, None] + 1 - sides + np.arange(2 * sides)[None, :]
        times = time_s[nodes]
        value = np.zeros(len(rows))
        for i in range(2 * sides):
            weight = np.ones(len(rows))
            for j in range(2 * sides):
                if j != i:
                    weight *= (wanted[rows] - times[:, j]) / (times[:, i] - times[:, j])
            value += weight * x[nodes[:, i]]
        late[rows] = value
    missing = np.isnan(late)
    if outside == "now":
        late[missing] = x[missing]
    elif outside == "first":
        late[missing] = x[0]
    else:
        end = n - 2 if delay_s < 0.0 else 0
        own = time_s[end + 1] - time_s[end]
        slope = (x[end + 1] - x[end]) / own if own > 0.0 else 0.0
        last = own if delay_s < 0.0 else 0.0
        by = np.clip(wanted - time_s[end], last - 2.0 * own, last + 2.0 * own)
        late[missing] = (x[end] + slope * by)[missing]
    return late
"#;

const BRANCH: &str = r#"
def _branch(x, half_width):
    """Branch, -1 to 1, of a play of a half-width; it starts in the middle."""
    y = np.empty(len(x))
    output = x[0] if len(x) else 0.0
    for k in range(len(x)):
        output = min(max(output, x[k] - half_width), x[k] + half_width)
        y[k] = (x[k] - output) / half_width
    return y
"#;

const MAIN: &str = r#"

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("expected one argument: a CSV table of the inputs, under their names")
    table = np.genfromtxt(sys.argv[1], delimiter=",", names=True)
    inputs = {name: np.atleast_1d(table[name]) for name in INPUTS}
    columns = added(inputs)
    print(",".join(["time_s", *columns]))
    for row in zip(inputs["time_s"], *columns.values()):
        print(",".join(repr(float(value)) for value in row))
"#;

struct Python;

impl Language for Python {
    fn input(&self, name: &str) -> String {
        format!("inputs[\"{name}\"]")
    }
    fn magnitude(&self, x: &str) -> String {
        format!("np.abs({x})")
    }
    fn sign(&self, x: &str) -> String {
        format!("np.sign({x})")
    }
    fn step(&self, x: &str) -> String {
        format!("np.where({x} >= 0.0, 1.0, 0.0)")
    }
    fn larger(&self, x: &str, y: &str) -> String {
        format!("np.maximum({x}, {y})")
    }
    fn smaller(&self, x: &str, y: &str) -> String {
        format!("np.minimum({x}, {y})")
    }
    fn dead_zone(&self, x: &str, threshold: &str) -> String {
        format!("np.where(np.abs({x}) < {threshold}, -{x}, 0.0)")
    }
    fn library(&self, name: &str, x: &str) -> String {
        format!("np.{name}({x})")
    }
    fn constant(&self, number: &str) -> String {
        format!("np.full(len(time_s), {number})")
    }
}

/// The source text of the module.
pub fn source(model: &Model) -> String {
    let words = words(model);
    let mut text = String::from("\"\"\"");
    for line in head(model) {
        let _ = writeln!(text, "{line}");
    }
    text.push_str(
        "\"\"\"\nimport sys\n\nimport numpy as np\n\n# Inputs: unit, and what each is.\nINPUTS = {\n",
    );
    for input in &model.inputs {
        let _ =
            writeln!(text, "    \"{}\": (\"{}\", \"{}\"),", input.name, plain(&input.unit), plain(&input.is));
    }
    text.push_str("}\n\n# Outputs: sensor, unit of what is added, unit of the case and its size, and where it is added.\nOUTPUTS = {\n");
    for output in &model.outputs {
        let _ = writeln!(
            text,
            "    \"{}\": (\"{}\", \"{}\", \"{}\", {:?}, \"{}\"),",
            word_of(&words, &output.sensor),
            plain(&output.sensor),
            plain(output.unit),
            plain(&output.written_unit),
            output.written_unit_in_si,
            output.enters
        );
    }
    text.push_str("}\n\n");
    for helper in helpers(model) {
        text.push_str(helper);
        text.push('\n');
    }
    text.push_str("\ndef added(inputs):\n    \"\"\"What is added to each output, by arrays of equal length under the names of INPUTS; SI units.\"\"\"\n");
    text.push_str("    inputs = {name: np.asarray(inputs[name], dtype=float) for name in INPUTS}\n    time_s = inputs[\"time_s\"]\n");
    text.push_str("    out = {name: np.zeros(len(time_s)) for name in OUTPUTS}\n");
    for term in &model.terms {
        let _ = writeln!(text, "    # {}", comment(term));
        let name = word_of(&words, &term.output);
        let _ = writeln!(text, "    out[\"{name}\"] += {} * {}", number(term.amplitude), expression(term));
    }
    text.push_str("    return out\n");
    text.push_str(MAIN);
    text
}

fn expression(term: &Term) -> String {
    let x = sum(&term.signal, &Python);
    match term.signal.memory {
        None => format!("({x})"),
        Some(Memory::Lag { tau_s }) => format!("_lagged(time_s, {x}, {})", number(tau_s)),
        Some(Memory::Bandwidth { tau_s }) => format!("_less_bandwidth(time_s, {x}, {})", number(tau_s)),
        Some(Memory::Branch { half_width }) => format!("_branch({x}, {})", number(half_width)),
        Some(Memory::Delay { delay_s, reach, outside, less_now }) => {
            let outside = match outside {
                Outside::Now => "now",
                Outside::First => "first",
                Outside::StraightOn => "straight_on",
            };
            let late = format!("_delayed(time_s, {x}, {}, {reach}, \"{outside}\")", number(delay_s));
            if less_now { format!("({late} - ({x}))") } else { late }
        }
    }
}

/// The functions that the terms need.
fn helpers(model: &Model) -> Vec<&'static str> {
    super::code::helpers(model, [LAG, BANDWIDTH, DELAY, BRANCH])
}
