//! Time stamps: integers of decimal fractions of a second.

/// Integers up to this are exact as doubles.
const EXACT: u128 = 1 << 53;

/// The double nearest to `count` · 10^−`places` seconds.
pub(super) fn seconds(count: i128, places: u8) -> f64 {
    if count.unsigned_abs() <= EXACT && places <= 22 {
        // Both are exact, so that the quotient is rounded once.
        return count as f64 / 10f64.powi(places.into());
    }
    // Two roundings would not always give the nearest. A decimal number is read with one; any integer is a number.
    format!("{count}e-{places}").parse().unwrap_or(f64::NAN)
}

/// The double nearest to whole seconds and nanoseconds.
pub(super) fn of_parts(whole: i64, nanoseconds: i64) -> f64 {
    seconds(i128::from(whole) * 1_000_000_000 + i128::from(nanoseconds), 9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_stamp_is_the_number_that_its_decimals_are() {
        let stamps: [(i128, u8, &str); 5] = [
            (1_700_000_000_123_456_789, 9, "1700000000.123456789"),
            (9_007_199_254_740_993, 9, "9007199.254740993"),
            (-1_500, 3, "-1.5"),
            (123_456_789, 6, "123.456789"),
            (i128::from(u64::MAX), 6, "18446744073709.551615"),
        ];
        for (count, places, text) in stamps {
            assert_eq!(seconds(count, places), text.parse::<f64>().unwrap(), "{text}");
        }
        assert_eq!(of_parts(-1, 500_000_000), -0.5);
    }
}
