//! Text tables as they are found in the world: separators, decimal commas, preambles, dates; and files that are no tables.
use std::fs;
use std::io::Write as _;

use schuler_recording::{Leniency, table};
use tempfile::TempDir;

/// Names and values of a text table, read twice: as it is and gzipped.
fn read(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let folder = TempDir::new().unwrap();
    let of = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let table = table::open(&path).unwrap();
        let names = table.names().to_vec();
        let all: Vec<usize> = (0..names.len()).collect();
        (names, table.read(&all).unwrap().values)
    };
    let plain = of("t.csv", text.as_bytes());
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(text.as_bytes()).unwrap();
    assert_eq!(plain, of("t.csv.gz", &encoder.finish().unwrap()));
    plain
}

fn refused(name: &str, bytes: &[u8]) -> String {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    let error = match table::open(&path) {
        Ok(table) => {
            let all: Vec<usize> = (0..table.names().len()).collect();
            table.read(&all).unwrap_err()
        }
        Err(error) => error,
    };
    error.to_string().replace(&format!("{}/", folder.path().display()), "")
}

#[test]
fn every_way_of_writing_gives_the_same_table() {
    let expected =
        (vec!["t".to_owned(), "x".to_owned()], vec![vec![0.0, 0.01, 0.02, 0.03], vec![1.5, -2.0, 1e-3, 7.0]]);
    for text in [
        "t,x\n0.00,1.5\n0.01,-2\n0.02,1e-3\n0.03,7\n",
        "t;x\r\n0.00;1.5\r\n0.01;-2\r\n0.02;1e-3\r\n0.03;7\r\n",
        "t;x\n0,00;1,5\n0,01;-2,0\n0,02;1,0e-3\n0,03;7,0\n",
        "t\tx\n0.00\t1.5\n0.01\t-2\n0.02\t1e-3\n0.03\t7\n",
        "  t     x\n  0.00  1.5\n  0.01 -2\n  0.02  1e-3 \n  0.03  7\n",
        "% t x\n0.00 1.5\n0.01 -2\n0.02 1e-3\n0.03 7\n",
        "Logger 7\nserial;4711\n\nt;x\ns;rad/s\n0,00;1,5\n0,01;-2,0\n0,02;1,0e-3\n0,03;7,0\n",
    ] {
        assert_eq!(read(text), expected, "{text}");
    }
    let dates =
        "when;x\n01.05.2024 12:00:00,25;1,5\n01.05.2024 12:00:01,25;1,5\n01.05.2024 12:00:02,25;1,5\n";
    assert_eq!(read(dates).1[0], [1_714_564_800.25, 1_714_564_801.25, 1_714_564_802.25]);
}

#[test]
fn mistakes_behind_a_preamble_have_the_lines_of_the_file() {
    let text = "a title\n\nt;x\ns;m\n0,0;1\n0,1;2\n0,2;3\n0,3;x\n";
    assert_eq!(
        refused("t.csv", text.as_bytes()),
        "t.csv:8: x: found \"x\"; expected a number, nan or nothing"
    );
    // Also where the first row is wrong, the quotes of a cell do not close, or blanks separate.
    for (bad, said) in [
        ("0,0;y", "t.csv:5: x: found \"y\"; expected a number, nan or nothing"),
        ("0,0;\"1", "t.csv:5: found a quote that does not close; expected none, or two around a cell"),
        ("0,0", "t.csv:5: found a row of 1 cells; expected 2, as in the header"),
    ] {
        let text = format!("a title\n\nt;x\ns;m\n{bad}\n{}", "0,1;2\n".repeat(20));
        assert_eq!(refused("t.csv", text.as_bytes()), said);
    }
    let blanks = "t x\n0 1\n1 2\n2 3\n3\n4 5\n";
    assert_eq!(
        refused("t.txt", blanks.as_bytes()),
        "t.txt:5: found a row of 1 cells; expected 2, as in the header"
    );
}

#[test]
fn leniently_rows_of_any_dialect_are_left_out_and_counted() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("t.txt");
    fs::write(&path, "a title\nt;x\n0,0;1\n0,1;2\n0,2;\"3\n0,3\n0,4;5,5\n0,5;6\n0,6;7\n").unwrap();
    let columns = table::open_with(&path, Leniency::Lenient).unwrap().read(&[0, 1]).unwrap();
    assert_eq!(columns.values, [vec![0.0, 0.1, 0.4, 0.5, 0.6], vec![1.0, 2.0, 5.5, 6.0, 7.0]]);
    assert_eq!((columns.lines, columns.warnings.len()), (vec![3, 4, 7, 8, 9], 1));
    let said = &columns.warnings[0];
    assert!(
        said.contains("2 rows are left out; the first: ") && said.contains("t.txt:5: found a quote"),
        "{said}"
    );
}

#[test]
fn what_is_no_table_is_named_with_the_way_out() {
    for (name, bytes, said) in [
        ("a.mat", b"MATLAB 7.3 MAT-file, Platform".as_slice(), "a.mat: cannot read the arrays: "),
        ("a.h5", b"\x89HDF\r\n\x1a\n\0\0", "a.h5: cannot read the arrays: "),
        ("a.npz", b"PK\x03\x04\x14\0\0\0", "the archive is damaged"),
        ("a.pkl", b"\x80\x04\x95\x10", "found a Python pickle, which is not read; in Python"),
        ("a.db3", b"SQLite format 3\0\x10", "a.db3: cannot read the log: "),
        ("a.rda", b"\x1f\x8b\x08\0\0\0", "found an RData file, which is not read; in R: write.csv"),
        ("a.csv", b"\xff\xfet\0,\0x\0", "found text in UTF-16, which is not read; save it as UTF-8"),
        ("a.bin", b"\x01\x02\0\0\0abc\n\0\0", "a.bin:1: found binary data of no format that is known"),
    ] {
        let message = refused(name, bytes);
        assert!(message.contains(said) && !message.contains('\n'), "{message}");
    }
    // What is read as it is, and not packed.
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(b"ULog\x01\x12\x35\x01").unwrap();
    let message = refused("a.ulg.gz", &encoder.finish().unwrap());
    assert!(message.contains("unpack it first"), "{message}");
}

#[test]
fn a_column_that_is_not_there_is_answered_with_those_that_are() {
    let names = ["t", "gyro_x"].map(str::to_owned);
    let message = table::column_index(&names, "pressure").unwrap_err();
    assert_eq!(message, "found \"pressure\"; expected a column of the table; it has t, gyro_x");
}
