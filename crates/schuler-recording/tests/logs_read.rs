//! Logs of other people's tools: ROS 1 bags, ArduPilot DataFlash, MAVLink, ROS 2 bags, arrays of NumPy, MATLAB and HDF5. The samples are made by `tests/oracle/make_logs.py`.
use std::collections::BTreeSet;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use schuler_recording::table::{self, Columns};
use tempfile::TempDir;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/samples").join(name)
}

/// Columns by their names.
fn read(path: &Path, names: &[&str]) -> Columns {
    let table = table::open(path).unwrap();
    let wanted: Vec<usize> = names.iter().map(|name| table.index(name).unwrap()).collect();
    table.read(&wanted).unwrap()
}

#[test]
fn ros_1_bags_are_read_compressed_or_not() {
    for (name, rows) in [("imu.bag", 400), ("plain.bag", 40)] {
        let columns = read(
            &sample(name),
            &["/imu.header.stamp", "/imu.angular_velocity.x", "/imu.angular_velocity.y", "/imu@log_time"],
        );
        assert_eq!((columns.rows(), columns.warnings.len()), (rows, 0), "{name}: {:?}", columns.warnings);
        for row in 0..rows {
            let [stamp_s, x, y, logged_s] = [0, 1, 2, 3].map(|column| columns.values[column][row]);
            let expected_s = 1_700_000_000.123_456_8 + 0.005 * row as f64;
            assert!((stamp_s - expected_s).abs() < 1e-6 && (logged_s - stamp_s - 0.002).abs() < 1e-6);
            assert_eq!((x, y), ((row as f64 / 10.0).sin(), row as f64));
        }
    }
}

#[test]
fn a_bag_that_is_cut_off_is_read_as_far_as_it_goes() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cut.bag");
    let bytes = fs::read(sample("plain.bag")).unwrap();
    let mut rows = Vec::new();
    for length in [bytes.len() / 2, bytes.len() - 10] {
        fs::write(&path, &bytes[..length]).unwrap();
        match table::open(&path) {
            Ok(table) => {
                let columns = table.read(&[0]).unwrap();
                assert!(columns.warnings[0].contains("cut off"), "{:?}", columns.warnings);
                rows.push(columns.rows());
            }
            Err(error) => assert!(error.to_string().contains("found no numbers"), "{error}"),
        }
    }
    assert_eq!(rows.last(), Some(&40));
}

/// A record of a bag: fields with their names, and data.
fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let counted = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat();
    let pairs = fields.iter().map(|(name, value)| counted(&[name.as_bytes(), b"=", *value].concat()));
    [counted(&pairs.collect::<Vec<_>>().concat()), counted(data)].concat()
}

/// Chunks that hold chunks could go on for ever.
#[test]
fn a_bag_has_no_chunks_in_chunks() {
    let chunk = |data: &[u8]| {
        let size = (data.len() as u32).to_le_bytes();
        record(&[("op", &[5]), ("compression", b"none"), ("size", &size)], data)
    };
    let bag = |records: &[u8]| [b"#ROSBAG V2.0\n", records].concat();
    let refused = |bytes: Vec<u8>| table::open_bytes(Path::new("a.bag"), bytes).err().unwrap().to_string();
    let nested = refused(bag(&chunk(&chunk(&record(&[("op", &[2])], b"")))));
    assert!(nested.contains("a chunk stands in a chunk; the file is damaged"), "{nested}");
    let empty = refused(bag(&[chunk(b""), chunk(b"")].concat()));
    assert!(empty.contains("found no numbers"), "{empty}");
    let long = refused([b"#ROSBAG V2.0\n".as_slice(), &u32::MAX.to_le_bytes()].concat());
    assert!(long.contains("a record is longer than 128 MiB"), "{long}");
}

