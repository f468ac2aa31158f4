//! How a text table is written: what separates its cells, how it writes decimals, where its header is.
//!
//! Everything is told from the first lines. Of comma, semicolon, tab and blanks that one separates
//! the cells into which most lines fall alike and as numbers; a decimal comma is one between digits,
//! where the comma separates nothing. Lines before the header (a title, remarks, the serial number
//! of an instrument) and a row of units below it are passed over.
use std::ops::Range;

use super::lines::{self, Unbalanced, line_end};

/// Bytes of a file that are looked at.
pub(super) const SAMPLE_BYTES: usize = 1 << 16;
/// Lines of them that are compared.
const LINES: usize = 200;
/// By so much a separator must do better than the comma.
const BETTER: f64 = 0.2;
/// Rows of numbers below the header that tell where it is.
const BODY_ROWS: usize = 3;
/// Of the cells of a row of numbers at least this part is a number.
const LEAST_NUMBERS: f64 = 0.5;
/// What begins a remark.
const REMARKS: &[u8] = b"#%";
/// Units that stand below the names of columns; of time stamps, too.
const UNITS: &[&str] = &[
    "s", "sec", "ms", "us", "µs", "ns", "min", "h", "utc", "rad", "deg", "°", "rad/s", "deg/s", "dps", "°/s",
    "deg/h", "°/h", "rad/s^2", "m", "mm", "km", "m/s", "km/h", "kn", "m/s^2", "m/s²", "m/s2", "m/s/s", "g",
    "mg", "ug", "µg", "gal", "mgal", "degc", "°c", "c", "k", "degf", "°f", "f", "v", "mv", "a", "ma", "w",
    "pa", "hpa", "kpa", "mbar", "bar", "t", "ut", "µt", "nt", "gauss", "mgauss", "hz", "%", "-", "1", "none",
    "counts", "lsb",
];

/// What separates the cells of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Separator {
    Byte(u8),
    /// One or more blanks or tabs.
    Blanks,
}

/// How a text table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dialect {
    pub(super) separator: Separator,
    pub(super) decimal_comma: bool,
    /// Lines before the header.
    pub(super) preamble: usize,
    /// Whether a remark's sign stands before the names, to be taken off.
    pub(super) marked: bool,
    /// Whether the row below the header is one of units.
    pub(super) units: bool,
}

impl Dialect {
    const COMMA: Self = Self {
        separator: Separator::Byte(b','),
        decimal_comma: false,
        preamble: 0,
        marked: false,
        units: false,
    };

    /// The dialect of a table that begins with `sample`.
    pub(super) fn of(sample: &[u8]) -> Self {
        let text = String::from_utf8_lossy(sample);
        let text = text.trim_start_matches('\u{feff}');
        let end = char::from(line_end(sample));
        let mut lines: Vec<&str> = text.split_terminator(end).take(LINES + 1).collect();
        let whole = sample.len() < SAMPLE_BYTES && text.ends_with(end) && lines.len() <= LINES;
        // The last line may be cut off.
        if lines.len() > 2 && !whole {
            lines.pop();
        }
        for line in &mut lines {
            *line = line.trim_end_matches(['\r', '\n']);
        }
        let comma = Self::COMMA;
        let semicolon = Self { separator: Separator::Byte(b';'), ..comma };
        let tab = Self { separator: Separator::Byte(b'\t'), ..comma };
        let blanks = Self { separator: Separator::Blanks, ..comma };
        let mut best = (comma, comma.score(&lines) + BETTER);
        for dialect in [semicolon, tab, blanks] {
            for decimal_comma in [false, true] {
                let dialect = Self { decimal_comma, ..dialect };
                let score = dialect.score(&lines);
                if score > best.1 {
                    best = (dialect, score);
                }
            }
        }
        best.0.with_header(&lines)
    }

    /// How well the lines fall into cells: the part of them with the usual number of cells, times the part of their cells that are
    /// numbers. Nothing, where lines are one cell.
    fn score(self, lines: &[&str]) -> f64 {
        let rows: Vec<Vec<&str>> =
            lines.iter().filter(|line| !line.trim().is_empty()).map(|line| self.cells(line)).collect();
        let usual = usual_cells(&rows);
        if usual < 2 {
            return 0.0;
        }
        let alike: Vec<&Vec<&str>> = rows.iter().filter(|row| row.len() == usual).collect();
        let numbers = alike.iter().flat_map(|row| row.iter()).filter(|cell| self.is_number(cell)).count();
        numbers as f64 / (alike.len() * usual) as f64 * alike.len() as f64 / rows.len() as f64
    }

