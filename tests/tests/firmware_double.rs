//! Double precision on the emulated Cortex-M4F, which is ours and in assembly, against this machine's: the same bits for
//! millions of pairs of operands of every kind.
use std::time::Duration;

use host_sim::emulator::{Emulator, Image};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};

use crate::common;

/// Pairs that the image takes at a time, and bytes of its answer to each.
const PAIRS: usize = 256;
const ANSWER: usize = 72;
/// How many times it is asked: four million pairs.
const ROUNDS: usize = 1 << 14;

const PATIENCE: Duration = Duration::from_mins(3);

const SIGN: u64 = 1 << 63;
const FRACTION: u64 = (1 << 52) - 1;

/// Where something changes, as bits without sign: zero, subnormal and normal, one, infinity, NaN, the ends of whole numbers
/// and of floats and the halves between them.
const BORDERS: [u64; 26] = [
    0,
    1,
    2,
    0x000f_ffff_ffff_ffff,
    0x0010_0000_0000_0000,
    0x0010_0000_0000_0001,
    0x3fe0_0000_0000_0000,
    0x3fef_ffff_ffff_ffff,
    0x3ff0_0000_0000_0000,
    0x3ff0_0000_0000_0001,
    0x7fe0_0000_0000_0000,
    0x7fef_ffff_ffff_ffff,
    0x7ff0_0000_0000_0000,
    0x7ff0_0000_0000_0001,
    0x7ff8_0000_0000_0000,
    0x41df_ffff_ffe0_0000,
    0x41e0_0000_0000_0000,
    0x41ef_ffff_ffe0_0000,
    0x41f0_0000_0000_0000,
    0x3690_0000_0000_0000,
    0x3690_0000_0000_0001,
    0x36a0_0000_0000_0000,
    0x380f_ffff_ffff_ffff,
    0x47ef_ffff_e000_0000,
    0x47ef_ffff_efff_ffff,
    0x47ef_ffff_f000_0000,
];

#[test]
fn double_precision_gives_the_bits_of_this_machine() {
    if common::skipped("double_precision_gives_the_bits_of_this_machine") {
        return;
    }
    let mut emulator = common::launch(Image::Double, &[]);
    let mut random = Pcg64::seed_from_u64(754);
    for _ in 0..ROUNDS {
        let pairs: Vec<[u64; 2]> = (0..PAIRS).map(|_| operands(&mut random)).collect();
        let bytes: Vec<u8> = pairs.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        emulator.send_bytes(&bytes).unwrap();
        let answers = answers(&mut emulator);
        for ([x, y], answer) in pairs.into_iter().zip(answers.chunks(ANSWER)) {
            compare(x, y, answer);
        }
    }
    say!("{} pairs of operands: the same bits", ROUNDS * PAIRS);
}

fn answers(emulator: &mut Emulator) -> Vec<u8> {
    let mut bytes = Vec::new();
    while bytes.len() < PAIRS * ANSWER {
        bytes.extend(emulator.next_bytes(PATIENCE).unwrap().expect("the image answers"));
    }
    bytes
}

/// A pair of one of the kinds that an implementation can get wrong.
fn operands(random: &mut Pcg64) -> [u64; 2] {
    let [x, y] = [(); 2].map(|()| random.next_u64());
    let mut below = |limit: u64| random.next_u64() % limit;
    let (sign, exponent) = (y & SIGN, x >> 52 & 0x7ff);
    // A fraction of few bits, so that halves and whole results are met.
    let short = |bits: u64, zeros: u64| bits & (FRACTION << zeros | !FRACTION);
    let number =
        |sign: u64, exponent: u64, fraction: u64| sign | exponent.min(0x7ff) << 52 | fraction & FRACTION;
    let kind = below(12);
    match kind {
        // Exponents near each other.
        1 => [x, number(sign, (exponent + below(120)).saturating_sub(60), y)],
        // The same with short fractions: ties.
        2 => {
            let (zeros, more) = (below(53), below(53));
            [short(x, zeros), short(number(sign, (exponent + below(120)).saturating_sub(60), y), more)]
        }
        // Nearly equal, or nearly opposite.
        3 => [x, (x & !SIGN).saturating_add(below(7)).saturating_sub(3) | sign],
        // One subnormal, or both.
        4 => [x & SIGN | (x & FRACTION) >> below(53), y],
        5 => [x, sign | (y & FRACTION) >> below(53)],
        6 => [x & SIGN | (x & FRACTION) >> below(53), sign | (y & FRACTION) >> below(53)],
        // A product, then a quotient, that is about the smallest, or about the largest.
        7 | 8 => {
            let border = if below(2) == 0 { 965 + below(70) } else { 3060 + below(20) };
            let other = if kind == 7 {
                border.saturating_sub(exponent)
            } else {
                (exponent + 2046).saturating_sub(border)
            };
            let (zeros, more) = (below(53), below(53));
            [short(x, zeros), short(number(sign, other, y), more)]
        }
        // At a border.
        9 => [x & SIGN | BORDERS[below(26) as usize], y],
        10 => [x & SIGN | BORDERS[below(26) as usize], sign | BORDERS[below(26) as usize]],
        // About what floats and whole numbers can hold.
        11 => {
            let zeros = below(53);
            [short(number(x & SIGN, 860 + below(300), x), zeros), sign | BORDERS[below(26) as usize]]
        }
        _ => [x, y],
    }
}

/// The same bits; of what is no number only that it is none.
fn compare(x: u64, y: u64, answer: &[u8]) {
    let word = x as u32;
    let (a, b) = (f64::from_bits(x), f64::from_bits(y));
    let doubles = [
        ("sum", a + b),
        ("difference", a - b),
        ("product", a * b),
        ("quotient", a / b),
        ("of a float", f64::from(f32::from_bits(word))),
        ("of a whole number", f64::from(word)),
        ("of a number with sign", f64::from(word.cast_signed())),
    ];
    let (of_doubles, of_words) = answer.split_at(8 * doubles.len());
    for ((what, expected), bytes) in doubles.into_iter().zip(of_doubles.chunks(8)) {
        let found = f64::from_le_bytes(bytes.try_into().unwrap());
        let same = found.to_bits() == expected.to_bits() || found.is_nan() && expected.is_nan();
        assert!(
            same,
            "{what} of {x:016x} and {y:016x}: {:016x}, here {:016x}",
            found.to_bits(),
            expected.to_bits()
        );
    }
    let order = [a < b, a <= b, a == b, a >= b, a > b, a.is_nan() || b.is_nan()];
    let order = order.iter().rev().fold(0, |bits, &holds| bits << 1 | u32::from(holds));
    let float = a as f32;
    let words = [
        ("as a float", float.to_bits()),
        ("as a whole number", a as u32),
        ("as a number with sign", (a as i32).cast_unsigned()),
        ("order", order),
    ];
    for ((what, expected), bytes) in words.into_iter().zip(of_words.chunks(4)) {
        let found = u32::from_le_bytes(bytes.try_into().unwrap());
        let nan = what == "as a float" && float.is_nan() && f32::from_bits(found).is_nan();
        assert!(
            found == expected || nan,
            "{what} of {x:016x} and {y:016x}: {found:08x}, here {expected:08x}"
        );
    }
}