/// A ZIP archive of deflated files; each is 1 MiB of zeros as often as is said, behind a head.
fn archive(files: &[(&str, &[u8], usize)]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, head, mebibytes) in files {
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(head).unwrap();
        for _ in 0..*mebibytes {
            encoder.write_all(&vec![0; 1 << 20]).unwrap();
        }
        let packed = encoder.finish().unwrap();
        let at = bytes.len() as u32;
        let u16s = |values: &[u16]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>();
        let sizes = [&(packed.len() as u32).to_le_bytes()[..], &[0; 4]].concat();
        let length = name.len() as u16;
        let common = [&u16s(&[20, 0, 8, 0, 0]), &[0; 4][..], &sizes, &u16s(&[length, 0])].concat();
        bytes.extend([b"PK\x03\x04", &common[..], name.as_bytes(), &packed].concat());
        directory.extend(
            [b"PK\x01\x02\x14\0", &common[..], &[0; 10], &at.to_le_bytes(), name.as_bytes()].concat(),
        );
    }
    let [at, length] = [bytes.len() as u32, directory.len() as u32].map(u32::to_le_bytes);
    let count = (files.len() as u16).to_le_bytes();
    bytes.extend([&directory[..], b"PK\x05\x06\0\0\0\0", &count, &count, &length, &at, &[0; 2]].concat());
    bytes
}

#[test]
fn archives_that_unpack_to_more_than_is_read_are_refused() {
    let head = |rows: usize| {
        let header = format!("{{'descr': '|i1', 'fortran_order': False, 'shape': ({rows},), }}\n");
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat()
    };
    let open = |bytes: Vec<u8>| table::open_bytes(Path::new("a.npz"), bytes);
    let small = open(archive(&[("x.npy", &head(1 << 20), 1), ("notes.txt", b"", 0)])).unwrap();
    assert_eq!(small.names(), ["x"]);
    assert_eq!(small.read(&[0]).unwrap().rows(), 1 << 20);
    // Numbers of a byte take eight in memory.
    let wide = head(200 << 20);
    let message = open(archive(&[("x.npy", &wide, 200)])).err().unwrap().to_string();
    assert!(message.contains("found more than 1 GiB of arrays"), "{message}");
    let message = open(archive(&[("xl/workbook.xml", b"<x/>", 0)])).err().unwrap().to_string();
    assert!(message.contains("found a spreadsheet, which is not read; save its sheet as CSV"), "{message}");
}

#[test]
fn dataflash_logs_have_a_topic_for_each_instance() {
    let names = ["IMU_0.TimeUS", "IMU_0.GyrX", "IMU_1.GyrY", "ATT.Roll", "ATT.Pitch"];
    let columns = read(&sample("imu.bin"), &names);
    assert_eq!(columns.rows(), 400);
    for row in 0..400 {
        let [time_us, x, y, roll, pitch] = [0, 1, 2, 3, 4].map(|column| columns.values[column][row]);
        assert_eq!(time_us, (1_000_000 + 5000 * row) as f64);
        assert!((x - (row as f64 / 10.0).sin()).abs() < 1e-7);
        assert_eq!(y, -(row as f64));
        if row % 2 == 0 {
            assert_eq!((roll, pitch), (row as f64 / 100.0, -(row as f64) / 100.0));
        } else {
            assert!(roll.is_nan() && pitch.is_nan());
        }
    }
    // Text is no column, and bytes that are no message are passed over.
    let table = table::open(&sample("imu.bin")).unwrap();
    assert!(table.index("IMU_0.Tag").is_err());
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("damaged.bin");
    let mut bytes = fs::read(sample("imu.bin")).unwrap();
    bytes.splice(5000..5000, [1, 2, 3]);
    bytes.truncate(bytes.len() - 4);
    fs::write(&path, bytes).unwrap();
    let columns = read(&path, &["IMU_0.TimeUS", "IMU_0.GyrX"]);
    assert!((398..=400).contains(&columns.rows()), "{}", columns.rows());
    assert!(columns.warnings.iter().any(|said| said.contains("are no messages")), "{:?}", columns.warnings);
}

