//! What happens when something that cannot happen does: a line in the log, and a reset.
//!
//! The stack ends where RAM does (`stack.x`); an MPU region below it makes the first access past the end a fault, on
//! the emulator too, which takes writes to the void in silence.
#![allow(unsafe_code)]
use core::arch::naked_asm;
use core::panic::PanicInfo;
use core::ptr;

use cortex_m::asm;
use cortex_m::peripheral::{MPU, SCB};
use cortex_m_rt::ExceptionFrame;
use schuler_link::message::Start;

use crate::start;

/// Size of the guarded region, log2 of bytes: more than the stack, so that no frame reaches over it.
const GUARD_SIZE: u32 = 15;

/// What the fault handler needs of the stack for itself, bytes.
const HANDLER_STACK: usize = 512;

mod mpu {
    /// The address is valid, region 0.
    pub(super) const REGION_0: u32 = 1 << 4;
    /// Not to be executed; no permission to read or write.
    pub(super) const NO_ACCESS: u32 = 1 << 28;
    pub(super) const REGION_ENABLE: u32 = 1;
    /// Everything outside the region as without MPU.
    pub(super) const ENABLE_WITH_BACKGROUND: u32 = 0b101;
}

/// Sets up the guard below the stack.
pub(crate) fn guard_stack(mpu: &mut MPU) {
    unsafe extern "C" {
        static _stack_end: u8;
    }
    let below = (ptr::addr_of!(_stack_end) as u32).wrapping_sub(1 << GUARD_SIZE);
    // SAFETY: the region is outside RAM: nothing that the program may touch lies there.
    unsafe {
        mpu.rbar.write(below | mpu::REGION_0);
        mpu.rasr.write(mpu::NO_ACCESS | (GUARD_SIZE - 1) << 1 | mpu::REGION_ENABLE);
        mpu.ctrl.write(mpu::ENABLE_WITH_BACKGROUND);
    }
    asm::dsb();
    asm::isb();
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    let (file, line) = info.location().map_or(("", 0), |place| (place.file(), place.line()));
    defmt::error!("panic in {=str}:{=u32}", file, line);
    start::restart(Start::Panic)
}

/// Where the stack has run out, goes on from its top: nothing returns from here.
///
/// # Safety
/// For the vector table only.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn HardFault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "movw r1, #:lower16:_stack_end",
        "movt r1, #:upper16:_stack_end",
        "add r1, r1, {need}",
        "cmp r0, r1",
        "bhs {fault}",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr msp, r1",
        "movs r0, #0",
        "b {fault}",
        need = const HANDLER_STACK,
        fault = sym fault,
    )
}

/// `frame` is what the processor has put on the stack, or null where that has run out.
extern "C" fn fault(frame: *const ExceptionFrame) -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: reading a status register changes nothing.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    // SAFETY: not null means within the stack, where the processor has put a frame.
    if let Some(frame) = unsafe { frame.as_ref() } {
        let (at, from) = (frame.pc(), frame.lr());
        defmt::error!("fault at {=u32:08x}, called from {=u32:08x}, status {=u32:08x}", at, from, status);
    } else {
        defmt::error!("stack overflow, status {=u32:08x}", status);
    }
    start::restart(Start::Fault)
}
