"""Data frames, arrays and dictionaries are explained without a file, and what is wrong in them is named by column and row."""

import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Doubles, arrays, write_case

import schuler

pd: Any = pytest.importorskip("pandas", reason="PANDAS IS NOT INSTALLED: its data frames are not tried")
pl: Any = pytest.importorskip("polars", reason="POLARS IS NOT INSTALLED: its data frames are not tried")

GYRO = {"gyro_x": {"kind": "fog", "unit": "deg/h", "axis": [0.0, 1.0, 0.0], "relative": True}}
SITE = {"latitude_deg": 55.57}
MOTION = {"kind": "static", "attitude_deg": {"roll": 0.0, "pitch": 0.0, "heading": 30.0}}


def explained(data: Any, **more: Any) -> schuler.Explanation:
    return schuler.explain(data, sensors=GYRO, nominal={"gyro_x": {"white": 0.1}}, motion=MOTION, site=SITE, **more)


def pair() -> tuple[dict[str, Doubles], dict[str, Doubles]]:
    """A simulator that knows the motion alone, and what was recorded: with a scale factor, and a bias that follows the temperature."""
    random = np.random.default_rng(5)
    t = np.arange(0.0, 1500.0)
    rate = 0.2 * np.sin(2.0 * np.pi * t / 300.0)
    temperature = 20.0 + 10.0 * np.sin(2.0 * np.pi * t / 1100.0)
    gyro = rate * 1.004 + 2e-4 * (temperature - 20.0) + 1e-4 * random.standard_normal(t.size)
    return {"t": t, "gyro_z": rate}, {"t": t, "gyro_z": gyro, "temperature": temperature}


def test_tables_of_every_kind_are_one() -> None:
    columns = arrays(5, coefficient=0.05)
    expected = explained(columns)
    assert expected["verdict"] == "explained"
    assert "bias_temperature" in [member["effect"] for member in expected["findings"][0]["class"]]
    frame = pd.DataFrame(columns)
    structured = np.zeros(len(frame), dtype=[(name, "f8") for name in columns])
    for name, values in columns.items():
        structured[name] = values
    lists = {name: values.tolist() for name, values in columns.items()}
    for data in [frame, pl.DataFrame(columns), structured, lists, frame.set_index("t"), frame.convert_dtypes()]:
        assert explained(data) == expected, type(data)
    flat = np.column_stack(list(columns.values()))
    assert explained(flat, columns=list(columns)) == expected
    # A case takes frames as well.
    assert schuler.explain(expected.case, frame) == expected


def test_dates_are_times() -> None:
    frame = pd.DataFrame(arrays(5, coefficient=0.05))
    stamps = pd.to_datetime(frame.pop("t") + 1.7e9, unit="s")
    expected = explained(frame.assign(t=stamps.astype("i8").to_numpy() / 10 ** {"s": 0, "ms": 3, "us": 6, "ns": 9}[stamps.dt.unit]))
    for index in (stamps, stamps.dt.tz_localize("UTC")):
        found = explained(frame.set_index(pd.DatetimeIndex(index)))
        assert found["findings"] == expected["findings"]
    assert explained(frame, step_s=1.0)["verdict"] == "explained"


def test_missing_cells_are_missing() -> None:
    columns = arrays(6, coefficient=0.05)
    columns["gyro_x"][100:200] = np.nan
    expected = explained(columns)
    objects = pd.DataFrame(columns).astype({"gyro_x": object})
    objects.loc[100:199, "gyro_x"] = None
    assert explained(objects) == expected
    nulls = pl.DataFrame(columns).with_columns(pl.col("gyro_x").fill_nan(None))
    assert explained(nulls) == expected


def test_answers_are_frames_of_the_library_that_asked() -> None:
    columns = arrays(5, coefficient=0.05)
    for library in (pd, pl):
        answer = explained(library.DataFrame(columns))
        for frame in (answer.findings, answer.parameters, answer.simulate()):
            assert isinstance(frame, library.DataFrame)
        found = answer.findings
        assert list(found.columns)[:7] == ["sensor", "effect", "probability", "parameter", "value", "sigma", "unit"]
        assert len(found) == len(answer["findings"])
        assert found["value"][0] == answer["findings"][0]["parameters"][0]["value"]
    quiet = explained(pd.DataFrame(arrays(1)))
    assert quiet["verdict"] == "no_mismatch" and len(quiet.findings) == 0 and "value" in quiet.findings
    # The index goes through.
    late = pd.DataFrame(columns, index=pd.Index(range(7, 1207), name="row"))
    assert explained(late, time="t").simulate().index.equals(late.index)


