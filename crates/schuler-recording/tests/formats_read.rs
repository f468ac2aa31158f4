//! One recording in every format, written by other people's tools (tests/oracle/make_tables.py), and what their files are
//! like when something has gone wrong.
use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use schuler_recording::table::{self, Columns, Copied, Format, TableReader};
use schuler_recording::{CaseFile, Error, Recording};

const CASE: &str = r#"
format = "schuler-case/1"
[recording]
path = "TABLE"
time = "sensor_gyro_0.timestamp"
step_s = 0.01
[motion]
kind = "static"
[[sensor]]
id = "x"
kind = "mems_gyro"
column = "sensor_gyro_0.x"
unit = "rad/s"
axis = [1.0, 0.0, 0.0]
[[sensor]]
id = "y"
kind = "mems_gyro"
column = "sensor_gyro_0.y"
unit = "deg/s"
axis = [0.0, 1.0, 0.0]
[[aux]]
column = "sensor_temp_0.temperature"
quantity = "temperature"
unit = "degC"
[[aux]]
column = "sensor_gyro_0.counts[1]"
quantity = "other"
unit = "1"
"#;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/samples").join(name)
}

fn recording(table: &str) -> Recording {
    let file = CaseFile::parse(&sample("case.toml"), &CASE.replace("TABLE", table)).unwrap();
    Recording::of_case(file).unwrap_or_else(|error| panic!("{error:#}"))
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| if value.is_nan() { u64::MAX } else { value.to_bits() }).collect()
}

fn columns(path: &Path, names: &[&str]) -> Columns {
    let table = table::open(path).unwrap_or_else(|error| panic!("{error}"));
    let wanted: Vec<usize> = names.iter().map(|name| table.index(name).unwrap()).collect();
    table.read(&wanted).unwrap_or_else(|error| panic!("{error}"))
}

fn copy(
    table: Box<dyn TableReader>,
    wanted: &[usize],
    span_s: Option<[f64; 2]>,
    path: &Path,
    format: Format,
) -> Result<Copied, Error> {
    let span = table::Span { of_s: span_s, step_s: None };
    table::copy(table, wanted, span, (fs::File::create(path).unwrap(), path), format, |_| Ok(()))
}

fn in_memory(name: &str, bytes: Vec<u8>, columns: &[&str]) -> Result<Columns, String> {
    let table = table::open_bytes(Path::new(name), bytes).map_err(|error| error.to_string())?;
    let wanted = columns.iter().map(|name| table.index(name)).collect::<Result<Vec<_>, _>>()?;
    table.read(&wanted).map_err(|error| error.to_string())
}

#[test]
fn one_case_is_the_same_recording_from_every_format() {
    let first = recording("recording.csv");
    // 113 messages of the gyro in 120 steps, 12 of the thermometer, of which the one at 0.83 s has no row.
    assert_eq!(first.len(), 120);
    assert_eq!(first.gaps.len(), 1);
    assert_eq!((first.sensors[0].quality.present, first.sensors[1].quality.present), (113, 112));
    assert_eq!(first.auxiliaries[0].quality.present, 11);
    for table in ["recording.csv.gz", "recording.parquet", "recording.mcap", "recording.ulg"] {
        let other = recording(table);
        assert_eq!(bits(&other.time_s), bits(&first.time_s), "{table}");
        assert_eq!((&other.gaps, &other.inserted), (&first.gaps, &first.inserted), "{table}");
        for (a, b) in first.sensors.iter().zip(&other.sensors) {
            assert_eq!(bits(&a.values), bits(&b.values), "{table}: {}", a.sensor.id);
            assert_eq!(a.quality, b.quality, "{table}");
        }
        for (a, b) in first.auxiliaries.iter().zip(&other.auxiliaries) {
            assert_eq!(bits(&a.values), bits(&b.values), "{table}: {}", a.auxiliary.column);
        }
        let is_log = table.ends_with("mcap") || table.ends_with("ulg");
        let said = other.warnings.join("\n");
        assert_eq!(
            said.contains("sensor_temp_0: 1 messages are left out: too far"),
            is_log,
            "{table}: {said}"
        );
        assert_eq!(other.warnings.len(), usize::from(is_log), "{table}: {said}");
    }
}

