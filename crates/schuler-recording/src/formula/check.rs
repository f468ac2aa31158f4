//! Which names of a formula are amplitudes, and whether it is linear in them.
//!
//! A name that is neither a column, [`INPUT`], [`TIME`] nor a parameter with a range is an amplitude. What the
//! formula adds is found by least squares, so it must be a sum of amplitudes times what has none: 0 where all of them are 0.
use super::{Expression, Formula, Function, INPUT, Mistake, Node, Operator, TIME};
use crate::document::suggestion;

/// What the names of a formula may stand for.
pub struct Scope<'s> {
    /// Names of the columns.
    pub columns: &'s [String],
    /// Names of the parameters with a range.
    pub free: &'s [&'s str],
}

/// How a part depends on the amplitudes.
#[derive(Clone, Debug, PartialEq)]
enum Degree {
    /// Not at all.
    None,
    /// A sum of amplitudes times what has none.
    Linear,
    /// A sum of that and of what has none, whose sign is at the character.
    Mixed(usize),
}

impl Formula {
    /// The names of the amplitudes, in the order of the text.
    ///
    /// # Errors
    /// The first mistake: a column that is not there, a formula without an amplitude or not linear in them, a delay or a time constant that
    /// is not the same in all rows.
    ///
    /// ```
    /// use schuler_recording::formula::Formula;
    /// use schuler_recording::formula::check::Scope;
    ///
    /// let columns = ["temp_x".to_owned(), "rate_x".to_owned()];
    /// let scope = Scope { columns: &columns, free: &["tau_s"] };
    /// let formula = Formula::parse("k * lag(temp_x, tau_s) * rate_x")?;
    /// assert_eq!(formula.amplitudes(&scope)?, ["k"]);
    /// let mistake = Formula::parse("k * c * rate_x")?.amplitudes(&scope).unwrap_err();
    /// assert!(mistake.message.starts_with("found k times c"));
    /// # Ok::<(), schuler_recording::formula::Mistake>(())
    /// ```
    pub fn amplitudes(&self, scope: &Scope<'_>) -> Result<Vec<&str>, Mistake> {
        let mut amplitudes = Vec::new();
        for (name, at, is_column) in self.names() {
            let is_there = scope.columns.iter().any(|column| column == name);
            if is_column && !is_there {
                let hint = suggestion(name, scope.columns.iter().map(String::as_str))
                    .map(|meant| format!("; did you mean `{meant}`?"));
                let message =
                    format!("found `{name}`; expected a column of the table{}", hint.unwrap_or_default());
                return Err(Mistake::new(at, message));
            }
            if !is_there && !scope.free.contains(&name) {
                amplitudes.push(name);
            }
        }
        if amplitudes.is_empty() {
            let message =
                "found no amplitude; expected a name that is no column and has no range, as k in k * (…)";
            return Err(Mistake::new(1, message));
        }
        match (Check { scope, amplitudes: &amplitudes }).degree(self.root())? {
            Degree::Mixed(at) => {
                let message = format!(
                    "found a part with {} added to one without an amplitude; expected nothing where all amplitudes are 0",
                    amplitudes.join(", ")
                );
                Err(Mistake::new(at, message))
            }
            Degree::None | Degree::Linear => Ok(amplitudes),
        }
    }

    /// The amplitudes among names whose like a column has: what was meant, perhaps.
    pub fn resembling<'f>(&'f self, scope: &Scope<'f>) -> Option<(&'f str, &'f str)> {
        let amplitudes = self.amplitudes(scope).ok()?;
        amplitudes.into_iter().find_map(|name| Some((name, like(name, scope)?)))
    }
}

/// A column that is called much like a name.
fn like<'s>(name: &str, scope: &Scope<'s>) -> Option<&'s str> {
    suggestion(name, scope.columns.iter().map(String::as_str)).filter(|_| name.chars().count() > 2)
}

struct Check<'c> {
    scope: &'c Scope<'c>,
    amplitudes: &'c [&'c str],
}

