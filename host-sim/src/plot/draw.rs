//! Drawing a figure as SVG.
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    BLACK, Cartesian2d, ChartBuilder, ChartContext, Circle, DrawingArea, IntoDrawingArea, IntoFont,
    LineSeries, PathElement, Polygon, RGBColor, Rectangle, SVGBackend, SeriesLabelPosition, WHITE,
};
use plotters::style::{Color, TextStyle};
use schuler_recording::error::is_control;

use super::{Colour, DrawError, Figure, Layer, Panel};

const WIDTH: u32 = 960;
const PANEL_HEIGHT: u32 = 300;
const TITLE_HEIGHT: u32 = 36;
/// Buckets to the right into which a long line is cut; each is drawn as its smallest and largest value.
const BUCKETS: usize = 1200;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Fonts that a browser has, beginning with the one that the PNG is made with.
pub(super) const FONTS: &str = "DejaVu Sans, Verdana, sans-serif";

pub(super) fn svg(figure: &Figure) -> Result<String, DrawError> {
    let mut text = String::new();
    let panels = figure.panels.len().max(1);
    let height = TITLE_HEIGHT + PANEL_HEIGHT * panels as u32;
    {
        let root = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (head, body) = root.split_vertically(TITLE_HEIGHT);
        let style = TextStyle::from((FONTS, 20).into_font()).color(&BLACK);
        head.draw_text(&figure.title, &style, (16, 8)).map_err(failed)?;
        for (area, panel) in body.split_evenly((panels, 1)).iter().zip(&figure.panels) {
            draw_panel(area, panel)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(printable(text))
}

/// The text of a page or figure without control characters, for which XML has no place.
pub(crate) fn printable(text: String) -> String {
    if text.contains(is_control) { text.replace(is_control, "\u{fffd}") } else { text }
}

fn draw_panel(area: &Area<'_>, panel: &Panel) -> Result<(), DrawError> {
    let (x_range, y_range) = ranges(panel);
    let mut chart = ChartBuilder::on(area)
        .margin(8)
        .margin_right(20)
        .x_label_area_size(40)
        .y_label_area_size(76)
        .build_cartesian_2d(x_range.0..x_range.1, y_range.0..y_range.1)
        .map_err(failed)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(225, 225, 225))
        .x_desc(&panel.x_label)
        .y_desc(&panel.y_label)
        .label_style((FONTS, 13))
        .axis_desc_style((FONTS, 14))
        .x_label_formatter(&|v| number(*v, x_range))
        .y_label_formatter(&|v| number(*v, y_range))
        .draw()
        .map_err(failed)?;
    let mut labelled = false;
    for layer in &panel.layers {
        labelled |= draw_layer(&mut chart, layer, x_range, y_range)?;
    }
    if labelled {
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(200, 200, 200))
            .label_font((FONTS, 13))
            .draw()
            .map_err(failed)?;
    }
    Ok(())
}

/// Draws a layer and says whether it stands in the legend.
fn draw_layer(
    chart: &mut Chart<'_, '_>,
    layer: &Layer,
    x_range: (f64, f64),
    y_range: (f64, f64),
) -> Result<bool, DrawError> {
    let clip = |y: f64| y.clamp(y_range.0, y_range.1);
    let label = match layer {
        Layer::Line { label, x, y, colour } => {
            let style = ink(*colour).stroke_width(1);
            let mut first = true;
            for piece in pieces(x, y) {
                let points = thinned(&piece, x_range).into_iter().map(|(x, y)| (x, clip(y)));
                let drawn = chart.draw_series(LineSeries::new(points, style)).map_err(failed)?;
                if first && !label.is_empty() {
                    let colour = ink(*colour);
                    drawn.label(label).legend(move |(x, y)| {
                        PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2))
                    });
                }
                first = false;
            }
            return Ok(!first && !label.is_empty());
        }
        Layer::Points { label, x, y, colour } => {
            let style = ink(*colour).filled();
            let visible = x.iter().zip(y).filter(|(x, y)| x.is_finite() && y.is_finite());
            let points: Vec<(f64, f64)> = visible.map(|(x, y)| (*x, clip(*y))).collect();
            let points = sparse(points);
            let drawn = chart
                .draw_series(points.into_iter().map(|point| Circle::new(point, 1, style)))
                .map_err(failed)?;
            if !label.is_empty() {
                let colour = ink(*colour);
                drawn.label(label).legend(move |(x, y)| Circle::new((x + 9, y), 3, colour.filled()));
            }
            label
        }
        Layer::Band { label, x, low, high, colour } => {
            let band = Band { label, x, low, high, colour: *colour };
            draw_band(chart, &band, x_range, &clip)?;
            label
        }
        Layer::Vertical { label, x, colour } => {
            let line = LineSeries::new([(*x, y_range.0), (*x, y_range.1)], ink(*colour).stroke_width(2));
            let drawn = chart.draw_series(line).map_err(failed)?;
            legend_line(drawn, label, *colour);
            label
        }
        Layer::Horizontal { label, y, colour } => {
            let line =
                LineSeries::new([(x_range.0, clip(*y)), (x_range.1, clip(*y))], ink(*colour).stroke_width(1));
            let drawn = chart.draw_series(line).map_err(failed)?;
            legend_line(drawn, label, *colour);
            label
        }
    };
    Ok(!label.is_empty())
}

