//! Rows of text tables that are none: errors by line, or left out and counted; and bounds on what is read.
use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use schuler_recording::table::{self, Columns};
use schuler_recording::{CaseFile, Error, Leniency, Recording};

/// A table of so many rows in which `change` may replace lines, the header being the first.
fn table_of(rows: usize, change: impl Fn(usize, String) -> String) -> String {
    let header = std::iter::once("t,x,y".to_owned());
    let lines = header.chain((0..rows).map(|row| format!("{row},{}.5,{}", row % 7, row % 3)));
    lines.enumerate().fold(String::new(), |text, (index, line)| text + &change(index + 1, line) + "\n")
}

fn read(text: &str, wanted: &[usize], leniency: Leniency) -> Result<Columns, Error> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("r.csv");
    std::fs::write(&path, text).unwrap();
    table::open_with(&path, leniency)?.read(wanted)
}

/// Lines that are no rows of the table, with what is said of them.
const DEPARTURES: [(&str, &str); 10] = [
    ("300,\"7.0,1", "found a quote that does not close"),
    ("300,7.0,\"1", "found a quote that does not close"),
    ("300,7.0\",1", "found a quote that does not close"),
    ("\"300,7.0,1", "found a quote that does not close"),
    ("300,7.0,1\"", "found a quote that does not close"),
    ("300,\"7\"5,1", "found a quote that does not close"),
    ("300,7.0", "found a row of 2 cells; expected 3"),
    ("300", "found a row of 1 cells; expected 3"),
    ("300,7.0,1,5", "found a row of 4 cells; expected 3"),
    ("300,7.0,1,,,5", "found a row of 6 cells; expected 3"),
];

#[test]
fn a_line_that_is_no_row_is_named() {
    for (bad, said) in DEPARTURES {
        // Whether or not anybody asks for the column in which it stands, and however often the like follows.
        for wanted in [&[0, 1][..], &[0, 2], &[0]] {
            for every in [usize::MAX, 600] {
                let text = table_of(2000, |line, row| {
                    if line == 302 || line > 302 && line % every == 0 { bad.to_owned() } else { row }
                });
                let error = read(&text, wanted, Leniency::Strict).unwrap_err().to_string();
                assert!(error.contains("r.csv:302: ") && error.contains(said), "{bad}: {error}");
            }
        }
    }
}

#[test]
fn leniently_all_other_rows_are_read_and_the_rest_is_counted() {
    for (bad, said) in DEPARTURES {
        let text = table_of(2000, |line, row| if line % 500 == 302 { bad.to_owned() } else { row });
        let columns = read(&text, &[0, 1], Leniency::Lenient).unwrap();
        assert_eq!(columns.rows(), 1996, "{bad}");
        assert_eq!(columns.values[0].iter().sum::<f64>() as usize, 1999 * 1000 - 4 * 300 - 500 * 6);
        assert_eq!(columns.warnings.len(), 1, "{:?}", columns.warnings);
        let warning = &columns.warnings[0];
        assert!(warning.contains(": 4 rows are left out; the first: "), "{warning}");
        assert!(warning.contains("r.csv:302: ") && warning.contains(said), "{warning}");
    }
}

#[test]
fn leniently_what_is_no_number_is_missing_and_a_row_without_time_is_left_out() {
    let text = table_of(100, |line, row| match line {
        10 | 20 => row.replacen(".5", "x", 1),
        30 => format!("noon{row}"),
        _ => row,
    });
    let error = read(&text, &[0, 1], Leniency::Strict).unwrap_err().to_string();
    assert!(error.contains("r.csv:10: x: found \"1x\"; expected a number"), "{error}");
    let columns = read(&text, &[0, 1], Leniency::Lenient).unwrap();
    assert_eq!(columns.rows(), 99);
    assert_eq!(columns.values[1].iter().filter(|value| value.is_nan()).count(), 2);
    assert!(columns.warnings[0].contains("1 rows are left out") && columns.warnings[0].contains("r.csv:30"));
    assert!(columns.warnings[1].contains("2 cells are missing") && columns.warnings[1].contains("r.csv:10"));
}

#[test]
fn quoted_cells_are_read_whatever_is_in_them() {
    let text =
        "t,note,x\r\n0,\"a, b\",1\r\n\"1\",\"he said \"\"no\"\"\", \"2\" \r\n2,the \"third\",3\r\n\r\n";
    let columns = read(text, &[0, 2], Leniency::Strict).unwrap();
    assert_eq!(columns.values, [vec![0.0, 1.0, 2.0], vec![1.0, 2.0, 3.0]]);
    assert_eq!(columns.lines, [2, 3, 4]);
    // Lines that end as on old machines.
    assert_eq!(read("t,x\r0,1\r1,2\r", &[0, 1], Leniency::Strict).unwrap().values[1], [1.0, 2.0]);
}

#[test]
fn a_case_is_read_as_leniently_as_its_table() {
    let directory = tempfile::tempdir().unwrap();
    let case = directory.path().join("case.toml");
    let text = "format = \"schuler-case/1\"\nauthor = \"me\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
        [[sensor]]\nid = \"x\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1, 0, 0]\ncolour = \"red\"\n";
    std::fs::write(&case, text).unwrap();
    let table = table_of(50, |line, row| if line == 20 { "18,\"1".to_owned() } else { row });
    std::fs::write(directory.path().join("r.csv"), table).unwrap();
    let error = format!("{:#}", CaseFile::read(&case).unwrap_err());
    assert!(error.contains("case.toml:2: author: unknown key"), "{error}");
    assert!(error.contains("case.toml:13: sensor[0].colour: unknown key"), "{error}");
    let file = CaseFile::read_with(&case, Leniency::Lenient).unwrap();
    let recording = Recording::of_case(file).unwrap();
    let said = recording.warnings.join("\n");
    assert_eq!(recording.warnings.len(), 3, "{said}");
    assert!(said.contains("author: unknown key, ignored") && said.contains("1 rows are left out"), "{said}");
    // The row is missing, in its place.
    assert_eq!((recording.len(), recording.sensors[0].quality.in_gaps), (50, 1));
}

