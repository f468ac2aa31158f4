//! Formulas of effects that a case defines: arithmetic over the columns of its table.
//!
//! | module | does |
//! | --- | --- |
//! | `grammar` | text to an [`Expression`] |
//! | [`check`] | which names are amplitudes, and whether the formula is linear in them |
//!
//! A formula knows no table: what its names stand for, and its values, are the business of whoever has one.
pub mod check;
mod grammar;

use std::cell::RefCell;
use std::fmt;

use serde::{Serialize, Serializer};

use crate::document::suggestion;

/// The name of the sensor's own input.
pub const INPUT: &str = "u";
/// The name of the time from the first row, s.
pub const TIME: &str = "t";
/// Longest formula, characters: deeper nesting than that is no physics.
const LONGEST: usize = 1000;

/// A formula: `k * lag(temp_x, tau_s) * rate_x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    text: String,
    root: Node,
}

/// A part of a formula.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The character of the formula at which it begins, of an operation that of its sign, from 1.
    pub at: usize,
    /// What it is.
    pub what: Expression,
}

/// What a part of a formula is.
#[derive(Clone, Debug, PartialEq)]
pub enum Expression {
    /// A number.
    Number(f64),
    /// A column, [`INPUT`], [`TIME`], a parameter or an amplitude.
    Name(String),
    /// A column between backticks, whatever its name.
    Column(String),
    /// The opposite.
    Negative(Box<Node>),
    /// Two parts and what is done to them.
    Operation(Operator, Box<[Node; 2]>),
    /// A function of one part or several.
    Call(Function, Vec<Node>),
}

/// What is done to two parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `^`
    Power,
}

/// A function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Sine of radians.
    Sin,
    /// Cosine of radians.
    Cos,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Log,
    /// Square root.
    Sqrt,
    /// Absolute value.
    Abs,
    /// −1, 0 or 1.
    Sign,
    /// The smaller of two.
    Min,
    /// The larger of two.
    Max,
    /// `d(x)`: rate of change, 1/s.
    Derivative,
    /// `lag(x, tau)`: first-order lag with the time constant tau, s, at rest at first.
    Lag,
    /// `delay(x, by)`: x as it was so many seconds before.
    Delay,
    /// `step(x, x0)`: 1 where x has reached x0, 0 elsewhere.
    Step,
}

impl Function {
    /// Every function under its name.
    pub const NAMES: [(&'static str, Function); 13] = [
        ("sin", Function::Sin),
        ("cos", Function::Cos),
        ("exp", Function::Exp),
        ("log", Function::Log),
        ("sqrt", Function::Sqrt),
        ("abs", Function::Abs),
        ("sign", Function::Sign),
        ("min", Function::Min),
        ("max", Function::Max),
        ("d", Function::Derivative),
        ("lag", Function::Lag),
        ("delay", Function::Delay),
        ("step", Function::Step),
    ];

    /// How many parts it is a function of.
    pub const fn arguments(self) -> usize {
        match self {
            Self::Min | Self::Max | Self::Lag | Self::Delay | Self::Step => 2,
            _ => 1,
        }
    }

    /// Whether the function of a sum is the sum of the functions, in its first part.
    pub const fn is_linear(self) -> bool {
        matches!(self, Self::Derivative | Self::Lag | Self::Delay)
    }

    fn named(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|&(_, function)| function)
    }
}

impl fmt::Display for Function {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::NAMES.iter().find(|(_, function)| function == self);
        f.write_str(name.map_or("", |(name, _)| name))
    }
}

/// What is wrong with a formula, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// The character of the formula, from 1.
    pub at: usize,
    /// What was found and what was expected.
    pub message: String,
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "character {}: {}", self.at, self.message)
    }
}

impl Mistake {
    /// A mistake at a character.
    pub fn new(at: usize, message: impl Into<String>) -> Self {
        Self { at, message: message.into() }
    }
}

