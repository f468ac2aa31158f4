//! What the emulated processor's arithmetic itself takes: double precision is software.
#![allow(unsafe_code, reason = "names of sections")]
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
    operation::<T>(meter, "add", precision, add);
    operation::<T>(meter, "multiply", precision, multiply);
    operation::<T>(meter, "divide", precision, divide);
    operation::<T>(meter, "square root", precision, |x, _| x.abs().sqrt());
    operation::<T>(meter, "compare", precision, |x, y| if x > y { T::one() } else { T::zero() });
}

#[inline(always)]
fn operation<T: RealField + Copy>(meter: &mut Meter, name: &str, precision: &str, f: fn(T, T) -> T) {
    // libm's square root leaves early where there is none to compute.
    let operands =
        if name == "square root" { |random: &mut Random| [random.symmetric(), 0.0] } else { operands };
    let f = black_box(f);
    let zero = T::zero();
    let prepare = |[x, y, _]: &mut [T; 3], random: &mut Random| {
        let operands = operands(random);
        *x = nalgebra::convert(operands[0]);
        *y = nalgebra::convert(operands[1]);
    };
    let run = |[x, y, result]: &mut [T; 3]| *result = f(*x, *y);
    meter.part(&heading(name, precision), 2000, [zero; 3], prepare, run);
}

// Out of functions with a section of their own the compiler does not move code that comes again into
// functions: a call more would be counted with the operation.

#[unsafe(link_section = ".text.counted")]
fn add<T: RealField>(x: T, y: T) -> T {
    x + y
}

#[unsafe(link_section = ".text.counted")]
fn multiply<T: RealField>(x: T, y: T) -> T {
    x * y
}

#[unsafe(link_section = ".text.counted")]
fn divide<T: RealField>(x: T, y: T) -> T {
    x / y
}

/// Every kind of operand: small numbers, any bits, subnormal ones, zeros, infinities, NaN, and pairs that cancel.
fn operands(random: &mut Random) -> [f64; 2] {
    let mut operand = || match random.below(8) {
        0 => f64::from_bits(random.bits()),
        1 => f64::from_bits(random.bits() & (1 << 63 | u64::MAX >> 12)),
        2 => f64::from_bits(random.bits() & 1 << 63),
        3 if random.once_in(2) => f64::INFINITY.copysign(random.symmetric()),
        4 if random.once_in(2) => f64::NAN,
        _ => random.symmetric(),
    };
    let [x, y] = [operand(), operand()];
    if random.once_in(16) { [x, x.copysign(y)] } else { [x, y] }
}

/// `name, precision`.
pub fn heading(name: &str, precision: &str) -> heapless::String<64> {
    let mut text = heapless::String::new();
    let _ = text.push_str(name);
    let _ = text.push_str(", ");
    let _ = text.push_str(precision);
    text
}
