//! Counts the instructions and the stack of every part of the step, on the emulator. Not for flight.
//!
//! The emulator must count: `-icount shift=10`. A line for each part on standard output: its name, the least, the
//! median and the most instructions over inputs that are drawn at random with faults, gaps and nonsense among them, and
//! the most bytes of stack; separated by `|`. At the end a line `end`.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![allow(
    clippy::cast_precision_loss,
    clippy::inline_always,
    clippy::many_single_char_names,
    reason = "inputs are small numbers, every operation is to be counted by itself, and the letters are the equations'"
)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod arithmetic;
#[cfg(target_os = "none")]
mod channel;
#[cfg(target_os = "none")]
mod gyros;
#[cfg(target_os = "none")]
mod meter;
#[cfg(target_os = "none")]
mod others;
#[cfg(target_os = "none")]
mod sensors;
#[cfg(target_os = "none")]
mod whole;

#[cfg(target_os = "none")]
mod image {
    #![allow(unsafe_code)]
    use cortex_m_rt::entry;
    use schuler_core::module::FlightModule;
    use schuler_firmware::semihosting::{Console, exit};
    use schuler_firmware::{board, start};
    use schuler_link::endpoint::Endpoint;
    use schuler_link::frame::Wire;

    use crate::meter::{Counts, Meter};
    use crate::{arithmetic, channel, gyros, others, sensors, whole};

    fn stop_beat() {
        // SAFETY: nothing else is at the timer any more.
        let mut core = unsafe { cortex_m::Peripherals::steal() };
        core.SYST.disable_interrupt();
        core.SYST.disable_counter();
    }

    #[entry]
    fn main() -> ! {
        static mut MODULE: FlightModule = FlightModule::new();
        static mut ENDPOINT: Endpoint = Endpoint::new(schuler_firmware::semihosting::IDENTITY);
        static mut WIRE: Wire = Wire::new();
        static mut COUNTS: Counts = Counts::new();

        board::start();
        // Nothing may come in between. Nor may the beat go on: the emulator would stop for each of its ticks, of which
        // there is one in every thousand instructions.
        cortex_m::interrupt::disable();
        stop_beat();
        ENDPOINT.identify(start::introduce(schuler_firmware::semihosting::IDENTITY));
        let Some(console) = Console::open() else { exit() };
        let mut meter = Meter::new(console, COUNTS);
        arithmetic::count(&mut meter);
        channel::count::<f32>(&mut meter, "f32");
        channel::count::<f64>(&mut meter, "f64");
        others::count::<f32>(&mut meter, "f32");
        others::count::<f64>(&mut meter, "f64");
        gyros::count(&mut meter);
        sensors::count::<f32>(&mut meter, "f32");
        sensors::count::<f64>(&mut meter, "f64");
        sensors::count_correction(&mut meter);
        whole::count(&mut meter, MODULE, ENDPOINT, WIRE);
        meter.end();
        exit()
    }
}
