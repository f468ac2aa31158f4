//! What the image that is flashed is made of.
use std::fs;

use host_sim::emulator::{Image, build};
use object::{Object, ObjectSection, ObjectSymbol, SectionKind};

mod common;

/// The board's flash and RAM, bytes (`memory.x`).
const FLASH: u64 = 1024 * 1024;
const RAM: u64 = 128 * 1024;

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

#[test]
fn the_flashed_image_fits_its_board() {
    if common::skipped("the_flashed_image_fits_its_board") {
        return;
    }
    let bytes = fs::read(build(Image::Flashed).unwrap()).unwrap();
    let elf = object::File::parse(&*bytes).unwrap();
    let (mut flash, mut ram) = (0, 0);
    for section in elf.sections() {
        let in_ram = section.address() >= 0x2000_0000;
        match section.kind() {
            SectionKind::Text | SectionKind::ReadOnlyData | SectionKind::ReadOnlyString => {
                flash += section.size();
            }
            SectionKind::Data => {
                flash += section.size();
                ram += section.size();
            }
            SectionKind::UninitializedData if in_ram => ram += section.size(),
            _ => (),
        }
    }
    say!("flash {flash} of {FLASH} bytes, RAM {ram} of {RAM} with the stack");
    assert!((8192..FLASH).contains(&flash));
    // Stack and queues at least; the last two words are the note for the next start.
    assert!((16 * 1024 + 4096..RAM - 8).contains(&ram));
}