impl Formula {
    /// Reads a formula.
    ///
    /// # Errors
    /// The first mistake: what cannot be read, a function that is not known or has another number of arguments.
    ///
    /// ```
    /// use schuler_recording::formula::Formula;
    ///
    /// assert!(Formula::parse("k * lag(temp_x, tau_s) * rate_x").is_ok());
    /// let mistake = Formula::parse("k * sine(rate_x)").unwrap_err();
    /// assert!(mistake.to_string().starts_with("character 5: found the function \"sine\""));
    /// ```
    pub fn parse(text: &str) -> Result<Self, Mistake> {
        let length = text.chars().count();
        if length > LONGEST {
            return Err(Mistake::new(
                LONGEST,
                format!("found {length} characters; expected {LONGEST} at most"),
            ));
        }
        let calls = RefCell::default();
        let root = grammar::formula(text, text, &calls).map_err(|error| syntax(text, &error))?;
        match calls.into_inner().into_iter().min_by_key(|mistake| mistake.at) {
            Some(mistake) => Err(mistake),
            None => Ok(Self { text: text.to_owned(), root }),
        }
    }

    /// The formula as it was written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// All of it.
    pub fn root(&self) -> &Node {
        &self.root
    }

    /// Every name in it, each once, with the character at which it first stands and whether it can only be a column; without
    /// [`INPUT`] and [`TIME`].
    pub fn names(&self) -> Vec<(&str, usize, bool)> {
        let mut names: Vec<(&str, usize, bool)> = Vec::new();
        self.root.visit(&mut |node| {
            let (name, is_column) = match &node.what {
                Expression::Name(name) if name != INPUT && name != TIME => (name, false),
                Expression::Column(name) => (name, true),
                _ => return,
            };
            match names.iter_mut().find(|(known, ..)| known == name) {
                Some((.., known)) => *known |= is_column,
                None => names.push((name, node.at, is_column)),
            }
        });
        names
    }

    /// Whether the sensor's own input is in it.
    pub fn has_input(&self) -> bool {
        let mut found = false;
        self.root.visit(&mut |node| found |= matches!(&node.what, Expression::Name(name) if name == INPUT));
        found
    }
}

impl Serialize for Formula {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.text)
    }
}

impl Node {
    /// Calls `see` with every part, in the order of the text.
    fn visit<'n>(&'n self, see: &mut impl FnMut(&'n Node)) {
        see(self);
        match &self.what {
            Expression::Number(_) | Expression::Name(_) | Expression::Column(_) => {}
            Expression::Negative(part) => part.visit(see),
            Expression::Operation(_, parts) => parts.iter().for_each(|part| part.visit(see)),
            Expression::Call(_, parts) => parts.iter().for_each(|part| part.visit(see)),
        }
    }
}

/// The character of a formula at a byte, from 1.
fn character(text: &str, byte: usize) -> usize {
    1 + text.char_indices().take_while(|(at, _)| *at < byte).count()
}

/// What is wrong with text that is no formula.
fn syntax(text: &str, error: &peg::error::ParseError<peg::str::LineCol>) -> Mistake {
    let at = error.location.offset;
    let found = text.get(at..).and_then(|rest| rest.chars().next());
    let found = found.map_or_else(|| "the end".to_owned(), |it| format!("{:?}", it.to_string()));
    let mut expected: Vec<&str> = error.expected.tokens().collect();
    expected.sort_unstable();
    Mistake::new(character(text, at), format!("found {found}; expected {}", expected.join(", ")))
}

