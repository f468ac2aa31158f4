//! Names of files made of what stands in a case.

/// Bytes of a name that are kept; the systems in use allow 255, of which endings and the mark of a changed name need some.
const LONGEST: usize = 96;
/// Offset basis and prime of the FNV-1a hash of 64 bits.
const FNV: (u64, u64) = (0xcbf2_9ce4_8422_2325, 0x0000_0100_0000_01b3);

/// The one way from a name in a case (an id, a column, a channel) to the name of a file.
///
/// The result is never empty, has no separator, no leading dot and no character that a file system or a terminal gives a
/// meaning, so that joined to a directory it stays in it. Letters and digits of any script, `_`, `-` and dots within stay.
/// A name that had to be changed gets a mark by which two such names still differ.
pub fn file_name(name: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
    let mut safe: String = name.chars().map(|c| if plain(c) { c } else { '_' }).collect();
    while safe.starts_with(['.', '-']) {
        safe.replace_range(..1, "_");
    }
    let mut end = safe.len().min(LONGEST);
    while !safe.is_char_boundary(end) {
        end -= 1;
    }
    safe.truncate(end);
    if safe.is_empty() {
        safe.push('_');
    }
    if safe == name {
        return safe;
    }
    let (basis, prime) = FNV;
    let hash = name.bytes().fold(basis, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(prime));
    format!("{safe}-{:08x}", hash >> 32)
}

#[cfg(test)]
mod tests {
    use std::path::{Component, Path};

    use super::*;

    #[test]
    fn plain_names_stay() {
        for name in ["gyro_x", "g-3", "Kreisel_äöü", "陀螺", "imu.x"] {
            assert_eq!(file_name(name), name);
        }
    }

    #[test]
    fn no_name_leaves_its_directory() {
        let long = "x".repeat(5000);
        let names = [
            "",
            ".",
            "..",
            "../../escaped",
            "/etc/passwd",
            "a/b",
            "a\\b",
            "C:\\x",
            "\0",
            "\u{1b}[31m",
            "a\nb",
            "-rf",
            ".hidden",
            "~",
            "con:",
            "ä/..",
            &long,
            "\u{202e}gpj",
        ];
        for name in names {
            let made = file_name(name);
            let parts: Vec<Component<'_>> = Path::new(&made).components().collect();
            assert!(matches!(parts[..], [Component::Normal(_)]), "{name:?}: {made:?}");
            assert!(!made.contains(['/', '\\', ':', '~', '\0', '\u{1b}', '\n']), "{name:?}: {made:?}");
            assert!(!made.starts_with(['.', '-']) && made.len() <= LONGEST + 9, "{name:?}: {made:?}");
        }
    }

    #[test]
    fn names_that_differ_give_files_that_differ() {
        let names = ["a/b", "a_b", "a\\b", "a b", "", "_", "..", "._"];
        let made: std::collections::BTreeSet<String> = names.iter().map(|name| file_name(name)).collect();
        assert_eq!(made.len(), names.len(), "{made:?}");
        let long = |end: &str| file_name(&format!("{}{end}", "x".repeat(300)));
        assert_ne!(long("1"), long("2"));
    }
}
