"""The example reproduces the papers without a screen, and draws."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="MATPLOTLIB IS NOT INSTALLED: the example is not run")


def test_papers(tmp_path: Path) -> None:
    example = Path(__file__).parent.parent / "examples" / "papers.py"
    environment = os.environ | {"MPLCONFIGDIR": str(tmp_path)}
    environment.pop("DISPLAY", None)
    command = [sys.executable, "-W", "error", str(example), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("everything is as published\n")
    figures = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert figures == [
        "five_gyros.png",
        "normalised_correlation.png",
        "retuned_in_flight.png",
        "right_and_wrong_coefficients.png",
        "right_gyro.png",
    ]
