//! `include/schuler.h` is what the sources say, and its numbers are those of the flight module.
use std::path::Path;
use std::{env, fs};

use schuler_core::compensation::TermStatus;
use schuler_core::health::{HealthAlarms, HealthStatus};
use schuler_core::isolation::IsolationFlags;
use schuler_core::module::Status;
use schuler_core::thermal::{CompensationStatus, ThermalStatus};

/// `SCHULER_REWRITE_GOLDEN=1` writes it anew.
#[test]
fn the_header_is_up_to_date() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).unwrap();
    let mut made = Vec::new();
    cbindgen::generate_with_config(folder, config).unwrap().write(&mut made);
    let path = folder.join("include/schuler.h");
    if env::var("SCHULER_REWRITE_GOLDEN").is_ok_and(|value| value == "1") {
        fs::write(&path, &made).unwrap();
    }
    let kept = fs::read(&path).unwrap_or_default();
    assert!(made == kept, "{} is out of date: SCHULER_REWRITE_GOLDEN=1 writes it anew", path.display());
}

/// Every flag of the flight module has its number in the header.
#[test]
fn the_flags_are_those_of_the_module() {
    let header = include_str!("../include/schuler.h");
    macro_rules! flags {
        ($($flags:ty, $prefix:literal;)*) => {
            $(for (name, flag) in <$flags>::all().iter_names() {
                let line = format!("\n#define SCHULER_{}_{name} {}\n", $prefix, flag.bits());
                assert!(header.contains(&line), "the header lacks {line}");
            })*
        };
    }
    flags! {
        Status, "STATUS";
        IsolationFlags, "ISOLATION";
        ThermalStatus, "THERMAL";
        CompensationStatus, "CALIBRATION";
        TermStatus, "TERMS";
        HealthAlarms, "ALARM";
        HealthStatus, "HEALTH_STATUS";
    }
}
