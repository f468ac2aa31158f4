//! Tables in Parquet files: flat columns of numbers; null = missing. A column of time stamps is read in seconds.
mod pages;
mod thrift;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{ConvertedType, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::DataType;
use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader};
use parquet::file::reader::ChunkReader;
use parquet::schema::types::ColumnDescriptor;

use super::kind::PARQUET_MAGIC;
use super::seconds::seconds;
use super::{CHUNK_ROWS, Chunks, Columns, TableReader, guarded};
use crate::error::{Error, Problem};

/// Key under which Arrow keeps a schema of its own, which is not that of a copy.
const ARROW_SCHEMA: &str = "ARROW:schema";
/// Bytes at the end of a file: the length of the metadata before them, and the format's name.
const TAIL_BYTES: u64 = 8;

/// A Parquet file of which the schema has been read.
pub(super) struct ParquetTable<R: ChunkReader> {
    path: PathBuf,
    names: Vec<String>,
    metadata: Vec<(String, String)>,
    file: Arc<R>,
    contents: ParquetMetaData,
}

impl<R: ChunkReader + 'static> ParquetTable<R> {
    /// Reads the schema.
    ///
    /// # Errors
    /// A file that cannot be read or has no columns.
    pub(super) fn new(path: &Path, file: R) -> Result<Self, Error> {
        let contents = guarded(path, || contents(&file).map_err(|error| unreadable(path, "", &error)))?;
        let schema = contents.file_metadata().schema_descr();
        let names: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
        if names.is_empty() {
            return Err(Error::one(path, Problem::new(None, "", "found no columns; expected at least one")));
        }
        let metadata = (contents.file_metadata().key_value_metadata().into_iter().flatten())
            .filter(|pair| pair.key != ARROW_SCHEMA)
            .map(|pair| (pair.key.clone(), pair.value.clone().unwrap_or_default()))
            .collect();
        Ok(Self { path: path.to_owned(), names, metadata, file: Arc::new(file), contents })
    }
}

/// What stands at the end of a file, gone through before it is decoded.
fn contents<R: ChunkReader>(file: &R) -> Result<ParquetMetaData, ParquetError> {
    if let Some(begin) = file.len().checked_sub(TAIL_BYTES) {
        let tail = file.get_bytes(begin, TAIL_BYTES as usize)?;
        // What is not there, encrypted or not of this format, the decoder says.
        if let (true, Some(&length)) = (tail.ends_with(PARQUET_MAGIC), tail.first_chunk()) {
            let length = u32::from_le_bytes(length);
            if let Some(begin) = begin.checked_sub(length.into()) {
                thrift::check_file(&file.get_bytes(begin, length as usize)?)?;
            }
        }
    }
    ParquetMetaDataReader::new().parse_and_finish(file)
}

impl<R: ChunkReader + 'static> TableReader for ParquetTable<R> {
    fn names(&self) -> &[String] {
        &self.names
    }

    fn metadata(&self) -> &[(String, String)] {
        &self.metadata
    }

    fn chunks(self: Box<Self>, wanted: &[usize]) -> Result<Chunks, Error> {
        let schema = self.contents.file_metadata().schema_descr();
        let columns = (wanted.iter())
            .map(|&index| {
                let name = self.names.get(index).cloned().unwrap_or_default();
                let descriptor = schema.column(index);
                let scale = scale(&descriptor)
                    .map_err(|found| Error::one(&self.path, Problem::new(None, &name, found)))?;
                Ok(Column { index, name, scale, nullable: descriptor.max_def_level() > 0 })
            })
            .collect::<Result<Vec<_>, Error>>()?;
        Ok(Box::new(ParquetRows {
            table: *self,
            columns,
            group: 0,
            readers: Vec::new(),
            left: 0,
            row: 0,
            ended: false,
        }))
    }
}

/// A column that is read.
struct Column {
    index: usize,
    name: String,
    scale: Scale,
    nullable: bool,
}

/// The rows of a Parquet file: a page of each column is in memory at a time.
struct ParquetRows<R: ChunkReader> {
    table: ParquetTable<R>,
    columns: Vec<Column>,
    /// The row group that is read next.
    group: usize,
    /// The columns of the row group that is read now, and how many of its rows are left.
    readers: Vec<ColumnReader>,
    left: usize,
    /// Rows read so far.
    row: u64,
    ended: bool,
}

impl<R: ChunkReader + 'static> Iterator for ParquetRows<R> {
    type Item = Result<Columns, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let path = self.table.path.clone();
        let chunk = guarded(&path, || self.chunk()).transpose();
        self.ended = chunk.as_ref().is_none_or(Result::is_err);
        chunk
    }
}

