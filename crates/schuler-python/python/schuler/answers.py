"""Types of the answers, which are the documents that the command prints with `--json`."""

from typing import Any, Literal, NotRequired, TypedDict


class Parameter(TypedDict):
    """A fitted number, or a word that says which of several (a column, an axis)."""

    name: str
    value: float | str | None
    sigma: float | None
    unit: str | None
    plausible: NotRequired[bool]
    stated: NotRequired[float]


class Evidence(TypedDict):
    """How sure a finding is: logarithm of its odds, and probability that nothing of its class is there."""

    gain_nats: float
    p_value: float


class Member(TypedDict):
    """What a finding may be, and how probable that is, given that it is one of its class."""

    sensor: str
    effect: str
    probability: float
    separated_by: str


class Impact(TypedDict):
    """What errors of a sensor do to a navigation solution that does not know of them."""

    sensor: str
    after_s: float
    position_m: float
    attitude_deg: float


# Not a class: `class` is a keyword.
Finding = TypedDict(
    "Finding",
    {
        "sensor": str,
        "effect": str,
        "probability": float,
        "class": list[Member],
        "interval_s": list[float],
        "parameters": list[Parameter],
        "evidence": Evidence,
        "share": NotRequired[float],
        "impact": NotRequired[Impact],
        "sentence": str,
    },
)


class Goodness(TypedDict):
    """How well a description predicts; None where there was nothing to judge by."""

    nll_per_sample: float | None
    rmse: float | None
    whiteness_p: float | None
    nis_mean: float | None


class BeforeAfter(TypedDict):
    """Without the findings and with them."""

    before: Goodness
    after: Goodness
    intervals_s: NotRequired[list[list[float]]]
    samples: NotRequired[int]


class Fit(TypedDict):
    """On the blocks that were fitted, and on those held out."""

    train: BeforeAfter
    held_out: BeforeAfter


class Located(TypedDict):
    """A place where record and simulation differ."""

    sensor: str
    test: str
    what: str
    p_value: float
    interval_s: NotRequired[list[float]]
    band_hz: NotRequired[list[float]]


class Remainder(TypedDict):
    """What remains where the catalogue does not suffice."""

    sensor: str
    what: str
    on: NotRequired[str]
    gain_nats: float


class NoiseNumbers(TypedDict, total=False):
    """The numbers of a noise, in the unit of the sensor; those that are 0 are left out."""

    white: float
    markov: list[list[float]]
    exp_cos: list[list[float]]
    random_walk: float
    flicker: float
    angle: float


class NoiseOfSensor(TypedDict):
    """The noise of a sensor: what the case states, and what was found."""

    sensor: str
    unit: str
    stated: NoiseNumbers | None
    found: NoiseNumbers
    nu: float | None
    holds_within: float


class At(TypedDict):
    """The value of a parameter in which an effect is not linear."""

    name: str
    value: float
    unit: str


class Bound(TypedDict):
    """The largest effect of a kind that could still hide; None where the recording cannot tell."""

    sensor: str
    effect: str
    variant: NotRequired[list[list[str]]]
    parameter: str
    bound: float | None
    unit: str
    at: NotRequired[list[At]]
    adds_rms: float | None
    adds_unit: str
    largest_plausible: NotRequired[float]
    because: NotRequired[str]


class Explanation(TypedDict):
    """`schuler-explanation/2`."""

    format: str
    verdict: Literal["explained", "partly_explained", "no_mismatch", "unexplained"]
    findings: list[Finding]
    fit: Fit
    located: list[Located]
    remainder: NotRequired[Remainder]
    explained_share: NotRequired[float]
    impact: NotRequired[Impact]
    noise: NotRequired[list[NoiseOfSensor]]
    certificate: NotRequired[list[Bound]]
    notes: NotRequired[list[str]]


class SensorIdentification(TypedDict):
    """The noise of one sensor, in SI units unless a key names another."""

    id: str
    column: str
    kind: str
    unit: str
    written_unit: str
    written_unit_in_si: float
    present: int
    missing: int
    subtracted: Any
    trend: dict[str, Any] | None
    autocorrelation: dict[str, Any]
    allan: list[dict[str, Any]]
    floor: dict[str, Any] | None
    coefficients: list[dict[str, Any]]
    power_laws_p: float | None
    structure: dict[str, Any]


class Identification(TypedDict):
    """`schuler-identification/1`."""

    format: str
    title: str
    time_column: str
    step_s: float
    rows: int
    rows_in_gaps: int
    sensors: list[SensorIdentification]
    warnings: list[str]


class CaseScore(TypedDict):
    """The score of a case of a campaign."""

    index: int
    seed: int
    name: str
    family: str
    setting: str
    rows: int
    sensors: int
    time_s: float
    failure: str | None
    verdict: str | None
    effects: list[dict[str, Any]]
    false_findings: list[list[str]]
    findings: list[list[str]]
    held_out_nats: list[float] | None
    fingerprint: str
