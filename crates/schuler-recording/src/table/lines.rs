//! Lines of text and their cells.
use std::io::{self, BufRead, Read};
use std::ops::Range;

/// Bytes of the longest line: three million columns of the most digits that a double has. A longer one is no line of a table.
pub(super) const LONGEST_LINE: usize = 1 << 26;

/// Why there is no next line.
pub(super) enum LineError {
    /// The file cannot be read.
    Io(io::Error),
    /// It is longer than [`LONGEST_LINE`].
    TooLong,
}

/// The lines of a text, one after another.
pub(super) struct Lines {
    bytes: Box<dyn BufRead>,
    /// The byte that ends a line.
    end: u8,
    line: Vec<u8>,
    /// Number of the line, from 1.
    number: u64,
    /// Bytes read so far.
    taken: u64,
}

impl Lines {
    /// Of a text that begins with these bytes. Lines end in LF, in CR LF, or, where there is no LF, in CR.
    pub(super) fn new(mut bytes: Box<dyn BufRead>) -> io::Result<Self> {
        let end = line_end(bytes.fill_buf()?);
        Ok(Self { bytes, end, line: Vec::new(), number: 0, taken: 0 })
    }

    /// Goes to the next line; false where there is none.
    pub(super) fn advance(&mut self) -> Result<bool, LineError> {
        self.line.clear();
        let mut bounded = (&mut self.bytes).take(LONGEST_LINE as u64 + 1);
        let read = bounded.read_until(self.end, &mut self.line).map_err(LineError::Io)?;
        self.number += 1;
        self.taken += read as u64;
        if read > LONGEST_LINE {
            return Err(LineError::TooLong);
        }
        while matches!(self.line.last(), Some(b'\n' | b'\r')) {
            self.line.pop();
        }
        Ok(read > 0)
    }

    /// The line, without its end.
    pub(super) fn line(&self) -> &[u8] {
        &self.line
    }

    /// Number of the line, from 1.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// Bytes read so far.
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }
}

/// The byte that ends the lines of a text that begins so: LF, or CR where there is no LF.
pub(super) fn line_end(beginning: &[u8]) -> u8 {
    if !beginning.contains(&b'\n') && beginning.contains(&b'\r') { b'\r' } else { b'\n' }
}

/// A quote that opens and does not close in its line, closes what is not open, or has text behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unbalanced;

/// Puts the places of the cells of a line into `cells`, quotes around a cell left out.
///
/// A cell is quoted if its first character but for blanks is a quote; it ends at the next quote that is not doubled. A cell
/// does not go on in the next line: no number does, and a stray quote would take all rows up to the next with it.
pub(super) fn split(line: &[u8], separator: u8, cells: &mut Vec<Range<usize>>) -> Result<(), Unbalanced> {
    cells.clear();
    let mut from = 0;
    loop {
        let rest = line.get(from..).unwrap_or_default();
        let blanks = rest.iter().take_while(|&&byte| is_blank(byte, separator)).count();
        let (cell, end) = if rest.get(blanks) == Some(&b'"') {
            quoted(line, separator, from + blanks + 1)?
        } else {
            let end = rest.iter().position(|&byte| byte == separator).map_or(line.len(), |at| from + at);
            let open = line[from..end].iter().fold(false, |open, &byte| open ^ (byte == b'"'));
            if open {
                return Err(Unbalanced);
            }
            (from..end, end)
        };
        cells.push(cell);
        if end == line.len() {
            return Ok(());
        }
        from = end + 1;
    }
}

/// As [`split`], of cells that are separated by one or more blanks or tabs.
pub(super) fn split_at_blanks(line: &[u8], cells: &mut Vec<Range<usize>>) -> Result<(), Unbalanced> {
    cells.clear();
    let mut from = 0;
    loop {
        let rest = line.get(from..).unwrap_or_default();
        from += rest.iter().take_while(|&&byte| matches!(byte, b' ' | b'\t')).count();
        let rest = line.get(from..).unwrap_or_default();
        let (cell, end) = match rest.first() {
            None => return Ok(()),
            Some(b'"') => quoted_word(line, from + 1)?,
            Some(_) => {
                let length = rest.iter().position(|&byte| matches!(byte, b' ' | b'\t')).unwrap_or(rest.len());
                if rest.iter().take(length).filter(|&&byte| byte == b'"').count() % 2 == 1 {
                    return Err(Unbalanced);
                }
                (from..from + length, from + length)
            }
        };
        cells.push(cell);
        from = end;
    }
}

