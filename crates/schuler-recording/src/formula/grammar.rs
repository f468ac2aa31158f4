//! Text to an expression.
use std::cell::RefCell;

use super::{Expression, Mistake, Node, Operator, character, function};

pub(super) use parser::formula;

/// Functions that are wrong, each where its name is.
type Calls = RefCell<Vec<Mistake>>;

peg::parser! {
    grammar parser() for str {
        /// A formula, which `text` is once more; functions that are not known are put into `calls`.
        pub rule formula(text: &str, calls: &Calls) -> Node = _ node:expression(text, calls) _ { node }

        // From the operations that bind least to those that bind most.
        rule expression(text: &str, calls: &Calls) -> Node = precedence! {
            x:(@) _ at:position!() "+" _ y:@ { operation(text, at, Operator::Add, x, y) }
            x:(@) _ at:position!() "-" _ y:@ { operation(text, at, Operator::Subtract, x, y) }
            --
            x:(@) _ at:position!() times() _ y:@ { operation(text, at, Operator::Multiply, x, y) }
            x:(@) _ at:position!() "/" _ y:@ { operation(text, at, Operator::Divide, x, y) }
            --
            at:position!() "-" _ x:@ { node(text, at, Expression::Negative(Box::new(x))) }
            --
            x:@ _ at:position!() power() _ y:(@) { operation(text, at, Operator::Power, x, y) }
            --
            at:position!() value:number() { node(text, at, Expression::Number(value)) }
            at:position!() name:name() _ "(" _ arguments:arguments(text, calls) _ ")" {
                call(text, at, name, arguments, calls)
            }
            at:position!() name:name() { node(text, at, Expression::Name(name.to_owned())) }
            at:position!() "`" name:$([^ '`']+) "`" { node(text, at, Expression::Column(name.to_owned())) }
            "(" _ x:expression(text, calls) _ ")" { x }
        }

        rule arguments(text: &str, calls: &Calls) -> Vec<Node> = expression(text, calls) ** (_ "," _)

        rule times() = "*" !"*"
        rule power() = "^" / "**"

        rule number() -> f64 = quiet! {
            text:$((digits() ("." digits()?)? / "." digits()) (['e' | 'E'] ['+' | '-']? digits())?) {?
                text.parse().or(Err("a number"))
            }
        } / expected!("a number")
        rule digits() = ['0'..='9']+

        rule name() -> &'input str = quiet! {
            $([c if c.is_alphabetic() || c == '_'] [c if c.is_alphanumeric() || c == '_' || c == '.']*)
        } / expected!("a name")

        rule _() = quiet! { [c if c.is_whitespace()]* }
    }
}

fn node(text: &str, at: usize, what: Expression) -> Node {
    Node { at: character(text, at), what }
}

fn operation(text: &str, at: usize, operator: Operator, x: Node, y: Node) -> Node {
    node(text, at, Expression::Operation(operator, Box::new([x, y])))
}

/// A call; of a function that is wrong a number, which is never used.
fn call(text: &str, at: usize, name: &str, arguments: Vec<Node>, calls: &Calls) -> Node {
    match function(name, arguments.len()) {
        Ok(function) => node(text, at, Expression::Call(function, arguments)),
        Err(message) => {
            calls.borrow_mut().push(Mistake::new(character(text, at), message));
            node(text, at, Expression::Number(0.0))
        }
    }
}
