"""The health monitor's verdict on a radio, and the measurements that it withholds from the filter."""

from typing import Any

import numpy as np
import pytest

import schuler

CONFIG = schuler.FilterConfig(
    accelerometer=schuler.MarkovNoise(sigma=1e-3, tau_s=300.0),
    gyro=schuler.MarkovNoise(sigma=1e-8, tau_s=3600.0),
    velocity_noise=0.3,
)
FAULT = slice(400, 500)


def flight(seed: int = 1) -> tuple[Any, Any]:
    """Velocity of the vehicle in the radio's eyes and the inertial unit's; the radio jumps by 5 m/s for a while."""
    random = np.random.default_rng(seed)
    inertial = 100.0 + 5.0 * np.sin(np.arange(700) / 60.0)
    radio = inertial + 0.1 * random.standard_normal(700)
    radio[FAULT] += 5.0
    return radio, inertial


def fly(seed: int = 1, **options: Any) -> schuler.AdaptiveRun:
    filter_ = schuler.AdaptiveFilter(CONFIG, method="off")
    filter_.watch_radio(**options)
    radio, inertial = flight(seed=seed)
    return filter_.run(inertial - radio, radio, inertial)


def test_a_faulty_radio_is_told_and_withheld() -> None:
    run = fly()
    late = slice(FAULT.start + 5, FAULT.stop)
    assert run.withheld[late].mean() > 0.95
    assert (run.p_fault[late] > 0.5).mean() > 0.95
    assert set(run.health_verdict[late]) <= {
        schuler.HealthVerdict.SHIFTED_MEAN,
        schuler.HealthVerdict.UNDECIDED_FAULT,
        schuler.HealthVerdict.SHIFTED_MEAN_AND_GROWN_NOISE,
        schuler.HealthVerdict.OUT_OF_MODEL,
    }
    # A healthy radio is withheld now and then, some steps together: see records/2026-11-28-health-acts.toml.
    healthy = np.concatenate([fly(seed=seed).withheld[: FAULT.start] for seed in range(1, 9)])
    assert healthy.mean() < 0.01
    assert schuler.HealthVerdict.NOMINAL in run.health_verdict[50 : FAULT.start]
    # The tilt keeps out of it: with the verdict used by nothing it does not.
    told = fly(withhold_above=None)
    assert not told.withheld.any()
    tilt = np.abs(run.estimate[FAULT, 1]).max()
    assert tilt < 0.2 * np.abs(told.estimate[FAULT, 1]).max()


def test_a_radio_that_holds_its_last_value_is_told() -> None:
    filter_ = schuler.AdaptiveFilter(CONFIG, method="off")
    filter_.watch_radio()
    radio, inertial = flight(seed=2)
    radio[FAULT] = radio[FAULT.start - 1]
    run = filter_.run(inertial - radio, radio, inertial)
    late = run.health_verdict[FAULT.start + 10 : FAULT.stop]
    assert (late == schuler.HealthVerdict.HELD_READING).all()


def test_what_is_wrong_is_said() -> None:
    filter_ = schuler.AdaptiveFilter(CONFIG)
    with pytest.raises(ValueError, match="radio_velocity: the health monitor is off"):
        filter_.run([0.0], [1.0], [1.0])
    with pytest.raises(ValueError, match="radio_use.withhold_above"):
        filter_.watch_radio(withhold_above=1.5)
    filter_.watch_radio()
    with pytest.raises(ValueError, match="inertial_velocity: found 2 values; expected 1"):
        filter_.run([0.0], [1.0], [1.0, 2.0])
    # Without them the monitor has nothing to judge by, and says so.
    run = filter_.run([0.0, 0.0])
    assert list(run.health_verdict) == [schuler.HealthVerdict.UNOBSERVED] * 2
