//! Tables written a chunk of rows at a time: CSV, gzipped CSV, Parquet.
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::write::GzEncoder;
use parquet::basic::{Compression, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::DoubleType;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::csv::CsvWriter;
use crate::error::{Error, Problem};

/// Rows of a Parquet row group: what is in memory, 8 bytes a value, before it is compressed.
const GROUP_ROWS: usize = 1 << 16;
/// Values of all columns of a row group, where that is fewer.
const GROUP_VALUES: usize = 1 << 19;
/// Least rows of a row group, however many columns there are: each group describes every column once more.
const LEAST_GROUP_ROWS: usize = 16;
/// Rows of a row group below which values are stored as they are. Compressing costs some 60 µs a column, to save less than 500 bytes.
const STORED_ROWS: usize = 64;

/// What a table can be written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values: a header row, every value in the fewest digits that read back to the same bits, an empty
    /// cell where one is missing.
    Csv,
    /// The same, gzipped.
    CsvGz,
    /// Parquet: columns of optional doubles, compressed with Zstandard, null where a value is missing.
    Parquet,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Csv, Self::CsvGz, Self::Parquet];

    /// How the names of such files end.
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Csv => ".csv",
            Self::CsvGz => ".csv.gz",
            Self::Parquet => ".parquet",
        }
    }

    /// The format that the name of a file says.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        Self::ALL.into_iter().find(|format| name.ends_with(format.ending()))
    }
}

/// Writes a table.
pub struct TableWriter {
    path: PathBuf,
    columns: usize,
    sink: Sink,
}

enum Sink {
    Csv(Box<CsvWriter<File>>),
    CsvGz(Box<CsvWriter<GzEncoder<File>>>),
    Parquet(Box<ParquetWriter>),
}

impl TableWriter {
    /// Makes the file at `path`; `metadata` is kept where the format has a place for it (Parquet).
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(
        path: &Path,
        format: Format,
        names: &[&str],
        metadata: &[(String, String)],
    ) -> Result<Self, Error> {
        let file = File::create(path).map_err(|error| unwritable(path, &error))?;
        Self::new(file, path, format, names, metadata)
    }

    /// Writes to an open file; `path` is what errors call it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn new(
        file: File,
        path: &Path,
        format: Format,
        names: &[&str],
        metadata: &[(String, String)],
    ) -> Result<Self, Error> {
        let sink = || match format {
            Format::Csv => Ok(Sink::Csv(Box::new(CsvWriter::new(file, names)?))),
            Format::CsvGz => {
                let encoder = GzEncoder::new(file, flate2::Compression::default());
                Ok(Sink::CsvGz(Box::new(CsvWriter::new(encoder, names)?)))
            }
            Format::Parquet => Ok(Sink::Parquet(Box::new(ParquetWriter::new(file, names, metadata)?))),
        };
        let sink = sink().map_err(|error: io::Error| unwritable(path, &error))?;
        Ok(Self { path: path.to_owned(), columns: names.len(), sink })
    }

    /// Writes rows, given by as many columns as there are names; NaN = missing.
    ///
    /// # Errors
    /// Another number of columns, columns of different lengths, a file that cannot be written.
    pub fn write(&mut self, columns: &[&[f64]]) -> Result<(), Error> {
        let rows = columns.first().map_or(0, |values| values.len());
        if columns.len() != self.columns {
            let message = format!("cannot write {} columns; expected {}", columns.len(), self.columns);
            return Err(Error::one(&self.path, Problem::of_file(message)));
        }
        if let Some(values) = columns.iter().find(|values| values.len() != rows) {
            let message = format!("cannot write a column of {} rows beside one of {rows}", values.len());
            return Err(Error::one(&self.path, Problem::of_file(message)));
        }
        match &mut self.sink {
            Sink::Csv(writer) => writer.write(columns),
            Sink::CsvGz(writer) => writer.write(columns),
            Sink::Parquet(writer) => writer.write(columns).map_err(io::Error::from),
        }
        .map_err(|error| unwritable(&self.path, &error))
    }

    /// Writes what is left and the end of the file; a file without it is not whole.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> Result<(), Error> {
        match self.sink {
            Sink::Csv(writer) => writer.finish(),
            Sink::CsvGz(writer) => writer.finish().and_then(GzEncoder::finish),
            Sink::Parquet(writer) => writer.finish().map_err(io::Error::from),
        }
        .map(drop)
        .map_err(|error| unwritable(&self.path, &error))
    }
}

