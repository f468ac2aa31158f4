//! Figures: stacked panels of lines, bands and points, as SVG and PNG.
//!
//! An SVG names its font, so that any browser can show it; the PNG is that SVG, rasterised with an embedded font of the
//! same family. Colours are the palette of Okabe and Ito, which colour-blind readers can tell apart.
mod draw;
pub mod envelope;
mod raster;

use std::path::{Path, PathBuf};

use schuler_recording::{Error, Problem};

use crate::output;

pub(crate) use draw::printable;

/// A figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Its title.
    pub title: String,
    /// From top to bottom.
    pub panels: Vec<Panel>,
}

/// One diagram of a figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// What runs to the right, with its unit.
    pub x_label: String,
    /// What runs upwards, with its unit.
    pub y_label: String,
    /// Limits upwards; none: as the values are.
    pub y_range: Option<(f64, f64)>,
    /// From back to front.
    pub layers: Vec<Layer>,
}

/// What a panel shows.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// A line through points; a value that is not finite breaks it.
    Line {
        /// For the legend; empty: not there.
        label: String,
        /// To the right.
        x: Vec<f64>,
        /// Upwards.
        y: Vec<f64>,
        /// Colour.
        colour: Colour,
    },
    /// Points.
    Points {
        /// For the legend.
        label: String,
        /// To the right.
        x: Vec<f64>,
        /// Upwards.
        y: Vec<f64>,
        /// Colour.
        colour: Colour,
    },
    /// The area between two lines.
    Band {
        /// For the legend.
        label: String,
        /// To the right.
        x: Vec<f64>,
        /// Lower line.
        low: Vec<f64>,
        /// Upper line.
        high: Vec<f64>,
        /// Colour.
        colour: Colour,
    },
    /// An event.
    Vertical {
        /// For the legend.
        label: String,
        /// Where.
        x: f64,
        /// Colour.
        colour: Colour,
    },
    /// A level.
    Horizontal {
        /// For the legend.
        label: String,
        /// Where.
        y: f64,
        /// Colour.
        colour: Colour,
    },
}

/// The palette of Okabe and Ito.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Black.
    Black,
    /// Orange.
    Orange,
    /// Sky blue.
    Sky,
    /// Bluish green.
    Green,
    /// Blue.
    Blue,
    /// Vermillion.
    Red,
    /// Reddish purple.
    Purple,
    /// Grey, for what is in the background.
    Grey,
}

impl Colour {
    /// For the k-th of several things of the same sort.
    pub fn nth(k: usize) -> Self {
        [Self::Blue, Self::Orange, Self::Green, Self::Red, Self::Purple, Self::Sky, Self::Black][k % 7]
    }

    const fn rgb(self) -> (u8, u8, u8) {
        match self {
            Self::Black => (0, 0, 0),
            Self::Orange => (230, 159, 0),
            Self::Sky => (86, 180, 233),
            Self::Green => (0, 158, 115),
            Self::Blue => (0, 114, 178),
            Self::Red => (213, 94, 0),
            Self::Purple => (204, 121, 167),
            Self::Grey => (150, 150, 150),
        }
    }
}

/// A form in which figures are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Scalable, for browsers.
    Svg,
    /// Pixels.
    Png,
}

/// Why a figure could not be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the figure cannot be drawn: {0}")]
pub struct DrawError(pub(crate) String);

impl Figure {
    /// The figure as SVG.
    ///
    /// # Errors
    /// A figure without extent.
    pub fn to_svg(&self) -> Result<String, DrawError> {
        draw::svg(self)
    }

    /// The figure as PNG.
    ///
    /// # Errors
    /// As [`Figure::to_svg`].
    pub fn to_png(&self) -> Result<Vec<u8>, DrawError> {
        raster::png(&self.to_svg()?)
    }

    /// Writes the figure into a directory under a name (of which [`output::file_name`] makes that of the file), in every form
    /// asked for, each file whole or not at all.
    ///
    /// # Errors
    /// A figure that cannot be drawn, a file that cannot be written.
    pub fn write(&self, directory: &Path, name: &str, formats: &[Format]) -> Result<Vec<PathBuf>, Error> {
        let mut written = Vec::new();
        for format in formats {
            let (ending, bytes) = match format {
                Format::Svg => ("svg", self.to_svg().map(String::into_bytes)),
                Format::Png => ("png", self.to_png()),
            };
            let path = directory.join(format!("{}.{ending}", output::file_name(name)));
            let bytes = bytes.map_err(|error| Error::one(&path, Problem::of_file(error.to_string())))?;
            output::write(&path, &bytes)?;
            written.push(path);
        }
        Ok(written)
    }
}