impl Check<'_> {
    fn degree(&self, node: &Node) -> Result<Degree, Mistake> {
        match &node.what {
            Expression::Name(name) if self.amplitudes.contains(&name.as_str()) => Ok(Degree::Linear),
            Expression::Number(_) | Expression::Name(_) | Expression::Column(_) => Ok(Degree::None),
            Expression::Negative(part) => self.degree(part),
            Expression::Operation(operator, parts) => {
                let degrees = [self.degree(&parts[0])?, self.degree(&parts[1])?];
                self.of_operation(node.at, *operator, parts, degrees)
            }
            Expression::Call(function, arguments) => self.of_call(node.at, *function, arguments),
        }
    }

    fn of_operation(
        &self,
        at: usize,
        operator: Operator,
        [x, y]: &[Node; 2],
        degrees: [Degree; 2],
    ) -> Result<Degree, Mistake> {
        let sign = match (operator, degrees) {
            (_, [Degree::None, Degree::None]) => return Ok(Degree::None),
            (Operator::Add | Operator::Subtract, [Degree::Linear, Degree::Linear]) => {
                return Ok(Degree::Linear);
            }
            (Operator::Add | Operator::Subtract, [Degree::Mixed(at), _] | [_, Degree::Mixed(at)]) => {
                return Ok(Degree::Mixed(at));
            }
            (Operator::Add | Operator::Subtract, _) => return Ok(Degree::Mixed(at)),
            (Operator::Multiply | Operator::Divide, [degree, Degree::None])
            | (Operator::Multiply, [Degree::None, degree]) => return Ok(degree),
            (Operator::Multiply, _) => "times",
            (Operator::Divide, _) => "divided by",
            (Operator::Power, _) => "to the power of",
        };
        Err(self.not_linear(at, &format!("{} {sign} {}", self.of(x), self.of(y)), &[x, y]))
    }

    fn of_call(&self, at: usize, function: Function, arguments: &[Node]) -> Result<Degree, Mistake> {
        let degrees = arguments.iter().map(|part| self.degree(part)).collect::<Result<Vec<_>, _>>()?;
        let varies = |part: &&Node| self.varies(part);
        if let (Function::Lag | Function::Delay, Some(part)) = (function, arguments.get(1).filter(varies)) {
            let what = if function == Function::Lag { "a time constant" } else { "a delay" };
            let message =
                format!("found {what} that varies; expected a number or a parameter with a range in `free`");
            return Err(Mistake::new(part.at, message));
        }
        match degrees.as_slice() {
            degrees if degrees.iter().all(|degree| *degree == Degree::None) => Ok(Degree::None),
            [degree] | [degree, Degree::None] if function.is_linear() => Ok(degree.clone()),
            _ => {
                let parts: Vec<&Node> = arguments.iter().collect();
                let inside: Vec<&str> = self.inside(&parts);
                Err(self.not_linear(at, &format!("{} within {function}(…)", inside.join(", ")), &parts))
            }
        }
    }

    /// Whether a part is not the same in all rows.
    fn varies(&self, node: &Node) -> bool {
        let mut varies = false;
        node.visit(&mut |part| {
            varies |= match &part.what {
                Expression::Name(name) => name == INPUT || name == TIME || self.scope.columns.contains(name),
                Expression::Column(_) => true,
                _ => false,
            };
        });
        varies
    }

    /// The amplitudes in some parts, each once.
    fn inside<'n>(&self, parts: &[&'n Node]) -> Vec<&'n str> {
        let mut inside: Vec<&str> = Vec::new();
        for part in parts {
            part.visit(&mut |node| {
                if let Expression::Name(name) = &node.what
                    && self.amplitudes.contains(&name.as_str())
                    && !inside.contains(&name.as_str())
                {
                    inside.push(name);
                }
            });
        }
        inside
    }

    /// A part in a message: its amplitudes.
    fn of(&self, part: &Node) -> String {
        let inside = self.inside(&[part]);
        if inside.is_empty() { "what has none".to_owned() } else { inside.join(", ") }
    }

    fn not_linear(&self, at: usize, found: &str, parts: &[&Node]) -> Mistake {
        let hint = self.inside(parts).into_iter().find_map(|name| {
            Some(format!("; no column is called {name}, but one is called {}", like(name, self.scope)?))
        });
        Mistake::new(
            at,
            format!(
                "found {found}; expected a formula that is linear in its amplitudes: list what is none in `free`, with its range{}",
                hint.unwrap_or_default()
            ),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Vec<String>, Mistake> {
        let columns = ["temp_x", "rate_x", "k2 odd"].map(str::to_owned);
        let scope = Scope { columns: &columns, free: &["tau_s", "p"] };
        let formula = Formula::parse(text)?;
        Ok(formula.amplitudes(&scope)?.into_iter().map(str::to_owned).collect())
    }

    #[test]
    fn amplitudes_are_names_that_stand_for_nothing_else() {
        for (text, expected) in [
            ("k * lag(temp_x, tau_s) * rate_x", &["k"][..]),
            ("a * u + b * u^2 + c * t", &["a", "b", "c"]),
            ("-(k * temp_x) / rate_x^p", &["k"]),
            ("d(k * temp_x - c * lag(rate_x, 2 * tau_s))", &["k", "c"]),
            ("delay(k, 3) + `k2 odd` * k", &["k"]),
            ("abs(rate_x) * (k + c * min(temp_x, 3))", &["k", "c"]),
        ] {
            assert_eq!(of(text).unwrap_or_else(|mistake| panic!("{text}: {mistake}")), expected, "{text}");
        }
    }

    #[test]
    fn what_is_not_linear_is_named_where_it_is() {
        for (text, at, said) in [
            ("temp_x * rate_x", 1, "found no amplitude"),
            ("k * `temp`", 5, "found `temp`; expected a column of the table; did you mean `temp_x`?"),
            ("k * c * temp_x", 3, "found k times c; expected a formula that is linear in its amplitudes"),
            ("k * temp_y", 3, "but one is called temp_x"),
            ("temp_x / k", 8, "found what has none divided by k"),
            ("k^2 * temp_x", 2, "found k to the power of what has none"),
            ("temp_x^k", 7, "found what has none to the power of k"),
            ("temp_x * sin(k * t)", 10, "found k within sin(…)"),
            ("max(k, c) * t", 1, "found k, c within max(…)"),
            ("k * temp_x + rate_x", 12, "found a part with k added to one without an amplitude"),
            ("rate_x * (1 - k)", 13, "expected nothing where all amplitudes are 0"),
            ("lag(temp_x, k) * c", 1, "found k within lag(…)"),
            ("k * lag(temp_x, rate_x)", 17, "found a time constant that varies"),
            ("k * delay(temp_x, 2 + t)", 21, "found a delay that varies"),
            ("k * lag(temp_x)", 5, "expected lag of 2 arguments"),
        ] {
            let mistake = of(text).expect_err(text);
            assert!(mistake.at == at && mistake.message.contains(said), "{text}: {mistake}");
        }
    }

    #[test]
    fn a_name_like_a_columns_is_noticed() {
        let columns = ["temp_x".to_owned()];
        let scope = Scope { columns: &columns, free: &[] };
        let formula = Formula::parse("temp_y * u").unwrap();
        assert_eq!(formula.resembling(&scope), Some(("temp_y", "temp_x")));
        assert_eq!(Formula::parse("k * u").unwrap().resembling(&scope), None);
    }
}
