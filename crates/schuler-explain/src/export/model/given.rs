//! The inputs of an exported model: what was recorded, and what is prepared of it, under names that are words in any language.
use nalgebra::Vector3;
use schuler_recording::recording::AuxiliarySeries;
use serde::{Deserialize, Serialize};

use super::signal::{Factor, Function, Weighted};
use crate::inputs::Series;

/// An input of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Its name.
    pub name: String,
    /// Unit of its values.
    pub unit: String,
    /// What it is.
    pub is: String,
    /// The recorded column, where it is one as it was recorded but for holes, which are bridged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Its values in the recording, one a row.
    #[serde(skip, default = "none")]
    pub values: Series,
}

fn none() -> Series {
    Vec::new().into()
}

/// The inputs of a model in the making.
#[derive(Clone, Debug, Default)]
pub struct Given {
    /// The inputs.
    pub inputs: Vec<Input>,
}

impl Given {
    /// The values of an input.
    pub fn values(&self, name: &str) -> Option<&[f64]> {
        self.inputs.iter().find(|input| input.name == name).map(|input| &*input.values)
    }

    /// Puts an input down once and tells its name.
    pub fn put(&mut self, wanted: &str, unit: &str, is: &str, values: &Series) -> String {
        self.put_column(wanted, unit, is, None, values)
    }

    /// The same with the column that it is.
    pub fn put_column(
        &mut self,
        wanted: &str,
        unit: &str,
        is: &str,
        column: Option<&str>,
        values: &Series,
    ) -> String {
        let wanted = word(wanted);
        let is_it = |input: &&Input| input.is == is && input.values == *values;
        if let Some(known) = self.inputs.iter().find(is_it) {
            return known.name.clone();
        }
        let taken = |name: &str| self.inputs.iter().any(|input| input.name == name);
        let numbered = (2..).map(|number| format!("{wanted}_{number}"));
        let name =
            std::iter::once(wanted.clone()).chain(numbered).find(|name| !taken(name)).unwrap_or(wanted);
        self.inputs.push(Input {
            name: name.clone(),
            unit: unit.to_owned(),
            is: is.to_owned(),
            column: column.map(str::to_owned),
            values: values.clone(),
        });
        name
    }

    /// A recorded quantity.
    pub fn recorded(&mut self, series: &AuxiliarySeries, values: &Series, smoothed: bool) -> String {
        let auxiliary = &series.auxiliary;
        let column = auxiliary.column.as_str();
        if smoothed {
            let is = format!("what changes smoothly in column {column}");
            return self.put(&format!("smoothed_{column}"), &auxiliary.unit, &is, values);
        }
        let is = format!("column {column}");
        self.put_column(&format!("recorded_{column}"), &auxiliary.unit, &is, Some(column), values)
    }

    /// Components along a direction of a vector, of which name, unit and what it is are given.
    pub fn along(
        &mut self,
        vector: (&str, &str, &str),
        direction: &Vector3<f64>,
        vectors: &[Series; 3],
    ) -> Vec<Weighted> {
        let (name, unit, is) = vector;
        let axes = ["x", "y", "z"].iter().zip(direction.iter()).zip(vectors);
        let parts = axes.filter(|((_, weight), _)| **weight != 0.0);
        parts
            .map(|((axis, &weight), values)| Weighted {
                input: self.put(&format!("{name}_{axis}"), unit, &format!("{is}, body axis {axis}"), values),
                weight,
            })
            .collect()
    }
}

/// Weighted inputs as a factor.
pub fn factor(of: Vec<Weighted>, exponent: u8) -> Factor {
    Factor::new(of, 0.0, Function::Power { exponent })
}

/// A name as a word of letters, digits and underscores that begins with a letter.
pub fn word(name: &str) -> String {
    let word: String = name
        .chars()
        .map(|it| if it.is_ascii_alphanumeric() { it.to_ascii_lowercase() } else { '_' })
        .collect();
    if word.starts_with(|it: char| it.is_ascii_alphabetic()) { word } else { format!("x_{word}") }
}
