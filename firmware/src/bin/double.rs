//! Does what it is told in double precision, for comparison with the host. Not for flight.
//!
//! Reads pairs of operands, x and y, 16 bytes each, [`PAIRS`] at a time, until the line is closed. Writes [`ANSWER`] bytes
//! for each; all numbers little-endian.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod image {
    use core::hint::black_box;

    use cortex_m_rt::entry;
    use schuler_firmware::board;
    use schuler_firmware::semihosting::{Console, Input, exit};

    /// Pairs at a time.
    const PAIRS: usize = 256;
    /// Bytes of an answer.
    const ANSWER: usize = 72;

    #[entry]
    fn main() -> ! {
        static mut OPERANDS: [[[u8; 8]; 2]; PAIRS] = [[[0; 8]; 2]; PAIRS];
        static mut ANSWERS: [[u8; ANSWER]; PAIRS] = [[0; ANSWER]; PAIRS];

        board::start();
        let (Some(mut input), Some(mut output)) = (Input::open(), Console::open()) else { exit() };
        if !(moves::<u8>() && moves::<u32>() && moves::<u64>()) {
            exit();
        }
        while input.fill(OPERANDS.as_flattened_mut().as_flattened_mut()) {
            for ([x, y], answer) in OPERANDS.iter().zip(ANSWERS.iter_mut()) {
                *answer = answer_to(u64::from_le_bytes(*x), u64::from_le_bytes(*y));
            }
            output.send(ANSWERS.as_flattened());
        }
        exit()
    }

    /// Bytes, or words of several, moved to and fro by every distance and length that there is room for arrive as they were. Without
    /// that there are no answers.
    fn moves<T: Copy + PartialEq + From<u8>>() -> bool {
        const ROOM: usize = 40;
        let original: [T; ROOM] = core::array::from_fn(|i| T::from(i as u8));
        (0..ROOM).all(|from| {
            (0..ROOM).all(|to| {
                (0..=ROOM - from.max(to)).all(|length| {
                    let mut moved = original;
                    moved.copy_within(from..from + black_box(length), to);
                    moved.iter().enumerate().all(|(at, element)| {
                        let came_from = if (to..to + length).contains(&at) { from + at - to } else { at };
                        *element == T::from(came_from as u8)
                    })
                })
            })
        })
    }

    /// Sum, difference, product, quotient; x's lower word as a float, a whole number without and with sign, each as a double;
    /// x as a float, a whole number without and with sign; and the comparisons, a bit for each.
    #[allow(clippy::cast_sign_loss, clippy::float_cmp, reason = "that is what is tried")]
    fn answer_to(x: u64, y: u64) -> [u8; ANSWER] {
        let word = x as u32;
        let (x, y) = (f64::from_bits(x), f64::from_bits(y));
        let doubles = [
            x + y,
            x - y,
            x * y,
            x / y,
            f64::from(f32::from_bits(word)),
            f64::from(word),
            f64::from(word.cast_signed()),
        ];
        let order = [x < y, x <= y, x == y, x >= y, x > y, x.is_nan() || y.is_nan()];
        let order = order.iter().rev().fold(0, |bits, &holds| bits << 1 | u32::from(holds));
        let words = [(x as f32).to_bits(), x as u32, (x as i32).cast_unsigned(), order];

        let mut answer = [0; ANSWER];
        let (of_doubles, of_words) = answer.split_at_mut(8 * doubles.len());
        for (bytes, double) in of_doubles.as_chunks_mut().0.iter_mut().zip(doubles) {
            *bytes = double.to_bits().to_le_bytes();
        }
        for (bytes, word) in of_words.as_chunks_mut().0.iter_mut().zip(words) {
            *bytes = word.to_le_bytes();
        }
        answer
    }
}
