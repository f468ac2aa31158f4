//! Sensors that have the same readings to the bit: one instrument under several names, or a column that was copied.
use std::path::Path;

use super::layout::Layout;
use crate::case::Case;
use crate::table::Columns;

/// Changes from row to row from which on two columns are not alike by chance: a constant has none.
const LEAST_CHANGES: usize = 8;

/// What the user is told of sensors whose columns have the same readings in all rows where both have one, one line a group of them.
pub(super) fn said(case: &Case, layout: &Layout, columns: &Columns, table: &Path) -> Vec<String> {
    let values = |sensor: usize| -> &[f64] {
        layout.sensor(sensor).and_then(|place| columns.values.get(place)).map_or(&[], Vec::as_slice)
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for sensor in 0..case.sensors.len() {
        let alike = |group: &&mut Vec<usize>| are_alike(values(group[0]), values(sensor));
        match groups.iter_mut().find(alike) {
            Some(group) => group.push(sensor),
            None => groups.push(vec![sensor]),
        }
    }
    let group_said = |group: &Vec<usize>| {
        let ids: Vec<&str> =
            group.iter().filter_map(|&it| case.sensors.get(it)).map(|it| it.id.as_str()).collect();
        let (last, first) = ids.split_last().filter(|(_, first)| !first.is_empty())?;
        Some(format!(
            "{}: {} and {last} have the same readings, bit for bit, in every row: one instrument under several names, or a copy; \
             they cannot check each other, and what is found on one is found on all",
            table.display(),
            first.join(", ")
        ))
    };
    groups.iter().filter_map(group_said).collect()
}

/// Whether two columns that vary are the same in all rows in which both have a value.
fn are_alike(one: &[f64], other: &[f64]) -> bool {
    let mut last = None;
    let mut changes = 0;
    for (a, b) in one.iter().zip(other).filter(|(a, b)| !a.is_nan() && !b.is_nan()) {
        if a != b {
            return false;
        }
        changes += usize::from(last.replace(a).is_some_and(|last| last != a));
    }
    changes >= LEAST_CHANGES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_alike_that_vary_and_never_differ() {
        let one: Vec<f64> = (0..100).map(|row| f64::from(row * row % 17)).collect();
        let but = |row: usize, value: f64| {
            let mut other = one.clone();
            other[row] = value;
            other
        };
        assert!(are_alike(&one, &one));
        assert!(are_alike(&one, &but(50, f64::NAN)), "missing in one of them");
        assert!(!are_alike(&one, &but(99, 0.5)), "the last row differs");
        assert!(!are_alike(&[1.0; 100], &[1.0; 100]), "constants");
        assert!(!are_alike(&one, &[f64::NAN; 100]), "no row in common");
    }
}
