//! Where a campaign's files lie, each whole or not there.
//!
//! | path | holds |
//! | --- | --- |
//! | `cases/0017/` | case and recording as their user has them |
//! | `seals/0017.txt` | fingerprint of the answer, written before anybody looks |
//! | `answers/0017.json` | the answer with its salt, and `0017.csv.gz` the oracle's gain row by row |
use std::path::{Path, PathBuf};

use schuler_recording::{Error, Problem};
use serde::{Deserialize, Serialize};

use super::answer::Answer;
use super::maker::Made;
use super::seal::Seal;
use crate::output;
use crate::simulation::CASE;

/// Directory of a campaign.
#[derive(Clone, Debug)]
pub struct Files {
    /// The directory.
    pub directory: PathBuf,
}

/// An answer with what breaks its seal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Opened {
    /// Seal.
    pub seal: Seal,
    /// Text of the answer as it was sealed.
    pub text: String,
}

impl Files {
    /// Directory of a case.
    pub fn case_directory(&self, index: usize) -> PathBuf {
        self.directory.join("cases").join(format!("{index:04}"))
    }

    /// A case.
    pub fn case(&self, index: usize) -> PathBuf {
        self.case_directory(index).join(CASE)
    }

    /// Fingerprint of an answer.
    pub fn seal(&self, index: usize) -> PathBuf {
        self.directory.join("seals").join(format!("{index:04}.txt"))
    }

    /// An answer.
    pub fn answer(&self, index: usize) -> PathBuf {
        self.directory.join("answers").join(format!("{index:04}.json"))
    }

    /// The oracle's gain.
    pub fn gain(&self, index: usize) -> PathBuf {
        self.directory.join("answers").join(format!("{index:04}.csv.gz"))
    }

    /// Writes a case and the fingerprint of its answer; the answer stays in hand.
    ///
    /// # Errors
    /// A file that cannot be written, no randomness for the salt.
    pub fn write_case(&self, made: &Made) -> Result<Opened, Error> {
        let index = made.answer.index;
        let failed = |message: String| Error::one(self.answer(index), Problem::of_file(message));
        let text = serde_json::to_string_pretty(&made.answer)
            .map_err(|error| failed(format!("cannot write the answer: {error}")))?;
        let seal = Seal::new(&text).map_err(|error| failed(error.to_string()))?;
        output::write(&self.seal(index), format!("{}\n", seal.fingerprint).as_bytes())?;
        made.simulated.write_public(&self.case_directory(index))?;
        Ok(Opened { seal, text })
    }

    /// Writes the answer, once it may be known.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_answer(&self, made: &Made, opened: &Opened) -> Result<(), Error> {
        let path = self.answer(made.answer.index);
        let document = serde_json::json!({
            "seal": opened.seal,
            "text": opened.text,
            "answer": made.answer,
        });
        let text = serde_json::to_string_pretty(&document).unwrap_or_default();
        output::write(&path, text.as_bytes())?;
        let time: Vec<f64> = (1..=made.gain.len()).map(|k| k as f64 * made.answer.step_s).collect();
        output::write_table(&self.gain(made.answer.index), &[("t", &time), ("gain_nats", &made.gain)])
    }

    /// Reads an answer and makes sure that it is the one that was sealed.
    ///
    /// # Errors
    /// Files that are missing or spoilt, a seal that does not fit.
    pub fn open(&self, index: usize) -> Result<Answer, Error> {
        let path = self.answer(index);
        let wrong = |message: &str| Error::one(&path, Problem::of_file(message));
        let read = |path: &Path| {
            std::fs::read_to_string(path).map_err(|error| Error::io(path, "read the file", &error))
        };
        let opened: Opened =
            serde_json::from_str(&read(&path)?).map_err(|error| wrong(&format!("not an answer: {error}")))?;
        let sealed = read(&self.seal(index))?;
        if sealed.trim() != opened.seal.fingerprint || !opened.seal.fits(&opened.text) {
            return Err(wrong("the answer is not the one that was sealed"));
        }
        serde_json::from_str(&opened.text).map_err(|error| wrong(&format!("not an answer: {error}")))
    }
}
