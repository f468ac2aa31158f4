//! Recordings in Parquet: the same case from CSV and from Parquet is the same recording; what is not a number is named.
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{BrotliLevel, Compression, GzipLevel, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, FloatType, Int64Type};
use parquet::file::metadata::ParquetMetaDataReader;
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use schuler_recording::{Recording, table};

const ROWS: usize = 40_000;
/// Time of the first row, ms.
const START_MS: i64 = 1_700_000_000_000;
const SCHEMA: &str = "message table {
    required int64 t (TIMESTAMP(MILLIS,true));
    optional double gyro;
    optional float temperature;
    required boolean heater;
    optional binary remark (UTF8);
}";

/// Rows at 10 Hz in two groups; every 100th gyro reading and every 7th temperature is null.
fn write(path: &Path, version: WriterVersion, compression: Compression) {
    let schema = Arc::new(parse_message_type(SCHEMA).unwrap());
    let properties = WriterProperties::builder().set_writer_version(version).set_compression(compression);
    let properties = Arc::new(properties.build());
    let mut writer = SerializedFileWriter::new(File::create(path).unwrap(), schema, properties).unwrap();
    for rows in [0..ROWS / 4, ROWS / 4..ROWS] {
        let mut group = writer.next_row_group().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let time: Vec<i64> = rows.clone().map(time_ms).collect();
        column.typed::<Int64Type>().write_batch(&time, None, None).unwrap();
        column.close().unwrap();
        let present =
            |every: usize| rows.clone().map(move |row| i16::from(row % every != 0)).collect::<Vec<_>>();
        let mut column = group.next_column().unwrap().unwrap();
        let gyro: Vec<f64> = rows.clone().filter(|row| row % 100 != 0).map(gyro).collect();
        column.typed::<DoubleType>().write_batch(&gyro, Some(&present(100)), None).unwrap();
        column.close().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let temperature: Vec<f32> = rows.clone().filter(|row| row % 7 != 0).map(temperature).collect();
        column.typed::<FloatType>().write_batch(&temperature, Some(&present(7)), None).unwrap();
        column.close().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let heater: Vec<bool> = rows.clone().map(|row| row % 2 == 1).collect();
        column.typed::<BoolType>().write_batch(&heater, None, None).unwrap();
        column.close().unwrap();
        let mut column = group.next_column().unwrap().unwrap();
        let remark: Vec<ByteArray> = rows.clone().map(|_| ByteArray::from("calm")).collect();
        column.typed::<ByteArrayType>().write_batch(&remark, Some(&vec![1; rows.len()]), None).unwrap();
        column.close().unwrap();
        group.close().unwrap();
    }
    writer.close().unwrap();
}

fn time_ms(row: usize) -> i64 {
    START_MS + 100 * i64::try_from(row).unwrap()
}

fn gyro(row: usize) -> f64 {
    (row as f64 * 0.01).sin() + 1.0 / 3.0
}

fn temperature(row: usize) -> f32 {
    20.0 + row as f32 * 1e-3
}

fn case(table: &str, column: &str) -> String {
    format!(
        r#"
        format = "schuler-case/1"
        title = "Bench"
        [recording]
        path = "{table}"
        time = "t"
        step_s = 0.1
        [motion]
        kind = "static"
        [[sensor]]
        id = "gyro"
        kind = "fog"
        column = "{column}"
        unit = "deg/h"
        axis = [1.0, 0.0, 0.0]
        [[aux]]
        column = "temperature"
        quantity = "temperature"
        unit = "degC"
        near = "gyro"
        "#
    )
}

/// Found by fuzzing: pages refer to a dictionary that is not there, on which the decoder panics.
#[test]
fn a_file_on_which_the_decoder_panics_is_an_error() {
    let bytes = include_bytes!("../../../fuzz/regressions/table_parquet/dictionary-missing");
    let table = table::open_bytes(Path::new("damaged.parquet"), bytes.to_vec());
    let error = match table {
        Ok(table) => {
            let all: Vec<usize> = (0..table.names().len()).collect();
            table.read(&all).unwrap_err()
        }
        Err(error) => error,
    };
    assert!(error.to_string().starts_with("damaged.parquet: "), "{error}");
}

