//! The functions that C calls. Each checks its pointers, and hands on references to what they point to.
//!
//! Common to all: a pointer that is not null must point to memory of the stated type or length that the program may use in that way, and
//! that nothing else uses during the call. A call works on the memory it is given and on nothing else: calls on different modules
//! can run at the same time, calls on the same module must not, interrupts included. No call blocks or allocates.
#![allow(unsafe_code)]
use core::ffi::{CStr, c_char};
use core::mem::MaybeUninit;
use core::slice;

use crate::module::{Module, SCHULER_MODULE_SIZE, SchulerModule};
use crate::{SchulerInput, SchulerOutput, SchulerResult};

/// Version of this interface: functions, structures, and what their bytes mean. Hand it to schuler_init.
pub const SCHULER_INTERFACE_VERSION: u32 = 2;

const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => panic!("a version has no zero in it"),
};

/// Makes a module that waits for its configuration. To be called once on the memory of each module, before everything else, and again to
/// start afresh. The memory may hold anything.
///
/// size: sizeof(SchulerModule). interface_version: SCHULER_INTERFACE_VERSION. Both are checked against the library.
///
/// # Safety
/// `module` is null or points to memory of this size.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_init(
    module: *mut SchulerModule,
    size: usize,
    interface_version: u32,
) -> SchulerResult {
    if interface_version != SCHULER_INTERFACE_VERSION {
        return SchulerResult::InterfaceVersion;
    }
    if size < SCHULER_MODULE_SIZE {
        return SchulerResult::Size;
    }
    if let Err(result) = check(module) {
        return result;
    }
    // SAFETY: not null and aligned, by the check, and large enough, by the caller's promise and the assertions on `Module`; whatever is
    // in the memory may be there.
    let memory = unsafe { &mut *module.cast::<MaybeUninit<Module>>() };
    Module::place(memory);
    SchulerResult::Ok
}

/// Starts the module anew from a configuration, the block that the ground has made. A refused configuration changes nothing.
///
/// SCHULER_RESULT_FORM, _CHECKSUM, _VERSION, _CONTENT: what is wrong with the block. SCHULER_RESULT_REFUSED: a value.
///
/// # Safety
/// `module` comes from `schuler_init`; `block` is null or has `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_configure(
    module: *mut SchulerModule,
    block: *const u8,
    length: usize,
) -> SchulerResult {
    // SAFETY: the promises of the caller are handed on.
    let (module, block) = unsafe { (used(module), bytes(block, length)) };
    answer(module.and_then(|module| module.configure(block?)))
}

/// Corrects the inputs by a compensation block from the next step on. Best before the first step: a block that acts on the velocity
/// channel starts the error filter anew. A refused block changes nothing.
///
/// Results as of schuler_configure, and SCHULER_RESULT_NOT_CONFIGURED.
///
/// # Safety
/// As `schuler_configure`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_load_compensation(
    module: *mut SchulerModule,
    block: *const u8,
    length: usize,
) -> SchulerResult {
    // SAFETY: the promises of the caller are handed on.
    let (module, block) = unsafe { (used(module), bytes(block, length)) };
    answer(module.and_then(|module| module.load_compensation(block?)))
}

/// One step, to be called once a second whether anything has come or not. Input and output may be in any state; no input makes the
/// module unusable. Its time does not depend on the values.
///
/// SCHULER_RESULT_NOT_CONFIGURED: nothing was computed; the output says so, too.
///
/// # Safety
/// `module` comes from `schuler_init`; the others are null or point to their types.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_step(
    module: *mut SchulerModule,
    input: *const SchulerInput,
    output: *mut SchulerOutput,
) -> SchulerResult {
    if let Err(result) = check(input).and(check(output)) {
        return result;
    }
    // SAFETY: the promise of the caller is handed on.
    let module = match unsafe { used(module) } {
        Ok(module) => module,
        Err(result) => return result,
    };
    // SAFETY: not null and aligned, by the check; every pattern of bits is an input.
    let input = unsafe { &*input };
    let (values, result) = module.step(input);
    // SAFETY: not null and aligned, by the check.
    unsafe { output.write(values) };
    result
}

/// Length of the saved state, bytes: a matter of the configuration alone.
///
/// # Safety
/// `module` comes from `schuler_init`; `length` is null or points to its type.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_state_length(
    module: *mut SchulerModule,
    length: *mut usize,
) -> SchulerResult {
    // SAFETY: the promises of the caller are handed on.
    unsafe { put(length, used(module).and_then(Module::state_length)) }
}