fn legend_line(drawn: &mut plotters::chart::SeriesAnno<'_, SVGBackend<'_>>, label: &str, colour: Colour) {
    if !label.is_empty() {
        let colour = ink(colour);
        drawn
            .label(label)
            .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
}

/// A band between two lines.
struct Band<'b> {
    label: &'b str,
    x: &'b [f64],
    low: &'b [f64],
    high: &'b [f64],
    colour: Colour,
}

fn draw_band(
    chart: &mut Chart<'_, '_>,
    band: &Band<'_>,
    x_range: (f64, f64),
    clip: &dyn Fn(f64) -> f64,
) -> Result<(), DrawError> {
    let Band { label, x, low, high, colour } = *band;
    let shade = ink(colour).mix(0.3);
    // Both lines finite, so that their pieces go together.
    let lower: Vec<f64> =
        low.iter().zip(high).map(|(l, h)| if h.is_finite() { *l } else { f64::NAN }).collect();
    let upper: Vec<f64> =
        high.iter().zip(low).map(|(h, l)| if l.is_finite() { *h } else { f64::NAN }).collect();
    let mut first = true;
    for (below, above) in pieces(x, &lower).into_iter().zip(pieces(x, &upper)) {
        let edge = |points: &[(f64, f64)], lowest: bool| envelope(points, x_range, lowest);
        let mut outline: Vec<(f64, f64)> =
            edge(&above, false).into_iter().map(|(x, y)| (x, clip(y))).collect();
        outline.extend(edge(&below, true).into_iter().rev().map(|(x, y)| (x, clip(y))));
        let drawn =
            chart.draw_series(std::iter::once(Polygon::new(outline, shade.filled()))).map_err(failed)?;
        if first && !label.is_empty() {
            drawn
                .label(label)
                .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 18, y + 5)], shade.filled()));
        }
        first = false;
    }
    Ok(())
}

fn ink(colour: Colour) -> RGBColor {
    let (r, g, b) = colour.rgb();
    RGBColor(r, g, b)
}

/// The runs of finite points.
fn pieces(x: &[f64], y: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let mut all: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut open = false;
    for (x, y) in x.iter().zip(y) {
        let finite = x.is_finite() && y.is_finite();
        if finite && !open {
            all.push(Vec::new());
        }
        if finite && let Some(piece) = all.last_mut() {
            piece.push((*x, *y));
        }
        open = finite;
    }
    all
}

/// A line of at most a few thousand points that looks the same: of every bucket the first, smallest, largest and last
/// point, in order.
fn thinned(points: &[(f64, f64)], x_range: (f64, f64)) -> Vec<(f64, f64)> {
    if points.len() <= 4 * BUCKETS {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for bucket in buckets(points, x_range) {
        let smallest = bucket.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(i, _)| i);
        let largest = bucket.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(i, _)| i);
        let mut chosen = [Some(0), smallest, largest, Some(bucket.len() - 1)];
        chosen.sort_unstable();
        let mut last = None;
        for index in chosen.into_iter().flatten() {
            if last != Some(index) {
                kept.push(bucket[index]);
            }
            last = Some(index);
        }
    }
    kept
}