#[test]
fn telemetry_logs_have_a_topic_for_each_sender() {
    let path = sample("imu.tlog");
    let names =
        ["ATTITUDE@log_time", "ATTITUDE.roll", "ATTITUDE.pitch", "ATTITUDE.time_boot_ms", "RAW_IMU.xacc"];
    let columns = read(&path, &names);
    assert_eq!((columns.rows(), columns.warnings.len()), (400, 0), "{:?}", columns.warnings);
    for row in 0..400 {
        let [time_s, roll, pitch, boot_ms, x] = [0, 1, 2, 3, 4].map(|column| columns.values[column][row]);
        let expected_s = 1_700_000_000.123_456 + 0.005 * row as f64;
        assert!((time_s - expected_s).abs() < 1e-6, "{time_s}");
        assert!((roll - (row as f64 / 10.0).sin()).abs() < 1e-7);
        assert_eq!((pitch, boot_ms), (row as f64, 5.0 * row as f64));
        if row % 2 == 0 {
            assert_eq!(x, (1000.0 * (row as f64 / 10.0).sin()).round());
        } else {
            assert!(x.is_nan());
        }
    }
    // The first version of the protocol has no temperature, and each sender is a topic.
    let imu = read(&path, &["RAW_IMU.time_usec", "RAW_IMU.yacc", "RAW_IMU.temperature"]);
    assert_eq!((imu.values[0][199], imu.values[1][199]), (1_990_000.0, 398.0));
    assert!(imu.values[2].iter().all(|value| value.is_nan()));
    assert_eq!(read(&path, &["HEARTBEAT_1_1.custom_mode"]).values, [[0.0, 200.0]]);
    assert_eq!(read(&path, &["HEARTBEAT_255_190.custom_mode"]).rows(), 2);
}

#[test]
fn damage_to_a_telemetry_log_costs_the_message() {
    let bytes = fs::read(sample("imu.tlog")).unwrap();
    let read = |bytes: Vec<u8>| {
        let table = table::open_bytes(Path::new("imu.tlog"), bytes).unwrap();
        let wanted = ["ATTITUDE.time_boot_ms", "ATTITUDE.roll"].map(|name| table.index(name).unwrap());
        table.read(&wanted).unwrap()
    };
    let (mut between, mut within) = (bytes.clone(), bytes.clone());
    // What looks like the beginning of a frame, and the first byte that an attitude carries.
    between.splice(0..0, *b"\0\x05\x80\0\0\0\0\0\xfd");
    within[18] ^= 0xff;
    let between = read(between);
    assert_eq!(between.rows(), 400);
    assert!(
        between.warnings.iter().any(|said| said.contains("9 bytes are no messages")),
        "{:?}",
        between.warnings
    );
    let within = read(within);
    assert_eq!((within.rows(), within.values[0][0]), (399, 5.0));
    assert!(within.warnings[0].contains("are no messages"), "{:?}", within.warnings);
    let cut = read(bytes[..bytes.len() - 3].to_vec());
    assert!(cut.warnings.iter().any(|said| said.contains("cut off")), "{:?}", cut.warnings);
}

