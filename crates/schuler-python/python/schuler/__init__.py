"""Error filter, noise identification and gyro fault isolation of a Schuler-tuned inertial system, and the explanation of
recordings, on numpy arrays and data frames.

| | |
| --- | --- |
| `ErrorFilter` | velocity error, error of the vertical, accelerometer error and gyro drift from measured velocity errors |
| `AdaptiveFilter` | the same as it flies: finds out its noise and retunes; withholds a faulty radio |
| `autocorrelation`, `fit_exponential`, `fit_exponential_cosine`, `choose_structure`, `allan_deviation` | noise of a series |
| `identify` | noise of every sensor of a recording |
| `GyroBlock` | five gyros: determinants, condition numbers, projector, sequential filter, likelihood |
| `FaultIsolation` | the isolation that flies |
| `explain` | why a recording does not look like its simulation: of a data frame, of arrays, of a case |
| `compare` | the same of a simulator's output beside a recording |
| `Explanation`, `Plot` | their answer: findings as a data frame, figures, exported models, the simulation with what was found |
| `campaign_cases`, `campaign_case`, `campaign_summary` | cases with concealed effects, one by one |
| `schuler.fleet` | many cases on many machines |

SI units and radians throughout, except in cases and recordings, whose units the case states. NaN is a missing value.
What is wrong with an argument is a `ValueError` of one line that says what, where, and what was expected.
"""

import enum

from schuler._schuler import (
    AdaptiveFilter,
    AdaptiveRun,
    AllanDeviation,
    Autocorrelation,
    ErrorFilter,
    Exponential,
    ExponentialCosine,
    FaultIsolation,
    FilterConfig,
    FilterRun,
    FilterStep,
    GyroBlock,
    IsolationRun,
    MarkovNoise,
    NoiseStructure,
    Projection,
    SequentialStatistics,
    __version__,
    allan_deviation,
    autocorrelation,
    campaign_case,
    campaign_cases,
    campaign_summary,
    choose_structure,
    fit_exponential,
    fit_exponential_cosine,
    identify,
)
from schuler.explanation import Explanation, Plot, compare, explain


class ChannelStatus(enum.IntEnum):
    """How well the noise parameters of a channel are known."""

    DATA_SHEET = 0
    """Not identified yet: the data sheet is flown."""
    DETERMINED = 1
    """Three times the correlation time, and a third of it, are both clearly worse."""
    WEAK = 2
    """Only one of the two is."""
    INDETERMINATE = 3
    """Neither is: the prior has decided."""
    UNOBSERVED = 4
    """The estimate holds next to nothing of this error; its parameters were left as they were."""


class HealthVerdict(enum.IntEnum):
    """What the health monitor holds a radio for that is compared with an inertial velocity."""

    UNOBSERVED = 0
    """No residual for a while, or the monitor is off."""
    NOMINAL = 1
    """Nothing speaks against the radio."""
    SHIFTED_MEAN = 2
    """Its mean has shifted."""
    GROWN_NOISE = 3
    """Its noise has grown."""
    SHIFTED_MEAN_AND_GROWN_NOISE = 4
    """Both."""
    UNDECIDED_FAULT = 5
    """One of the two, and which is open."""
    INERTIAL_DIVERGENCE = 6
    """The inertial error is beyond its specified bound."""
    OUT_OF_MODEL = 7
    """Several residuals in a row that no mode explains."""
    HELD_READING = 8
    """The radio holds its last value."""


class Verdict(enum.IntEnum):
    """What to believe of five gyros."""

    NO_FAULT = 0
    """Nothing speaks against any gyro."""
    DETECTED_NOT_ISOLATED = 1
    """One gyro or more has failed; which one cannot be said (yet)."""
    FAULT = 2
    """One gyro has failed, or could not be read; the rate is that of the other four."""
    BLOCK_UNTRUSTED = 3
    """Two gyros or more have failed or could not be read: there is no rate."""


class IsolationFlags(enum.IntFlag):
    """Why the verdict is what it is, and what happened in this sample."""

    READING_UNUSABLE = 1 << 0
    OUTLIER = 1 << 1
    ALARM_RAISED = 1 << 2
    ISOLATED = 1 << 3
    GIVEN_UP = 1 << 4
    SECOND_FAULT = 1 << 5
    STUCK = 1 << 6
    LOST = 1 << 7
    FROZEN = 1 << 8
    SUMS_SUSPENDED = 1 << 9
    CALIBRATING = 1 << 10
    OFFSET_REJECTED = 1 << 11
    READMITTED = 1 << 12
    COMMAND_REJECTED = 1 << 13
    ALARM_WITHDRAWN = 1 << 14


__all__ = [
    "AdaptiveFilter",
    "AdaptiveRun",
    "AllanDeviation",
    "Autocorrelation",
    "ChannelStatus",
    "ErrorFilter",
    "Explanation",
    "Exponential",
    "ExponentialCosine",
    "FaultIsolation",
    "FilterConfig",
    "FilterRun",
    "FilterStep",
    "GyroBlock",
    "HealthVerdict",
    "IsolationFlags",
    "IsolationRun",
    "MarkovNoise",
    "NoiseStructure",
    "Plot",
    "Projection",
    "SequentialStatistics",
    "Verdict",
    "__version__",
    "allan_deviation",
    "autocorrelation",
    "campaign_case",
    "campaign_cases",
    "campaign_summary",
    "choose_structure",
    "compare",
    "explain",
    "fit_exponential",
    "fit_exponential_cosine",
    "identify",
]