/// The lower or upper edge of a band with at most one point a bucket.
fn envelope(points: &[(f64, f64)], x_range: (f64, f64), lowest: bool) -> Vec<(f64, f64)> {
    if points.len() <= BUCKETS {
        return points.to_vec();
    }
    let mut edge: Vec<(f64, f64)> = buckets(points, x_range)
        .filter_map(|bucket| {
            let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let extreme = if lowest { bucket.iter().min_by(by) } else { bucket.iter().max_by(by) };
            let centre = bucket.get(bucket.len() / 2)?;
            extreme.map(|point| (centre.0, point.1))
        })
        .collect();
    if let (Some(first), Some(point)) = (edge.first_mut(), points.first()) {
        first.0 = point.0;
    }
    if let (Some(last), Some(point)) = (edge.last_mut(), points.last()) {
        last.0 = point.0;
    }
    edge
}

fn buckets(points: &[(f64, f64)], x_range: (f64, f64)) -> impl Iterator<Item = &[(f64, f64)]> {
    let width = (x_range.1 - x_range.0) / BUCKETS as f64;
    points.chunk_by(move |a, b| ((a.0 - x_range.0) / width).floor() == ((b.0 - x_range.0) / width).floor())
}

/// At most some thousand of many points, evenly chosen.
fn sparse(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let every = points.len().div_ceil(4 * BUCKETS).max(1);
    points.into_iter().step_by(every).collect()
}

fn reach(range: &mut (f64, f64), values: &[f64]) {
    for value in values.iter().filter(|v| v.is_finite()) {
        *range = (range.0.min(*value), range.1.max(*value));
    }
}

/// Limits of a panel: those asked for, or those of the values with a margin.
fn ranges(panel: &Panel) -> ((f64, f64), (f64, f64)) {
    let mut x = (f64::INFINITY, f64::NEG_INFINITY);
    let mut y = x;
    for layer in &panel.layers {
        match layer {
            Layer::Line { x: xs, y: ys, .. } | Layer::Points { x: xs, y: ys, .. } => {
                reach(&mut x, xs);
                reach(&mut y, ys);
            }
            Layer::Band { x: xs, low, high, .. } => {
                reach(&mut x, xs);
                reach(&mut y, low);
                reach(&mut y, high);
            }
            Layer::Vertical { .. } => {}
            Layer::Horizontal { y: level, .. } => reach(&mut y, &[*level]),
        }
    }
    let open = |range: (f64, f64), share: f64| {
        if range.0 > range.1 {
            return (0.0, 1.0);
        }
        let width = range.1 - range.0;
        let margin = if width > 0.0 { share * width } else { range.0.abs().max(1e-12) * 0.5 };
        (range.0 - margin, range.1 + margin)
    };
    (open(x, 0.0), panel.y_range.unwrap_or_else(|| open(y, 0.06)))
}

/// A number on an axis: as many digits as its divisions need.
fn number(value: f64, range: (f64, f64)) -> String {
    let width = (range.1 - range.0).abs();
    let largest = range.0.abs().max(range.1.abs());
    let value = if value.abs() < width * 1e-9 { 0.0 } else { value };
    if !(1e-3..1e5).contains(&largest) {
        return format!("{value:.1e}");
    }
    let digits = (2.0 - width.max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn failed(error: impl std::fmt::Display) -> DrawError {
    DrawError(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_extremes_and_ends() {
        let mut points: Vec<(f64, f64)> =
            (0..100_000).map(|k| (f64::from(k), (f64::from(k) * 0.37).sin())).collect();
        points[54_321].1 = 9.0;
        points[12_345].1 = -9.0;
        let kept = thinned(&points, (0.0, 99_999.0));
        assert!(kept.len() < 5000);
        assert!(kept.contains(&(54_321.0, 9.0)) && kept.contains(&(12_345.0, -9.0)));
        assert_eq!((kept.first(), kept.last()), (points.first(), points.last()));
        assert!(kept.windows(2).all(|w| w[0].0 < w[1].0));
    }

    #[test]
    fn numbers_have_the_digits_that_their_axis_needs() {
        assert_eq!(number(0.25, (0.0, 1.0)), "0.25");
        assert_eq!(number(10.0, (0.0, 24.0)), "10");
        assert_eq!(number(1.2e-6, (0.0, 2e-6)), "1.2e-6");
        assert_eq!(number(1e-17, (-1.0, 1.0)), "0");
    }
}
