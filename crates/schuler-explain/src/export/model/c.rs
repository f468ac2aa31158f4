//! The model as one C99 file that needs `math.h` alone: no heap, no globals that change.
use std::fmt::Write;

use super::code::{Language, comment, head, number, plain, sum, word_of, words};
use super::signal::{Memory, Outside};
use super::{Model, Term};

const LAG: &str = "
/* First-order lag that starts at rest on the first value; exact for a straight line from row to row. */
static void add_lagged(signal_of of, const struct schuler_inputs *in, double tau_s, double gain, double *out)
{
    double state = in->rows > 0 ? of(in, 0) : 0.0, before = state;
    for (size_t k = 0; k < in->rows; k++) {
        const double step = k > 0 ? (in->time_s[k] - in->time_s[k - 1]) / tau_s : 0.0;
        const double decay = exp(-step), x = of(in, k);
        const double now = step < 1e-4 ? 0.5 * step : 1.0 - (1.0 - decay) / step;
        state = decay * state + (1.0 - decay - now) * before + now * x;
        before = x;
        out[k] += gain * state;
    }
}
";

const BANDWIDTH: &str = "
static double quotient(signal_of of, const struct schuler_inputs *in, size_t a, size_t b)
{
    return b > a ? (of(in, b) - of(in, a)) / (in->time_s[b] - in->time_s[a]) : 0.0;
}

/* Rate of change: central differences of fourth order where the steps are even. */
static double slope_at(signal_of of, const struct schuler_inputs *in, size_t k)
{
    const size_t n = in->rows;
    const double *t = in->time_s;
    if (k < 2 || k + 2 >= n)
        return quotient(of, in, k > 0 ? k - 1 : 0, k + 1 < n ? k + 1 : n - 1);
    const double span = t[k + 2] - t[k - 2], near = quotient(of, in, k - 1, k + 1);
    for (size_t j = 1; j < 5; j++)
        if (fabs(t[k + j - 2] - t[k + j - 3] - span / 4.0) >= 0.01 * span)
            return near;
    return (4.0 * near - quotient(of, in, k - 2, k + 2)) / 3.0;
}

/* First-order lag of x less x; exact for the cubic with the values and slopes of both rows. */
static void add_less_bandwidth(signal_of of, const struct schuler_inputs *in, double tau_s, double gain, double *out)
{
    if (in->rows == 0)
        return;
    double state = of(in, 0), x0 = state, s0 = slope_at(of, in, 0);
    for (size_t k = 1; k < in->rows; k++) {
        const double h = in->time_s[k] - in->time_s[k - 1], decay = exp(-h / tau_s);
        const double x1 = of(in, k), s1 = slope_at(of, in, k), rise = (x1 - x0) / h;
        const double third = 6.0 * (s0 + s1 - 2.0 * rise) / (h * h);
        const double second = 2.0 * (3.0 * rise - 2.0 * s0 - s1) / h;
        const double end = -tau_s * (s1 - tau_s * (second + third * h - tau_s * third));
        const double begin = -tau_s * (s0 - tau_s * (second - tau_s * third));
        state = decay * state + x1 - decay * x0 + end - decay * begin;
        out[k] += gain * (state - x1);
        x0 = x1;
        s0 = s1;
    }
}
";

const DELAY: &str = "
enum outside { OUTSIDE_NOW, OUTSIDE_FIRST, OUTSIDE_STRAIGHT_ON };

static double beyond(signal_of of, const struct schuler_inputs *in, size_t k, double delay_s, enum outside outside)
{
    const size_t end = delay_s < 0.0 && in->rows > 1 ? in->rows - 2 : 0;
    if (outside == OUTSIDE_NOW || in->rows < 2)
        return of(in, k);
    if (outside == OUTSIDE_FIRST)
        return of(in, 0);
    const double own = in->time_s[end + 1] - in->time_s[end], last = delay_s < 0.0 ? own : 0.0;
    const double slope = own > 0.0 ? (of(in, end + 1) - of(in, end)) / own : 0.0;
    const double by = in->time_s[k] - delay_s - in->time_s[end];
    return of(in, end) + slope * fmin(fmax(by, last - 2.0 * own), last + 2.0 * own);
}

/* x as it was delay_s before, by Lagrange's interpolation through up to `reach` rows on either side. */
static void add_delayed(signal_of of, const struct schuler_inputs *in, double delay_s, size_t reach,
                        enum outside outside, int less_now, double gain, double *out)
{
    const size_t n = in->rows;
    const double *t = in->time_s, step = n > 1 ? (t[n - 1] - t[0]) / (double)(n - 1) : 0.0;
    size_t after = 0; /* the first row that is later than what is wanted */
    for (size_t k = 0; k < n; k++) {
        const double wanted = t[k] - delay_s;
        double late = 0.0;
        while (after < n && t[after] <= wanted + 1e-9 * step)
            after++;
        if (after > 0 && fabs(wanted - t[after - 1]) <= 1e-9 * step) {
            late = of(in, after - 1);
        } else if (after == 0 || after == n) {
            late = beyond(of, in, k, delay_s, outside);
        } else {
            size_t sides = after < n - after ? after : n - after;
            sides = sides < reach ? sides : reach;
            for (size_t i = after - sides; i < after + sides; i++) {
                double weight = 1.0;
                for (size_t j = after - sides; j < after + sides; j++)
                    if (j != i)
                        weight *= (wanted - t[j]) / (t[i] - t[j]);
                late += weight * of(in, i);
            }
        }
        out[k] += gain * (less_now ? late - of(in, k) : late);
    }
}
";