def test_what_is_guessed_is_said() -> None:
    answer = schuler.explain(pd.DataFrame(arrays(5, coefficient=0.05)).assign(note="quiet"), motion="static", site=SITE)
    said = "\n".join(answer.said)
    assert "gyro_x is taken for a gyro, in rad/s (a guess)" in said
    assert "temp_x is taken for a temperature" in said and "left out of data: note" in said
    assert isinstance(answer.case, dict) and answer.case["sensor"][0]["kind"] == "mems_gyro"


def test_a_simulator_beside_a_recording(tmp_path: Path) -> None:
    sim, real = pair()
    answers = [schuler.compare(make(sim), make(real)) for make in (dict, pd.DataFrame, pl.DataFrame)]
    answer = answers[0]
    assert answers[1] == answer and answers[2] == answer
    assert {finding["effect"] for finding in answer["findings"]} == {"scale_factor", "bias_temperature"}
    simulated = answer.simulate()
    before, after = real["gyro_z"] - sim["gyro_z"], real["gyro_z"] - simulated["gyro_z"].to_numpy()
    assert np.std(after) < 1.1e-4 < 5e-4 < np.std(before)
    # The exported model is what was put back.
    written = answer.export(tmp_path / "model.py")
    assert [path.name for path in written] == ["model.py", "model_inputs.csv"]
    run = subprocess.run([sys.executable, *written], capture_output=True, text=True, check=True)
    added = np.genfromtxt(run.stdout.splitlines(), delimiter=",", names=True)
    np.testing.assert_allclose(sim["gyro_z"] + added["gyro_z"], simulated["gyro_z"], rtol=0, atol=1e-9)
    # Another clock, another name, another step.
    sparse = pd.DataFrame({"seconds": sim["t"][::2], "omega": sim["gyro_z"][::2]})
    mapped = schuler.compare(sparse, real, map={"omega": "gyro_z"}, sensors={"gyro_z": {"unit": "rad/s"}})
    assert {"scale_factor", "bias_temperature"} <= {finding["effect"] for finding in mapped["findings"]}


def test_a_prediction_beside_the_readings() -> None:
    sim, real = pair()
    by_array = schuler.explain(real, sensors=["gyro_z"], nominal={"gyro_z": sim["gyro_z"]}, motion="unknown")
    by_column = schuler.explain(
        real | {"sim": sim["gyro_z"]}, sensors=["gyro_z"], nominal={"gyro_z": "sim"}, motion="unknown"
    )
    assert by_array["findings"] == by_column["findings"]
    assert "scale_factor" in {finding["effect"] for finding in by_array["findings"]}


def test_answers_show_themselves(tmp_path: Path) -> None:
    answer = explained(arrays(5, coefficient=0.05))
    shown = answer._repr_html_()
    assert "The findings explain the mismatch." in shown and "<table>" in shown
    assert repr(answer).startswith("<Explanation: explained") and "gyro_x" in str(answer)
    figure = answer.plot()
    assert list(figure.figures) == ["gyro_x_explained"] and "<svg" in figure._repr_html_()
    assert figure.save(tmp_path / "a.png")[0].read_bytes()[1:4] == b"PNG"
    assert len(answer.plot("all").save(tmp_path / "b.svg")) == len(answer.plot("all").figures) > 2
    assert "</html>" in answer.report(tmp_path / "page.html").read_text()
    with pytest.raises(ValueError, match=r"^which: found 'all of it'; expected one of explained, "):
        answer.plot("all of it")
    with pytest.raises(ValueError, match=r"^path: found the ending '.pdf'; expected .svg or .png$"):
        figure.save(tmp_path / "a.pdf")
    with pytest.raises(ValueError, match=r"the ending .m for a model; expected .json, .py, .c or .rs$"):
        answer.export(tmp_path / "model.m")
    copy = pickle.loads(pickle.dumps(answer))
    assert copy == answer and str(copy) == str(answer) and len(copy.findings) == len(answer["findings"])
    assert json.loads(json.dumps(answer)) == answer
    with pytest.raises(RuntimeError, match="copy from another process"):
        copy.plot()


def broken(column: str, row: int, value: Any) -> Any:
    frame = pd.DataFrame(arrays(1, rows=60)).astype({column: object})
    frame.loc[row, column] = value
    return frame