#[test]
fn messages_of_ros_and_protobuf_are_the_same_numbers() {
    let text =
        columns(&sample("recording.csv"), &["sensor_gyro_0.timestamp", "sensor_gyro_0.x", "sensor_gyro_0.y"]);
    let sums: Vec<f64> = text.values[1].iter().zip(&text.values[2]).map(|(x, y)| x + y).collect();
    for (file, stamp) in [
        ("ros1.mcap", "/imu.header.stamp"),
        ("ros2.mcap", "/imu.header.stamp"),
        ("protobuf.mcap", "/imu.stamp"),
    ] {
        let names = [
            stamp,
            "/imu@log_time",
            "/imu.angular_velocity.x",
            "/imu.angular_velocity.y",
            "/imu.angular_velocity.z",
            "/imu.short[1]",
            "/imu.valid",
        ];
        let found = columns(&sample(file), &names);
        assert_eq!(bits(&found.values[0]), bits(&text.values[0]), "{file}: stamp");
        assert_eq!(bits(&found.values[1]), bits(&text.values[0]), "{file}: log time");
        assert_eq!(bits(&found.values[2]), bits(&text.values[1]), "{file}: x");
        assert_eq!(bits(&found.values[3]), bits(&text.values[2]), "{file}: y");
        assert_eq!(bits(&found.values[4]), bits(&sums), "{file}: z");
        for (row, (short, valid)) in found.values[5].iter().zip(&found.values[6]).enumerate().take(20) {
            // The messages of the thermometer are counted, too: one at 3, 13 … of the steps.
            let message = row + (row + 6) / 10;
            assert!(short.is_nan() == (message % 4 < 2), "{file}: row {row}: {short}");
            assert!(short.is_nan() || *short == 0.5 * message as f64, "{file}: row {row}: {short}");
            assert_eq!(*valid, f64::from(u8::from(message % 3 == 0)), "{file}: row {row}");
        }
    }
    let ros = columns(&sample("ros2.mcap"), &["/imu.covariance[8]"]);
    let expected: Vec<f64> = text.values[1].iter().map(|x| 8.0 * x).collect();
    assert_eq!(bits(&ros.values[0]), bits(&expected));
}

#[test]
fn every_format_is_copied_to_every_format_without_a_bit_lost() {
    let directory = tempfile::tempdir().unwrap();
    for from in [
        "recording.csv",
        "recording.csv.gz",
        "recording.parquet",
        "recording.mcap",
        "recording.ulg",
        "ros2.mcap",
    ] {
        let table = table::open(&sample(from)).unwrap();
        let time = table.names().iter().find(|name| name.ends_with("stamp")).unwrap();
        let others = table.names().iter().filter(|name| *name != time && !name.contains('@'));
        let names: Vec<&str> = std::iter::once(time).chain(others).map(String::as_str).collect();
        let original = columns(&sample(from), &names);
        for format in Format::ALL {
            let path = directory.path().join(format!("copy{}", format.ending()));
            assert_eq!(Format::of(&path), Some(format));
            let opened = table::open(&sample(from)).unwrap();
            let wanted: Vec<usize> = names.iter().map(|name| opened.index(name).unwrap()).collect();
            let copied = copy(opened, &wanted, None, &path, format).unwrap();
            assert_eq!(copied.rows, original.rows() as u64);
            let copy = columns(&path, &names);
            for (name, (a, b)) in names.iter().zip(original.values.iter().zip(&copy.values)) {
                assert_eq!(bits(a), bits(b), "{from} to {format:?}: {name}");
            }
        }
    }
    let path = directory.path().join("copy.parquet");
    for (from, key, value) in [
        ("recording.ulg", "sys_name", "PX4"),
        ("recording.parquet", "bench", "rate table 2"),
        ("recording.mcap", "bench.table", "2"),
    ] {
        let table = table::open(&sample(from)).unwrap();
        let wanted = [table.index("sensor_gyro_0.timestamp").unwrap()];
        copy(table, &wanted, None, &path, Format::Parquet).unwrap();
        let copy = table::open(&path).unwrap();
        assert!(copy.metadata().contains(&(key.to_owned(), value.to_owned())), "{:?}", copy.metadata());
    }
}

