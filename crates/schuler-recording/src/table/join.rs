//! Messages of several topics put into the rows of one of them, each into the nearest; see [`super::log`].
use std::collections::VecDeque;

use super::Columns;
use crate::error::Problem;

/// Rows that are kept for messages that come late, and messages that are kept for rows that come late.
const LATE_ROWS: usize = 1 << 13;
const LATE_MESSAGES: usize = 1 << 15;

/// Rows that are being put together.
pub(super) struct Join {
    names: Vec<String>,
    leading: usize,
    /// Name of the time column, for errors.
    time: String,
    /// Of each topic, the columns that its fields go to.
    columns: Vec<Vec<usize>>,
    width: usize,
    /// Whether there are other topics than that of the rows.
    several: bool,
    rows: VecDeque<Row>,
    /// Messages later than the last row, in the order of their times.
    waiting: VecDeque<Waiting>,
    /// Time of the row before the first of `rows`.
    before_s: Option<f64>,
    taken: u64,
    ended: bool,
    left_out: Vec<LeftOut>,
}

struct Row {
    time_s: f64,
    values: Vec<f64>,
    /// Of each topic, how far the message is whose fields stand here, s; empty where there is one topic.
    distance_s: Vec<f64>,
}

struct Waiting {
    time_s: f64,
    topic: usize,
    fields: Vec<f64>,
}

/// Messages of a topic that are in no row.
#[derive(Clone, Copy, Default)]
struct LeftOut {
    /// Another one is nearer to their row.
    thinned: u64,
    /// Too far from any row.
    far: u64,
    /// Their row had gone, or theirs is no time.
    late: u64,
}

impl Join {
    /// Of topics with these names, `leading` gives the rows, its time being in the column called `time`. The fields of a
    /// message are its time and what goes to `columns` of its topic.
    pub(super) fn new(
        names: Vec<String>,
        leading: usize,
        time: String,
        columns: Vec<Vec<usize>>,
        width: usize,
    ) -> Self {
        let several = columns.iter().filter(|columns| !columns.is_empty()).count() > 1;
        Self {
            left_out: vec![LeftOut::default(); names.len()],
            names,
            leading,
            time,
            columns,
            width,
            several,
            rows: VecDeque::new(),
            waiting: VecDeque::new(),
            before_s: None,
            taken: 0,
            ended: false,
        }
    }

    /// Takes the next message of the log.
    ///
    /// # Errors
    /// A row without a time or not after the one before, where that matters.
    pub(super) fn add(&mut self, topic: usize, fields: &[f64]) -> Result<(), Problem> {
        let Some((&time_s, fields)) = fields.split_first() else { return Ok(()) };
        if topic == self.leading {
            return self.add_row(time_s, fields);
        }
        let last_s = self.rows.back().map(|row| row.time_s);
        if !time_s.is_finite() {
            self.left_out[topic].late += 1;
        } else if last_s.is_some_and(|last_s| time_s <= last_s) {
            self.place(topic, time_s, fields);
        } else {
            if self.waiting.len() == LATE_MESSAGES
                && let Some(Waiting { topic, .. }) = self.waiting.pop_front()
            {
                self.left_out[topic].far += 1;
            }
            let at = self.waiting.partition_point(|other| other.time_s <= time_s);
            self.waiting.insert(at, Waiting { time_s, topic, fields: fields.to_vec() });
        }
        Ok(())
    }

    fn add_row(&mut self, time_s: f64, fields: &[f64]) -> Result<(), Problem> {
        let last_s = self.rows.back().map(|row| row.time_s).or(self.before_s);
        let row = self.taken + self.rows.len() as u64 + 1;
        let disordered = last_s.is_some_and(|last_s| time_s <= last_s);
        if self.several && (disordered || !time_s.is_finite()) {
            let found = match last_s {
                Some(last_s) if disordered => format!("found time {time_s} after {last_s}"),
                _ => "found no time".to_owned(),
            };
            let message = format!(
                "message {row}: {found}; expected a time that strictly increases, by which to tell the rows of other topics"
            );
            return Err(Problem::new(None, &self.time, message));
        }
        let mut values = vec![f64::NAN; self.width];
        for (&column, &value) in self.columns[self.leading].iter().zip(fields) {
            values[column] = value;
        }
        let distance_s = if self.several { vec![f64::INFINITY; self.names.len()] } else { Vec::new() };
        self.rows.push_back(Row { time_s, values, distance_s });
        while self.waiting.front().is_some_and(|message| message.time_s <= time_s)
            && let Some(Waiting { time_s, topic, fields }) = self.waiting.pop_front()
        {
            self.place(topic, time_s, &fields);
        }
        Ok(())
    }

    /// Puts a message into the row that is nearest to it.
    fn place(&mut self, topic: usize, time_s: f64, fields: &[f64]) {
        let left_out = &mut self.left_out[topic];
        let behind = self.rows.partition_point(|row| row.time_s < time_s);
        let distance_s = |row: Option<f64>| row.map_or(f64::INFINITY, |row_s| (row_s - time_s).abs());
        let before_s = match behind.checked_sub(1) {
            Some(before) => self.rows.get(before).map(|row| row.time_s),
            None => self.before_s,
        };
        let (before, after) = (distance_s(before_s), distance_s(self.rows.get(behind).map(|row| row.time_s)));
        let at = if before <= after { behind.checked_sub(1) } else { Some(behind) };
        let Some(row) = at.and_then(|at| self.rows.get_mut(at)) else {
            left_out.late += u64::from(before.is_finite());
            left_out.far += u64::from(!before.is_finite());
            return;
        };
        let nearest = &mut row.distance_s[topic];
        left_out.thinned += u64::from(nearest.is_finite());
        if before.min(after) < *nearest {
            *nearest = before.min(after);
            for (&column, &value) in self.columns[topic].iter().zip(fields) {
                row.values[column] = value;
            }
        }
    }

