//! How what an effect adds is computed from recorded quantities, so that it can leave for a simulation.
use super::in_flight::Part;

/// The form of the columns of an effect. The export resolves it in a case and compares it with the columns that were fitted: where the two
/// differ, the columns leave as values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// The product that its [term in flight](super::InFlight) is.
    Term,
    /// 1 from `onset_s` on.
    Step,
    /// The time, or that since `onset_s`.
    Drift,
    /// exp(−t/`tau_s`), t from the first row or since the last switch-on.
    WarmUp,
    /// 1 in one run from switch-on to switch-off.
    Runs,
    /// Cosine and sine of `frequency_hz`, or of the Schuler frequency and of the Earth's rate.
    Waves,
    /// First-order lag by `tau_s` of a product.
    Lag(&'static [Part]),
    /// The branch of a play of half-width `width` on the temperature.
    Branch,
    /// The recorded quantity of the parameter `column`, or the function of it that the parameter `function` names.
    Recorded,
    /// The square of that quantity.
    RecordedSquare,
    /// A component of the magnetic field, recorded or of the Earth's dipole.
    MagneticField,
    /// The sensor's own quantity along another axis, or the rotation of a whole instrument.
    Mounting,
    /// Minus the input where that is below `threshold`.
    DeadZone,
    /// What a limit takes away from the input.
    Clipped,
    /// First-order lag by `tau_s` of the power that a torquer takes, or the torquers of both axes take.
    Heating,
    /// The angular acceleration about the axis of the parameter `axis`.
    AngularAcceleration,
    /// The input as it was `delay_s` ago, less the input.
    Delay,
    /// The first-order lag by `tau_s` of the input, less the input.
    Bandwidth,
    /// ω̇ × r + ω × (ω × r), or ω × r.
    LeverArm,
    /// The Earth's rate at another heading or latitude.
    EarthRate,
    /// Gravity, upwards.
    Gravity,
    /// A multiple of the input.
    Proportional,
    /// None of these: what it adds, if anything, leaves as one value a row.
    Values,
}
