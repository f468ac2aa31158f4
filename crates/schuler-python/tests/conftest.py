"""What the tests share: cases small enough to be explained in a moment, and what Rust found on this machine."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import schuler

Doubles = NDArray[np.float64]

R1 = schuler.FilterConfig(
    accelerometer=schuler.MarkovNoise(9.80665e-4, 60.0),
    gyro=schuler.MarkovNoise(np.pi / 180.0 / 3600.0 * 0.1, 1800.0),
    velocity_noise=0.1,
)
"""Scenario R1 of the specification."""


@pytest.fixture(scope="session")
def reference() -> dict[str, Any]:
    """What the Rust crates gave for the same input, written by the test that runs these."""
    path = os.environ.get("SCHULER_REFERENCE")
    assert path, "SCHULER_REFERENCE is not set; run `cargo test -p schuler-python`"
    found: dict[str, Any] = json.loads(Path(path).read_text())
    return found


def numbers(values: Any) -> Doubles:
    """Numbers of JSON, in which null is NaN."""
    return np.array(values, dtype=float)


def same(found: Any, expected: Any) -> None:
    """Bit for bit, and NaN where NaN is."""
    found = np.asarray(found)
    np.testing.assert_array_equal(found, np.asarray(numbers(expected), dtype=found.dtype))


def case(kind: str = "fog", unit: str = "deg/h") -> dict[str, Any]:
    """A gyro at rest with a thermometer beside it, as a dictionary."""
    return {
        "format": "schuler-case/1",
        "title": "A gyro at rest",
        "recording": {"path": "recording.csv", "time": "t", "step_s": 1.0},
        "site": {"latitude_deg": 55.57},
        "motion": {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 30.0}},
        "sensor": [
            {
                "id": "gyro_x",
                "kind": kind,
                "column": "gyro_x",
                "unit": unit,
                "axis": np.array([0.0, 1.0, 0.0]),
                "relative": True,
                "nominal": {"white": 0.1},
            }
        ],
        "aux": [{"column": "temp_x", "quantity": "temperature", "unit": "degC", "near": "gyro_x"}],
    }


def arrays(seed: int, rows: int = 1200, coefficient: float = 0.0) -> dict[str, Doubles]:
    """Its recording: white noise, a temperature that swings, and a bias that follows it."""
    random = np.random.default_rng(seed)
    t = np.arange(float(rows))
    temperature = 20.0 + 5.0 * np.sin(2.0 * np.pi * t / 500.0) + 0.005 * t
    gyro = 0.1 * random.standard_normal(rows) + coefficient * (temperature - 20.0)
    return {"t": t, "gyro_x": gyro, "temp_x": temperature}


def toml_of(value: Any) -> str:
    """A value of a TOML file on one line."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml_of(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_of, value)) + "]"
    return json.dumps(value)


def write_case(directory: Path, name: str, seed: int, rows: int = 1200, coefficient: float = 0.0) -> Path:
    """The same as files."""
    directory.mkdir(parents=True, exist_ok=True)
    about = case()
    about["recording"]["path"] = f"{name}.csv"
    path = directory / f"{name}.toml"
    path.write_text("\n".join(f"{key} = {toml_of(value)}" for key, value in about.items()) + "\n")
    columns = arrays(seed, rows, coefficient)
    lines = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    (directory / f"{name}.csv").write_text("\n".join(lines) + "\n")
    return path