#[test]
fn arrays_of_matlab_are_columns() {
    let sine: Vec<f64> = (0..40).map(|row| (f64::from(row) / 10.0).sin()).collect();
    let counted: Vec<f64> = (0..40).map(f64::from).collect();
    let names = ["t", "gyro[0]", "gyro[1]", "imu.count", "imu.more.x"];
    for name in ["packed.mat", "plain.mat", "matlab73.mat"] {
        let table = table::open(&sample(name)).unwrap();
        assert_eq!(
            table.names().iter().collect::<BTreeSet<_>>(),
            names.map(str::to_owned).iter().collect(),
            "{name}"
        );
        let columns = read(&sample(name), &names);
        assert!((columns.values[0][39] - 0.195).abs() < 1e-12);
        assert!(columns.values[1].iter().zip(&sine).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!((&columns.values[2], &columns.values[3]), (&counted, &counted));
        assert!(columns.values[4].iter().zip(&sine).all(|(a, b)| (a - b).abs() < 1e-7));
    }
}

#[test]
fn datasets_of_hdf5_are_columns() {
    let table = table::open(&sample("arrays.h5")).unwrap();
    let names =
        ["t", "gyro[0]", "gyro[1]", "imu/counts", "imu/ok", "imu/records.x", "imu/records.y", "z.r", "z.i"];
    let found: BTreeSet<&str> = table.names().iter().map(String::as_str).collect();
    assert_eq!(found, names.into_iter().collect());
    let columns = read(&sample("arrays.h5"), &names[..7]);
    let counted: Vec<f64> = (0..40).map(f64::from).collect();
    let sine = |row: usize| (row as f64 / 10.0).sin();
    assert!((columns.values[0][39] - 0.195).abs() < 1e-12);
    assert!((0..40).all(|row| (columns.values[1][row] - sine(row)).abs() < 1e-15));
    assert_eq!((&columns.values[2], &columns.values[3]), (&counted, &counted));
    assert_eq!(columns.values[4][..4], [1.0, 0.0, 1.0, 0.0]);
    assert!((0..40).all(|row| columns.values[5][row] == f64::from(sine(row) as f32)));
    assert_eq!(columns.values[6], counted);
    assert_eq!(read(&sample("arrays.h5"), &names[7..]).values, [vec![0.0, 2.0], vec![1.0, 0.0]]);
}

#[test]
fn ros_2_bags_in_sqlite_are_read_with_their_definitions_or_those_of_ros() {
    let imu = ["/imu.header.stamp", "/imu.angular_velocity.x", "/imu.linear_acceleration.z", "/imu@log_time"];
    let sine = |row: usize| (row as f64 / 10.0).sin();
    let bytes = |name: &str| table::open_bytes(Path::new(name), fs::read(sample(name)).unwrap()).unwrap();
    for name in ["described.db3", "undescribed.db3"] {
        let columns = read(&sample(name), &imu);
        assert_eq!((columns.rows(), columns.warnings.len()), (40, 0), "{name}: {:?}", columns.warnings);
        for row in 0..40 {
            let [stamp_s, x, z, logged_s] = [0, 1, 2, 3].map(|column| columns.values[column][row]);
            let expected_s = 1_700_000_000.123_456_8 + 0.005 * row as f64;
            assert!((stamp_s - expected_s).abs() < 1e-6 && (logged_s - stamp_s - 0.002).abs() < 1e-6);
            assert_eq!((x, z), (sine(row), -9.8));
        }
        // From memory as from the file, which stays alone.
        let in_memory = bytes(name);
        let wanted: Vec<usize> = imu.iter().map(|name| in_memory.index(name).unwrap()).collect();
        assert_eq!(in_memory.read(&wanted).unwrap(), columns);
        for beside in ["-wal", "-journal", "-shm"] {
            assert!(!sample(&format!("{name}{beside}")).exists());
        }
    }
    let own = read(&sample("described.db3"), &["/lab.count", "/lab.rate[0]"]);
    assert_eq!((own.rows(), own.values[0][39]), (40, 39.0));
    assert!((0..40).all(|row| own.values[1][row] == sine(row)));
    let message = bytes("undescribed.db3").index("/lab.count").unwrap_err();
    assert!(message.contains("no schema"), "{message}");
}

#[test]
fn an_sqlite_database_that_is_no_bag_is_named() {
    let folder = TempDir::new().unwrap();
    let made = |name: &str, sql: &str| {
        let path = folder.path().join(name);
        rusqlite::Connection::open(&path).unwrap().execute_batch(sql).unwrap();
        table::open(&path).err().unwrap().to_string()
    };
    let other = made("other.db", "CREATE TABLE notes(text TEXT)");
    assert!(other.contains("is no bag of ROS 2; expected the tables topics and messages"), "{other}");
    // A view may have rows without end.
    let view = made(
        "view 100%?#.db3",
        "CREATE TABLE topics(id, name, type, serialization_format);
         CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)
             SELECT id AS rowid, 1 AS topic_id, 1 AS timestamp, x'00' AS data FROM n",
    );
    assert!(view.contains("is no bag of ROS 2"), "{view}");
}

