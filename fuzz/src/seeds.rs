//! Sound inputs to start from.
use std::sync::Arc;

use parquet::basic::{BrotliLevel, Compression, GzipLevel, ZstdLevel};
use parquet::data_type::{BoolType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::{WriterProperties, WriterVersion};
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
        HostMessage::Forget,
        HostMessage::Step(input),
        HostMessage::ReadState { begin: 0 },
        HostMessage::LoadState { begin: 0, bytes: b"SCHS\x04\0\0\0".iter().copied().collect() },
        HostMessage::SetPace(Pace::Clock { period_ms: 1000 }),
        HostMessage::Reset,
    ]
}

fn from_module() -> Vec<ModuleMessage> {
    let identity =
        Identity { board: Board::Host, transport: Transport::Memory, start: Start::PowerOn, boots: 0 };
    vec![
        ModuleMessage::Banner(Banner::new(identity)),
        ModuleMessage::Counters(Counters::NONE),
        ModuleMessage::Forgotten,
        ModuleMessage::StateTaken { next: 512 },
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
    let versions = [WriterVersion::PARQUET_1_0, WriterVersion::PARQUET_2_0];
    versions
        .into_iter()
        .flat_map(|version| compressions.iter().map(move |&compression| (version, compression)))
        .filter_map(|(version, compression)| parquet_table(version, compression).ok())
        .collect()
}

fn parquet_table(version: WriterVersion, compression: Compression) -> Result<Vec<u8>, ParquetError> {
    let schema = "message table {
        required int64 t (TIMESTAMP(MILLIS,true)); optional double gyro; required float temp; required boolean on;
    }";
    let properties = WriterProperties::builder().set_writer_version(version).set_compression(compression);
    let properties = Arc::new(properties.build());
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

/// ULog files: formats in formats, two topics, text, a dropout, data appended, and what is no message.
pub fn ulog_tables() -> Vec<Vec<u8>> {
    fn add(log: &mut Vec<u8>, kind: u8, content: &[&[u8]]) {
        let content = content.concat();
        log.extend((content.len() as u16).to_le_bytes());
        log.push(kind);
        log.extend(content);
    }
    let seed = |appended: u64| {
        let mut log = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec();
        let incompatible = u64::from(appended > 0).to_le_bytes();
        add(&mut log, b'B', &[&[0; 8], &incompatible, &appended.to_le_bytes(), &[0; 16]]);
        add(&mut log, b'I', &[&[16], b"char[3] sys_name", b"PX4"]);
        add(&mut log, b'F', &[b"esc:int8_t[2] load;bool on;uint8_t _padding0;"]);
        add(&mut log, b'F', &[b"gyro:uint64_t timestamp;float x;esc[2] escs;char[4] id;"]);
        add(&mut log, b'F', &[b"temp:uint64_t timestamp;double t;"]);
        add(&mut log, b'A', &[&[0, 1, 0], b"gyro"]);
        add(&mut log, b'A', &[&[1, 2, 0], b"temp"]);
        for row in 0..4_u8 {
            add(
                &mut log,
                b'D',
                &[&[1, 0], &[10 * row, 0, 0, 0, 0, 0, 0, 0], &[0, 0, 0x80, 0x3f], &[row; 12]],
            );
            if row == 1 {
                add(&mut log, b'O', &[&[9, 0]]);
                add(&mut log, b'D', &[&[2, 0], &[12, 0, 0, 0, 0, 0, 0, 0], &21.5_f64.to_le_bytes()]);
                log.extend([0; 5]);
                add(&mut log, b'S', &[&[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]]);
            }
        }
        add(&mut log, b'R', &[&[2, 0]]);
        log
    };
    let length = seed(0).len() as u64;
    vec![seed(0), seed(length - 20)]
}

/// Encoding of messages, encoding of schemas, name of the message, for each kind of messages.
const KINDS: [[&str; 3]; 5] = [
    ["json", "jsonschema", "a"],
    ["protobuf", "protobuf", "b.I"],
    ["ros1", "ros1msg", "b/I"],
    ["cdr", "ros2msg", "b/msg/I"],
    ["cdr", "ros2idl", "b/msg/I"],
];

/// An MCAP file with messages of one kind: `content` is the definition, behind two bytes of its length, and messages, each
/// behind a byte of its length.
///
/// # Errors
/// When it cannot be written.
pub fn mcap_of(kind: u8, content: &[u8]) -> Result<Vec<u8>, mcap::McapError> {
    let [encoding, schema_encoding, name] = KINDS[usize::from(kind) % KINDS.len()];
    let (length, content) = content.split_first_chunk().unwrap_or((&[0, 0], content));
    let (schema, mut messages) = content.split_at(content.len().min(u16::from_le_bytes(*length).into()));
    let mut file = std::io::Cursor::new(Vec::new());
    let compression = if kind & 0x80 == 0 { None } else { Some(mcap::Compression::Lz4) };
    let mut writer = mcap::WriteOptions::new().compression(compression).create(&mut file)?;
    let schema = writer.add_schema(name, schema_encoding, schema)?;
    let channel_id = writer.add_channel(schema, "/a", encoding, &std::collections::BTreeMap::new())?;
    let mut log_time = 0;
    while let Some((&length, rest)) = messages.split_first() {
        let (message, rest) = rest.split_at(rest.len().min(length.into()));
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: 5 };
        writer.write_to_known_channel(&header, message)?;
        log_time += 1_000_000;
        messages = rest;
    }
    writer.finish()?;
    drop(writer);
    Ok(file.into_inner())
}