/// Saves the whole state, with a version and a checksum: a power cycle then costs nothing but the outage. The module goes on as if
/// nothing had been asked. length becomes the bytes written.
///
/// SCHULER_RESULT_ROOM: capacity is less than schuler_state_length.
///
/// # Safety
/// `module` comes from `schuler_init`; `state` is null or has `capacity` bytes; `length` is null or points to its type.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_save(
    module: *mut SchulerModule,
    state: *mut u8,
    capacity: usize,
    length: *mut usize,
) -> SchulerResult {
    if let Err(result) = check(length) {
        return result;
    }
    // SAFETY: the promises of the caller are handed on.
    unsafe {
        let state = bytes_mut(state, capacity);
        put(length, used(module).and_then(|module| module.save(state?)))
    }
}

/// Goes on from a saved state, as if it had never stopped: the same inputs give the same bits. What it was configured with is in the
/// state. A module that has been configured takes none of another configuration; one that has not takes any. A state that does not fit
/// changes nothing; but one that fits its checksum and says something that cannot be leaves a module without configuration.
///
/// SCHULER_RESULT_FORM, _CHECKSUM, _VERSION, _CONTENT, _OTHER_CONFIGURATION: what is wrong with the state.
///
/// # Safety
/// `module` comes from `schuler_init`; `state` is null or has `length` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_restore(
    module: *mut SchulerModule,
    state: *const u8,
    length: usize,
) -> SchulerResult {
    // SAFETY: the promises of the caller are handed on.
    let (module, state) = unsafe { (used(module), bytes(state, length)) };
    answer(module.and_then(|module| module.restore(state?)))
}

/// Which field the last configuration or compensation block was refused for, and why, as text that ends with a zero: "filter.gyro.tau_s:
/// must be greater than zero". Empty when it was not refused. What does not fit into capacity is left out.
///
/// # Safety
/// `module` comes from `schuler_init`; `text` is null or has `capacity` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn schuler_refusal(
    module: *mut SchulerModule,
    text: *mut c_char,
    capacity: usize,
) -> SchulerResult {
    // SAFETY: the promises of the caller are handed on; a char of C is a byte.
    let (module, text) = unsafe { (used(module), bytes_mut(text.cast(), capacity)) };
    answer(module.and_then(|module| {
        module.refusal(text?);
        Ok(())
    }))
}

/// Version of the library, as text that ends with a zero; it stays where it is.
#[unsafe(no_mangle)]
pub extern "C" fn schuler_version() -> *const c_char {
    VERSION.as_ptr()
}

fn answer(result: Result<(), SchulerResult>) -> SchulerResult {
    result.err().unwrap_or(SchulerResult::Ok)
}

/// Not null, and aligned.
fn check<T>(pointer: *const T) -> Result<(), SchulerResult> {
    if pointer.is_null() {
        Err(SchulerResult::NullPointer)
    } else if pointer.is_aligned() {
        Ok(())
    } else {
        Err(SchulerResult::Misaligned)
    }
}

/// The module in its memory.
///
/// # Safety
/// `module` is null or points to memory of its type, that nothing else uses.
unsafe fn used<'a>(module: *mut SchulerModule) -> Result<&'a mut Module, SchulerResult> {
    check(module)?;
    // SAFETY: not null and aligned, by the check; the mark is the first word.
    let mark = unsafe { module.cast::<u64>().read() };
    if !Module::is_marked(mark) {
        return Err(SchulerResult::NotInitialised);
    }
    // SAFETY: not null and aligned, by the check; by the mark, `schuler_init` has put a module there.
    Ok(unsafe { &mut *module.cast::<Module>() })
}

/// Bytes of the caller.
///
/// # Safety
/// `begin` is null or has `length` bytes, that nothing writes to.
unsafe fn bytes<'a>(begin: *const u8, length: usize) -> Result<&'a [u8], SchulerResult> {
    check(begin)?;
    if length > isize::MAX as usize {
        return Err(SchulerResult::Form);
    }
    // SAFETY: not null, no longer than half of all memory, and of that length by the caller's promise.
    Ok(unsafe { slice::from_raw_parts(begin, length) })
}

/// Bytes of the caller, to be written to.
///
/// # Safety
/// `begin` is null or has `length` bytes, that nothing else uses.
unsafe fn bytes_mut<'a>(begin: *mut u8, length: usize) -> Result<&'a mut [u8], SchulerResult> {
    check(begin)?;
    if length > isize::MAX as usize {
        return Err(SchulerResult::Room);
    }
    // SAFETY: as in `bytes`.
    Ok(unsafe { slice::from_raw_parts_mut(begin, length) })
}

/// Writes a value to where the caller wants it.
///
/// # Safety
/// `place` is null or points to its type.
unsafe fn put(place: *mut usize, value: Result<usize, SchulerResult>) -> SchulerResult {
    match check(place).and(value) {
        Ok(value) => {
            // SAFETY: not null and aligned, by the check.
            unsafe { place.write(value) };
            SchulerResult::Ok
        }
        Err(result) => result,
    }
}