#[test]
fn a_matlab_file_of_the_other_order_of_bytes_is_read_and_one_of_objects_is_named() {
    let element = |kind: u32, content: &[u8]| {
        let mut bytes = [kind.to_be_bytes(), (content.len() as u32).to_be_bytes()].concat();
        bytes.extend(content);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    };
    let file = |class: u32, values: &[u8]| {
        let mut header = b"MATLAB 5.0 MAT-file".to_vec();
        header.resize(124, b' ');
        header.extend(b"\x01\0MI");
        let parts = [
            element(6, &[class.to_be_bytes(), [0; 4]].concat()),
            element(5, &[1_u32.to_be_bytes(), 3_u32.to_be_bytes()].concat()),
            element(1, b"omega"),
            element(9, values),
        ];
        table::open_bytes(Path::new("a.mat"), [header, element(14, &parts.concat())].concat())
    };
    let values = [1.5_f64, -2.0, 3.0].map(f64::to_be_bytes).concat();
    let table = file(6, &values).unwrap();
    assert_eq!(table.names(), ["omega"]);
    assert_eq!(table.read(&[0]).unwrap().values, [[1.5, -2.0, 3.0]]);
    let objects = file(17, &values).err().unwrap().to_string();
    assert!(objects.contains("found no arrays") && objects.contains("table2struct"), "{objects}");
    let short = file(6, &values[..20]).err().unwrap().to_string();
    assert!(short.contains("the file is damaged or cut off"), "{short}");
}

#[test]
fn arrays_of_numpy_are_columns() {
    let sine: Vec<f64> = (0..40).map(|row| (f64::from(row) / 10.0).sin()).collect();
    let counted: Vec<f64> = (0..40).map(f64::from).collect();
    let fields = read(&sample("fields.npy"), &["when", "x", "y"]);
    assert!(fields.values[1].iter().zip(&sine).all(|(a, b)| (a - b).abs() < 1e-15));
    assert_eq!(fields.values[2], counted);
    assert_eq!(fields.values[0][0], 1_700_000_000.123_456_8);
    assert!((fields.values[0][39] - fields.values[0][0] - 0.195).abs() < 1e-6);
    let arrays = read(&sample("arrays.npz"), &["t", "gyro[0]", "gyro[1]"]);
    assert!((arrays.values[0][39] - 0.195).abs() < 1e-12);
    assert!(arrays.values[1].iter().zip(&sine).all(|(a, b)| (a - b).abs() < 1e-15));
    assert_eq!(arrays.values[2], counted);
    let two = read(&sample("two.npz"), &["gyro[0]", "gyro[1]"]);
    assert_eq!(two.values[0], counted);
    assert_eq!(two.values[1][39], -39.0);
    let table = table::open(&sample("arrays.npz")).unwrap();
    assert!(table.all().unwrap_err().contains("\"short\" of 3"));
    let [t, short] = ["t", "short"].map(|name| table.index(name).unwrap());
    let error = table.read(&[t, short]).unwrap_err();
    assert!(error.to_string().contains("short: found 3 rows; expected 40, as of \"t\""), "{error}");
    assert_eq!(table::open(&sample("two.npz")).unwrap().all().unwrap().len(), 3);
}

#[test]
fn damaged_logs_are_answered_with_a_message_or_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("damaged");
    for name in [
        "imu.bag",
        "plain.bag",
        "imu.bin",
        "imu.tlog",
        "fields.npy",
        "arrays.npz",
        "packed.mat",
        "plain.mat",
        "matlab73.mat",
        "arrays.h5",
        "described.db3",
    ] {
        let bytes = fs::read(sample(name)).unwrap();
        for damage in 0..60_usize {
            let mut damaged = bytes.clone();
            let at = 13 + damage * damage * 37 % (bytes.len() - 13);
            damaged[at] = damaged[at].wrapping_add(1 + (damage % 255) as u8);
            fs::write(&path, &damaged).unwrap();
            if let Ok(table) = table::open(&path)
                && let Err(error) = table.read(&[0])
            {
                assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }
}