#[test]
fn a_span_of_time_is_copied() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("copy.csv");
    let open = || table::open(&sample("recording.ulg")).unwrap();
    let all = columns(&sample("recording.csv"), &["sensor_gyro_0.timestamp"]).values.remove(0);
    let wanted = [open().index("sensor_gyro_0.timestamp").unwrap(), open().index("sensor_gyro_0.x").unwrap()];
    let copied = copy(open(), &wanted, Some([all[10], all[19]]), &path, Format::Csv).unwrap();
    assert_eq!((copied.rows, copied.left_out, copied.span_s), (10, 103, Some([all[10], all[19]])));
    let copied = copy(open(), &wanted, Some([0.0, 1.0]), &path, Format::Csv).unwrap();
    assert_eq!((copied.rows, copied.left_out, copied.span_s), (0, 113, None));
}

#[test]
fn columns_of_topics_that_cannot_be_joined_or_read_say_why() {
    let error = in_memory(
        "a.mcap",
        fs::read(sample("recording.mcap")).unwrap(),
        &["sensor_gyro_0.x", "sensor_temp_0.temperature"],
    )
    .unwrap_err();
    assert!(
        error.starts_with(
            "a.mcap: sensor_temp_0.temperature: found no \"sensor_temp_0.x\"; expected one, by which"
        ),
        "{error}"
    );
    let error =
        in_memory("a.ulg", fs::read(sample("recording.ulg")).unwrap(), &["sensor_gyro.x"]).unwrap_err();
    assert!(error.contains("did you mean \"sensor_gyro_0.x\"?"), "{error}");
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(&mut bytes)).unwrap();
    let channel = writer.add_channel(0, "/imu", "cbor", &std::collections::BTreeMap::new()).unwrap();
    let channel_json = writer.add_channel(0, "/state", "json", &std::collections::BTreeMap::new()).unwrap();
    for (channel_id, data) in [(channel, &b"\xa0"[..]), (channel_json, b"{\"mode\": 2}")] {
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 7, publish_time: 7 };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let error = in_memory("a.mcap", bytes.clone(), &["/imu.rate"]).unwrap_err();
    assert!(
        error.contains("the messages of \"/imu\" are encoded as \"cbor\" with no schema, which is not read"),
        "{error}"
    );
    assert_eq!(
        in_memory("a.mcap", bytes, &["/state@log_time", "/state.mode"]).unwrap().values,
        [[7e-9], [2.0]]
    );
}

#[test]
fn an_mcap_file_that_was_not_closed_is_read_as_far_as_it_goes() {
    let names = ["sensor_gyro_0.timestamp", "sensor_gyro_0.x", "sensor_gyro_0.y"];
    let bytes = fs::read(sample("recording.mcap")).unwrap();
    let whole = in_memory("a.mcap", bytes.clone(), &names).unwrap();
    assert!(whole.warnings.is_empty(), "{:?}", whole.warnings);
    let mut read = 0;
    for length in (0..bytes.len()).step_by(97) {
        let Ok(part) = in_memory("a.mcap", bytes[..length].to_vec(), &names) else { continue };
        read += 1;
        assert!(part.rows() <= whole.rows());
        for (part, whole) in part.values.iter().zip(&whole.values) {
            assert_eq!(bits(part), bits(&whole[..part.len()]), "{length} bytes");
        }
        assert_eq!(part.warnings.len(), 1, "{length} bytes: {:?}", part.warnings);
    }
    assert!(read > 100, "{read}");
}

#[test]
fn a_changed_byte_of_an_mcap_file_never_changes_a_value() {
    let names = ["/imu.header.stamp", "/imu.angular_velocity.x"];
    for file in ["ros1.mcap", "ros2.mcap"] {
        let bytes = fs::read(sample(file)).unwrap();
        let whole = in_memory("a.mcap", bytes.clone(), &names).unwrap();
        let (mut refused, mut read) = (0, 0);
        for at in (0..bytes.len()).step_by(61) {
            let mut changed = bytes.clone();
            changed[at] ^= 0x10;
            match in_memory("a.mcap", changed, &names) {
                Err(_) => refused += 1,
                Ok(found) => {
                    for (found, whole) in found.values.iter().zip(&whole.values) {
                        assert_eq!(bits(found), bits(&whole[..found.len()]), "{file}: byte {at}");
                    }
                    read += 1;
                    // What is under no checksum: numbers and indices about chunks, the summary.
                    let whole = found.rows() == whole.rows();
                    assert!(whole || !found.warnings.is_empty(), "{file}: byte {at}");
                }
            }
        }
        assert!(refused > 3 * read, "{file}: {refused} refused, {read} read");
    }
}

