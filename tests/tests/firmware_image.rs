//! What the image that is flashed is made of.
use std::fs;

use host_sim::emulator::{Image, build};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};

use crate::common;

/// Sizes of the sections, bytes.
const SIZES: &str = "image_sizes.txt";
/// By how much a size may differ from the golden one before the change is to be looked at.
const TOLERANCE: f64 = 0.02;

/// The bars, bytes: 96 KiB of flash, 64 KiB of RAM with the stack. The board has 1024 and 128 (`memory.x`).
const FLASH_BAR: u64 = 96 * 1024;
const RAM_BAR: u64 = 64 * 1024;

/// Not one panic is left in the image: neither in the step, nor in the link, nor around them. Every panic of Rust ends in
/// a function of `core::panicking` or in one of the like; what is not there cannot be called.
#[test]
fn the_flashed_image_cannot_panic() {
    if common::skipped("the_flashed_image_cannot_panic") {
        return;
    }
    let bytes = fs::read(build(Image::Flashed).unwrap()).unwrap();
    let elf = object::File::parse(&*bytes).unwrap();
    let names: Vec<&str> = elf.symbols().filter_map(|symbol| symbol.name().ok()).collect();
    assert!(names.iter().any(|name| name.contains("schuler_link")), "the image has no symbols to look at");
    let panics: Vec<&&str> = names
        .iter()
        .filter(|name| {
            ["panicking", "rust_begin_unwind", "unwrap_failed", "expect_failed"]
                .iter()
                .any(|part| name.contains(part))
        })
        .collect();
    assert!(panics.is_empty(), "the image can panic: {panics:#?}");
}

/// Sections of the flashed image against `golden/image_sizes.txt`, to [`TOLERANCE`].
#[test]
fn the_flashed_image_fits_its_board() {
    if common::skipped("the_flashed_image_fits_its_board") {
        return;
    }
    let bytes = fs::read(build(Image::Flashed).unwrap()).unwrap();
    let elf = object::File::parse(&*bytes).unwrap();
    let (mut flash, mut ram) = (0, 0);
    let (mut text, mut data, mut bss) = (0, 0, 0);
    for section in elf.sections() {
        let in_ram = section.address() >= 0x2000_0000;
        match section.kind() {
            SectionKind::Text | SectionKind::ReadOnlyData | SectionKind::ReadOnlyString => {
                flash += section.size();
                text += if section.name() == Ok(".text") { section.size() } else { 0 };
            }
            SectionKind::Data => {
                flash += section.size();
                ram += section.size();
                data += section.size();
            }
            SectionKind::UninitializedData if in_ram => {
                ram += section.size();
                bss += if section.name() == Ok(".bss") { section.size() } else { 0 };
            }
            _ => (),
        }
    }
    say!("flash {flash} of {FLASH_BAR} bytes, RAM {ram} of {RAM_BAR} with the stack");
    assert!((65_536..=FLASH_BAR).contains(&flash));
    // Stack and the module at least.
    assert!((8 * 1024 + 40_000..=RAM_BAR).contains(&ram));

    let sizes = [("flash", flash), ("text", text), ("data", data), ("bss", bss), ("ram", ram)];
    let golden = common::golden(SIZES);
    let was = |name: &str| -> Option<u64> {
        golden.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok())
    };
    let near = |now: u64, was: u64| now.abs_diff(was) as f64 <= TOLERANCE * was as f64;
    let same = sizes.iter().all(|(name, now)| was(name).is_some_and(|was| near(*now, was)));
    if !same || common::rewrite_golden() {
        let lines = sizes.map(|(name, size)| format!("{name:<6}{size:>8}\n"));
        common::assert_golden(SIZES, &lines.concat());
    }
}
