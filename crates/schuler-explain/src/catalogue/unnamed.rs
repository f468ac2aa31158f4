//! What is in no catalogue: a smooth function of a recorded quantity, or of the time, and a product of two quantities.
//!
//! Without such a rival whatever stands nearest in the catalogue would be named as surely as what is there.
use std::f64::consts::PI;

use super::Effect;
use super::draft::{Draft, ITSELF, Plausible, amplitude, any, at_each_place};
use super::form::Form;
use super::in_flight::HAS_NO_TERM;

/// Cosines of which a smooth function is made.
const TERMS: usize = 6;

pub(super) const UNNAMED: Effect = Effect {
    id: "unexplained",
    formula: "Σ aⱼ cos πjr, r the rank of a recorded quantity, or the time, from 0 to 1; \
              a cos πr cos πs of two quantities",
    sentence: "depends on a quantity as no effect of the catalogue does",
    needs: "a quantity that varies",
    separated_by: "vary that quantity alone",
    source: "",
    in_flight: HAS_NO_TERM,
    form: Form::Values,
    acts_on: any,
    candidates: |effect, inputs| {
        let of_time = (String::from("time"), inputs.time_s.to_vec());
        let recorded = inputs.conditions().into_iter().map(|it| (it.name, it.values.to_vec()));
        let quantities: Vec<(String, Vec<f64>)> = std::iter::once(of_time).chain(recorded).collect();
        let cosines: Vec<(String, Vec<Vec<f64>>)> = (quantities.into_iter())
            .map(|(name, values)| {
                let ranks = ranks(&values);
                let cosine =
                    |j: usize| ranks.iter().map(|rank| (PI * j as f64 * rank).cos()).collect::<Vec<f64>>();
                (name, (1..=TERMS).map(cosine).collect())
            })
            .collect();
        let products = products(&cosines[1..]);
        let bases: Vec<(String, Vec<Vec<f64>>)> = cosines.into_iter().chain(products).collect();
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

/// The products of the first cosines of each two quantities.
fn products(cosines: &[(String, Vec<Vec<f64>>)]) -> Vec<(String, Vec<Vec<f64>>)> {
    let product = |(one, of_one): &(String, Vec<Vec<f64>>), (other, of_other): &(String, Vec<Vec<f64>>)| {
        let values = of_one[0].iter().zip(&of_other[0]).map(|(a, b)| a * b).collect();
        (format!("{one} and {other}"), vec![values])
    };
    let beside = |place: usize| cosines[place + 1..].iter().map(move |other| product(&cosines[place], other));
    (0..cosines.len()).flat_map(beside).collect()
}

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