/// Messages of a ULog file.
struct Ulog(Vec<u8>);

impl Ulog {
    fn new() -> Self {
        let mut bytes = b"ULog\x01\x12\x35\x01".to_vec();
        bytes.extend(0_u64.to_le_bytes());
        Self(bytes)
    }

    fn add(mut self, kind: u8, content: &[&[u8]]) -> Self {
        let content = content.concat();
        self.0.extend(u16::try_from(content.len()).unwrap().to_le_bytes());
        self.0.push(kind);
        self.0.extend(content);
        self
    }

    fn flags(self, appended: u64) -> Self {
        let incompatible = u64::from(appended > 0);
        self.add(b'B', &[&[0; 8], &incompatible.to_le_bytes(), &appended.to_le_bytes(), &[0; 16]])
    }

    fn data(self, number: u16, time_us: u64, fields: &[u8]) -> Self {
        self.add(b'D', &[&number.to_le_bytes(), &time_us.to_le_bytes(), fields])
    }

    fn simple(self) -> Self {
        self.add(b'F', &[b"a:uint64_t timestamp;float x;"]).add(b'A', &[&[0, 3, 0], b"a"])
    }
}

const SIMPLE: [&str; 2] = ["a_0.timestamp", "a_0.x"];

fn x(value: f32) -> [u8; 4] {
    value.to_le_bytes()
}

#[test]
fn the_formats_of_a_ulog_file_are_understood() {
    let log = Ulog::new()
        .flags(0)
        .add(b'F', &[b"esc:int8_t[2] load;bool on;char[3] id;uint8_t _padding0;double rpm;"])
        .add(b'F', &[b"all:uint64_t timestamp;esc[2] escs;uint16_t[70] spectrum;uint32_t last;uint8_t[4] _padding0;"])
        .add(b'A', &[&[1, 9, 0], b"all"])
        .data(
            9,
            2_500_000,
            &[
                [&[0xff, 2, 1], &b"abc\0"[..], &1.5_f64.to_le_bytes()].concat(),
                [&[3, 0x80, 0], &b"abc\0"[..], &(-2.0_f64).to_le_bytes()].concat(),
                vec![7; 140],
                0xffff_ffff_u32.to_le_bytes().to_vec(),
            ]
            .concat(),
        );
    let table = table::open_bytes(Path::new("a.ulg"), log.0.clone()).unwrap();
    let expected = [
        ("all_1.timestamp", 2.5),
        ("all_1.escs[0].load[0]", -1.0),
        ("all_1.escs[0].load[1]", 2.0),
        ("all_1.escs[0].on", 1.0),
        ("all_1.escs[0].rpm", 1.5),
        ("all_1.escs[1].load[0]", 3.0),
        ("all_1.escs[1].load[1]", -128.0),
        ("all_1.escs[1].on", 0.0),
        ("all_1.escs[1].rpm", -2.0),
        ("all_1.last", 4_294_967_295.0),
    ];
    let names: Vec<&str> = expected.iter().map(|(name, _)| *name).collect();
    assert_eq!(table.names(), names);
    let found = in_memory("a.ulg", log.0, &names).unwrap();
    assert_eq!(found.values, expected.map(|(_, value)| [value]));
}

#[test]
fn a_ulog_file_cut_off_is_read_as_far_as_it_goes() {
    let log =
        Ulog::new().simple().data(3, 0, &x(1.0)).data(3, 1, &x(2.0)).add(b'O', &[&30_u16.to_le_bytes()]);
    let log = log.data(3, 2, &x(3.0)).0;
    let found = in_memory("a.ulg", log.clone(), &SIMPLE).unwrap();
    assert_eq!(found.values[1], [1.0, 2.0, 3.0]);
    assert_eq!(found.warnings, ["a.ulg: the logger dropped data 1 times, 30 ms altogether"]);
    let found = in_memory("a.ulg", log[..log.len() - 1].to_vec(), &SIMPLE).unwrap();
    assert_eq!(found.values[1], [1.0, 2.0]);
    assert_eq!(found.warnings[1], "a.ulg: the last message is cut off and is left out");
}