/// Whole MCAP files, and for each kind of messages a definition with messages of it.
pub fn mcap_tables() -> Vec<Vec<u8>> {
    fn content(kind: u8, definition: &[u8], messages: &[&[u8]]) -> Vec<u8> {
        let mut content = vec![kind];
        content.extend((definition.len() as u16).to_le_bytes());
        content.extend(definition);
        for message in messages {
            content.push(message.len() as u8);
            content.extend(*message);
        }
        content
    }
    let ros = b"b/H header\nfloat64[2] x # two\nfloat32[] y\nstring n\nuint8 OK=1\n===\nMSG: b/H\nbuiltin_interfaces/Time stamp\nbool ok";
    let ros1 = b"time stamp\nint16[] x\nstring n\nb/V v\n===\nMSG: b/V\nfloat32 x";
    // FileDescriptorSet of `package b; message I { double x = 1; repeated int32 y = 2; I i = 3; }`, proto3.
    let protobuf = b"\x0a:\x0a\x01a\x12\x01b\x22*\x0a\x01I\x12\x09\x0a\x01x\x18\x01 \x01(\x01\x12\x09\x0a\x01y\x18\x02 \x03(\x05\x12\x0f\x0a\x01i\x18\x03 \x01(\x0b2\x04.b.Ib\x06proto3";
    let mut seeds = vec![
        content(0, b"{}", &[br#"{"t":{"sec":1,"nsec":5},"x":[0.5,null],"n":"a"}"#, br#"{"x":[1e-9,true,{"y":-2}]}"#]),
        content(0x81, protobuf, &[b"\x09\0\0\0\0\0\0\xf0\x3f\x12\x02\x01\x02\x1a\x02\x10\x07"]),
        content(2, ros1, &[b"\x01\0\0\0\x02\0\0\0\x02\0\0\0\x05\0\x06\0\x01\0\0\0n\0\0\x80\x3f"]),
        content(
            3,
            ros,
            &[
                b"\0\x01\0\0\x01\0\0\0\x02\0\0\0\x01\0\0\0\0\0\0\0\0\0\0\0\0\0\xf0\x3f\0\0\0\0\0\0\0\x40\x01\0\0\0\0\0\x80\x3f\
                \x02\0\0\0n\0",
                b"\0\x01\0\0\0\0\0\0",
            ],
        ),
    ];
    for seed in seeds.clone() {
        if let Some((&kind, content)) = seed.split_first() {
            seeds.extend(mcap_of(kind, content));
            seeds.extend(mcap_of(kind ^ 0x80, content));
        }
    }
    seeds
}
