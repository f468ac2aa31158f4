//! Chooses the linker scripts of the board and the size of the stack.
use std::env;
use std::path::Path;

/// Bytes of stack: the deepest way through the calls, and an eighth of it besides (`docs/flight-budget.md`).
const STACK: u32 = 10_176;
/// The counting image has more on its stack: what it counts, and how.
const COUNTING_STACK: u32 = 24 * 1024;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let firmware = Path::new(env!("CARGO_MANIFEST_DIR"));
    let an386 = env::var_os("CARGO_FEATURE_MPS2_AN386").is_some();
    // link.x of cortex-m-rt takes memory.x from the workspace's root: the map of the board that is flashed.
    let layout = if an386 { "link-mps2-an386.x" } else { "link.x" };
    for directory in [firmware, &firmware.join("..")] {
        println!("cargo:rustc-link-search={}", directory.display());
    }
    let stack = if env::var_os("CARGO_FEATURE_COUNT").is_some() { COUNTING_STACK } else { STACK };
    println!("cargo:rustc-link-arg-bins=--defsym=_stack_size={stack}");
    // The stack first: the layout provides what is still undefined.
    for script in ["stack.x", layout, "defmt.x"] {
        println!("cargo:rustc-link-arg-bins=-T{script}");
    }
    println!("cargo:rustc-link-arg-bins=--nmagic");
    for file in ["device.x", "link-mps2-an386.x", "stack.x", "../memory.x"] {
        println!("cargo:rerun-if-changed={file}");
    }
}
