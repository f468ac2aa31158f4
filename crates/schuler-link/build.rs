//! Hashes the sources that determine what a firmware image computes and says, so that a host can tell whether
//! the image at the other end of the link was built from the sources that it was built from itself.
use std::fs;
use std::path::{Path, PathBuf};

/// What goes into an image, relative to the workspace's root.
const SOURCES: [&str; 10] = [
    ".cargo/config.toml",
    "Cargo.lock",
    "Cargo.toml",
    "crates/schuler-core/Cargo.toml",
    "crates/schuler-core/src",
    "crates/schuler-link/Cargo.toml",
    "crates/schuler-link/build.rs",
    "crates/schuler-link/src",
    "firmware",
    "memory.x",
];

/// What there is of that where the crate comes from a registry, relative to the crate.
const PACKAGED: [&str; 3] = ["Cargo.toml", "build.rs", "src"];

fn main() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let workspace = package.join("../..");
    let in_workspace = workspace.join("crates/schuler-link/Cargo.toml").is_file();
    let (root, sources) =
        if in_workspace { (workspace.as_path(), &SOURCES[..]) } else { (package, &PACKAGED[..]) };
    let mut files = Vec::new();
    for source in sources {
        println!("cargo:rerun-if-changed={}", root.join(source).display());
        collect(&root.join(source), &mut files);
    }
    files.sort();

    let crc = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let mut digest = crc.digest();
    for file in &files {
        // A file that vanished since the listing brings this script back by itself.
        let Ok(content) = fs::read(file) else { continue };
        let name = file.strip_prefix(root).unwrap_or(file).to_string_lossy().replace('\\', "/");
        digest.update(name.as_bytes());
        digest.update(&(content.len() as u64).to_le_bytes());
        digest.update(&content);
    }
    println!("cargo:rustc-env=SCHULER_SOURCE_HASH={:016x}", digest.finalize());
}

/// The files at and below `path`; none where there is nothing.
fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if let Ok(entries) = fs::read_dir(path) {
        entries.flatten().for_each(|entry| collect(&entry.path(), files));
    } else if path.is_file() {
        files.push(path.to_path_buf());
    }
}
