//! Values of a formula in the rows of a recording.
use std::fmt;

use schuler_recording::formula::{Expression, Function, INPUT, Node, Operator, TIME};

use crate::inputs::Series;
use crate::inputs::series::{delayed, derivative, lagged, map};

/// What the names of a formula stand for, but for its parameters.
#[derive(Clone, Debug)]
pub(super) struct Names {
    /// Time from the first row, s.
    pub(super) time_s: Series,
    /// The columns, gaps bridged.
    pub(super) columns: Vec<(String, Series)>,
    /// The sensor's own input in its unit.
    pub(super) input: Option<Series>,
}

/// Values of parameters and amplitudes.
pub(super) type Values<'v> = &'v [(&'v str, f64)];

/// A part of a formula that has no value in some rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    /// The character of the formula.
    pub(super) at: usize,
    /// What was found there.
    pub(super) what: String,
    /// The first of the rows, from 0, and their number; none where it is so in all of them.
    pub(super) rows: Option<(usize, usize)>,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "character {}: found {}", self.at, self.what)?;
        match self.rows {
            None => Ok(()),
            Some((first, 1)) => write!(f, " in row {}", first + 1),
            Some((first, count)) => write!(f, " in {count} rows, the first of them row {}", first + 1),
        }
    }
}

/// The value of a part.
#[derive(Clone, Debug)]
enum Value {
    /// The same in all rows.
    Constant(f64),
    /// One a row.
    Rows(Series),
}

impl Value {
    fn map(self, of: impl Fn(f64) -> f64) -> Self {
        match self {
            Self::Constant(value) => Self::Constant(of(value)),
            Self::Rows(values) => Self::Rows(map(&values, of).into()),
        }
    }

    fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        match (self, other) {
            (a, Self::Constant(b)) => a.map(|a| of(a, b)),
            (Self::Constant(a), b) => b.map(|b| of(a, b)),
            (Self::Rows(a), Self::Rows(b)) => {
                Self::Rows(a.iter().zip(&*b).map(|(a, b)| of(*a, *b)).collect())
            }
        }
    }

    /// The same, as the value of a part that must be finite.
    fn finite(self, part: &Node) -> Result<Self, Fault> {
        let is_missing = |value: &f64| !value.is_finite();
        let rows = match &self {
            Self::Constant(value) if is_missing(value) => None,
            Self::Constant(_) => return Ok(self),
            Self::Rows(values) => match values.iter().position(is_missing) {
                Some(first) => Some((first, values.iter().filter(|value| is_missing(value)).count())),
                None => return Ok(self),
            },
        };
        Err(Fault { at: part.at, what: reason(&part.what).to_owned(), rows })
    }
}

impl Names {
    /// The formula in every row.
    ///
    /// # Errors
    /// The first part that has no finite value somewhere.
    pub(super) fn values(&self, formula: &Node, values: Values<'_>) -> Result<Series, Fault> {
        match self.of(formula, values)? {
            Value::Constant(value) => Ok(vec![value; self.time_s.len()].into()),
            Value::Rows(rows) => Ok(rows),
        }
    }

    fn of(&self, node: &Node, values: Values<'_>) -> Result<Value, Fault> {
        let value = match &node.what {
            Expression::Number(number) => Value::Constant(*number),
            Expression::Name(name) => self.named(node.at, name, values)?,
            Expression::Column(name) => self.column(node.at, name)?,
            Expression::Negative(part) => self.of(part, values)?.map(|x| -x),
            Expression::Operation(operator, parts) => {
                let (x, y) = (self.of(&parts[0], values)?, self.of(&parts[1], values)?);
                match operator {
                    Operator::Add => x.with(y, |x, y| x + y),
                    Operator::Subtract => x.with(y, |x, y| x - y),
                    Operator::Multiply => x.with(y, |x, y| x * y),
                    Operator::Divide => x.with(y, |x, y| x / y),
                    Operator::Power => x.with(y, f64::powf),
                }
            }
            Expression::Call(function, arguments) => {
                let arguments: Result<Vec<Value>, Fault> =
                    arguments.iter().map(|part| self.of(part, values)).collect();
                self.call(node.at, *function, arguments?)?
            }
        };
        value.finite(node)
    }

