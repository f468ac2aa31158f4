//! What the page's plots show: thinned, in the unit of the case, with a caption that says what to see.
use schuler_explain::diagnostics::{
    Autocorrelation, CaseEvidence, Compared, Dependence, SensorEvidence, Whiteness,
};
use serde::{Serialize, Serializer};

use super::Report;
use super::number::{duration, percent, plain, printed_unit};
use super::thin;
use super::words;

/// Blocks over which innovations are averaged.
const BLOCKS: usize = 150;
/// Significant digits of what is drawn upwards and to the right.
const DIGITS_Y: usize = 4;
const DIGITS_X: usize = 7;
/// Half width of the error bars in standard deviations.
const ERROR_BARS: f64 = 2.0;

/// A plot with what stands beside it.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Chart {
    #[serde(skip)]
    pub title: String,
    /// What it shows and what to see.
    #[serde(skip)]
    pub caption: String,
    /// The same for those who do not see it, with numbers.
    #[serde(skip)]
    pub summary: String,
    pub x_label: String,
    pub y_label: String,
    /// Whether both axes are logarithmic.
    pub logarithmic: bool,
    /// Charts of the same group zoom and point together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    pub x: Numbers,
    pub curves: Vec<Curve>,
    /// Places of the curves between which the area is filled: upper and lower.
    pub bands: Vec<[usize; 2]>,
    /// Spans to the right.
    pub shades: Vec<Shade>,
    /// Levels.
    pub levels: Vec<f64>,
}

/// A line or points.
#[derive(Debug, Serialize)]
pub(super) struct Curve {
    pub label: String,
    /// In which of the page's three views it is there.
    pub views: &'static [&'static str],
    pub look: Look,
    pub ink: Ink,
    pub y: Numbers,
    /// Half width of error bars.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<Numbers>,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Look {
    Line,
    Thin,
    Dash,
    Dots,
    Marks,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Ink {
    Before,
    After,
    Explained,
    Limit,
}

#[derive(Debug, Serialize)]
pub(super) struct Shade {
    pub from: f64,
    pub to: f64,
    pub kind: &'static str,
}

const BEFORE: &[&str] = &["before", "both"];
const AFTER: &[&str] = &["after", "both"];
const ONLY_BEFORE: &[&str] = &["before"];
const ONLY_AFTER: &[&str] = &["after"];
const ALWAYS: &[&str] = &["before", "after", "both"];

/// Numbers with as many digits as can be seen; what is not finite becomes `null`.
#[derive(Debug)]
pub(super) struct Numbers {
    pub values: Vec<f64>,
    digits: usize,
}

impl Serialize for Numbers {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.values.iter().map(|value| rounded(*value, self.digits)))
    }
}

fn rounded(value: f64, digits: usize) -> Option<f64> {
    value.is_finite().then(|| format!("{value:.*e}", digits - 1).parse().unwrap_or(value))
}

fn heights(values: Vec<f64>) -> Numbers {
    Numbers { values, digits: DIGITS_Y }
}

fn places(values: Vec<f64>) -> Numbers {
    Numbers { values, digits: DIGITS_X }
}

fn curve(label: &str, views: &'static [&'static str], look: Look, ink: Ink, y: Vec<f64>) -> Curve {
    Curve { label: label.to_owned(), views, look, ink, y: heights(y), error: None }
}

/// The unit in which times are shown: name and length, s.
fn time_unit(length_s: f64) -> (&'static str, f64) {
    match length_s {
        s if s > 7200.0 => ("h", 3600.0),
        s if s > 300.0 => ("min", 60.0),
        _ => ("s", 1.0),
    }
}

/// The plots of each sensor, in the order of the evidence.
pub(super) fn of_sensors(report: &Report) -> Vec<Vec<Chart>> {
    let length_s = report.recorded.length_s;
    (report.evidence.sensors.iter().enumerate())
        .map(|(index, sensor)| {
            let context = Context { report, evidence: &report.evidence, time: time_unit(length_s), index };
            let mut charts = vec![context.residual(sensor)];
            charts.extend(sensor.dependences.iter().map(|it| context.dependence(sensor, it)));
            charts.push(context.innovation(sensor));
            charts.push(autocorrelation(&sensor.autocorrelation));
            charts.push(whiteness(&sensor.whiteness));
            charts.push(density(sensor));
            charts.retain(|chart| chart.curves.iter().any(|it| it.y.values.iter().any(|y| y.is_finite())));
            charts
        })
        .collect()
}

