//! Whatever stops the main loop on the target ends in a reset, and the log says why.
use std::time::{Duration, Instant};

use host_sim::emulator::{Emulator, Image, Target, Transport};
use schuler_core::module::ModuleConfig;
use schuler_link::{PROTOCOL, SOURCE_HASH};

use crate::common;

/// Longer than the watchdog waits, on a machine that has other things to do.
const PATIENCE: Duration = Duration::from_secs(90);

/// The line of the log that every start begins with.
fn boot_line(reason: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "info schuler {version}, sources {SOURCE_HASH:016x}, protocol {PROTOCOL}, mps2-an386, started by {reason}"
    )
}

fn wait_for_ready_mark(emulator: &mut Emulator) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        match emulator.next_bytes(deadline.saturating_duration_since(Instant::now())).unwrap() {
            Some(bytes) if bytes.contains(&b'R') => return,
            Some(_) => (),
            None => panic!("not ready"),
        }
    }
}

/// Provokes a fault, waits for the next start, and returns the log in between.
fn provoke(how: u8) -> Vec<String> {
    provoke_under(&[], how)
}

/// The same with further options for QEMU.
fn provoke_under(options: &[&str], how: u8) -> Vec<String> {
    let mut emulator = common::launch(Image::Provoke, options);
    wait_for_ready_mark(&mut emulator);
    emulator.send_bytes(&[how]).unwrap();
    wait_for_ready_mark(&mut emulator);
    common::wait_for_log(&emulator, |log| log.iter().filter(|line| line.contains("started by")).count() == 2)
}

#[test]
fn a_panic_resets() {
    if common::skipped("a_panic_resets") {
        return;
    }
    let log = provoke(b'p');
    assert_eq!(log.first(), Some(&boot_line("power")));
    assert!(log[1].starts_with("error panic in firmware/src/bin/provoke.rs:"), "{log:?}");
    assert_eq!(log[2..], [boot_line("panic")]);
}

#[test]
fn an_access_to_nothing_resets() {
    if common::skipped("an_access_to_nothing_resets") {
        return;
    }
    let log = provoke(b'f');
    assert!(log[1].starts_with("error fault at 0000"), "{log:?}");
    // Precise data bus error, and the address is valid.
    assert!(log[1].ends_with("status 00008200"), "{log:?}");
    assert_eq!(log[2..], [boot_line("fault")]);
}

#[test]
fn a_stack_overflow_resets_before_it_does_harm() {
    if common::skipped("a_stack_overflow_resets_before_it_does_harm") {
        return;
    }
    let log = provoke(b's');
    assert!(log[1].starts_with("error stack overflow"), "{log:?}");
    assert_eq!(log[2..], [boot_line("fault")]);
}

#[test]
fn an_interrupt_nobody_asked_for_resets() {
    if common::skipped("an_interrupt_nobody_asked_for_resets") {
        return;
    }
    let log = provoke(b'i');
    assert_eq!(log[1..], ["error unexpected interrupt 5".to_owned(), boot_line("fault")]);
}

#[test]
fn a_hang_wakes_the_watchdog() {
    if common::skipped("a_hang_wakes_the_watchdog") {
        return;
    }
    // An instruction takes a microsecond: the minute that the watchdog waits is over in a second or two.
    let log = provoke_under(&["-icount", "shift=10"], b'w');
    assert_eq!(log[1..], ["error the main loop has hung".to_owned(), boot_line("watchdog")]);
}

/// What a flight begins with in the log.
#[test]
fn the_log_of_a_start_is_as_it_was() {
    if common::skipped("the_log_of_a_start_is_as_it_was") {
        return;
    }
    let mut emulator = common::start(Transport::Uart);
    emulator.configure(&ModuleConfig::default()).unwrap();
    emulator.send_bytes(&[1, 2, 3, 0]).unwrap();
    let log = common::wait_for_log(&emulator, |log| log.len() == 3);
    let text = log.join("\n").replace(&format!("{SOURCE_HASH:016x}"), "<hash of the sources>") + "\n";
    common::assert_golden("start_mps2-an386.log", &text);
}
