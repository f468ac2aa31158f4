"""Copies go on by themselves; what has no state of its own can be pickled."""

import copy
import pickle

import numpy as np
import pytest
from conftest import R1

import schuler


def test_what_is_configured_is_pickled() -> None:
    for value in [R1, R1.gyro]:
        assert pickle.loads(pickle.dumps(value)) == value
        assert copy.deepcopy(value) == value
    block = schuler.GyroBlock(sigma=[1.0, 2.0, 1.0, 1.0, 1.5])
    for other in [pickle.loads(pickle.dumps(block)), copy.deepcopy(block)]:
        assert np.array_equal(other.axes, block.axes)
        assert np.array_equal(other.sigma, block.sigma)


def test_a_copy_of_a_filter_goes_on_by_itself() -> None:
    velocity = np.sin(np.arange(50.0))
    first = schuler.ErrorFilter(R1)
    first.run(velocity)
    second, untouched = copy.deepcopy(first), copy.copy(first)
    went_on = first.run(velocity)
    assert np.array_equal(second.run(velocity).estimate, went_on.estimate)
    assert not np.array_equal(untouched.mean, first.mean)


def test_copies_of_isolation_and_module_are_their_own() -> None:
    rates = np.random.default_rng(1).normal(size=(20, 5))
    first = schuler.FaultIsolation(sigma=[1.0] * 5, range=100.0)
    second = copy.deepcopy(first)
    ran = first.run(rates)
    assert np.array_equal(second.run(rates).parity, ran.parity)
    adaptive = schuler.AdaptiveFilter(R1)
    other = copy.deepcopy(adaptive)
    flown = adaptive.run(np.zeros(30))
    assert np.array_equal(other.run(np.zeros(30)).estimate, flown.estimate)


def test_a_filter_with_a_state_is_not_pickled() -> None:
    with pytest.raises(TypeError, match="ErrorFilter"):
        pickle.dumps(schuler.ErrorFilter(R1))