const BRANCH: &str = "
/* Branch, -1 to 1, of a play of a half-width; it starts in the middle. */
static void add_branch(signal_of of, const struct schuler_inputs *in, double half_width, double gain, double *out)
{
    double output = in->rows > 0 ? of(in, 0) : 0.0;
    for (size_t k = 0; k < in->rows; k++) {
        const double x = of(in, k);
        output = fmin(fmax(output, x - half_width), x + half_width);
        out[k] += gain * (x - output) / half_width;
    }
}
";

struct C;

impl Language for C {
    fn input(&self, name: &str) -> String {
        format!("in->{name}[k]")
    }
    fn magnitude(&self, x: &str) -> String {
        format!("fabs({x})")
    }
    fn sign(&self, x: &str) -> String {
        format!("(double)(({x} > 0.0) - ({x} < 0.0))")
    }
    fn step(&self, x: &str) -> String {
        format!("({x} >= 0.0 ? 1.0 : 0.0)")
    }
    fn larger(&self, x: &str, y: &str) -> String {
        format!("fmax({x}, {y})")
    }
    fn smaller(&self, x: &str, y: &str) -> String {
        format!("fmin({x}, {y})")
    }
    fn dead_zone(&self, x: &str, threshold: &str) -> String {
        format!("(fabs({x}) < {threshold} ? -{x} : 0.0)")
    }
    fn library(&self, name: &str, x: &str) -> String {
        format!("{name}({x})")
    }
}

/// The source text of the file.
pub fn source(model: &Model) -> String {
    let words = words(model);
    let mut text = String::from("/*\n");
    for line in head(model) {
        let _ = writeln!(text, "{}", format!(" * {line}").trim_end());
    }
    text.push_str(" *\n * schuler_add() adds to the arrays of struct schuler_outputs, which may hold zeros or what a simulation says.\n */\n");
    text.push_str("#include <math.h>\n#include <stddef.h>\n\nstruct schuler_inputs {\n    size_t rows;\n");
    for input in &model.inputs {
        let _ = writeln!(
            text,
            "    const double *{}; /* {}: {} */",
            input.name,
            plain(&input.unit),
            plain(&input.is)
        );
    }
    text.push_str("};\n\nstruct schuler_outputs {\n");
    for output in &model.outputs {
        let (word, sensor) = (word_of(&words, &output.sensor), plain(&output.sensor));
        let _ =
            writeln!(text, "    double *{word}; /* {sensor}, {}: {} */", plain(output.unit), output.enters);
    }
    // A structure has a member at least.
    if model.outputs.is_empty() {
        text.push_str("    double *none;\n");
    }
    text.push_str("};\n");
    for (index, term) in model.terms.iter().enumerate() {
        let (head, x) = (comment(term), sum(&term.signal, &C));
        let _ = write!(
            text,
            "\n/* {head} */\nstatic double signal_{index}(const struct schuler_inputs *in, size_t k)\n{{\n    (void)in;\n    (void)k;\n    return {x};\n}}\n"
        );
    }
    let helpers = helpers(model);
    if !helpers.is_empty() {
        text.push_str("\ntypedef double (*signal_of)(const struct schuler_inputs *in, size_t k);\n");
    }
    for helper in helpers {
        text.push_str(helper);
    }
    text.push_str("\nvoid schuler_add(const struct schuler_inputs *in, const struct schuler_outputs *out)\n{\n    (void)in;\n    (void)out;\n");
    for (index, term) in model.terms.iter().enumerate() {
        let _ = writeln!(text, "    {}", call(index, term, word_of(&words, &term.output)));
    }
    text.push_str("}\n");
    text
}

fn call(index: usize, term: &Term, output: &str) -> String {
    let gain = number(term.amplitude);
    let to = format!("{gain}, out->{output});");
    match term.signal.memory {
        None => {
            format!(
                "for (size_t k = 0; k < in->rows; k++) out->{output}[k] += {gain} * signal_{index}(in, k);"
            )
        }
        Some(Memory::Lag { tau_s }) => format!("add_lagged(signal_{index}, in, {}, {to}", number(tau_s)),
        Some(Memory::Bandwidth { tau_s }) => {
            format!("add_less_bandwidth(signal_{index}, in, {}, {to}", number(tau_s))
        }
        Some(Memory::Branch { half_width }) => {
            format!("add_branch(signal_{index}, in, {}, {to}", number(half_width))
        }
        Some(Memory::Delay { delay_s, reach, outside, less_now }) => {
            let outside = match outside {
                Outside::Now => "OUTSIDE_NOW",
                Outside::First => "OUTSIDE_FIRST",
                Outside::StraightOn => "OUTSIDE_STRAIGHT_ON",
            };
            let (delay, less) = (number(delay_s), i32::from(less_now));
            format!("add_delayed(signal_{index}, in, {delay}, {reach}, {outside}, {less}, {to}")
        }
    }
}

/// The functions that the terms need.
fn helpers(model: &Model) -> Vec<&'static str> {
    super::code::helpers(model, [LAG, BANDWIDTH, DELAY, BRANCH])
}