struct Context<'r> {
    report: &'r Report,
    evidence: &'r CaseEvidence,
    time: (&'static str, f64),
    index: usize,
}

impl Context<'_> {
    fn time(&self) -> Vec<f64> {
        self.evidence.time_s.iter().map(|time| time / self.time.1).collect()
    }

    fn over_time(&self, y_label: String) -> Chart {
        let in_unit =
            |[from, to]: [f64; 2], kind| Shade { from: from / self.time.1, to: to / self.time.1, kind };
        Chart {
            group: Some(format!("time-{}", self.index)),
            shades: self.evidence.held_out_s.iter().map(|block| in_unit(*block, "held_out")).collect(),
            ..blank(format!("time, {}", self.time.0), y_label)
        }
    }

    fn residual(&self, sensor: &SensorEvidence) -> Chart {
        let unit = printed_unit(sensor.unit.name());
        let in_unit =
            |values: &[f64]| -> Vec<f64> { values.iter().map(|v| v / sensor.unit.in_si()).collect() };
        let (residual, explained, remainder) =
            (in_unit(&sensor.residual), in_unit(&sensor.explained), in_unit(&sensor.remainder));
        let (x, thinned) = thin::thin(&self.time(), &[&residual, &remainder, &explained]);
        let mut curves = Vec::new();
        let looks = [
            ("recorded − simulated", BEFORE, Look::Thin, Ink::Before),
            ("remainder", AFTER, Look::Thin, Ink::After),
            ("explained", BEFORE, Look::Line, Ink::Explained),
        ];
        let found = !sensor.findings.is_empty();
        for ((label, views, look, ink), y) in looks.into_iter().zip(thinned) {
            if found || matches!(ink, Ink::Before) {
                let views = if found { views } else { ALWAYS };
                curves.push(curve(label, views, look, ink, y));
            }
        }
        let mut chart = self.over_time(format!("residual, {unit}"));
        for finding in sensor.findings.iter().filter_map(|k| self.report.explanation.findings.get(*k)) {
            let [from, to] = finding.interval_s;
            if from > 0.001 * self.report.recorded.length_s || to < 0.999 * self.report.recorded.length_s {
                chart.shades.push(Shade { from: from / self.time.1, to: to / self.time.1, kind: "finding" });
            }
        }
        let Compared { before, after } = sensor.rms;
        let rms = |value: f64| plain(value / sensor.unit.in_si(), 3);
        let held_out = if self.evidence.held_out_s.is_empty() {
            ""
        } else {
            " The grey stretches were kept from the fit: it must be as small there as elsewhere."
        };
        let interval = if chart.shades.iter().any(|shade| shade.kind == "finding") {
            " Dashed lines: where a finding begins or ends."
        } else {
            ""
        };
        chart.summary = if found {
            format!(
                "Root mean square about the mean: {} {unit} before, {} {unit} after.",
                rms(before),
                rms(after)
            )
        } else {
            format!("Root mean square about the mean: {} {unit}. Nothing of it is explained.", rms(before))
        };
        chart.caption = if found {
            format!("What is left after the findings should have no shape of its own.{held_out}{interval}")
        } else {
            format!("What was recorded less what was simulated.{held_out}")
        };
        chart.title = "Residual over time".into();
        chart.x = places(x);
        chart.curves = curves;
        chart
    }

    fn dependence(&self, sensor: &SensorEvidence, it: &Dependence) -> Chart {
        let to_unit = 1.0 / sensor.unit.in_si();
        let (unit, mut cause_unit, mut cause_factor) =
            (printed_unit(sensor.unit.name()), printed_unit(&it.cause.unit), 1.0);
        if it.cause.unit == "s" {
            (cause_unit, cause_factor) = (self.time.0.to_owned(), 1.0 / self.time.1);
        }
        let effect = self.report.explanation.findings.get(it.finding).map_or("", |found| &found.effect);
        let all = it.cause.values.iter().zip(&it.residual).zip(&it.explained);
        let all: Vec<[f64; 3]> = all.map(|((x, y), e)| [*x, *y, *e]).collect();
        let rows = thin::cloud(all.len(), |row| {
            all.get(row).is_some_and(|values| values.iter().all(|value| value.is_finite()))
        });
        let mut points: Vec<Point> = rows
            .into_iter()
            .filter_map(|row| all.get(row))
            .map(|[x, y, e]| Point { x: *x, before: *y, after: y - e, ..Point::NONE })
            .collect();
        points.extend(it.bins.iter().map(|bin| Point {
            x: bin.cause,
            mean_before: bin.residual,
            mean_after: bin.residual - bin.explained,
            explained: bin.explained,
            error: ERROR_BARS * bin.sigma,
            ..Point::NONE
        }));
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let column = |of: fn(&Point) -> f64| -> Vec<f64> { points.iter().map(|p| of(p) * to_unit).collect() };
        let error = column(|p| p.error);
        let with_error = |of: Curve| Curve { error: Some(heights(error.clone())), ..of };
        let curves = vec![
            curve("each", BEFORE, Look::Dots, Ink::Before, column(|p| p.before)),
            curve("each, after", ONLY_AFTER, Look::Dots, Ink::After, column(|p| p.after)),
            curve("effect found", BEFORE, Look::Line, Ink::Explained, column(|p| p.explained)),
            with_error(curve("mean", BEFORE, Look::Marks, Ink::Before, column(|p| p.mean_before))),
            with_error(curve("mean, after", AFTER, Look::Marks, Ink::After, column(|p| p.mean_after))),
        ];
        let chart = blank(
            format!("{}, {cause_unit}", it.cause.name),
            format!("residual less other findings, {unit}"),
        );
        let off = |of: fn(&schuler_explain::diagnostics::Bin) -> f64| {
            let off = it.bins.iter().filter(|bin| of(bin).abs() > ERROR_BARS * bin.sigma).count();
            format!("{off} of {}", it.bins.len())
        };
        Chart {
            title: format!("{} against {}", words::name_of(effect), it.cause.name),
            caption: "Marks: means over equally many rows, with bars of ±2 σ that allow for correlated noise. Before, they \
                 should follow the line of the effect; after, lie about zero."
                .to_owned(),
            summary: format!(
                "Means more than 2 σ from zero: {} before, {} after.",
                off(|bin| bin.residual),
                off(|bin| bin.residual - bin.explained)
            ),
            x: places(points.iter().map(|point| point.x * cause_factor).collect()),
            curves,
            ..chart
        }
    }

    fn innovation(&self, sensor: &SensorEvidence) -> Chart {
        let time = self.time();
        let (x, thinned) = thin::thin(&time, &[&sensor.innovation.before, &sensor.innovation.after]);
        let mut thinned = thinned.into_iter();
        let (before, after) = (thinned.next().unwrap_or_default(), thinned.next().unwrap_or_default());
        let size = time.len().div_ceil(BLOCKS).max(1);
        let blocks_before = block_means(&sensor.innovation.before, size);
        let blocks_after = block_means(&sensor.innovation.after, size);
        let centres: Vec<f64> =
            time.chunks(size).map(|block| block.get(block.len() / 2).copied().unwrap_or(f64::NAN)).collect();
        let (x, columns) = merged(&x, &[before, after], &centres, &[blocks_before, blocks_after]);
        let inks = [
            ("each, before", ONLY_BEFORE, Look::Thin, Ink::Before),
            ("each, after", ONLY_AFTER, Look::Thin, Ink::After),
            ("mean of a block, before", BEFORE, Look::Marks, Ink::Before),
            ("mean of a block, after", AFTER, Look::Marks, Ink::After),
        ];
        let curves = (inks.into_iter().zip(columns))
            .map(|((label, views, look, ink), y)| curve(label, views, look, ink, y))
            .collect();
        let chart = self.over_time("standard deviations".into());
        let beyond = |values: &[f64]| {
            let means = block_means(values, size);
            let known = means.iter().filter(|mean| mean.is_finite()).count();
            let beyond = means.iter().filter(|mean| mean.abs() > 3.0).count();
            format!("{beyond} of {known}")
        };
        Chart {
            title: "Innovations over time".into(),
            caption: format!(
                "What each reading adds to its prediction, over its expected standard deviation. Marks: means over {} \
                 times the root of their number; 99.7 % of them lie within ±3 if the model is right.",
                duration(size as f64 * self.evidence.step_s)
            ),
            summary: format!(
                "Block means beyond ±3: {} before, {} after.",
                beyond(&sensor.innovation.before),
                beyond(&sensor.innovation.after)
            ),
            x: places(x),
            curves,
            levels: vec![-3.0, 3.0],
            ..chart
        }
    }
}

