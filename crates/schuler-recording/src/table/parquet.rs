//! Tables in Parquet files: flat columns of numbers; null = missing. A column of time stamps is read in seconds.
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};

use parquet::basic::{ConvertedType, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;

use super::{Columns, TableReader};
use crate::error::{Error, Problem};

/// Values that are decoded at a time.
const BATCH: usize = 1 << 14;

/// A Parquet file of which the schema has been read.
pub(super) struct ParquetTable<R: ChunkReader> {
    path: PathBuf,
    names: Vec<String>,
    reader: SerializedFileReader<R>,
}

impl<R: ChunkReader + 'static> ParquetTable<R> {
    /// Reads the schema.
    ///
    /// # Errors
    /// A file that cannot be read or has no columns.
    pub(super) fn new(path: &Path, file: R) -> Result<Self, Error> {
        let reader =
            guarded(path, || SerializedFileReader::new(file).map_err(|error| unreadable(path, "", &error)))?;
        let schema = reader.metadata().file_metadata().schema_descr();
        let names: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
        if names.is_empty() {
            return Err(Error::one(path, Problem::new(None, "", "found no columns; expected at least one")));
        }
        Ok(Self { path: path.to_owned(), names, reader })
    }

    /// Appends the values of one column of one row group.
    fn read_column(&self, group: usize, column: usize, values: &mut Vec<f64>) -> Result<(), Error> {
        let name = self.names.get(column).map_or("", String::as_str);
        let failed = |error: ParquetError| unreadable(&self.path, name, &error);
        let descriptor = self.reader.metadata().file_metadata().schema_descr().column(column);
        let scale =
            scale(&descriptor).map_err(|found| Error::one(&self.path, Problem::new(None, name, found)))?;
        let rows = self.reader.metadata().row_group(group).num_rows() as usize;
        let group = self.reader.get_row_group(group).map_err(failed)?;
        let reader = group.get_column_reader(column).map_err(failed)?;
        let nullable = descriptor.max_def_level() > 0;
        let before = values.len();
        match reader {
            ColumnReader::BoolColumnReader(reader) => decode(reader, nullable, f64::from, values),
            ColumnReader::Int32ColumnReader(reader) => decode(reader, nullable, scale.of_i32(), values),
            ColumnReader::Int64ColumnReader(reader) => decode(reader, nullable, scale.of_i64(), values),
            ColumnReader::FloatColumnReader(reader) => decode(reader, nullable, f64::from, values),
            ColumnReader::DoubleColumnReader(reader) => decode(reader, nullable, |value| value, values),
            _ => Ok(()),
        }
        .map_err(failed)?;
        let found = values.len() - before;
        if found != rows {
            let message = format!("found {found} values in a group of {rows} rows; the file is damaged");
            return Err(Error::one(&self.path, Problem::new(None, name, message)));
        }
        Ok(())
    }
}

impl<R: ChunkReader + 'static> TableReader for ParquetTable<R> {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn read(self: Box<Self>, wanted: &[usize]) -> Result<Columns, Error> {
        let mut columns = Columns { infinite: vec![0; wanted.len()], ..Columns::default() };
        for (&column, infinite) in wanted.iter().zip(&mut columns.infinite) {
            let mut values = Vec::new();
            for group in 0..self.reader.num_row_groups() {
                guarded(&self.path, || self.read_column(group, column, &mut values))?;
            }
            for value in &mut values {
                *infinite += usize::from(value.is_infinite());
                if !value.is_finite() {
                    *value = f64::NAN;
                }
            }
            columns.values.push(values);
        }
        let rows = columns.values.iter().map(Vec::len).max().unwrap_or_default();
        columns.lines = (1..=rows as u64).collect();
        Ok(columns)
    }
}

/// What the integers of a column mean.
#[derive(Clone, Copy)]
struct Scale {
    factor: f64,
    unsigned: bool,
}

impl Scale {
    fn of_i32(self) -> impl Fn(i32) -> f64 {
        move |value| {
            if self.unsigned { f64::from(value.cast_unsigned()) } else { f64::from(value) * self.factor }
        }
    }

    fn of_i64(self) -> impl Fn(i64) -> f64 {
        move |value| if self.unsigned { value.cast_unsigned() as f64 } else { value as f64 * self.factor }
    }
}

/// How to turn a column's values into numbers, or why they are none.
fn scale(column: &ColumnDescriptor) -> Result<Scale, String> {
    let not_a_number = |found: &str| Err(format!("found {found}; expected a flat column of numbers"));
    if column.max_rep_level() > 0 || column.max_def_level() > 1 || column.path().parts().len() > 1 {
        return not_a_number("a nested or repeated column");
    }
    if column.self_type().get_basic_info().repetition() == Repetition::REPEATED {
        return not_a_number("a repeated column");
    }
    if matches!(
        column.physical_type(),
        Physical::INT96 | Physical::BYTE_ARRAY | Physical::FIXED_LEN_BYTE_ARRAY
    ) {
        return not_a_number(&format!("values of type {}", column.physical_type()));
    }
    let plain = Scale { factor: 1.0, unsigned: false };
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(timestamp)), _) => Ok(Scale {
            factor: match timestamp.unit {
                TimeUnit::MILLIS => 1e-3,
                TimeUnit::MICROS => 1e-6,
                TimeUnit::NANOS => 1e-9,
            },
            ..plain
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS) => Ok(Scale { factor: 1e-3, ..plain }),
        (_, ConvertedType::TIMESTAMP_MICROS) => Ok(Scale { factor: 1e-6, ..plain }),
        (
            _,
            ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64,
        ) => Ok(Scale { unsigned: true, ..plain }),
        (_, ConvertedType::DECIMAL) => not_a_number("decimal values"),
        _ => Ok(plain),
    }
}

/// Decodes a column of one row group; nulls become NaN.
fn decode<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    nullable: bool,
    number: impl Fn(T::T) -> f64,
    values: &mut Vec<f64>,
) -> Result<(), ParquetError> {
    let (mut present, mut levels) = (Vec::with_capacity(BATCH), Vec::with_capacity(BATCH));
    loop {
        present.clear();
        levels.clear();
        let (records, ..) =
            reader.read_records(BATCH, nullable.then_some(&mut levels), None, &mut present)?;
        if records == 0 {
            return Ok(());
        }
        let mut numbers = present.drain(..).map(&number);
        if nullable {
            values.extend(
                levels.iter().map(|&level| if level > 0 { numbers.next() } else { None }.unwrap_or(f64::NAN)),
            );
        } else {
            values.extend(numbers);
        }
    }
}

/// The decoder's own checks end in a panic for some damaged files; here that is an error like any other.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let message = "cannot read the table: its contents contradict each other; the file is damaged";
        Err(Error::one(path, Problem::of_file(message)))
    })
}

fn unreadable(path: &Path, column: &str, error: &ParquetError) -> Error {
    Error::one(path, Problem::new(None, column, format!("cannot read the table: {error}")))
}