impl<R: ChunkReader + 'static> ParquetRows<R> {
    fn chunk(&mut self) -> Result<Option<Columns>, Error> {
        while self.left == 0 {
            let contents = &self.table.contents;
            if self.group == contents.num_row_groups() {
                return Ok(None);
            }
            self.left = usize::try_from(contents.row_group(self.group).num_rows()).unwrap_or_default();
            self.readers = (self.columns.iter())
                .map(|column| {
                    let opened = pages::column_reader(&self.table.file, contents, self.group, column.index);
                    opened.map_err(|error| unreadable(&self.table.path, &column.name, &error))
                })
                .collect::<Result<_, _>>()?;
            self.group += 1;
        }
        let rows = self.left.min(CHUNK_ROWS);
        let last = rows == self.left;
        let mut chunk = Columns::none(self.columns.len());
        for (place, (column, reader)) in self.columns.iter().zip(&mut self.readers).enumerate() {
            let mut values = Vec::with_capacity(rows);
            // One more than there should be, at the end of a group.
            column
                .decode(reader, rows + usize::from(last), &mut values)
                .map_err(|error| unreadable(&self.table.path, &column.name, &error))?;
            if values.len() != rows {
                let message = "found another number of values than rows in a group; the file is damaged";
                return Err(Error::one(&self.table.path, Problem::new(None, &column.name, message)));
            }
            for value in values {
                chunk.push(place, value);
            }
        }
        chunk.lines.extend(self.row + 1..=self.row + rows as u64);
        self.row += rows as u64;
        self.left -= rows;
        Ok(Some(chunk))
    }
}

impl Column {
    /// Appends up to `most` values; nulls become NaN.
    fn decode(
        &self,
        reader: &mut ColumnReader,
        most: usize,
        values: &mut Vec<f64>,
    ) -> Result<(), ParquetError> {
        match reader {
            ColumnReader::BoolColumnReader(reader) => self.typed(reader, f64::from, most, values),
            ColumnReader::Int32ColumnReader(reader) => self.typed(reader, self.scale.of_i32(), most, values),
            ColumnReader::Int64ColumnReader(reader) => self.typed(reader, self.scale.of_i64(), most, values),
            ColumnReader::FloatColumnReader(reader) => self.typed(reader, f64::from, most, values),
            ColumnReader::DoubleColumnReader(reader) => self.typed(reader, |value| value, most, values),
            // Refused by `scale`.
            _ => Ok(()),
        }
    }

    fn typed<T: DataType>(
        &self,
        reader: &mut ColumnReaderImpl<T>,
        number: impl Fn(T::T) -> f64,
        most: usize,
        values: &mut Vec<f64>,
    ) -> Result<(), ParquetError> {
        let (mut present, mut levels) = (Vec::with_capacity(most), Vec::with_capacity(most));
        while values.len() < most {
            present.clear();
            levels.clear();
            let left = most - values.len();
            let (records, ..) =
                reader.read_records(left, self.nullable.then_some(&mut levels), None, &mut present)?;
            if records == 0 {
                break;
            }
            let mut numbers = present.drain(..).map(&number);
            if self.nullable {
                values.extend(
                    levels
                        .iter()
                        .map(|&level| if level > 0 { numbers.next() } else { None }.unwrap_or(f64::NAN)),
                );
            } else {
                values.extend(numbers);
            }
        }
        Ok(())
    }
}

/// What the integers of a column mean.
#[derive(Clone, Copy)]
struct Scale {
    /// Decimal places of a time stamp's seconds.
    places: u8,
    unsigned: bool,
}

impl Scale {
    fn of_i32(self) -> impl Fn(i32) -> f64 {
        move |value| if self.unsigned { f64::from(value.cast_unsigned()) } else { f64::from(value) }
    }

    fn of_i64(self) -> impl Fn(i64) -> f64 {
        move |value| match (self.unsigned, self.places) {
            (true, _) => value.cast_unsigned() as f64,
            (false, 0) => value as f64,
            (false, places) => seconds(value.into(), places),
        }
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
    let plain = Scale { places: 0, unsigned: false };
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(timestamp)), _) => Ok(Scale {
            places: match timestamp.unit {
                TimeUnit::MILLIS => 3,
                TimeUnit::MICROS => 6,
                TimeUnit::NANOS => 9,
            },
            ..plain
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS) => Ok(Scale { places: 3, ..plain }),
        (_, ConvertedType::TIMESTAMP_MICROS) => Ok(Scale { places: 6, ..plain }),
        (
            _,
            ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64,
        ) => Ok(Scale { unsigned: true, ..plain }),
        (_, ConvertedType::DECIMAL) => not_a_number("decimal values"),
        _ => Ok(plain),
    }
}

fn unreadable(path: &Path, column: &str, error: &ParquetError) -> Error {
    Error::one(path, Problem::new(None, column, format!("cannot read the table: {error}")))
}