/// A point of a cloud, or a mean.
#[derive(Clone, Copy)]
struct Point {
    x: f64,
    before: f64,
    after: f64,
    mean_before: f64,
    mean_after: f64,
    explained: f64,
    error: f64,
}

impl Point {
    const NONE: Self = Self {
        x: f64::NAN,
        before: f64::NAN,
        after: f64::NAN,
        mean_before: f64::NAN,
        mean_after: f64::NAN,
        explained: f64::NAN,
        error: f64::NAN,
    };
}

/// Sum over √n of each block with at least half of its values: standard normal for white noise of variance one.
fn block_means(values: &[f64], size: usize) -> Vec<f64> {
    values
        .chunks(size)
        .map(|block| {
            let present = block.iter().filter(|value| value.is_finite());
            let count = present.clone().count();
            if 2 * count < block.len().max(1) {
                f64::NAN
            } else {
                present.sum::<f64>() / (count as f64).sqrt()
            }
        })
        .collect()
}

/// Columns over two sets of places as columns over both, in order.
fn merged(
    x: &[f64],
    columns: &[Vec<f64>],
    other_x: &[f64],
    others: &[Vec<f64>],
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let mut order: Vec<(f64, bool, usize)> = x.iter().enumerate().map(|(k, x)| (*x, false, k)).collect();
    order.extend(other_x.iter().enumerate().map(|(k, x)| (*x, true, k)));
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let pick = |column: &Vec<f64>, wanted: bool| {
        let at = |(_, other, k): &(f64, bool, usize)| {
            if *other == wanted { column.get(*k).copied().unwrap_or(f64::NAN) } else { f64::NAN }
        };
        order.iter().map(at).collect()
    };
    let all = columns.iter().map(|c| pick(c, false)).chain(others.iter().map(|c| pick(c, true))).collect();
    (order.iter().map(|(x, _, _)| *x).collect(), all)
}

