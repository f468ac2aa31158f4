//! What is in no catalogue: a smooth function of a recorded quantity, or of the time.
//!
//! Without such a rival whatever stands nearest in the catalogue would be named as surely as what is there.
use std::f64::consts::PI;

use super::Effect;
use super::draft::{Draft, ITSELF, Plausible, amplitude, any, at_each_place};

/// Cosines of which a smooth function is made.
const TERMS: usize = 6;

pub(super) const UNNAMED: Effect = Effect {
    id: "unexplained",
    formula: "Σ aⱼ cos πjr, r the rank of a recorded quantity, or the time, from 0 to 1",
    sentence: "depends on a quantity as no effect of the catalogue does",
    needs: "a quantity that varies",
    separated_by: "vary that quantity alone",
    source: "",
    acts_on: any,
    candidates: |effect, inputs| {
        let of_time = (String::from("time"), inputs.time_s.to_vec());
        let recorded = inputs.conditions().into_iter().map(|it| (it.name, it.values.to_vec()));
        let quantities: Vec<(String, Vec<f64>)> = std::iter::once(of_time).chain(recorded).collect();
        let bases: Vec<(String, Vec<Vec<f64>>)> = (quantities.into_iter())
            .map(|(name, values)| {
                let ranks = ranks(&values);
                let cosine =
                    |j: usize| ranks.iter().map(|rank| (PI * j as f64 * rank).cos()).collect::<Vec<f64>>();
                (name, (1..=TERMS).map(cosine).collect())
            })
            .collect();
        at_each_place(effect, inputs, |place| {
            let draft = |(name, columns): &(String, Vec<Vec<f64>>)| {
                let columns = columns.iter().enumerate().map(|(j, values)| {
                    let name = format!("a_{}", j + 1);
                    (values.clone(), amplitude(place, &name, ITSELF, Plausible::UNKNOWN))
                });
                Draft::columns(place, columns.collect()).with("column", name.clone())
            };
            bases.iter().map(draft).collect()
        })
    },
};

/// Ranks of values from 0 to 1, equal ones alike.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let last = values.len().saturating_sub(1).max(1) as f64;
    let mut ranks = vec![0.0; values.len()];
    let mut from = 0;
    for equal in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let middle = (from as f64 + 0.5 * (equal.len() as f64 - 1.0)) / last;
        for &row in equal {
            ranks[row] = middle;
        }
        from += equal.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::ranks;

    #[test]
    fn equal_values_have_one_rank() {
        assert_eq!(ranks(&[3.0, 1.0, 1.0, 9.0, 5.0]), [0.5, 0.125, 0.125, 1.0, 0.75]);
    }
}