    fn named(&self, at: usize, name: &str, values: Values<'_>) -> Result<Value, Fault> {
        if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
            return Ok(Value::Constant(*value));
        }
        match (name, &self.input) {
            (TIME, _) => Ok(Value::Rows(self.time_s.clone())),
            (INPUT, Some(input)) => Ok(Value::Rows(input.clone())),
            (INPUT, None) => Err(fault(at, "u, the sensor's input, which the case does not tell")),
            _ => self.column(at, name),
        }
    }

    fn column(&self, at: usize, name: &str) -> Result<Value, Fault> {
        let column = self.columns.iter().find(|(known, _)| known == name);
        let missing = || fault(at, &format!("{name}, which has no value in any row"));
        column.map(|(_, values)| Value::Rows(values.clone())).ok_or_else(missing)
    }

    fn call(&self, at: usize, function: Function, arguments: Vec<Value>) -> Result<Value, Fault> {
        let mut arguments = arguments.into_iter();
        let mut next = || arguments.next().unwrap_or(Value::Constant(0.0));
        let (x, y) = (next(), next());
        Ok(match function {
            Function::Sin => x.map(f64::sin),
            Function::Cos => x.map(f64::cos),
            Function::Exp => x.map(f64::exp),
            Function::Log => x.map(f64::ln),
            Function::Sqrt => x.map(f64::sqrt),
            Function::Abs => x.map(f64::abs),
            Function::Sign => x.map(|x| if x == 0.0 { 0.0 } else { x.signum() }),
            Function::Min => x.with(y, f64::min),
            Function::Max => x.with(y, f64::max),
            Function::Step => x.with(y, |x, from| f64::from(x >= from)),
            Function::Derivative => match x {
                Value::Constant(_) => Value::Constant(0.0),
                Value::Rows(values) => Value::Rows(derivative(&self.time_s, &values).into()),
            },
            Function::Lag | Function::Delay => match (x, y) {
                (x, Value::Constant(seconds)) => self.of_the_past(at, function, x, seconds)?,
                _ => return Err(fault(at, "a time constant or a delay that varies")),
            },
        })
    }

    fn of_the_past(&self, at: usize, function: Function, x: Value, seconds: f64) -> Result<Value, Fault> {
        let Value::Rows(values) = x else { return Ok(x) };
        if function == Function::Lag {
            if seconds <= 0.0 {
                return Err(fault(at, &format!("a time constant of {seconds} s")));
            }
            return Ok(Value::Rows(lagged(&self.time_s, &values, seconds).into()));
        }
        // What was before the record, or comes behind it, is taken to be as at its end.
        let end = if seconds > 0.0 { values.first() } else { values.last() };
        let end = end.copied().unwrap_or_default();
        let late = delayed(&self.time_s, &values, seconds).into_iter().map(|value| value.unwrap_or(end));
        Ok(Value::Rows(late.collect()))
    }
}

fn fault(at: usize, what: &str) -> Fault {
    Fault { at, what: what.to_owned(), rows: None }
}

/// Why a part has no finite value.
fn reason(what: &Expression) -> &'static str {
    match what {
        Expression::Operation(Operator::Divide, _) => "a division by zero",
        Expression::Operation(Operator::Power, _) => "a power that is no number",
        Expression::Call(Function::Log, _) => "the logarithm of a number that is not above zero",
        Expression::Call(Function::Sqrt, _) => "the square root of a number below zero",
        _ => "a number beyond all bounds",
    }
}

#[cfg(test)]
mod tests {
    use schuler_recording::formula::Formula;

    use super::*;

    fn names() -> Names {
        let time_s: Series = (0..100).map(|row| 0.5 * f64::from(row)).collect();
        let column = |of: &dyn Fn(f64) -> f64| -> Series { map(&time_s, of).into() };
        let columns = vec![("x".to_owned(), column(&|t| t - 10.0)), ("x^2".to_owned(), column(&|t| t * t))];
        Names { columns, input: None, time_s }
    }

    fn values(text: &str) -> Result<Series, Fault> {
        let formula = Formula::parse(text).unwrap_or_else(|mistake| panic!("{text}: {mistake}"));
        names().values(formula.root(), &[("k", 2.0), ("tau", 4.0)])
    }

    #[test]
    fn functions_of_series_are_those_of_the_inputs() {
        let names = names();
        let (time_s, x) = (&names.time_s, &names.columns[0].1);
        for (text, expected) in [
            ("k * x - x / 4", map(x, |x| 1.75 * x)),
            ("d(`x^2`)", derivative(time_s, &names.columns[1].1)),
            ("lag(x, tau)", lagged(time_s, x, 4.0)),
            ("delay(x, 3)", map(time_s, |t| if t < 3.0 { -10.0 } else { t - 13.0 })),
            ("delay(x, -3)", map(time_s, |t| if t > 46.5 { 39.5 } else { t - 7.0 })),
            ("step(t, 20) * k", map(time_s, |t| if t >= 20.0 { 2.0 } else { 0.0 })),
            ("sign(x) * sqrt(abs(x))", map(x, |x| if x == 0.0 { 0.0 } else { x.signum() * x.abs().sqrt() })),
            ("max(x, 0) ^ 2 + min(k, tau)", map(x, |x| x.max(0.0).powi(2) + 2.0)),
            ("exp(log(tau)) + sin(0) + cos(0)", vec![5.0; 100]),
            ("lag(k, tau) + d(k) + delay(k, 1)", vec![4.0; 100]),
        ] {
            let found = values(text).unwrap_or_else(|fault| panic!("{text}: {fault}"));
            let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-9, "{text}: {off}");
        }
    }

    #[test]
    fn what_has_no_value_is_named_with_its_rows() {
        for (text, said) in [
            ("1 + k / x", "character 7: found a division by zero in row 21"),
            ("k / (x - 3) / x", "character 3: found a division by zero in row 27"),
            (
                "log(x)",
                "character 1: found the logarithm of a number that is not above zero in 21 rows, the first of them row 1",
            ),
            ("sqrt(x)", "found the square root of a number below zero in 20 rows"),
            ("x ^ 0.5", "character 3: found a power that is no number in 20 rows"),
            ("exp(1000 * t)", "found a number beyond all bounds in"),
            ("k / 0", "character 3: found a division by zero"),
            ("lag(x, 0 - tau)", "character 1: found a time constant of -4 s"),
            ("u * k", "character 1: found u, the sensor's input, which the case does not tell"),
            ("y * k", "character 1: found y, which has no value in any row"),
        ] {
            let fault = values(text).expect_err(text).to_string();
            assert!(fault.contains(said), "{text}: {fault}");
        }
    }
}