    /// Where the header is, from the first rows of numbers.
    fn with_header(self, lines: &[&str]) -> Self {
        let rows: Vec<Vec<&str>> = lines.iter().map(|line| self.cells(line)).collect();
        let usual = usual_cells(&rows);
        if usual < 2 {
            return self;
        }
        let is_body = |row: &Vec<&str>| {
            let numbers = row.iter().filter(|cell| self.is_number(cell)).count();
            row.len() == usual && numbers as f64 >= LEAST_NUMBERS * usual as f64
        };
        let Some(body) = rows.windows(BODY_ROWS).position(|rows| rows.iter().all(is_body)) else {
            return self;
        };
        let names = |line: usize| {
            let cells = self.cells(self.without_mark(lines[line]));
            (cells.len() == usual).then_some(cells)
        };
        let is_text = |line: usize| {
            let is_text = |cell: &&str| cell.trim().is_empty() || !self.is_number(cell);
            names(line).is_some_and(|cells| {
                cells.iter().all(is_text) && cells.iter().any(|cell| !cell.trim().is_empty())
            })
        };
        // Names may be numbers, but not all; a row with a number below one without is a row of the table.
        let is_names = |line: &usize| names(*line).is_some_and(|cells| !cells.iter().all(is_plain_number));
        let text = (0..body).rev().find(|line| is_text(*line));
        let Some(last) = text.or_else(|| body.checked_sub(1).filter(is_names)) else { return self };
        let units = last > 0 && is_text(last - 1) && names(last).is_some_and(|cells| are_units(&cells));
        let header = if units { last - 1 } else { last };
        let marked = self.without_mark(lines[header]).len() < lines[header].len();
        Self { preamble: header, marked, units, ..self }
    }

    /// A line without the sign of a remark that stands before names that blanks separate.
    fn without_mark(self, line: &str) -> &str {
        let marked = self.separator == Separator::Blanks;
        std::str::from_utf8(if marked { unmarked(line.as_bytes()) } else { line.as_bytes() }).unwrap_or(line)
    }

    /// The cells of a line; one, where its quotes do not close.
    fn cells(self, line: &str) -> Vec<&str> {
        let mut cells = Vec::new();
        match self.split(line.as_bytes(), &mut cells) {
            Ok(()) => cells.into_iter().filter_map(|cell| line.get(cell)).collect(),
            Err(Unbalanced) => vec![line],
        }
    }

    /// Puts the places of the cells of a line into `cells`, quotes around a cell left out.
    pub(super) fn split(self, line: &[u8], cells: &mut Vec<Range<usize>>) -> Result<(), Unbalanced> {
        match self.separator {
            Separator::Byte(separator) => lines::split(line, separator, cells),
            Separator::Blanks => lines::split_at_blanks(line, cells),
        }
    }

    fn is_number(self, cell: &str) -> bool {
        self.number(cell.as_bytes()).is_some()
    }

    /// The number in a cell, NaN where it is missing, `None` where there is something else. A date with its time of day is seconds
    /// since 1970, a time of day seconds since midnight.
    pub(super) fn number(self, cell: &[u8]) -> Option<f64> {
        let cell = cell.trim_ascii();
        if cell.is_empty() {
            return Some(f64::NAN);
        }
        let text = std::str::from_utf8(cell).ok()?;
        if let Ok(number) = text.parse() {
            return Some(number);
        }
        if self.decimal_comma
            && let Some((whole, part)) = text.split_once(',')
            && whole.ends_with(|letter: char| letter.is_ascii_digit())
            && part.starts_with(|letter: char| letter.is_ascii_digit())
            && let Ok(number) = format!("{whole}.{part}").parse()
        {
            return Some(number);
        }
        super::dates::seconds(text)
    }
}

/// A line without the sign of a remark at its beginning.
pub(super) fn unmarked(line: &[u8]) -> &[u8] {
    let signs = line.iter().take_while(|byte| REMARKS.contains(byte)).count();
    line.get(signs..).unwrap_or_default()
}

fn is_plain_number(cell: &&str) -> bool {
    cell.trim().parse::<f64>().is_ok()
}

/// Whether more than half of the cells are units, or stand in brackets.
fn are_units(cells: &[&str]) -> bool {
    let units = cells.iter().filter(|cell| {
        let bare = cell.trim().trim_matches(['[', ']', '(', ')']);
        bare.len() < cell.trim().len() || UNITS.contains(&bare.to_lowercase().as_str())
    });
    2 * units.count() > cells.len()
}

