//! HDF5 files, of which MATLAB's of version 7.3 and netCDF-4 are some: <https://support.hdfgroup.org/documentation>.
//!
//! A dataset of numbers is a column under its path, `imu/gyro`, of two axes a column `imu/gyro[k]` for each k of the
//! second. The fields of a dataset of records are columns `imu.x`; so are the parts `z.r` and `z.i` of complex numbers.
//! MATLAB's variables are columns as those of version 5 are: `imu.x` of a structure, and `gyro[k]` for the k-th column of
//! a matrix, of which MATLAB turns the axes when it writes. Text, references, and what MATLAB keeps for itself have no
//! columns, nor have MATLAB's complex numbers.
use std::path::Path;

use hdf5_reader::error::Error as Hdf5Error;
use hdf5_reader::group::Group;
use hdf5_reader::{ByteOrder, CompoundField, Dataset, Datatype, Hdf5File, OpenOptions};

use super::arrays::{ArrayTable, LARGEST_BYTES, Shape, TOO_LARGE};
use super::guarded;
use super::number::Number;
use crate::error::{Error, Problem};

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
/// First bytes of a file that MATLAB has written.
pub(super) const MATLAB_MAGIC: &[u8] = b"MATLAB 7.3 MAT-file";
/// Groups in groups that are gone into.
const DEEPEST: usize = 16;
/// Datasets that are looked at.
const MOST_DATASETS: usize = 100_000;
/// The attribute by which MATLAB says what an array is, and classes that are numbers.
const CLASS: &str = "MATLAB_class";
const NUMBERS: [&str; 11] =
    ["double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical"];
/// The attribute of an array without elements, of which the data are its axes.
const EMPTY: &str = "MATLAB_empty";

/// The table of a file in memory.
///
/// # Errors
/// A file that cannot be read, or has no columns.
pub(super) fn table(path: &Path, bytes: Vec<u8>) -> Result<ArrayTable, Error> {
    let matlab = bytes.starts_with(MATLAB_MAGIC);
    guarded(path, || {
        let options = OpenOptions::default().with_max_read_bytes(LARGEST_BYTES as usize);
        let opened = Hdf5File::from_vec_with_options(bytes, options);
        let root = opened.and_then(|file| file.root_group());
        let failed = |wrong: Wrong| Error::one(path, Problem::of_file(wrong.message()));
        let root = root.map_err(|error| failed(Wrong::Reader(error)))?;
        let mut file = File { table: ArrayTable::new(path), matlab, datasets: 0, objects: false };
        file.group(&root, "", 0).map_err(failed)?;
        let hint = if file.objects {
            "; tables, timetables and objects are not read: in MATLAB s = table2struct(T, \"ToScalar\", true), or writetable"
        } else {
            ""
        };
        file.table.with_columns(hint)
    })
}

/// Why a file cannot be read.
enum Wrong {
    Reader(Hdf5Error),
    /// A message.
    Said(String),
}

impl From<Hdf5Error> for Wrong {
    fn from(error: Hdf5Error) -> Self {
        Self::Reader(error)
    }
}

impl Wrong {
    fn message(self) -> String {
        match self {
            Self::Reader(error) => format!("cannot read the arrays: {error}"),
            Self::Said(message) => message,
        }
    }
}

/// A file that is gone through.
struct File {
    table: ArrayTable,
    matlab: bool,
    datasets: usize,
    /// Whether there are objects of MATLAB, which are not read.
    objects: bool,
}

impl File {
    /// Adds what is in a group, whose path ends in the separator.
    fn group(&mut self, group: &Group, within: &str, depth: usize) -> Result<(), Wrong> {
        if depth > DEEPEST {
            return Err(Wrong::Said(format!(
                "found more than {DEEPEST} groups in each other; expected less"
            )));
        }
        let (groups, datasets) = group.members()?;
        for dataset in &datasets {
            self.datasets += 1;
            if self.datasets > MOST_DATASETS {
                return Err(Wrong::Said(format!(
                    "found more than {MOST_DATASETS} datasets; expected no more"
                )));
            }
            self.dataset(dataset, &format!("{within}{}", last_of(dataset.name())))?;
        }
        for inner in &groups {
            let name = last_of(inner.name());
            // Where MATLAB keeps cells and objects.
            if self.matlab && name.starts_with('#') {
                continue;
            }
            let separator = if self.matlab { '.' } else { '/' };
            self.group(inner, &format!("{within}{name}{separator}"), depth + 1)?;
        }
        Ok(())
    }