/// Writes a gzip file of so many bytes.
fn gzip(path: &Path, head: &[u8], byte: u8, bytes: usize) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = flate2::write::GzEncoder::new(io::BufWriter::new(file), flate2::Compression::fast());
    encoder.write_all(head).unwrap();
    for _ in 0..bytes >> 20 {
        encoder.write_all(&vec![byte; 1 << 20]).unwrap();
    }
    encoder.finish().unwrap();
}

#[test]
fn a_line_that_does_not_end_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("r.csv.gz");
    gzip(&path, b"t,x\n0,1\n1,", b'1', 80 << 20);
    let error = table::open(&path).unwrap().read(&[0, 1]).unwrap_err().to_string();
    assert!(error.contains("r.csv.gz:3: found a line of more than 67 MB"), "{error}");
    gzip(&path, b"", b't', 80 << 20);
    let error = table::open(&path).err().unwrap().to_string();
    assert!(error.contains("r.csv.gz:1: found a line of more than 67 MB"), "{error}");
}

#[test]
fn who_reads_a_table_of_nothing_can_stop() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("r.csv.gz");
    gzip(&path, b"t,x\n0,1\n", b'\n', 96 << 20);
    let mut chunks = table::open(&path).unwrap().chunks(&[0, 1]).unwrap();
    let rows: Vec<usize> = (0..4).map(|_| chunks.next().unwrap().unwrap().rows()).collect();
    assert_eq!(rows, [1, 0, 0, 0]);
}

#[test]
fn wide_tables_are_read_in_chunks_of_few_rows() {
    const COLUMNS: usize = 100_000;
    let mut text = String::new();
    for row in 0..60 {
        let cells =
            (0..COLUMNS).map(|column| if row == 0 { format!("c{column}") } else { format!("{column}") });
        writeln!(text, "{}", cells.collect::<Vec<_>>().join(",")).unwrap();
    }
    let table = table::open_bytes(Path::new("wide.csv"), text.into_bytes()).unwrap();
    let wanted: Vec<usize> = (0..COLUMNS).collect();
    let rows: Vec<usize> = table.chunks(&wanted).unwrap().map(|chunk| chunk.unwrap().rows()).collect();
    assert!(rows.iter().sum::<usize>() == 59 && rows.iter().all(|rows| *rows < 40), "{rows:?}");
}

#[test]
fn one_wrong_time_stamp_does_not_make_a_long_recording() {
    let directory = tempfile::tempdir().unwrap();
    let case = directory.path().join("case.toml");
    let text = "format = \"schuler-case/1\"\n[recording]\npath = \"r.csv\"\ntime = \"t\"\nstep_s = 1.0\n\
        [[sensor]]\nid = \"x\"\nkind = \"fog\"\ncolumn = \"x\"\nunit = \"deg/h\"\naxis = [1, 0, 0]\n";
    std::fs::write(&case, text).unwrap();
    let table = |gap: usize| {
        table_of(600, |line, row| if line == 601 { format!("{},1.5,1", 598 + gap) } else { row })
    };
    std::fs::write(directory.path().join("r.csv"), table(999_000)).unwrap();
    let error = Recording::read(&case).unwrap_err().to_string();
    assert!(error.contains("r.csv:601: t: row 600: found a jump of 999000 s"), "{error}");
    // Rows are put in only when whoever reads has heard how many there will be.
    std::fs::write(directory.path().join("r.csv"), table(100_000)).unwrap();
    let file = CaseFile::read(&case).unwrap();
    let opened = file.open_table().unwrap();
    let mut most = 0;
    let stopped = Recording::of_table_watched(file, opened, |rows, _| {
        most = rows;
        let heard = Error::one("memory", schuler_recording::Problem::of_file("too little"));
        if rows > 10_000 { Err(heard) } else { Ok(()) }
    });
    assert_eq!((stopped.is_err(), most), (true, 100_599));
}

/// Many empty records that a chunk holds compressed: little to read, much to go through.
#[test]
fn a_log_of_empty_records_is_refused_soon() {
    let record = [[0x7f].as_slice(), &0_u64.to_le_bytes()].concat();
    let chunk = record.repeat((120 << 20) / record.len());
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    let mut put = |opcode: u8, content: &[u8]| {
        bytes.push(opcode);
        bytes.extend((content.len() as u64).to_le_bytes());
        bytes.extend(content);
    };
    put(1, &[0; 8]);
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let compressed = zstd::bulk::compress(&chunk, 3).unwrap();
    let head = [
        &0_u64.to_le_bytes()[..],
        &0_u64.to_le_bytes(),
        &(chunk.len() as u64).to_le_bytes(),
        &0_u32.to_le_bytes(),
        &text("zstd"),
        &(compressed.len() as u64).to_le_bytes(),
        &compressed,
    ];
    put(6, &head.concat());
    put(2, &[0; 20]);
    assert!(bytes.len() < 40_000, "{} bytes", bytes.len());
    let began = Instant::now();
    let error = table::open_bytes(Path::new("a.mcap"), bytes).err().unwrap().to_string();
    assert!(error.contains("more records than its size lets expect"), "{error}");
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
}