/// The number of cells that most rows have.
fn usual_cells(rows: &[Vec<&str>]) -> usize {
    let mut counts = std::collections::BTreeMap::new();
    for row in rows {
        *counts.entry(row.len()).or_insert(0_usize) += 1;
    }
    counts.into_iter().max_by_key(|&(cells, rows)| (rows, cells)).map_or(0, |(cells, _)| cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Dialect {
        Dialect::of(text.as_bytes())
    }

    fn separated(by: u8) -> Dialect {
        Dialect { separator: Separator::Byte(by), ..Dialect::COMMA }
    }

    #[test]
    fn separators_are_told_by_what_they_separate() {
        for text in [
            "t,x\n0,1\n1,2\n2,3\n",
            "t,note,x\n0,at rest; still,1\n1,\"a, b\",2\n2,,3\n",
            "t,x\n",
            "x\n1.5\n2.5\n",
            "t, x, y\n0.0, 1.5, 2\n0.1, 1.6, 2\n0.2, 1.7, 2\n",
            "when,x\n2024-05-01 12:00:00,1\n2024-05-01 12:00:01,2\n2024-05-01 12:00:02,2\n",
        ] {
            assert_eq!(of(text), Dialect::COMMA, "{text}");
        }
        assert_eq!(of("t;x\n0.0;1.5\n0.1;1.6\n0.2;1.7\n"), separated(b';'));
        assert_eq!(of("t\tx\n0.0\t1.5\n0.1\t1.6\n0.2\t1.7\n"), separated(b'\t'));
        let comma = Dialect { decimal_comma: true, ..separated(b';') };
        assert_eq!(of("t;x\n0,00;0,0132\n0,01;-1,5e-3\n0,02;7\n"), comma);
        let blanks = Dialect { separator: Separator::Blanks, ..Dialect::COMMA };
        assert_eq!(of("  t    x  y\n 0.00  1.0 -2.0\n 0.01 -1.0  2.0\n 0.02  1.0  2.0\n"), blanks);
    }

    #[test]
    fn headers_are_found_below_preambles_and_above_units() {
        let found = of("Logger 7, firmware 1.2\nserial;4711\n\nt;x\ns;rad/s\n0;1\n1;2\n2;3\n");
        assert_eq!(found, Dialect { preamble: 3, units: true, ..separated(b';') });
        let remarks = of("# made by hand\n# twice\nt,x\n0,1\n1,2\n2,3\n");
        assert_eq!(remarks, Dialect { preamble: 2, ..Dialect::COMMA });
        let marked = of("% a remark of words\n% t x\n0 1\n1 2\n2 3\n");
        assert_eq!((marked.preamble, marked.marked, marked.separator), (1, true, Separator::Blanks));
        // A preamble that falls into cells like the table.
        assert_eq!(of("serial,A4\nt,x\n0,1\n1,2\n2,3\n"), Dialect { preamble: 1, ..Dialect::COMMA });
        // Without a header nothing is passed over, nor are rows with a mistake.
        assert_eq!(of("0,1\n1,2\n2,3\n3,4\n"), Dialect::COMMA);
        assert_eq!(of("t,x\n0,1.5x\n1,2\n2,3\n3,4\n"), Dialect::COMMA);
        assert_eq!(of("t,x\n0,\"1\n1,2\n2,3\n3,4\n"), Dialect::COMMA);
        assert_eq!(of("t,1,2\n0,1,2\n1,2,2\n2,3,2\n"), Dialect::COMMA);
        // Lines that end as on old machines.
        assert_eq!(of("title\rt;x\r0;1\r1;2\r2;3\r"), Dialect { preamble: 1, ..separated(b';') });
    }

    #[test]
    fn numbers_are_read_as_the_dialect_writes_them() {
        let comma = Dialect { decimal_comma: true, ..separated(b';') };
        assert_eq!(comma.number(b" -1,25e-3 "), Some(-1.25e-3));
        assert_eq!(Dialect::COMMA.number(b"1,25"), None);
        assert!(Dialect::COMMA.number(b"").unwrap().is_nan());
        assert_eq!(Dialect::COMMA.number(b"1970-01-01T00:00:01.5Z"), Some(1.5));
        assert_eq!(comma.number(b"1,2,3"), None);
        assert_eq!(comma.number(b"x,1"), None);
    }
}