#[test]
fn data_appended_to_a_ulog_file_are_read_behind_a_message_cut_off() {
    let before = Ulog::new().flags(1).simple().data(3, 0, &x(1.0)).data(3, 1, &x(2.0)).0;
    let cut = before.len() - 7;
    let mut log = Ulog::new().flags(cut as u64).simple().data(3, 0, &x(1.0)).data(3, 1, &x(2.0)).0;
    log.truncate(cut);
    let log = Ulog(log).data(3, 9, &x(4.0)).0;
    let found = in_memory("a.ulg", log, &SIMPLE).unwrap();
    assert_eq!(found.values, [[0.0, 9e-6], [1.0, 4.0]]);
    assert_eq!(found.warnings, ["a.ulg: the last message is cut off and is left out"]);
    let unknown = Ulog::new().add(b'B', &[&[0; 8], &[2], &[0; 31]]).simple().0;
    let error = in_memory("a.ulg", unknown, &SIMPLE).unwrap_err();
    assert!(error.starts_with("a.ulg: found incompatible flags 0x2"), "{error}");
}

#[test]
fn reading_a_ulog_file_goes_on_behind_damage() {
    let synchronisation: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
    let mut log = Ulog::new().simple().data(3, 0, &x(1.0));
    log.0.extend([0; 40]);
    let log = log
        .add(b'S', &[&synchronisation])
        .data(3, 5, &x(2.0))
        .data(4, 6, &x(3.0))
        .data(3, 7, &[0; 2])
        .data(3, 8, &x(4.0));
    let found = in_memory("a.ulg", log.0, &SIMPLE).unwrap();
    assert_eq!(found.values, [[0.0, 5e-6, 8e-6], [1.0, 2.0, 4.0]]);
    assert_eq!(
        found.warnings,
        [
            "a.ulg: 2 messages are of no topic or too short and are left out",
            "a.ulg: 40 bytes are no messages and are left out"
        ]
    );
}

#[test]
fn ulog_formats_without_end_are_refused() {
    let deep = (0..20).fold(Ulog::new(), |log, level| {
        log.add(b'F', &[format!("f{level}:f{}[9] inner;", level + 1).as_bytes()])
    });
    let looped = Ulog::new().add(b'F', &[b"f0:f0 inner;uint8_t x;"]);
    let empty = Ulog::new().add(b'F', &[b"f0:g[65535] inner;"]).add(b'F', &[b"g:;"]);
    let undefined = Ulog::new().add(b'F', &[b"f0:g inner;"]);
    for log in [deep, looped, empty, undefined] {
        let log = log.add(b'A', &[&[0, 0, 0], b"f0"]);
        let error = in_memory("a.ulg", log.0, &["f0_0.x"]).unwrap_err();
        assert!(error.starts_with("a.ulg: found no numbers: its messages are of "), "{error}");
    }
}

#[test]
fn a_case_reads_the_same_from_a_copy_of_its_columns() {
    let directory = tempfile::tempdir().unwrap();
    let file = CaseFile::parse(&sample("case.toml"), &CASE.replace("TABLE", "recording.ulg")).unwrap();
    let table = table::open(&file.table_path()).unwrap();
    let wanted: Vec<usize> = file.case.columns().into_iter().map(|name| table.index(name).unwrap()).collect();
    assert_eq!(wanted.len(), 5);
    let path = directory.path().join("recording.parquet");
    copy(table, &wanted, None, &path, Format::Parquet).unwrap();
    let mut copy = file.clone();
    copy.case.recording.path = path;
    let (a, b) = (Recording::of_case(file).unwrap(), Recording::of_case(copy).unwrap());
    assert_eq!(bits(&a.time_s), bits(&b.time_s));
    assert_eq!(bits(&a.sensors[1].values), bits(&b.sensors[1].values));
    assert_eq!(bits(&a.auxiliaries[0].values), bits(&b.auxiliaries[0].values));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn parquet_reads_back_to_the_same_bits(rows in prop::collection::vec((any::<f64>(), any::<f64>()), 0..50)) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.parquet");
        let finite = |value: f64| if value.is_finite() { value } else { f64::NAN };
        let first: Vec<f64> = rows.iter().map(|row| finite(row.0)).collect();
        let second: Vec<f64> = rows.iter().map(|row| finite(row.1)).collect();
        table::write(&path, &[("a.b[0], c", &first), ("b", &second)]).unwrap();
        let found = columns(&path, &["b", "a.b[0], c"]);
        prop_assert_eq!(bits(&found.values[0]), bits(&second));
        prop_assert_eq!(bits(&found.values[1]), bits(&first));
    }
}