/// The function of a call, or what is wrong with it.
fn function(name: &str, arguments: usize) -> Result<Function, String> {
    let Some(function) = Function::named(name) else {
        let names = || Function::NAMES.iter().map(|(name, _)| *name);
        let hint = suggestion(name, names()).map(|meant| format!("; did you mean \"{meant}\"?"));
        let all = names().collect::<Vec<_>>().join(", ");
        return Err(format!(
            "found the function \"{name}\"; expected one of {all}{}",
            hint.unwrap_or_default()
        ));
    };
    let expected = function.arguments();
    if arguments == expected {
        Ok(function)
    } else {
        let plural = if expected == 1 { "" } else { "s" };
        Err(format!("found {name} of {arguments}; expected {name} of {expected} argument{plural}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The value of a formula of numbers alone.
    fn value(node: &Node) -> f64 {
        match &node.what {
            Expression::Number(number) => *number,
            Expression::Negative(part) => -value(part),
            Expression::Operation(operator, parts) => {
                let (a, b) = (value(&parts[0]), value(&parts[1]));
                match operator {
                    Operator::Add => a + b,
                    Operator::Subtract => a - b,
                    Operator::Multiply => a * b,
                    Operator::Divide => a / b,
                    Operator::Power => a.powf(b),
                }
            }
            Expression::Call(Function::Min, parts) => value(&parts[0]).min(value(&parts[1])),
            Expression::Call(Function::Max, parts) => value(&parts[0]).max(value(&parts[1])),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn operations_have_the_order_that_is_usual() {
        for (text, expected) in [
            ("-2^2", -4.0),
            ("2^3^2", 512.0),
            ("2^-3*4", 0.5),
            ("2 ** 3", 8.0),
            ("1 - 2 - 3", -4.0),
            ("12 / 2 * 3", 18.0),
            ("1 + 2 * 3", 7.0),
            ("--2", 2.0),
            ("1e-3 * .5E+3", 0.5),
            ("min(1, max(2, 3)) - (4)", -3.0),
            (" ( 1 ) ", 1.0),
        ] {
            let formula = Formula::parse(text).unwrap_or_else(|mistake| panic!("{text}: {mistake}"));
            assert!((value(formula.root()) - expected).abs() < 1e-12, "{text}: {}", value(formula.root()));
        }
    }

    #[test]
    fn names_are_those_of_columns_of_any_kind() {
        let formula = Formula::parse("k*`acc y (m/s^2)` + c * sensor_gyro_0.x * u - k*τ*t + `u`").unwrap();
        let names: Vec<(&str, bool)> =
            formula.names().iter().map(|&(name, _, quoted)| (name, quoted)).collect();
        assert_eq!(
            names,
            [
                ("k", false),
                ("acc y (m/s^2)", true),
                ("c", false),
                ("sensor_gyro_0.x", false),
                ("τ", false),
                ("u", true)
            ]
        );
        assert!(formula.has_input() && !Formula::parse("k * `u`").unwrap().has_input());
    }

    #[test]
    fn every_mistake_is_named_where_it_is() {
        for (text, at, said) in [
            ("", 1, "found the end; expected \"(\""),
            ("k * ", 5, "found the end; expected \"(\""),
            ("k * (x + 1", 11, "found the end; expected \")\""),
            ("k * x)", 6, "found \")\"; expected"),
            ("k x", 3, "found \"x\"; expected"),
            ("2k", 2, "found \"k\"; expected"),
            ("k + * x", 5, "found \"*\"; expected"),
            ("k $ x", 3, "found \"$\"; expected"),
            ("τ $ x", 3, "found \"$\"; expected"),
            ("k * `x", 7, "found the end; expected"),
            ("k * sine(x)", 5, "found the function \"sine\"; expected one of sin, cos"),
            ("k * sine(x)", 5, "did you mean \"sin\"?"),
            ("k * lag(x)", 5, "found lag of 1; expected lag of 2 arguments"),
            ("k * sin(x, y)", 5, "found sin of 2; expected sin of 1 argument"),
        ] {
            let mistake = Formula::parse(text).expect_err(text);
            assert!(mistake.at == at && mistake.message.contains(said), "{text}: {mistake}");
        }
        let long = format!("k{}", "+k".repeat(600));
        assert!(Formula::parse(&long).unwrap_err().message.contains("expected 1000 at most"));
        // As deep as its length lets it be.
        let deep = format!("{}k{}", "(".repeat(499), ")".repeat(499));
        assert!(Formula::parse(&deep).is_ok());
    }
}
