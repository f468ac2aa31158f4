"""Types and docstrings say what is there."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import schuler

PACKAGE = Path(schuler.__file__).parent
PROJECT = Path(__file__).parent.parent


def check(*arguments: str) -> None:
    """Runs a module of this Python and expects it to find nothing."""
    command = [sys.executable, "-m", *arguments]
    found = subprocess.run(command, capture_output=True, text=True, cwd=PROJECT, check=False)
    assert found.returncode == 0, found.stdout + found.stderr


def test_stubs_are_those_of_the_compiled_module() -> None:
    check("mypy.stubtest", "--mypy-config-file", "pyproject.toml", "schuler")


def test_strict_types(tmp_path: Path) -> None:
    assert (PACKAGE / "py.typed").exists()
    cache = ("--cache-dir", str(tmp_path))
    check("mypy", *cache, "-p", "schuler")
    check("mypy", *cache, "examples/papers.py", *map(str, sorted(Path(__file__).parent.glob("*.py"))))


@pytest.mark.parametrize("name", schuler.__all__)
def test_everything_has_a_docstring(name: str) -> None:
    thing = getattr(schuler, name)
    if name == "__version__":
        return
    assert inspect.getdoc(thing)
    if inspect.isclass(thing) and thing.__module__ == "schuler" and not hasattr(thing, "__members__"):
        members = [member for member in vars(thing) if not member.startswith("_")]
        assert members
        for member in members:
            assert inspect.getdoc(getattr(thing, member)), f"{name}.{member}"