fn blank(x_label: String, y_label: String) -> Chart {
    Chart {
        title: String::new(),
        caption: String::new(),
        summary: String::new(),
        x_label,
        y_label,
        logarithmic: false,
        group: None,
        x: places(Vec::new()),
        curves: Vec::new(),
        bands: Vec::new(),
        shades: Vec::new(),
        levels: Vec::new(),
    }
}

/// The longer of two series over the same places: one may be empty.
fn longer<'v>(a: &'v [f64], b: &'v [f64]) -> &'v [f64] {
    if a.len() >= b.len() { a } else { b }
}

fn autocorrelation(found: &Compared<Autocorrelation>) -> Chart {
    let Compared { before, after } = found;
    let lag_s = longer(&before.lag_s, &after.lag_s);
    let (unit, length) = time_unit(lag_s.last().copied().unwrap_or_default());
    let x: Vec<f64> = lag_s.iter().map(|lag| lag / length).collect();
    let band = longer(&before.band, &after.band);
    let below: Vec<f64> = band.iter().map(|value| -value).collect();
    let (x, columns) = thin::thin(&x, &[&before.correlation, &after.correlation, band, &below]);
    let inks = [
        ("before", BEFORE, Look::Thin, Ink::Before),
        ("after", AFTER, Look::Thin, Ink::After),
        ("95 % of white noise", ALWAYS, Look::Dash, Ink::Limit),
        ("", ALWAYS, Look::Dash, Ink::Limit),
    ];
    let curves = (inks.into_iter().zip(columns)).map(|((l, v, look, ink), y)| curve(l, v, look, ink, y));
    Chart {
        title: "Autocorrelation of the innovations".into(),
        caption:
            "If nothing is left to predict, 95 % of the lags lie within the band of white noise, in no order."
                .into(),
        summary: format!(
            "Lags outside of the band: {} before, {} after; 5 % are expected.",
            percent(before.outside()),
            percent(after.outside())
        ),
        x: places(x),
        curves: curves.collect(),
        bands: vec![[2, 3]],
        levels: vec![0.0],
        ..blank(format!("lag, {unit}"), "correlation".into())
    }
}

