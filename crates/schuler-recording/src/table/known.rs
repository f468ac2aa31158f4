//! Formats that are known by their first bytes and not read here, each with the way out.

/// A format: its first bytes, from where on they stand, its name, and what a user can do.
struct Known {
    at: usize,
    magic: &'static [u8],
    name: &'static str,
    way_out: &'static str,
}

const CSV: &str = "save it as CSV or Parquet";
const R: &str = "in R: write.csv(x, \"x.csv\", row.names = FALSE)";
const UNPACK: &str = "unpack it first";

const fn known(at: usize, magic: &'static [u8], name: &'static str, way_out: &'static str) -> Known {
    Known { at, magic, name, way_out }
}

const KNOWN: &[Known] = &[
    known(0, b"MATLAB 7.3 MAT-file", "a MATLAB 7.3 file", "in MATLAB: save it with -v7, or writetable"),
    known(0, b"# Created by Octave", "an Octave text file", "in Octave: save -v7 x.mat"),
    known(0, b"\x89HDF\r\n\x1a\n", "an HDF5 file", "in Python: pandas.read_hdf(...).to_parquet(...)"),
    known(0, b"#ROSBAG V1", "a ROS bag older than version 2.0", "convert it: rosbag fix IN.bag OUT.bag"),
    known(
        0,
        b"SQLite format 3\0",
        "an SQLite database, perhaps of rosbag2",
        "convert it to MCAP: mcap convert IN.db3 OUT.mcap",
    ),
    known(
        0,
        b"FMT, 128,",
        "an ArduPilot DataFlash log as text",
        "mavlogdump.py --format csv --types IMU IN.log",
    ),
    known(0, b"RDX2\n", "an RData file", R),
    known(0, b"RDX3\n", "an RData file", R),
    known(0, b"X\n\0\0\0\x02", "an RDS file", R),
    known(0, b"X\n\0\0\0\x03", "an RDS file", R),
    known(0, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Excel file", CSV),
    known(0, b"ARROW1", "an Arrow (Feather) file", "save it as Parquet"),
    known(0, b"FEA1", "a Feather file", "save it as Parquet"),
    known(0, b"TDSm", "a LabVIEW TDMS file", "in Python: nptdms' as_dataframe().to_csv"),
    known(0, b"CDF\x01", "a netCDF file", CSV),
    known(0, b"CDF\x02", "a netCDF file", CSV),
    known(0, b"MDF     ", "an MDF measurement file", "in Python: asammdf's export to CSV"),
    known(0, b"Obj\x01", "an Avro file", "save it as Parquet"),
    known(0, b"\x80\x02", "a Python pickle", "in Python: save it with to_parquet or to_csv"),
    known(0, b"\x80\x03", "a Python pickle", "in Python: save it with to_parquet or to_csv"),
    known(0, b"\x80\x04\x95", "a Python pickle", "in Python: save it with to_parquet or to_csv"),
    known(0, b"\x80\x05\x95", "a Python pickle", "in Python: save it with to_parquet or to_csv"),
    known(0, b"\xfd7zXZ\0", "an xz-compressed file", UNPACK),
    known(0, b"BZh91AY&SY", "a bzip2-compressed file", UNPACK),
    known(0, b"\x28\xb5\x2f\xfd", "a Zstandard-compressed file", UNPACK),
    known(0, b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", UNPACK),
    known(257, b"ustar", "a tar archive", UNPACK),
    known(0, b"\xff\xfe", "text in UTF-16", "save it as UTF-8"),
    known(0, b"\xfe\xff", "text in UTF-16", "save it as UTF-8"),
    known(0, b"\xb5\x62", "a u-blox UBX log", "convert it with the receiver's own software"),
];

/// What a file is that begins so, and the way out; `None` where that is not known.
pub(super) fn named(beginning: &[u8]) -> Option<String> {
    let starts = |known: &&Known| beginning.get(known.at..).is_some_and(|rest| rest.starts_with(known.magic));
    let Known { name, way_out, .. } = KNOWN.iter().find(starts)?;
    Some(format!("found {name}, which is not read; {way_out}"))
}

/// What a compressed file is that has this name; R compresses what it saves.
pub(super) fn named_by_ending(path: &std::path::Path) -> Option<String> {
    let ending = path.extension()?.to_str()?.to_lowercase();
    matches!(ending.as_str(), "rda" | "rdata" | "rds")
        .then(|| format!("found an RData file, which is not read; {R}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_named_with_the_way_out() {
        for (beginning, name) in [
            (b"MATLAB 7.3 MAT-file, Platform: GLNXA64".as_slice(), "MATLAB 7.3"),
            (b"\x89HDF\r\n\x1a\n\0", "HDF5"),
            (b"# Created by Octave 8.4.0, Sat", "Octave"),
            (b"#ROSBAG V1.2\n", "ROS bag older than"),
            (b"FMT, 128, 89, FMT", "DataFlash"),
            (b"RDX3\nX\n", "RData"),
        ] {
            let said = named(beginning).unwrap();
            assert!(said.contains(name) && said.contains("; "), "{said}");
        }
        for text in ["t,x\n0,1\n", "", "MAT,x\n", "RDX,x\n1,2\n", "X\n1\n"] {
            assert_eq!(named(text.as_bytes()), None, "{text}");
        }
    }
}