impl Panel {
    /// An empty panel.
    pub fn new(x_label: &str, y_label: &str) -> Self {
        Self { x_label: x_label.to_owned(), y_label: y_label.to_owned(), ..Self::default() }
    }

    /// With a layer more.
    #[must_use]
    pub fn with(mut self, layer: Layer) -> Self {
        self.layers.push(layer);
        self
    }

    /// With a line more.
    #[must_use]
    pub fn line(self, label: &str, x: &[f64], y: Vec<f64>, colour: Colour) -> Self {
        self.with(Layer::Line { label: label.to_owned(), x: x.to_vec(), y, colour })
    }

    /// With points more.
    #[must_use]
    pub fn points(self, label: &str, x: &[f64], y: Vec<f64>, colour: Colour) -> Self {
        self.with(Layer::Points { label: label.to_owned(), x: x.to_vec(), y, colour })
    }

    /// With a band more.
    #[must_use]
    pub fn band(self, label: &str, x: &[f64], low: Vec<f64>, high: Vec<f64>, colour: Colour) -> Self {
        self.with(Layer::Band { label: label.to_owned(), x: x.to_vec(), low, high, colour })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let x: Vec<f64> = (0..20_000).map(|k| f64::from(k) / 3600.0).collect();
        let y: Vec<f64> = x.iter().map(|t| (t * 3.0).sin()).collect();
        let mut gap = y.clone();
        gap[5000..6000].fill(f64::NAN);
        Figure {
            title: "Vertical error δ ± 3σ".to_owned(),
            panels: vec![
                Panel::new("time, h", "δ, ″")
                    .band(
                        "±3σ",
                        &x,
                        y.iter().map(|v| v - 0.3).collect(),
                        y.iter().map(|v| v + 0.3).collect(),
                        Colour::Sky,
                    )
                    .line("estimate", &x, gap, Colour::Blue),
                Panel::new("time, h", "χ²")
                    .points("NIS", &x[..100], y[..100].to_vec(), Colour::Red)
                    .with(Layer::Horizontal { label: "limit".into(), y: 0.5, colour: Colour::Grey })
                    .with(Layer::Vertical { label: "fault".into(), x: 0.01, colour: Colour::Orange }),
            ],
        }
    }

    #[test]
    fn svg_has_text_and_is_small_whatever_the_length_of_the_data() {
        let svg = figure().to_svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in ["δ ± 3σ", "time, h", "estimate", "limit", "fault"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(svg.len() < 400_000, "{}", svg.len());
    }

    #[test]
    fn png_shows_letters_and_curves() {
        let png = figure().to_png().unwrap();
        assert_eq!(&png[1..4], b"PNG");
        let pixmap = resvg::tiny_skia::Pixmap::decode_png(&png).unwrap();
        // The title's strip is not blank: the embedded font was found.
        let title = &pixmap.data()[..pixmap.width() as usize * 4 * 30];
        assert!(title.chunks(4).filter(|p| p[0] < 100).count() > 100);
    }

    #[test]
    fn empty_and_constant_figures_can_be_drawn() {
        let nothing = Figure { title: "none".into(), panels: vec![Panel::new("x", "y")] };
        assert!(nothing.to_svg().is_ok());
        let x = [0.0, 1.0];
        let flat = Panel::new("x", "y").line("flat", &x, vec![2.0, 2.0], Colour::Blue);
        let missing = Panel::new("x", "y").line("missing", &x, vec![f64::NAN; 2], Colour::Blue);
        assert!(Figure { title: String::new(), panels: vec![flat, missing] }.to_svg().is_ok());
    }

    #[test]
    fn figures_are_written_under_their_names() {
        let directory = tempfile::tempdir().unwrap();
        let written = figure().write(directory.path(), "delta", &[Format::Svg, Format::Png]).unwrap();
        assert!(written.iter().all(|path| path.exists()));
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2);
    }
}