fn whiteness(found: &Compared<Whiteness>) -> Chart {
    let Compared { before, after } = found;
    let wide = if before.low.len() >= after.low.len() { before } else { after };
    let curves = vec![
        curve("before", BEFORE, Look::Line, Ink::Before, before.power.clone()),
        curve("after", AFTER, Look::Line, Ink::After, after.power.clone()),
        curve("95 % of white noise", ALWAYS, Look::Dash, Ink::Limit, wide.high.clone()),
        curve("", ALWAYS, Look::Dash, Ink::Limit, wide.low.clone()),
    ];
    Chart {
        title: "Spectrum of the innovations".into(),
        caption: "White noise is flat at 1 and 95 % of it within the band; a bump says at which frequency the model \
                  still lacks something."
            .into(),
        summary: format!(
            "Frequencies outside of the band: {} before, {} after; 5 % are expected.",
            percent(before.outside()),
            percent(after.outside())
        ),
        logarithmic: true,
        x: places(longer(&before.frequency_hz, &after.frequency_hz).to_vec()),
        curves,
        bands: vec![[2, 3]],
        ..blank("frequency, Hz".into(), "power, white = 1".into())
    }
}

fn density(sensor: &SensorEvidence) -> Chart {
    let Compared { before, after } = &sensor.density;
    let unit = printed_unit(sensor.unit.name());
    let in_unit =
        |values: &[f64]| values.iter().map(|value| value / sensor.unit.in_si()).collect::<Vec<f64>>();
    let curves = vec![
        curve("recorded − simulated", BEFORE, Look::Line, Ink::Before, in_unit(&before.amplitude)),
        curve("remainder", AFTER, Look::Line, Ink::After, in_unit(&after.amplitude)),
    ];
    let lowest = |values: &[f64]| {
        values.first().map_or_else(|| "unknown".into(), |v| plain(v / sensor.unit.in_si(), 2))
    };
    Chart {
        title: "Spectral density of the residual".into(),
        caption:
            "Where the curves part, the findings explain what the sensor does at that frequency; where they \
                  run together, it is noise."
                .into(),
        summary: format!(
            "At the lowest frequency: {} {unit}/√Hz before, {} {unit}/√Hz after.",
            lowest(&before.amplitude),
            lowest(&after.amplitude)
        ),
        logarithmic: true,
        x: places(longer(&before.frequency_hz, &after.frequency_hz).to_vec()),
        curves,
        ..blank("frequency, Hz".into(), format!("density, {unit}/√Hz"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_what_is_missing_is_null() {
        let text = serde_json::to_string(&heights(vec![1.0 / 3.0, f64::NAN, 2.0, -1.23456e-9])).unwrap();
        assert_eq!(text, "[0.3333,null,2.0,-1.235e-9]");
    }

    #[test]
    fn block_means_are_standard_normal_sums() {
        let means = block_means(&[1.0, 1.0, 1.0, 1.0, f64::NAN, f64::NAN, f64::NAN, 3.0, 2.0], 4);
        assert_eq!(means[0], 2.0);
        assert!(means[1].is_nan());
        assert_eq!(means[2], 2.0);
    }

    #[test]
    fn merging_keeps_every_value_at_its_place() {
        let (x, columns) = merged(&[0.0, 2.0], &[vec![5.0, 6.0]], &[1.0], &[vec![7.0]]);
        assert_eq!(x, [0.0, 1.0, 2.0]);
        assert_eq!((columns[0][0], columns[0][2], columns[1][1]), (5.0, 6.0, 7.0));
        assert!(columns[0][1].is_nan() && columns[1][0].is_nan());
    }
}
