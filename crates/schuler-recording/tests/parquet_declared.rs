//! Parquet files that declare what they do not have: refused at once, whatever the number. What is merely long is read.
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parquet::basic::{BrotliLevel, Compression, Encoding, GzipLevel, ZstdLevel};
use parquet::data_type::DoubleType;
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use schuler_recording::table;

/// What a file may take that is refused; the decoder takes seconds to hours for these.
const LONGEST: Duration = Duration::from_secs(2);

/// Types of the compact protocol of Thrift.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const MAP: u8 = 11;
const STRUCTURE: u8 = 12;

/// Physical types, encodings and codecs.
const BOOLEAN: i64 = 0;
const DOUBLE: i64 = 5;
const PLAIN: i64 = 0;
const RUNS_OF_DICTIONARY: i64 = 8;
const UNCOMPRESSED: i64 = 0;
const SNAPPY: i64 = 1;
const GZIP: i64 = 2;
const BROTLI: i64 = 4;

const MOST: i64 = i32::MAX as i64;

fn unsigned(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

fn integer(value: i64) -> Vec<u8> {
    unsigned((value.cast_unsigned() << 1) ^ (value >> 63).cast_unsigned())
}

fn length<T>(of: &[T]) -> i64 {
    of.len().try_into().unwrap()
}

fn binary(bytes: &[u8]) -> Vec<u8> {
    [unsigned(bytes.len() as u64), bytes.to_vec()].concat()
}

fn list(wire: u8, elements: &[Vec<u8>]) -> Vec<u8> {
    [vec![0xf0 | wire], unsigned(elements.len() as u64), elements.concat()].concat()
}

/// Fields with their numbers in full.
fn structure(fields: &[(i64, u8, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (id, wire, value) in fields {
        bytes.push(*wire);
        bytes.extend(integer(*id));
        bytes.extend(value);
    }
    bytes.push(0);
    bytes
}

/// A list that says it has 2³¹ − 1 booleans.
fn booleans() -> Vec<u8> {
    [vec![0xf1], unsigned(i32::MAX as u64)].concat()
}

/// One column `x` without nulls.
struct File {
    physical: i64,
    codec: i64,
    rows: i64,
    dictionary: bool,
    pages: Vec<u8>,
    /// Further fields at the end of the metadata.
    further: Vec<(i64, u8, Vec<u8>)>,
}

impl File {
    fn of_doubles(codec: i64, rows: i64, pages: Vec<u8>) -> Self {
        Self { physical: DOUBLE, codec, rows, dictionary: false, pages, further: Vec::new() }
    }

    fn bytes(&self) -> Vec<u8> {
        let length = integer(length(&self.pages));
        let mut column = vec![
            (1, I32, integer(self.physical)),
            (2, LIST, list(I32, &[integer(PLAIN)])),
            (3, LIST, list(BINARY, &[binary(b"x")])),
            (4, I32, integer(self.codec)),
            (5, I64, integer(self.rows)),
            (6, I64, length.clone()),
            (7, I64, length.clone()),
            (9, I64, integer(4)),
        ];
        if self.dictionary {
            column.push((11, I64, integer(4)));
        }
        let chunk = structure(&[(2, I64, integer(0)), (3, STRUCTURE, structure(&column))]);
        let group = structure(&[
            (1, LIST, list(STRUCTURE, &[chunk])),
            (2, I64, length),
            (3, I64, integer(self.rows)),
        ]);
        let schema = [
            structure(&[(4, BINARY, binary(b"table")), (5, I32, integer(1))]),
            structure(&[(1, I32, integer(self.physical)), (3, I32, integer(0)), (4, BINARY, binary(b"x"))]),
        ];
        let mut fields = vec![
            (1, I32, integer(1)),
            (2, LIST, list(STRUCTURE, &schema)),
            (3, I64, integer(self.rows)),
            (4, LIST, list(STRUCTURE, &[group])),
        ];
        fields.extend(self.further.iter().cloned());
        let metadata = structure(&fields);
        let length = u32::try_from(metadata.len()).unwrap().to_le_bytes();
        [b"PAR1", &*self.pages, &metadata, &length, b"PAR1"].concat()
    }

    fn read(&self) -> Result<table::Columns, String> {
        let table = table::open_bytes(Path::new("table.parquet"), self.bytes());
        table.and_then(|table| table.read(&[0])).map_err(|error| error.to_string())
    }

    /// The message with which the file is refused, soon.
    fn refused(&self) -> String {
        let start = Instant::now();
        let message = self.read().unwrap_err();
        assert!(start.elapsed() < LONGEST, "{message}: {:?}", start.elapsed());
        assert!(message.starts_with("table.parquet: ") && message.contains("damaged"), "{message}");
        message
    }
}

fn page(kind: i64, size: i64, stored: &[u8], id: i64, header: Vec<u8>) -> Vec<u8> {
    let header = structure(&[
        (1, I32, integer(kind)),
        (2, I32, integer(size)),
        (3, I32, integer(length(stored))),
        (id, STRUCTURE, header),
    ]);
    [header, stored.to_vec()].concat()
}

/// A page of so many values that says it has `size` bytes.
fn data(values: i64, encoding: i64, size: i64, stored: &[u8]) -> Vec<u8> {
    let header = [integer(values), integer(encoding), integer(3), integer(3)];
    let header: Vec<_> = (1..).zip(header).map(|(id, value)| (id, I32, value)).collect();
    page(0, size, stored, 5, structure(&header))
}

fn dictionary(values: i64, size: i64, stored: &[u8]) -> Vec<u8> {
    page(2, size, stored, 7, structure(&[(1, I32, integer(values)), (2, I32, integer(PLAIN))]))
}

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn plain(values: &[f64]) -> Vec<u8> {
    let stored = doubles(values);
    data(length(values), PLAIN, length(&stored), &stored)
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut writer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    writer.write_all(bytes).unwrap();
    writer.finish().unwrap()
}

fn by_brotli(bytes: &[u8]) -> Vec<u8> {
    let mut compressed = Vec::new();
    let mut writer = brotli::CompressorWriter::new(&mut compressed, 4096, 5, 22);
    writer.write_all(bytes).unwrap();
    drop(writer);
    compressed
}

#[test]
fn the_file_that_is_varied_here_is_sound() {
    let file = File::of_doubles(UNCOMPRESSED, 3, [plain(&[1.0, 2.0]), plain(&[3.0])].concat());
    assert_eq!(file.read().unwrap().values, [[1.0, 2.0, 3.0]]);
    // A field that a later format may have is passed over.
    let further = vec![(100, LIST, list(I32, &[integer(1)])), (101, MAP, vec![1, 0x55, 2, 4])];
    let file = File { further, ..file };
    assert_eq!(file.read().unwrap().rows(), 3);
}

/// Found by fuzzing: the decoder counts to 2³¹ over a list that takes no bytes.
#[test]
fn a_list_is_no_longer_than_the_bytes_that_are_left() {
    let file = |further| File { further, ..File::of_doubles(UNCOMPRESSED, 2, plain(&[1.0, 2.0])) };
    let lists = list(LIST, &vec![booleans(); 1000]);
    let map = [unsigned(i32::MAX as u64), vec![0x11]].concat();
    for (wire, value) in [(LIST, booleans()), (LIST, lists), (MAP, map)] {
        let message = file(vec![(100, wire, value)]).refused();
        assert!(message.contains("a list of 2147483647 elements in "), "{message}");
    }
    // As many as there are bytes: the decoder would go on behind the list's beginning.
    let message = file(vec![(100, LIST, [vec![0xf1, 2], vec![1, 1]].concat())]).refused();
    assert!(message.contains("2 booleans"), "{message}");
    // A field of the format that is of another kind, behind which the decoder would read on.
    let hidden = file(vec![(5, BINARY, binary(&booleans()))]).refused();
    assert!(hidden.contains("a field 5 of type 8"), "{hidden}");

    let header = structure(&[(1, I32, integer(0)), (100, LIST, booleans())]);
    let message = File::of_doubles(UNCOMPRESSED, 2, header).refused();
    assert!(message.contains("a list of 2147483647 elements in "), "{message}");
}

/// The decoder reserves what a group says it has, and calls itself for each group in a group.
#[test]
fn a_schema_is_a_tree_of_what_is_there() {
    let group =
        |children| structure(&[(4, BINARY, binary(b"g")), (3, I32, integer(0)), (5, I32, integer(children))]);
    let leaf = structure(&[(1, I32, integer(DOUBLE)), (3, I32, integer(0)), (4, BINARY, binary(b"x"))]);
    let file = |schema: &[Vec<u8>]| {
        let metadata = structure(&[
            (1, I32, integer(1)),
            (2, LIST, list(STRUCTURE, schema)),
            (3, I64, integer(0)),
            (4, LIST, list(STRUCTURE, &[])),
        ]);
        let length = u32::try_from(metadata.len()).unwrap().to_le_bytes();
        let bytes = [b"PAR1", &*metadata, &length, b"PAR1"].concat();
        table::open_bytes(Path::new("table.parquet"), bytes).map(|table| table.names().len())
    };
    let message = |schema: &[Vec<u8>]| file(schema).unwrap_err().to_string();
    let message_of_many = message(&[group(MOST), leaf.clone()]);
    assert!(message_of_many.contains("a group of 2147483647 columns in "), "{message_of_many}");
    let mut deep = vec![group(1); 100_000];
    deep.push(leaf.clone());
    let message_of_deep = message(&deep);
    assert!(message_of_deep.contains("more than 64 groups"), "{message_of_deep}");
    // Many beside each other are none in each other.
    let beside = (0..100).flat_map(|_| [group(2), leaf.clone(), leaf.clone()]);
    let beside: Vec<_> = [group(101)].into_iter().chain(beside).chain([leaf.clone()]).collect();
    assert_eq!(file(&beside).unwrap(), 201);
}

#[test]
fn a_dictionary_has_no_more_values_than_bytes() {
    let runs = data(2, RUNS_OF_DICTIONARY, 2, &[0, 4]);
    for (physical, stored) in [(DOUBLE, doubles(&[1.0])), (BOOLEAN, vec![1])] {
        for values in [9, MOST] {
            let pages = [dictionary(values, length(&stored), &stored), runs.clone()].concat();
            let file = File { physical, dictionary: true, ..File::of_doubles(UNCOMPRESSED, 2, pages) };
            let message = file.refused();
            assert!(message.contains(&format!("a dictionary of {values} values")), "{message}");
        }
    }
    let twice = [dictionary(1, 8, &doubles(&[1.0])), dictionary(1, 8, &doubles(&[1.0])), runs].concat();
    let message = File { dictionary: true, ..File::of_doubles(UNCOMPRESSED, 2, twice) }.refused();
    assert!(message.contains("two dictionaries"), "{message}");
}

#[test]
fn a_page_is_no_larger_than_its_bytes_and_values_can_make_it() {
    // Beyond what Snappy makes of six bytes; beyond what two values take.
    for (codec, stored) in
        [(SNAPPY, vec![0xff, 0xff, 0xff, 0xff, 7, 0]), (BROTLI, by_brotli(&vec![0; 100_000]))]
    {
        let message = File::of_doubles(codec, 2, data(2, PLAIN, MOST, &stored)).refused();
        assert!(message.contains("a page of 2147483647 bytes"), "{message}");
    }
    // More bytes come out than the header says.
    let zeros = vec![0; 64 << 20];
    for (codec, stored) in [(GZIP, gzipped(&zeros)), (BROTLI, by_brotli(&zeros))] {
        let message = File::of_doubles(codec, 2, data(2, PLAIN, 16, &stored)).refused();
        assert!(message.contains("has not the 16 bytes"), "{message}");
        // And fewer.
        let message =
            File::of_doubles(codec, 2, data(2, PLAIN, 17, &by_brotli(&[0; 16]))).read().unwrap_err();
        assert!(message.starts_with("table.parquet: "), "{message}");
    }
    let message = File::of_doubles(UNCOMPRESSED, 2, data(3, PLAIN, 24, &doubles(&[1.0; 3]))).refused();
    assert!(message.contains("a page of 3 values in a group that has 2 rows left"), "{message}");
}

#[test]
fn what_is_decompressed_here_is_what_was_compressed() {
    let values: Vec<f64> = (0..1000).map(f64::from).collect();
    let size = 8 * length(&values);
    for (codec, stored) in [(GZIP, gzipped(&doubles(&values))), (BROTLI, by_brotli(&doubles(&values)))] {
        let file = File::of_doubles(codec, 1000, data(1000, PLAIN, size, &stored));
        assert_eq!(file.read().unwrap().values[0], values);
    }
}

/// Zeros without a dictionary are what every codec makes least of.
#[test]
fn a_page_may_be_as_small_as_its_codec_can_make_it() {
    const ROWS: usize = 2_000_000;
    let schema = Arc::new(parse_message_type("message table { required double x; }").unwrap());
    for version in [WriterVersion::PARQUET_1_0, WriterVersion::PARQUET_2_0] {
        for compression in [
            Compression::SNAPPY,
            Compression::GZIP(GzipLevel::try_new(9).unwrap()),
            Compression::ZSTD(ZstdLevel::try_new(19).unwrap()),
            Compression::LZ4_RAW,
            Compression::LZ4,
            Compression::BROTLI(BrotliLevel::try_new(9).unwrap()),
        ] {
            let properties = WriterProperties::builder()
                .set_writer_version(version)
                .set_compression(compression)
                .set_dictionary_enabled(false)
                .set_encoding(Encoding::PLAIN)
                .set_data_page_size_limit(1 << 30)
                .set_data_page_row_count_limit(ROWS)
                .build();
            let mut bytes = Vec::new();
            let mut writer =
                SerializedFileWriter::new(&mut bytes, schema.clone(), Arc::new(properties)).unwrap();
            let mut group = writer.next_row_group().unwrap();
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<DoubleType>().write_batch(&vec![0.0; ROWS], None, None).unwrap();
            column.close().unwrap();
            group.close().unwrap();
            writer.close().unwrap();
            let columns = table::open_bytes(Path::new("table.parquet"), bytes).unwrap().read(&[0]).unwrap();
            assert_eq!(columns.rows(), ROWS, "{version:?}, {compression:?}");
        }
    }
}

/// 2³¹ − 1 rows in 128 bytes are a sound file: a constant column takes as many bytes for a day as for a second.
#[test]
fn a_constant_column_may_be_of_any_length() {
    let run = [vec![0], unsigned(2 * MOST.cast_unsigned())].concat();
    let pages = [dictionary(1, 8, &doubles(&[0.25])), data(MOST, RUNS_OF_DICTIONARY, length(&run), &run)];
    let file = File { dictionary: true, ..File::of_doubles(UNCOMPRESSED, MOST, pages.concat()) };
    let table = table::open_bytes(Path::new("table.parquet"), file.bytes()).unwrap();
    let mut rows = 0;
    for chunk in table.chunks(&[0]).unwrap().take(1000) {
        let chunk = chunk.unwrap();
        assert!(chunk.values[0].iter().all(|&value| value == 0.25));
        rows += chunk.rows();
    }
    assert!(rows > 4_000_000, "{rows}");
}
