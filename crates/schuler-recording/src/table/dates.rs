//! Dates with the time of day, as logs write them.
//!
//! Read are ISO 8601 (`2024-05-01T12:30:00.25Z`, also with a blank for the T, with an offset, with `/` for `-`), the day first with
//! points (`01.05.2024 12:30:00,25`), and a time of day alone (`12:30:00.25`). A day first with `/` is read by nobody alike and is
//! not read here. Without an offset the time is taken for UTC; a difference is the same in any zone.
use super::seconds::seconds as of_decimal;

/// Decimal places of a second that are read.
const PLACES: usize = 9;
const DAY_S: i64 = 86_400;

/// Seconds since 1970 of a date and time, since midnight of a time of day; `None` of anything else.
pub(super) fn seconds(text: &str) -> Option<f64> {
    let (date, time) = match text.split_once(['T', ' ']) {
        Some((date, time)) => (Some(date), time.trim()),
        None if text.contains(':') => (None, text),
        None => return None,
    };
    let days = date.map_or(Some(0), day)?;
    let (time, offset_s) = without_offset(time)?;
    let nanoseconds = time_of_day(time)?;
    let whole = i128::from(days * DAY_S - offset_s) * 1_000_000_000 + i128::from(nanoseconds);
    Some(of_decimal(whole, PLACES as u8))
}

/// Days since 1970-01-01.
fn day(date: &str) -> Option<i64> {
    let point = date.contains('.');
    let mut parts = date.split(['-', '/', '.']);
    let [first, month, last] = [parts.next()?, parts.next()?, parts.next()?];
    let (year, day) = if point && first.len() <= 2 { (last, first) } else { (first, last) };
    if parts.next().is_some() || year.len() != 4 {
        return None;
    }
    let [year, month, day] = [number(year)?, number(month)?, number(day)?];
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Days from civil, with the year beginning in March (Fliegel & Van Flandern, 1968).
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    Some(
        365 * year + year.div_euclid(4) - year.div_euclid(100)
            + year.div_euclid(400)
            + (153 * month + 2) / 5
            + day
            - 719_469,
    )
}

/// A time of day without its offset from UTC, and that, s.
fn without_offset(time: &str) -> Option<(&str, i64)> {
    if let Some(time) = time.strip_suffix(['Z', 'z']) {
        return Some((time, 0));
    }
    let Some(at) = time.rfind(['+', '-']) else { return Some((time, 0)) };
    let (time, offset) = time.split_at_checked(at)?;
    let (sign, offset) = offset.split_at_checked(1)?;
    let digits: String = offset.chars().filter(|letter| *letter != ':').collect();
    let (hours, minutes) = digits.split_at_checked(2)?;
    let minutes = if minutes.is_empty() { 0 } else { number(minutes)? };
    let offset_s = 3600 * number(hours)? + 60 * minutes;
    Some((time, if sign == "-" { -offset_s } else { offset_s }))
}

/// Nanoseconds since midnight of hours, minutes, seconds and a decimal part of them behind a point or comma.
fn time_of_day(time: &str) -> Option<i64> {
    let mut parts = time.split(':');
    let [hours, minutes] = [number(parts.next()?)?, number(parts.next()?)?];
    let seconds = parts.next().unwrap_or("0");
    if parts.next().is_some() {
        return None;
    }
    let (whole, part) = seconds.split_once(['.', ',']).unwrap_or((seconds, ""));
    let whole = number(whole)?;
    // A leap second is the 60th.
    if hours > 24 || minutes > 59 || whole > 60 {
        return None;
    }
    let digits: String = part.chars().chain(std::iter::repeat('0')).take(PLACES).collect();
    if !part.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    Some(((hours * 60 + minutes) * 60 + whole) * 1_000_000_000 + number(&digits)?)
}

fn number(text: &str) -> Option<i64> {
    let digits = !text.is_empty() && text.len() <= PLACES && text.bytes().all(|byte| byte.is_ascii_digit());
    if digits { text.parse().ok() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_seconds_since_1970() {
        // By `date -u -d … +%s`.
        for (text, expected) in [
            ("1970-01-01T00:00:00Z", 0.0),
            ("2013-06-24T19:02:59.758555392Z", 1_372_100_579.758_555_4),
            ("2024-02-29 12:00:00", 1_709_208_000.0),
            ("2024-03-01T00:00:00.5+02:00", 1_709_244_000.5),
            ("2024/03/01 00:00", 1_709_251_200.0),
            ("01.03.2024 00:00:00,25", 1_709_251_200.25),
            ("1969-12-31T23:59:59Z", -1.0),
            ("12:30:00.125", 45_000.125),
        ] {
            assert_eq!(seconds(text), Some(expected), "{text}");
        }
        for text in [
            "2024-05-01",
            "x",
            "1:2:3:4",
            "2024-13-01 00:00",
            "24-05-01 00:00",
            "01/02/2024 00:00",
            "",
            "at 12:00",
            "a:b",
        ] {
            assert_eq!(seconds(text), None, "{text}");
        }
    }
}
