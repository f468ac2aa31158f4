//! Every test across the crates, in one program: forty programs take more time and room to link than to run.
#[macro_use]
mod common;
mod isolation_common;

mod acceptance_identification;
mod acceptance_structure;
mod calibration_complete_unit;
mod calibration_gyro_block;
mod documents;
mod equation_definitions;
mod explain_real;
mod firmware_counts;
mod firmware_double;
mod firmware_faults;
mod firmware_image;
mod firmware_serial;
mod formats;
mod golden_filter;
mod golden_identification;
mod health_acceptance;
mod health_calibration;
mod health_faults;
mod health_golden;
mod health_guards;
mod health_recording;
mod health_robustness;
mod house;
mod identify_oracle;
mod isolation_acceptance;
mod isolation_comparison;
mod isolation_flight;
mod isolation_golden;
mod isolation_methods;
mod isolation_physics;
mod link_fault_grid;
mod link_faults;
mod module_bad_input;
mod module_compensation;
mod recording_real;
mod same_bits;
mod thermal_accuracy;
mod thermal_compensation;
mod thermal_golden;
mod thermal_real_logs;
mod thirty_days;

/// A file of tests that nobody has named above would never run.
#[test]
fn every_file_of_tests_is_part_of_this_program() {
    let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let named = include_str!("all.rs");
    for entry in std::fs::read_dir(here).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        assert!(name == "all" || named.contains(&format!("mod {name};")), "{} is not run", path.display());
    }
}