fn is_blank(byte: u8, separator: u8) -> bool {
    matches!(byte, b' ' | b'\t') && byte != separator
}

/// The cell whose opening quote is just before `from`, and where its separator or the end of the line is.
fn quoted(line: &[u8], separator: u8, from: usize) -> Result<(Range<usize>, usize), Unbalanced> {
    let close = closing_quote(line, from)?;
    let behind = &line[close + 1..];
    let blanks = behind.iter().take_while(|&&byte| is_blank(byte, separator)).count();
    let end = close + 1 + blanks;
    if end == line.len() || line[end] == separator { Ok((from..close, end)) } else { Err(Unbalanced) }
}

/// As [`quoted`], of a cell behind which a blank or the end of the line stands.
fn quoted_word(line: &[u8], from: usize) -> Result<(Range<usize>, usize), Unbalanced> {
    let close = closing_quote(line, from)?;
    match line.get(close + 1) {
        None | Some(b' ' | b'\t') => Ok((from..close, close + 1)),
        Some(_) => Err(Unbalanced),
    }
}

/// Where the next quote is that is not doubled.
fn closing_quote(line: &[u8], from: usize) -> Result<usize, Unbalanced> {
    let mut at = from;
    loop {
        at += line.get(at..).unwrap_or_default().iter().position(|&byte| byte == b'"').ok_or(Unbalanced)?;
        if line.get(at + 1) != Some(&b'"') {
            return Ok(at);
        }
        at += 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(line: &str) -> Option<Vec<&str>> {
        let mut cells = Vec::new();
        split(line.as_bytes(), b',', &mut cells).ok()?;
        Some(cells.into_iter().map(|cell| &line[cell]).collect())
    }

    #[test]
    fn cells_stand_between_separators_and_within_quotes() {
        for (line, expected) in [
            ("1,2,3", vec!["1", "2", "3"]),
            ("", vec![""]),
            (",", vec!["", ""]),
            ("1,,3,", vec!["1", "", "3", ""]),
            ("\"1\",\"a,b\",3", vec!["1", "a,b", "3"]),
            (" \"1\" ,2", vec!["1", "2"]),
            ("\"a \"\"b\"\"\",2", vec!["a \"\"b\"\"", "2"]),
            ("\"\",2", vec!["", "2"]),
            ("the \"b\" one,2", vec!["the \"b\" one", "2"]),
            ("1\t,2", vec!["1\t", "2"]),
        ] {
            assert_eq!(cells(line), Some(expected), "{line}");
        }
    }

    #[test]
    fn cells_stand_between_blanks_and_within_quotes() {
        for (line, expected) in [
            ("  1  2\t3 ", Some(vec!["1", "2", "3"])),
            ("", Some(vec![])),
            (" \t ", Some(vec![])),
            ("\"a b\" 2", Some(vec!["a b", "2"])),
            ("1 \"\"", Some(vec!["1", ""])),
            ("1 \"2", None),
            ("1 2\" 3", None),
            ("\"1\"2 3", None),
        ] {
            let mut cells = Vec::new();
            let split = split_at_blanks(line.as_bytes(), &mut cells);
            let found: Vec<&str> = cells.into_iter().map(|cell| &line[cell]).collect();
            assert_eq!(split.ok().map(|()| found), expected, "{line}");
        }
    }

    #[test]
    fn a_quote_without_its_other_is_found_in_its_line() {
        for line in ["300,\"7.0,1", "1,7\",2", "\"", "1,\"2\"3,4", "1,2,\"", "\"1\"\",2", "1,a\"b\"c\",2"] {
            assert_eq!(cells(line), None, "{line}");
        }
    }
}
