"""The package gives what the Rust crates give, bit for bit. The expected values are made by the test that runs these."""

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import R1, numbers, same

import schuler

FILTER = ("innovation", "innovation_variance", "nis", "log_likelihood", "gated", "reacquired", "reset")


def config(about: dict[str, Any]) -> schuler.FilterConfig:
    """The configuration that Rust wrote down."""
    accelerometer, gyro = (schuler.MarkovNoise(**about.pop(name)) for name in ("accelerometer", "gyro"))
    return schuler.FilterConfig(accelerometer=accelerometer, gyro=gyro, **about)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("discretisation", ["exact", "third_order"])
def test_filter(reference: dict[str, Any], precision: Any, discretisation: Any) -> None:
    about = reference["filter"]
    filter_ = schuler.ErrorFilter(config(dict(about["config"])), precision=precision, discretisation=discretisation)
    run = filter_.run(numbers(about["velocity_error"]))
    expected = about[f"{precision}_{discretisation}"]
    same(run.estimate, expected["estimate"])
    same(run.sigma, expected["sigma"])
    for name in FILTER:
        same(getattr(run, name), expected[name])
    assert run.gated.any() and run.reacquired.any()


def test_adaptive_filter(reference: dict[str, Any]) -> None:
    about = reference["adaptive"]
    filter_ = schuler.AdaptiveFilter(config(dict(about["config"])))
    run = filter_.run(numbers(about["velocity_error"]))
    assert run.retuned.sum() >= 1
    same(run.retuned.nonzero()[0], about["retuned"])
    every = about["every"]
    for name in ("estimate", "sigma", "averaged", "averaged_sigma", "accelerometer_noise", "gyro_noise"):
        same(getattr(run, name)[::every], about[name])
    same(run.accelerometer_status[::every], about["accelerometer_status"])
    same(run.gyro_status[::every], about["gyro_status"])


def test_block(reference: dict[str, Any]) -> None:
    about = reference["block"]
    block = schuler.GyroBlock(about["axes"], about["sigma"])
    rates = numbers(about["rates"])
    same(block.parity_matrix, about["parity_matrix"])
    same(block.projector, about["projector"])
    same(block.parity(rates), about["parity"])
    same(block.likelihood(rates), about["likelihood"])
    same(block.determinants(rates), about["determinants"])
    same(block.determinants(rates, normalised=False), about["raw_determinants"])
    projection = block.project(rates)
    same(projection.total, about["total"])
    same(projection.unexplained, about["unexplained"])
    kalman = block.sequential(rates)
    same(kalman.last, about["kalman_last"])
    same(kalman.previous, about["kalman_previous"])
    same(block.sequential(rates, recursion="covariance_first").last, about["covariance_first_last"])


def test_isolation(reference: dict[str, Any]) -> None:
    about = reference["isolation"]
    isolation = schuler.FaultIsolation()
    run = isolation.run(numbers(about["rates"]))
    for name in ("verdict", "faulty", "flags", "excluded", "parity", "determinants", "alarm_level", "margin"):
        same(getattr(run, name), about[name])
    # Where there is none, Rust has zero.
    used = run.verdict != schuler.Verdict.BLOCK_UNTRUSTED
    same(run.rate[used], numbers(about["rate"])[used])
    sized = numbers(about["fault_sigma"]) > 0.0
    same(run.fault_size[sized], numbers(about["fault_size"])[sized])
    assert sized.any() and set(run.faulty.tolist()) == {-1, about["failed"]}


def test_fits(reference: dict[str, Any]) -> None:
    about = reference["noise"]
    found = schuler.autocorrelation(numbers(about["series"]), 400)
    same(found.covariance, about["covariance"])
    exponential = schuler.fit_exponential(found.covariance, about["spacing_s"])
    cosine = schuler.fit_exponential_cosine(found.covariance, about["spacing_s"])
    assert exponential is not None and cosine is not None
    assert [exponential.variance, exponential.alpha, exponential.lags] == about["exponential"]
    assert [cosine.variance, cosine.alpha, cosine.beta, cosine.crossing_s] == about["exponential_cosine"]


@pytest.mark.parametrize("name", ["explain", "identify"])
def test_documents(reference: dict[str, Any], name: str) -> None:
    for about in reference["cases"]:
        expected = json.loads(Path(about[name]).read_text())
        assert getattr(schuler, name)(about["case"]) == expected
        assert expected["format"].startswith("schuler-")


def test_r1_is_what_rust_calls_r1(reference: dict[str, Any]) -> None:
    assert config(dict(reference["adaptive"]["truth"])) == R1
