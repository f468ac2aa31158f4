//! Expressions of a signal, in whatever language has a word for each function.
use super::given::word;
use super::signal::{Factor, Function, Memory, Product, Signal};
use super::{Model, Term};

/// How a language writes what signals are made of; every expression is one that an operator can stand before or behind.
pub trait Language {
    /// An input in a row.
    fn input(&self, name: &str) -> String;
    /// |x|.
    fn magnitude(&self, x: &str) -> String;
    /// −1, 0 or 1.
    fn sign(&self, x: &str) -> String;
    /// 1 where x is not below 0, else 0.
    fn step(&self, x: &str) -> String;
    /// The larger of two.
    fn larger(&self, x: &str, y: &str) -> String;
    /// The smaller of two.
    fn smaller(&self, x: &str, y: &str) -> String;
    /// −x where |x| is below a threshold, else 0.
    fn dead_zone(&self, x: &str, threshold: &str) -> String;
    /// A function of the mathematical library: `exp`, `cos` or `sin`.
    fn library(&self, name: &str, x: &str) -> String;
    /// A number as an array as long as the inputs, where the language computes with arrays.
    fn constant(&self, number: &str) -> String {
        number.to_owned()
    }
}

/// The sum of a signal as an expression, without its memory.
pub fn sum(signal: &Signal, language: &impl Language) -> String {
    let products: Vec<String> = signal.sum.iter().map(|it| product(it, language)).collect();
    if products.is_empty() { language.constant("0.0") } else { products.join(" + ") }
}

fn product(Product { coefficient, factors }: &Product, language: &impl Language) -> String {
    let mut words: Vec<String> = factors.iter().map(|it| factor(it, language)).collect();
    if words.is_empty() {
        return language.constant(&number(*coefficient));
    }
    if *coefficient != 1.0 {
        words.insert(0, number(*coefficient));
    }
    words.join(" * ")
}

fn factor(Factor { of, reference, function }: &Factor, language: &impl Language) -> String {
    let weighted = of.iter().map(|it| {
        let input = language.input(&it.input);
        if it.weight == 1.0 { input } else { format!("{} * {input}", number(it.weight)) }
    });
    let mut terms: Vec<String> = weighted.collect();
    if terms.is_empty() {
        terms.push(language.constant("0.0"));
    }
    let plain = terms.len() == 1 && *reference == 0.0 && of.iter().all(|it| it.weight == 1.0);
    let mut x = terms.join(" + ");
    if *reference != 0.0 {
        x = format!("{x} - {}", number(*reference));
    }
    let x = if plain { x } else { format!("({x})") };
    match *function {
        Function::Power { exponent: 0 } => language.constant("1.0"),
        Function::Power { exponent } => vec![x; usize::from(exponent)].join(" * "),
        Function::Magnitude => language.magnitude(&x),
        Function::Sign => language.sign(&x),
        Function::Step => language.step(&x),
        Function::Ramp => language.larger(&x, "0.0"),
        Function::Decay { tau_s } => language.library("exp", &format!("-{x} / {}", number(tau_s))),
        Function::Cosine { frequency_hz } => language.library("cos", &turn(&x, frequency_hz)),
        Function::Sine { frequency_hz } => language.library("sin", &turn(&x, frequency_hz)),
        Function::DeadZone { threshold } => language.dead_zone(&x, &number(threshold)),
        Function::Clipped { limit } => {
            let clipped = language.smaller(&language.larger(&x, &number(-limit)), &number(limit));
            format!("({clipped} - {x})")
        }
    }
}

fn turn(x: &str, frequency_hz: f64) -> String {
    format!("{} * {x}", number(std::f64::consts::TAU * frequency_hz))
}

/// A number to all its digits.
pub fn number(value: f64) -> String {
    format!("{value:?}")
}