@pytest.mark.parametrize(
    ("data", "more", "message"),
    [
        (broken("gyro_x", 17, "n/a"), {}, r'''^data\["gyro_x"\]\[17\]: found 'n/a'; expected a number$'''),
        (broken("temp_x", 3, [1.0]), {}, r'^data\["temp_x"\]\[3\]: found \[1.0\]; expected a number$'),
        (broken("t", 30, 12.0), {}, r'^data\["t"\]\[30\]: found 12.0 after 29.0; expected times that increase'),
        (broken("t", 30, None), {}, r'^data\["t"\]\[30\]: found no time; expected one in every row$'),
        (arrays(1, rows=60), {"time": "when"}, r'^data: time: found "when"; expected a column of the table'),
        (arrays(1, rows=60), {"sensors": ["gyro_q"]}, r'^sensors: found "gyro_q"; expected a column of data: t, gyro_x'),
        (arrays(1, rows=60), {"aux": ["heat"]}, r'^aux: found "heat"; expected a column of data'),
        (arrays(1, rows=60), {"nominal": {"gyro_q": {}}}, r'^nominal: found "gyro_q"; expected one of the sensors: gyro_x$'),
        (arrays(1, rows=60), {"nominal": {"gyro_x": "sim"}}, r'^nominal\["gyro_x"\]: found "sim"; expected a column of data'),
        (
            arrays(1, rows=60),
            {"nominal": {"gyro_x": np.zeros(59)}},
            r'^nominal\["gyro_x"\]: found an array of shape \(59,\); expected \(60,\)$',
        ),
        (
            arrays(1, rows=60) | {"gyro_x": np.zeros(59)},
            {},
            r'^data\["gyro_x"\]: found 59 rows; expected 60, as data\["t"\] has$',
        ),
        (
            arrays(1, rows=60) | {"gyro_x": np.zeros(60, complex)},
            {},
            r'^data\["gyro_x"\]: found values of type complex128; expected real numbers$',
        ),
        (pd.DataFrame({"a": ["x", "y"], "t": [0.0, 1.0]}), {"sensors": ["a"]}, r'''^data\["a"\]\[0\]: found 'x'; expected a number$'''),
        (pd.DataFrame({1: [0.0, 1.0]}), {}, r"^data: found the column 1; expected names that are strings$"),
        (np.zeros((9, 2)), {}, r"^columns: found none; expected the names of the 2 columns of data$"),
        ({"gyro_x": np.sin(np.arange(60.0))}, {}, r"^data: found no column that is a time.*: state step_s=$"),
    ],
)
def test_wrong_tables(data: Any, more: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        schuler.explain(data, **more)


def test_wrong_arguments(tmp_path: Path) -> None:
    path = write_case(tmp_path, "gyro", 5)
    with pytest.raises(TypeError, match=r"^sensors: found with a case; expected data, or this in the case$"):
        schuler.explain(path, sensors=["gyro_x"])
    with pytest.raises(TypeError, match=r"^recording: found beside data; expected it with a case alone$"):
        schuler.explain(arrays(1), arrays(1))
    with pytest.raises(TypeError, match=r"^sim: found str; expected a data frame, a dictionary of arrays"):
        schuler.compare("sim.csv", arrays(1))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^sensors: found a string; expected a list of columns or a dictionary$"):
        schuler.explain(arrays(1), sensors="gyro_x")
    sim, real = pair()
    with pytest.raises(ValueError, match=r"^no column of the simulation is called as one of the recording: .*map="):
        schuler.compare({"t": sim["t"], "y": sim["gyro_z"]}, real)
    with pytest.raises(ValueError, match=r'^map: found "y"; expected a column of sim: t, gyro_z$'):
        schuler.compare(sim, real, map={"y": "gyro_z"})
    with pytest.raises(ValueError, match=r'^sim\["t"\]\[1\]: found 1498.0 after 1499.0; expected times that increase'):
        schuler.compare({"t": sim["t"][::-1], "gyro_z": sim["gyro_z"]}, real, sim_time="t")


def test_the_package_installs_the_command(tmp_path: Path) -> None:
    maturin = [sys.executable, "-m", "maturin", "pep517", "write-dist-info", "--interpreter", sys.executable]
    done = subprocess.run(
        [*maturin, "--metadata-directory", str(tmp_path)],
        capture_output=True, text=True, check=False, cwd=Path(__file__).parent.parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (scripts,) = tmp_path.glob("schuler-*.dist-info/entry_points.txt")
    assert scripts.read_text().split() == ["[console_scripts]", "schuler=schuler._command:main"]


def test_the_command_comes_with_the_package(tmp_path: Path) -> None:
    path = write_case(tmp_path, "gyro", 5, coefficient=0.05)
    code = "import sys; from schuler._command import main; sys.exit(main())"

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)

    done = run("explain", str(path), "--json", "--quiet")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == schuler.explain(path)
    wrong = run("explain", str(tmp_path / "absent.toml"))
    assert wrong.returncode == 2 and "absent.toml: cannot read the case" in wrong.stderr
    assert run("--version").stdout.startswith("schuler 0.")
