//! Sound inputs to start from.
use std::sync::Arc;

use parquet::basic::{BrotliLevel, Compression, GzipLevel, ZstdLevel};
use parquet::data_type::{BoolType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use schuler_core::compensation::{Block, Calibration, Factor, Quantity, Target, Term};
use schuler_core::module::{FlightModule, ModuleConfig, StepInput};
use schuler_core::reading::Reading;
use schuler_link::block::encode;
use schuler_link::frame::{Message, Wire};
use schuler_link::message::{
    Banner, Board, Counters, HostMessage, Identity, ModuleMessage, Pace, Start, Transport,
};

use crate::flight;

fn from_host() -> Vec<HostMessage> {
    let input = StepInput { velocity_error: Reading::good(0.125), ..StepInput::without_readings(1000) };
    vec![
        HostMessage::Hello,
        HostMessage::Counters,
        HostMessage::Configure(ModuleConfig::default()),
        HostMessage::Step(input),
        HostMessage::LoadCompensation(encode(&Block::default())),
        HostMessage::SetPace(Pace::Clock { period_ms: 1000 }),
        HostMessage::Reset,
    ]
}

fn from_module() -> Vec<ModuleMessage> {
    let identity = Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn };
    vec![
        ModuleMessage::Banner(Banner::new(identity)),
        ModuleMessage::Counters(Counters::NONE),
        ModuleMessage::Configured,
        ModuleMessage::Output(FlightModule::new().step(&StepInput::without_readings(1))),
    ]
}

/// Frames of every message.
pub fn frames() -> Vec<Vec<u8>> {
    fn wire(message: &impl Message) -> Vec<u8> {
        let mut wire = Wire::new();
        // A message of these fits.
        let _ = wire.encode(3, message);
        wire.as_bytes().to_vec()
    }
    from_host().iter().map(wire).chain(from_module().iter().map(wire)).collect()
}

/// The contents of the frames.
pub fn messages() -> Vec<Vec<u8>> {
    let host = from_host().into_iter().filter_map(|message| postcard::to_allocvec(&message).ok());
    host.chain(from_module().into_iter().filter_map(|message| postcard::to_allocvec(&message).ok())).collect()
}

/// Configurations as they are sent.
pub fn configurations() -> Vec<Vec<u8>> {
    let all = flight::configurations().iter().copied().chain([ModuleConfig::default()]);
    all.filter_map(|config| postcard::to_allocvec(&config).ok()).collect()
}

/// Blocks and their contents.
pub fn blocks() -> Vec<Vec<u8>> {
    let factor = Factor { quantity: Quantity::TemperatureDifference(0, 1), reference: 20.0, power: 2 };
    let term = Term { target: Target::Gyro(1), coefficient: 1e-9, factors: [factor, Factor::default()] };
    let full = Block {
        calibration: Some(Calibration::default()),
        terms: [term; 5].into_iter().collect(),
        ..Block::default()
    };
    let blocks = [Block::default(), full];
    let contents = blocks.clone().into_iter().filter_map(|block| postcard::to_allocvec(&block).ok());
    blocks.iter().map(|block| encode(block).to_vec()).chain(contents).collect()
}

/// A case with every part.
pub fn cases() -> Vec<Vec<u8>> {
    vec![include_bytes!("../seeds/whole.toml").to_vec(), include_bytes!("../seeds/loop.toml").to_vec()]
}

/// CSV and gzipped CSV.
pub fn text_tables() -> Vec<Vec<u8>> {
    let plain = b"t,gyro,temp\n0,0.1,20\n1,nan,20.5\n2,,21\n5,-3e-2,inf\n6,1\n".to_vec();
    let quoted = b"\"t\",\"gyro\",\"temp\"\r\n0,1,2\r\n\r\n1.5,2,3\r\n".to_vec();
    let mut seeds = vec![plain, quoted];
    let directory = std::env::temp_dir();
    let path = directory.join(format!("schuler-fuzz-{}.csv.gz", std::process::id()));
    let columns: [(&str, &[f64]); 3] =
        [("t", &[0.0, 1.0]), ("gyro", &[0.5, f64::NAN]), ("temp", &[20.0, 21.0])];
    if schuler_recording::table::write(&path, &columns).is_ok() {
        seeds.extend(std::fs::read(&path));
        let _ = std::fs::remove_file(&path);
    }
    seeds
}

/// Bytes without a form, for targets that make their input of them.
pub fn noise() -> Vec<Vec<u8>> {
    let mut state = 12345u32;
    let mut byte = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    [64, 512, 4096].map(|length| (0..length).map(|_| byte()).collect()).to_vec()
}

/// Parquet files: a time stamp, an optional number, a float and a boolean, under each compression.
pub fn parquet_tables() -> Vec<Vec<u8>> {
    let compressions = [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::GZIP(GzipLevel::default()),
        Compression::ZSTD(ZstdLevel::default()),
        Compression::LZ4_RAW,
        Compression::BROTLI(BrotliLevel::default()),
    ];
    compressions.into_iter().filter_map(|compression| parquet_table(compression).ok()).collect()
}

fn parquet_table(compression: Compression) -> Result<Vec<u8>, ParquetError> {
    let schema = "message table {
        required int64 t (TIMESTAMP(MILLIS,true)); optional double gyro; required float temp; required boolean on;
    }";
    let properties = Arc::new(WriterProperties::builder().set_compression(compression).build());
    let mut bytes = Vec::new();
    let mut writer =
        SerializedFileWriter::new(&mut bytes, Arc::new(parse_message_type(schema)?), properties)?;
    for first in [0, 4] {
        let mut group = writer.next_row_group()?;
        let mut place = 0;
        while let Some(mut column) = group.next_column()? {
            match place {
                0 => drop(column.typed::<Int64Type>().write_batch(
                    &[first, first + 1, first + 2, first + 3],
                    None,
                    None,
                )?),
                1 => drop(column.typed::<DoubleType>().write_batch(
                    &[0.5, 0.25, 0.5],
                    Some(&[1, 0, 1, 1]),
                    None,
                )?),
                2 => drop(column.typed::<FloatType>().write_batch(&[20.0, 21.0, 20.0, 20.0], None, None)?),
                _ => drop(column.typed::<BoolType>().write_batch(&[true, false, true, true], None, None)?),
            }
            column.close()?;
            place += 1;
        }
        group.close()?;
    }
    writer.close()?;
    Ok(bytes)
}