    fn dataset(&mut self, dataset: &Dataset, name: &str) -> Result<(), Wrong> {
        if self.matlab && !self.is_matrix(dataset) {
            return Ok(());
        }
        let mut axes = Vec::new();
        for &length in dataset.shape() {
            axes.push(usize::try_from(length).map_err(|_| Wrong::Said(TOO_LARGE.to_owned()))?);
        }
        let fields = match dataset.dtype() {
            Datatype::Compound { fields, .. } if !self.matlab => {
                let numbers =
                    fields.iter().filter_map(|field| Some((of_field(field, name), element_of(field)?)));
                numbers.collect()
            }
            kind => number_of(kind).map(|number| vec![(name.to_owned(), (0, number))]).unwrap_or_default(),
        };
        if fields.is_empty() || axes.is_empty() {
            return Ok(());
        }
        // Turned by MATLAB: its first axis is the last one here, and the fastest.
        let shape = if self.matlab {
            axes.reverse();
            Shape { axes, by_columns: true }
        } else {
            Shape { axes, by_columns: false }
        };
        let size = dataset.raw_element_size()?;
        let bytes = dataset.read_raw_bytes()?;
        if shape.count().and_then(|count| count.checked_mul(size)) != Some(bytes.len()) {
            return Err(Wrong::Said("cannot read the arrays: the file is damaged or cut off".to_owned()));
        }
        for (name, (offset, (number, big_endian))) in fields {
            let at = |index: usize| {
                number.read_in_order(bytes.get(index.checked_mul(size)?.checked_add(offset)?..)?, big_endian)
            };
            self.table.add(&name, &shape, |index| at(index).unwrap_or(f64::NAN)).map_err(Wrong::Said)?;
        }
        Ok(())
    }

    /// Whether a dataset is what MATLAB calls a matrix of numbers.
    fn is_matrix(&mut self, dataset: &Dataset) -> bool {
        if dataset.attribute(EMPTY).is_ok() {
            return false;
        }
        let class = dataset.attribute(CLASS).and_then(|class| class.read_string());
        let class = class.as_deref().map(|class| class.trim_end_matches('\0'));
        self.objects |= dataset.attribute("MATLAB_object_decode").is_ok();
        class.is_ok_and(|class| NUMBERS.contains(&class))
    }
}

/// The last name of a path.
fn last_of(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

fn of_field(field: &CompoundField, dataset: &str) -> String {
    format!("{dataset}.{}", field.name)
}

/// Where a field stands in its record, and how it is written.
fn element_of(field: &CompoundField) -> Option<(usize, (Number, bool))> {
    Some((field.byte_offset as usize, number_of(&field.datatype)?))
}

/// How a number is written, and whether the most significant byte is first; `None` of what is none.
fn number_of(kind: &Datatype) -> Option<(Number, bool)> {
    let (number, order) = match kind {
        Datatype::FixedPoint { size, signed, byte_order } => {
            let number = match (size, signed) {
                (1, true) => Number::I8,
                (1, false) => Number::U8,
                (2, true) => Number::I16,
                (2, false) => Number::U16,
                (4, true) => Number::I32,
                (4, false) => Number::U32,
                (8, true) => Number::I64,
                (8, false) => Number::U64,
                _ => return None,
            };
            (number, byte_order)
        }
        Datatype::FloatingPoint { size: 4, byte_order } => (Number::F32, byte_order),
        Datatype::FloatingPoint { size: 8, byte_order } => (Number::F64, byte_order),
        // Of h5py's booleans.
        Datatype::Enum { base, .. } => return number_of(base),
        _ => return None,
    };
    Some((number, *order == ByteOrder::BigEndian))
}