/// Words that are none of the user's in C or in Rust.
const KEYWORDS: &[&str] = &[
    "abstract", "as", "async", "auto", "await", "become", "bool", "box", "break", "case", "char", "const",
    "continue", "crate", "default", "do", "double", "dyn", "else", "enum", "extern", "false", "final",
    "float", "fn", "for", "gen", "goto", "if", "impl", "in", "inline", "int", "let", "long", "loop", "macro",
    "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "register", "restrict", "return",
    "self", "short", "signed", "sizeof", "static", "struct", "super", "switch", "trait", "true", "try",
    "type", "typedef", "typeof", "union", "unsafe", "unsigned", "unsized", "use", "virtual", "void",
    "volatile", "where", "while", "yield",
];

/// The outputs with a word for each, no two alike.
pub fn words(model: &Model) -> Vec<(String, String)> {
    let mut words: Vec<(String, String)> = Vec::new();
    for output in &model.outputs {
        let wanted = word(&output.sensor);
        let wanted = if KEYWORDS.contains(&wanted.as_str()) { format!("{wanted}_") } else { wanted };
        let taken = |name: &String| words.iter().any(|(_, known)| known == name);
        let numbered = (2..).map(|number| format!("{wanted}_{number}"));
        let name =
            std::iter::once(wanted.clone()).chain(numbered).find(|name| !taken(name)).unwrap_or(wanted);
        words.push((output.sensor.clone(), name));
    }
    words
}

/// The word of an output.
pub fn word_of<'w>(words: &'w [(String, String)], output: &str) -> &'w str {
    words.iter().find(|(sensor, _)| sensor == output).map_or("", |(_, word)| word.as_str())
}

/// A text as it can stand in a comment or a string of any language, in one line.
pub fn plain(text: &str) -> String {
    let kept = text.chars().filter(|it| !it.is_control() && !matches!(it, '"' | '\\'));
    kept.collect::<String>().replace("*/", "* /").replace("/*", "/ *").trim().to_owned()
}

/// What the head of a source file says, line by line.
pub fn head(model: &Model) -> Vec<String> {
    let mut lines = vec![
        format!("What the simulation of this case leaves out: {}", plain(&model.title)),
        String::new(),
        "Written by schuler explain. Inputs and outputs have one value a row, in SI units, temperatures in degrees Celsius.".to_owned(),
    ];
    let (before, after) = (&model.fit.train.before, &model.fit.train.after);
    if model.fit.train.samples > 0 {
        lines.push(format!(
            "With it the negative log-likelihood a sample is {:.6} instead of {:.6} nats, over {} samples.",
            after.nll_per_sample, before.nll_per_sample, model.fit.train.samples
        ));
    }
    let cautions = model.cautions();
    if !cautions.is_empty() {
        lines.push(String::new());
        lines.extend(cautions.iter().map(|caution| format!("Note: {}.", plain(caution))));
    }
    if !model.noise.is_empty() {
        lines.push(String::new());
        lines.extend(model.noise.iter().map(|noise| format!("Noise: {}", plain(&noise.sentence))));
    }
    lines
}

/// What the comment above a term says.
pub fn comment(term: &Term) -> String {
    let table = if term.is_table { " (values of this recording alone)" } else { "" };
    format!(
        "{}, {} of {}{table}: {}",
        plain(&term.output),
        term.parameter,
        term.effect,
        plain(&term.sentence)
    )
}

/// Those of the texts for lag, bandwidth, delay and branch that the terms of a model need.
pub fn helpers(model: &Model, texts: [&'static str; 4]) -> Vec<&'static str> {
    let place = |memory: Memory| match memory {
        Memory::Lag { .. } => 0,
        Memory::Bandwidth { .. } => 1,
        Memory::Delay { .. } => 2,
        Memory::Branch { .. } => 3,
    };
    let mut needed: Vec<usize> =
        model.terms.iter().filter_map(|term| term.signal.memory).map(place).collect();
    needed.sort_unstable();
    needed.dedup();
    needed.into_iter().filter_map(|place| texts.get(place).copied()).collect()
}