    /// No message follows.
    pub(super) fn end(&mut self) {
        self.ended = true;
        for Waiting { time_s, topic, fields } in std::mem::take(&mut self.waiting) {
            self.place(topic, time_s, &fields);
        }
    }

    /// Rows that no message can change any more.
    pub(super) fn settled(&self) -> usize {
        if self.several && !self.ended { self.rows.len().saturating_sub(LATE_ROWS) } else { self.rows.len() }
    }

    /// Takes the rows that are settled.
    pub(super) fn take(&mut self) -> Columns {
        let mut taken = Columns::none(self.width);
        for _ in 0..self.settled() {
            let Some(mut row) = self.rows.pop_front() else { break };
            let after_s = self.rows.front().map_or(f64::INFINITY, |after| after.time_s - row.time_s);
            let farthest_s =
                after_s.min(self.before_s.map_or(f64::INFINITY, |before_s| row.time_s - before_s));
            for (topic, &distance_s) in row.distance_s.iter().enumerate() {
                if distance_s.is_finite() && distance_s > farthest_s {
                    self.left_out[topic].far += 1;
                    for &column in &self.columns[topic] {
                        row.values[column] = f64::NAN;
                    }
                }
            }
            self.before_s = Some(row.time_s);
            for (column, value) in row.values.into_iter().enumerate() {
                taken.push(column, value);
            }
            self.taken += 1;
            taken.lines.push(self.taken);
        }
        taken
    }

    /// What became of messages that are in no row.
    pub(super) fn warnings(&self) -> impl Iterator<Item = String> + '_ {
        self.names.iter().zip(&self.left_out).flat_map(move |(name, left_out)| {
            let LeftOut { thinned, far, late } = *left_out;
            let rows = format!("the rows, messages of {}", self.names[self.leading]);
            [
                (thinned, format!("another one is nearer to its row of {rows}")),
                (far, format!("too far from {rows}")),
                (late, format!("without a time or too late for {rows}")),
            ]
            .into_iter()
            .filter(|&(count, _)| count > 0)
            .map(move |(count, why)| format!("{name}: {count} messages are left out: {why}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of topic 0 with its time, one field of topic 1.
    fn join() -> Join {
        let names = vec!["a".to_owned(), "b".to_owned()];
        Join::new(names, 0, "a.t".to_owned(), vec![vec![0], vec![1]], 2)
    }

    fn rows(join: &mut Join) -> Vec<f64> {
        join.end();
        join.take().values.swap_remove(1)
    }

    #[test]
    fn a_message_stands_in_the_nearest_row_whatever_the_order() {
        let messages = [(0, 0.0), (1, 1.4), (0, 1.0), (0, 2.0), (1, 0.1), (0, 3.0), (1, 3.4)];
        let mut join = join();
        for (topic, time_s) in messages {
            join.add(topic, &[time_s, time_s]).unwrap();
        }
        let found = rows(&mut join);
        assert_eq!(found[..2], [0.1, 1.4]);
        assert!(found[2].is_nan());
        assert_eq!(found[3], 3.4);
        assert_eq!(join.warnings().count(), 0);
    }

    #[test]
    fn of_several_the_nearest_is_taken_and_far_ones_are_left_out() {
        let mut join = join();
        for time_s in [0.0, 1.0, 2.0, 12.0, 13.0] {
            join.add(0, &[time_s, time_s]).unwrap();
        }
        for time_s in [0.8, 1.1, 1.2, 1.5, 6.0, 11.2] {
            join.add(1, &[time_s, time_s]).unwrap();
        }
        let found = rows(&mut join);
        assert!(found[0].is_nan() && found[2].is_nan() && found[4].is_nan(), "{found:?}");
        assert_eq!((found[1], found[3]), (1.1, 11.2));
        let said: Vec<String> = join.warnings().collect();
        assert!(said[0].starts_with("b: 3 messages are left out: another one is nearer"), "{said:?}");
        assert!(said[1].starts_with("b: 1 messages are left out: too far"), "{said:?}");
    }

    #[test]
    fn memory_does_not_grow_when_a_topic_ends() {
        let mut join = join();
        join.add(0, &[0.0, 0.0]).unwrap();
        for message in 0..3 * LATE_MESSAGES {
            join.add(1, &[1.0 + message as f64, 0.0]).unwrap();
        }
        assert!(join.waiting.len() <= LATE_MESSAGES);
        let mut taken = 0;
        for row in 1..3 * LATE_ROWS {
            join.add(0, &[1e6 + row as f64, 0.0]).unwrap();
            taken += join.take().rows();
            assert!(join.rows.len() <= LATE_ROWS);
        }
        join.end();
        assert_eq!(taken + join.take().rows(), 3 * LATE_ROWS);
    }

    #[test]
    fn rows_out_of_order_are_an_error_where_others_depend_on_them() {
        let mut join = join();
        join.add(0, &[1.0, 1.0]).unwrap();
        let problem = join.add(0, &[1.0, 1.0]).unwrap_err();
        assert!(problem.message.contains("found time 1 after 1"), "{}", problem.message);
    }
}
