//! Saved states.
use arbitrary::{Result, Unstructured};
use schuler_core::module::{FlightModule, StateError, StateLoader, Status};

use crate::flight::{check_output, on_a_module, quiet_step, started};

/// The checksum of a state, by its definition: it is not made by what is tested.
const CRC: crc::Crc<u32, crc::Table<16>> = crc::Crc::<u32, crc::Table<16>>::new(&crc::CRC_32_ISO_HDLC);
const CHECKSUM: usize = 4;

/// Steps before a state is saved, and ordinary ones after it was brought back.
const BEFORE: u32 = 100;
const AFTER: u32 = 3;

/// The first of [`started`] are without identification.
pub(crate) const SHORT: usize = 2;

/// A module in flight, and its state.
struct Original {
    module: Box<FlightModule>,
    state: Vec<u8>,
}

fn originals() -> Vec<Original> {
    let flown = started().into_iter().map(|mut module| {
        for k in 0..BEFORE {
            module.step(&quiet_step(k));
        }
        let state = save(&mut module);
        Original { module, state }
    });
    flown.collect()
}

/// Room for any state.
const ROOM: usize = 1 << 16;

pub(crate) fn save(module: &mut FlightModule) -> Vec<u8> {
    let mut state = vec![0; ROOM];
    // As one part, which takes fewer walks over the module than to ask for its length before.
    let length = module.save_part(0, &mut state).expect("the module is configured and whole");
    assert!(length < ROOM);
    state.truncate(length);
    state
}

thread_local! {
    static ORIGINALS: Vec<Original> = originals();
}

/// The state of this or another module, changed, cut and joined, as it is or under a sound checksum, as a whole or in parts.
pub fn state(data: &[u8]) {
    ORIGINALS.with(|originals| {
        // Bytes that end too early end the input.
        let _ = on_a_module(|module| bring_back(&mut Unstructured::new(data), originals, module));
    });
}

fn bring_back(
    source: &mut Unstructured<'_>,
    originals: &[Original],
    module: &mut FlightModule,
) -> Result<()> {
    // Mostly one without identification, whose state is a sixth as long, and mostly its own.
    let short = originals.get(..SHORT).unwrap_or(originals);
    let among = if source.ratio(1, 32)? { originals } else { short };
    let target = source.choose(among)?;
    let saved = if source.ratio(1, 4)? { source.choose(among)? } else { target };
    let mut state = saved.state.clone();
    let sealed = source.arbitrary()?;
    let in_parts = source.ratio(1, 4)?;
    change(source, &mut state, originals)?;
    if sealed {
        seal(&mut state);
    }

    // A module in flight takes a state of its configuration, one that waits any.
    let waits = source.ratio(1, 4)?;
    module.clone_from(&target.module);
    if waits {
        module.forget();
    }
    let taken = if in_parts { load_in_parts(source, module, &state)? } else { module.restore(&state) };
    match taken {
        Ok(()) => {
            let body = state.len() - CHECKSUM;
            assert_eq!(
                state[body..],
                CRC.checksum(&state[..body]).to_le_bytes(),
                "a damaged state was taken"
            );
            flies_on(module, state == saved.state, &saved.module);
        }
        Err(error) if !waits && module.state_length().is_ok() => {
            assert!(save(module) == target.state, "changed by a state that was refused: {error}");
        }
        Err(_) => {
            assert_eq!(module.step(&quiet_step(0)).status, Status::NOT_CONFIGURED);
            // A whole state mends it.
            assert_eq!(module.restore(&target.state), Ok(()));
            assert!(save(module) == target.state);
        }
    }
    Ok(())
}

/// Values anywhere in it, its end, stretches of other states.
fn change(source: &mut Unstructured<'_>, state: &mut Vec<u8>, originals: &[Original]) -> Result<()> {
    for _ in 0..source.int_in_range(0..=8u8)? {
        let place = usize::from(source.arbitrary::<u16>()?) % state.len().max(1);
        // Tags and counts are among the last.
        let place = if source.arbitrary()? { state.len().saturating_sub(place) } else { place };
        let length = usize::from(source.int_in_range(1..=8u8)?);
        match source.arbitrary::<u8>()? {
            0..8 => state.truncate(place),
            8..16 => state.extend_from_slice(source.bytes(length.min(source.len()))?),
            16..48 => {
                let other = &source.choose(originals)?.state;
                let end = other.len().min(state.len()).min(place + 64 * length);
                if place < end {
                    state[place..end].copy_from_slice(&other[place..end]);
                }
            }
            _ => {
                let bytes = source.bytes(length.min(source.len()))?;
                state.iter_mut().skip(place).zip(bytes).for_each(|(slot, byte)| *slot = *byte);
            }
        }
    }
    Ok(())
}

fn seal(state: &mut [u8]) {
    if let Some(body) = state.len().checked_sub(CHECKSUM) {
        let checksum = CRC.checksum(&state[..body]);
        state[body..].copy_from_slice(&checksum.to_le_bytes());
    }
}

/// In parts of any size, which may end too early.
///
/// # Errors
/// Never: an input that has ended gives zeros.
fn load_in_parts(
    source: &mut Unstructured<'_>,
    module: &mut FlightModule,
    state: &[u8],
) -> Result<core::result::Result<(), StateError>> {
    let mut end = state.len();
    if source.ratio(1, 4)? {
        end = usize::from(source.arbitrary::<u16>()?) % (end + 1);
    }
    let mut loader = StateLoader::new();
    let mut begin = 0;
    loop {
        // Each part takes a walk over the module: a few of them, any of which may cut a value.
        let size = state.len() / 8 + usize::from(source.arbitrary::<u16>()?) % 4096;
        let part = &state[begin..end.min(begin + size)];
        match loader.take(module, begin as u32, part) {
            Ok(next) => {
                assert!(next as usize <= begin + part.len());
                let stands_still = next as usize == begin;
                begin = next as usize;
                // Cut within a value: the module waits for the rest.
                if begin == end || stands_still {
                    break;
                }
            }
            Err(error) => return Ok(Err(error)),
        }
    }
    Ok(module.state_length().map(|_| ()))
}

/// What came back saves and comes back as the same, and both fly the same bits; from an untouched state those that the
/// module would have flown, which are finite and in range. Of numbers that no module saves only the panic is excluded.
fn flies_on(module: &mut FlightModule, untouched: bool, original: &FlightModule) {
    let saved = save(module);
    let mut other = Box::new(FlightModule::new());
    assert_eq!(other.restore(&saved), Ok(()));
    assert!(save(&mut other) == saved);
    for k in 0..AFTER {
        let input = quiet_step(BEFORE + k);
        let [one, two] = [module.step(&input), other.step(&input)];
        if untouched {
            check_output(&one);
        }
        // As text: NaN is not equal to itself and comes back as another one, and the zeros have signs.
        assert_eq!(format!("{one:?}"), format!("{two:?}"));
    }
    if untouched {
        let mut continued = Box::new(*original);
        for k in 0..AFTER {
            continued.step(&quiet_step(BEFORE + k));
        }
        assert!(save(&mut continued) == save(module));
    }
}