#[test]
fn a_case_reads_the_same_from_csv_and_from_parquet() {
    let directory = tempfile::tempdir().unwrap();
    let time: Vec<f64> = (0..ROWS).map(|row| time_ms(row) as f64 / 1e3).collect();
    let unless = |every: usize, value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..ROWS).map(|row| if row % every == 0 { f64::NAN } else { value(row) }).collect()
    };
    let columns = [
        ("t", &*time),
        ("gyro", &*unless(100, &gyro)),
        ("temperature", &*unless(7, &|row| f64::from(temperature(row)))),
    ];
    table::write(&directory.path().join("table.csv"), &columns).unwrap();
    let csv = directory.path().join("csv.toml");
    std::fs::write(&csv, case("table.csv", "gyro")).unwrap();
    let from_csv = Recording::read(&csv).unwrap();
    // The first row holds nothing but its time, as do others, which become gaps.
    assert_eq!(from_csv.len(), ROWS - 1);

    let versions = [WriterVersion::PARQUET_1_0, WriterVersion::PARQUET_2_0];
    let compressions = [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::GZIP(GzipLevel::default()),
        Compression::ZSTD(ZstdLevel::default()),
        Compression::LZ4_RAW,
        Compression::BROTLI(BrotliLevel::default()),
    ];
    for (version, compression) in
        versions.into_iter().flat_map(|version| compressions.iter().map(move |&it| (version, it)))
    {
        write(&directory.path().join("table.parquet"), version, compression);
        let path = directory.path().join("parquet.toml");
        std::fs::write(&path, case("table.parquet", "gyro")).unwrap();
        let from_parquet = Recording::read(&path).unwrap();
        assert_eq!(from_parquet.time_s, from_csv.time_s, "{compression:?}");
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(
            bits(&from_parquet.sensors[0].values),
            bits(&from_csv.sensors[0].values),
            "{compression:?}"
        );
        let temperature = |recording: &Recording| bits(&recording.auxiliaries[0].values);
        assert_eq!(temperature(&from_parquet), temperature(&from_csv), "{compression:?}");
        assert_eq!(from_parquet.sensors[0].quality, from_csv.sensors[0].quality, "{compression:?}");
    }
}

#[test]
fn what_is_not_a_number_is_named() {
    let directory = tempfile::tempdir().unwrap();
    write(&directory.path().join("table.parquet"), WriterVersion::PARQUET_1_0, Compression::SNAPPY);
    let path = directory.path().join("case.toml");
    std::fs::write(&path, case("table.parquet", "remark")).unwrap();
    let message = Recording::read(&path).unwrap_err().to_string();
    assert!(message.contains("remark") && message.contains("BYTE_ARRAY"), "{message}");
    std::fs::write(&path, case("table.parquet", "giro")).unwrap();
    let message = Recording::read(&path).unwrap_err().to_string();
    assert!(message.contains("did you mean \"gyro\"?"), "{message}");
}

#[test]
fn a_damaged_file_is_an_error_wherever_the_damage_is() {
    let directory = tempfile::tempdir().unwrap();
    let good = directory.path().join("good.parquet");
    write(&good, WriterVersion::PARQUET_1_0, Compression::SNAPPY);
    let bytes = std::fs::read(&good).unwrap();
    let damaged = directory.path().join("damaged.parquet");
    for length in [4, 5, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&damaged, &bytes[..length]).unwrap();
        assert!(table::open(&damaged).is_err(), "cut to {length} bytes");
    }
    // A flipped byte may hide in the values; what matters is that nothing panics.
    for at in (4..bytes.len()).step_by(bytes.len() / 300) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x55;
        std::fs::write(&damaged, &flipped).unwrap();
        if let Ok(table) = table::open(&damaged) {
            let _ = table.read(&[0, 1, 2, 3]);
        }
    }
}

#[test]
fn wide_tables_are_stored_as_they_are_in_few_groups() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("wide.parquet");
    let value =
        |row: usize, column: usize| if row == 7 { f64::NAN } else { (row * 31 + column) as f64 / 7.0 };
    for (columns, rows, groups, stored) in [(100, 40, 1, false), (9_000, 70, 2, true), (35_000, 32, 2, true)]
    {
        let names: Vec<String> = (0..columns).map(|column| format!("c{column}")).collect();
        let values: Vec<Vec<f64>> =
            (0..columns).map(|column| (0..rows).map(|row| value(row, column)).collect()).collect();
        let table: Vec<(&str, &[f64])> =
            names.iter().zip(&values).map(|(name, values)| (name.as_str(), values.as_slice())).collect();
        table::write(&path, &table).unwrap();
        let contents = ParquetMetaDataReader::new().parse_and_finish(&File::open(&path).unwrap()).unwrap();
        assert_eq!(contents.num_row_groups(), groups, "{columns} columns");
        let compression = contents.row_group(0).column(columns / 2).compression();
        assert_eq!(compression == Compression::UNCOMPRESSED, stored, "{columns} columns: {compression}");
        let read = table::open(&path).unwrap().read(&[0, columns - 1]).unwrap();
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        for (found, column) in read.values.iter().zip([0, columns - 1]) {
            assert_eq!(bits(found), bits(&values[column]), "{columns} columns");
        }
    }
}