fn unwritable(path: &Path, error: &io::Error) -> Error {
    Error::io(path, "write the table", error)
}

/// Collects rows into row groups.
struct ParquetWriter {
    writer: SerializedFileWriter<File>,
    group: Vec<Vec<f64>>,
    group_rows: usize,
}

impl ParquetWriter {
    fn new(file: File, names: &[&str], metadata: &[(String, String)]) -> Result<Self, ParquetError> {
        let columns = names
            .iter()
            .map(|name| {
                let column = Type::primitive_type_builder(name, Physical::DOUBLE)
                    .with_repetition(Repetition::OPTIONAL)
                    .build()?;
                Ok(Arc::new(column))
            })
            .collect::<Result<_, ParquetError>>()?;
        let schema = Type::group_type_builder("table").with_fields(columns).build()?;
        let metadata =
            metadata.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone())).collect();
        let group_rows = GROUP_ROWS.min(GROUP_VALUES / names.len().max(1)).max(LEAST_GROUP_ROWS);
        let properties = WriterProperties::builder().set_key_value_metadata(Some(metadata));
        let properties = if group_rows < STORED_ROWS {
            (properties.set_compression(Compression::UNCOMPRESSED))
                .set_dictionary_enabled(false)
                .set_statistics_enabled(EnabledStatistics::None)
        } else {
            properties.set_compression(Compression::ZSTD(ZstdLevel::default()))
        };
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties.build()))?;
        Ok(Self { writer, group: vec![Vec::new(); names.len()], group_rows })
    }

    fn write(&mut self, columns: &[&[f64]]) -> Result<(), ParquetError> {
        let rows = columns.first().map_or(0, |values| values.len());
        let mut from = 0;
        while from < rows {
            let there = self.group.first().map_or(0, Vec::len);
            let to = rows.min(from + self.group_rows - there);
            for (group, values) in self.group.iter_mut().zip(columns) {
                group.extend(values.get(from..to).unwrap_or_default());
            }
            if there + to - from == self.group_rows {
                self.write_group()?;
            }
            from = to;
        }
        Ok(())
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.writer.next_row_group()?;
        for values in &mut self.group {
            let levels: Vec<i16> = values.iter().map(|value| i16::from(!value.is_nan())).collect();
            values.retain(|value| !value.is_nan());
            if let Some(mut column) = group.next_column()? {
                column.typed::<DoubleType>().write_batch(values, Some(&levels), None)?;
                column.close()?;
            }
            values.clear();
        }
        group.close()?;
        Ok(())
    }

    fn finish(mut self) -> Result<File, ParquetError> {
        if self.group.first().is_some_and(|values| !values.is_empty()) {
            self.write_group()?;
        }
        self.writer.into_inner()
    }
}

/// Writes `columns` under their names to `path` in the format that its name says, CSV where it says none.
///
/// Every finite value reads back to the same bits; NaN is missing.
///
/// # Errors
/// Columns of different lengths, a file that cannot be written.
pub fn write(path: &Path, columns: &[(&str, &[f64])]) -> Result<(), Error> {
    write_to(File::create(path).map_err(|error| unwritable(path, &error))?, path, columns)
}

/// Writes `columns` as [`write()`] does to an open file, which is to be at `path`.
///
/// # Errors
/// As [`write()`].
pub fn write_to(file: File, path: &Path, columns: &[(&str, &[f64])]) -> Result<(), Error> {
    let rows = columns.first().map_or(0, |(_, values)| values.len());
    if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != rows) {
        let message = format!("cannot write a column of {} rows beside one of {rows}", values.len());
        return Err(Error::one(path, Problem::new(None, *name, message)));
    }
    let (names, values): (Vec<&str>, Vec<&[f64]>) = columns.iter().copied().unzip();
    let mut writer = TableWriter::new(file, path, Format::of(path).unwrap_or(Format::Csv), &names, &[])?;
    writer.write(&values)?;
    writer.finish()
}
