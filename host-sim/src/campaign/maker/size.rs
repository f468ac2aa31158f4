//! The size of an effect: one near the limit of detection.
use super::bench::{Bench, Sized};
use crate::campaign::draw::Draw;
use crate::campaign::effect::Concealed;
use crate::output::Interrupted;

/// Simulations spent on the size of an effect that is not proportional to it.
const SEARCHES: usize = 8;
/// A found gain may be off the wanted one by this factor.
const CLOSE: f64 = 1.3;
/// Gains beyond which a size is no use, nats.
const USEFUL: [f64; 2] = [2.0, 1e6];

impl Bench<'_> {
    /// The effect with a size whose gain is as drawn from this range; none if there is no such size.
    pub(super) fn size(
        &self,
        concealed: Concealed,
        gains: [f64; 2],
        draw: &mut Draw,
    ) -> Result<Option<Sized>, Interrupted> {
        let wanted = draw.log_between(gains[0], gains[1]);
        let mut size = concealed.start;
        let mut best: Option<(f64, f64)> = None;
        for search in 0..SEARCHES {
            let gain = if concealed.noise.is_some() {
                self.noise_gain(&concealed, size)?.0
            } else {
                let (signals, _) = self.signals(&concealed, size)?;
                self.expected(&concealed, size, &signals)
            };
            let off = (gain.max(1e-9) / wanted).ln().abs();
            if gain.is_finite() && best.is_none_or(|(_, before)| off < before) {
                best = Some((size, off));
            }
            if off < CLOSE.ln() || concealed.fixed || (concealed.effect == "output_stuck") {
                break;
            }
            if concealed.linear && gain > 0.0 {
                // The gain is a quadratic form of the signal.
                size *= (wanted / gain).sqrt();
                best = Some((size, 0.0));
                break;
            }
            let factor = if gain > 1e-3 { (wanted / gain).sqrt().clamp(0.1, 10.0) } else { 10.0 };
            // A gain that is a power of the size is met at once; otherwise nearer every time.
            size *= if search > 4 { factor.sqrt() } else { factor };
        }
        let Some((size, _)) = best else { return Ok(None) };
        let (signals, silent) = self.signals(&concealed, size)?;
        let gain = if concealed.noise.is_some() {
            self.noise_gain(&concealed, size)?.0
        } else {
            self.expected(&concealed, size, &signals)
        };
        let most = if concealed.fixed { gains } else { USEFUL };
        let useful = (most[0]..=most[1]).contains(&gain) || concealed.effect == "output_stuck";
        let sized = Sized { concealed, size, signals, silent };
        Ok((useful && size.is_finite() && self.is_what_it_is_called(&sized, gain)).then_some(sized))
    }
}
