//! What the emulated processor's arithmetic itself takes: double precision is software, and varies with its operands.
use core::hint::black_box;

use nalgebra::RealField;

use crate::meter::{Meter, Random};

/// Single operations in both precisions.
#[inline(never)]
pub fn count(meter: &mut Meter) {
    operations::<f32>(meter, "f32");
    operations::<f64>(meter, "f64");
}

#[inline(always)]
fn operations<T: RealField + Copy>(meter: &mut Meter, precision: &str) {
    operation::<T>(meter, "add", precision, |x, y| x + y);
    operation::<T>(meter, "multiply", precision, |x, y| x * y);
    operation::<T>(meter, "divide", precision, |x, y| x / y);
    operation::<T>(meter, "square root", precision, |x, _| x.abs().sqrt());
    operation::<T>(meter, "compare", precision, |x, y| if x > y { T::one() } else { T::zero() });
}

#[inline(always)]
fn operation<T: RealField + Copy>(meter: &mut Meter, name: &str, precision: &str, f: fn(T, T) -> T) {
    let f = black_box(f);
    let zero = T::zero();
    let prepare = |[x, y, _]: &mut [T; 3], random: &mut Random| {
        *x = nalgebra::convert(random.symmetric());
        *y = nalgebra::convert(random.symmetric());
    };
    let run = |[x, y, result]: &mut [T; 3]| *result = f(*x, *y);
    meter.part(&heading(name, precision), 2000, [zero; 3], prepare, run);
}

/// `name, precision`.
pub fn heading(name: &str, precision: &str) -> heapless::String<64> {
    let mut text = heapless::String::new();
    let _ = text.push_str(name);
    let _ = text.push_str(", ");
    let _ = text.push_str(precision);
    text
}
