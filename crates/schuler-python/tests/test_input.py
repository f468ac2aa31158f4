"""What is not as it should be: missing values, shapes, types, order in memory, threads, Ctrl-C."""

import _thread
import re
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import R1, arrays, case, write_case

import schuler


def wrong(message: str) -> Any:
    """A ValueError of one line that is exactly this."""
    return pytest.raises(ValueError, match=f"^{re.escape(message)}$")


def test_missing_values_of_every_kind_are_one() -> None:
    z = np.linspace(0.0, 0.1, 50)
    gaps = [3, 4, 20]
    masked = np.ma.masked_array(z, mask=np.isin(np.arange(50), gaps))
    nan, infinite = z.copy(), z.copy()
    nan[gaps] = np.nan
    infinite[gaps] = [np.inf, -np.inf, np.inf]
    expected = schuler.ErrorFilter(R1).run(nan)
    assert np.isnan(expected.innovation).nonzero()[0].tolist() == gaps
    for other in (masked, infinite):
        np.testing.assert_array_equal(schuler.ErrorFilter(R1).run(other).estimate, expected.estimate)
    step_by_step = schuler.ErrorFilter(R1)
    for k, value in enumerate(nan):
        step = step_by_step.step(None if k in gaps else float(value))
        np.testing.assert_array_equal(step.estimate, expected.estimate[k])
        np.testing.assert_array_equal(step.sigma, expected.sigma[k])
        assert step.gated == expected.gated[k]


def test_nothing_is_nothing() -> None:
    run = schuler.ErrorFilter(R1).run([])
    assert run.estimate.shape == (0, 4) and run.nis.shape == (0,)
    assert schuler.GyroBlock().parity(np.empty((0, 5))).shape == (0, 2)
    assert schuler.autocorrelation([], 10).covariance.shape == (0,)


def test_memory_may_lie_in_any_order() -> None:
    random = np.random.default_rng(1)
    z = random.standard_normal(400) * 0.05
    expected = schuler.ErrorFilter(R1).run(z[::2].copy())
    # A column of packed records begins at odd addresses; a copy of its bytes at one is contiguous, too.
    packed = np.zeros(200, dtype=[("flag", "u1"), ("z", "<f8")])
    packed["z"] = z[::2]
    unaligned = np.frombuffer(b"\0" + z[::2].tobytes(), dtype="f8", offset=1)
    swapped = np.frombuffer(b"\0" + z[::2].astype(">f8").tobytes(), dtype=">f8", offset=1)
    assert not (packed["z"].flags.aligned or unaligned.flags.aligned)
    for other in (z[::2], z[::2].astype(">f8"), packed["z"], unaligned, swapped, list(z[::2]), tuple(z[::2])):
        np.testing.assert_array_equal(schuler.ErrorFilter(R1).run(other).estimate, expected.estimate)
    backwards = schuler.ErrorFilter(R1).run(z[::2][::-1][::-1])
    np.testing.assert_array_equal(backwards.estimate, expected.estimate)
    rates = random.standard_normal((30, 5))
    block = schuler.GyroBlock()
    np.testing.assert_array_equal(block.parity(np.asfortranarray(rates)), block.parity(rates))
    np.testing.assert_array_equal(block.parity(rates.T.copy().T), block.parity(rates))
    read_only = rates.copy()
    read_only.flags.writeable = False
    np.testing.assert_array_equal(block.parity(read_only), block.parity(rates))


def test_numbers_of_other_types_are_numbers() -> None:
    counts = np.arange(20)
    expected = schuler.ErrorFilter(R1).run(counts.astype(float)).estimate
    for dtype in (np.int32, np.uint8, np.float32, np.int64, np.float16):
        np.testing.assert_array_equal(schuler.ErrorFilter(R1).run(counts.astype(dtype)).estimate, expected)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 4)), "velocity_error: found an array of shape (3, 4); expected (n,)"),
        (1.0, "velocity_error: found an array of shape (); expected (n,)"),
        (np.zeros(3, complex), "velocity_error: found values of type complex128; expected real numbers"),
        (["1", "2"], "velocity_error: found values of type <U1; expected real numbers"),
        ([1.0, None], "velocity_error: found values of type object; expected real numbers"),
        (np.zeros(2, "M8[s]"), "velocity_error: found values of type datetime64[s]; expected real numbers"),
    ],
)
def test_wrong_arrays(values: Any, message: str) -> None:
    for filter_ in (schuler.ErrorFilter(R1), schuler.AdaptiveFilter(R1)):
        with wrong(message):
            filter_.run(values)


def test_ragged_arrays() -> None:
    with pytest.raises(ValueError, match=r"^rates: .*inhomogeneous.*expected numbers of shape \(n, 5\)$"):
        schuler.GyroBlock().parity([[1.0], [2.0, 3.0]])


def test_wrong_arguments() -> None:
    noise = schuler.MarkovNoise(1e-3, 60.0)
    with wrong("filter.gyro.tau_s: is not a finite number"):
        schuler.FilterConfig(accelerometer=noise, gyro=schuler.MarkovNoise(1e-7, np.nan), velocity_noise=0.1)
    with wrong("filter.velocity_noise: must be greater than zero"):
        schuler.FilterConfig(accelerometer=noise, gyro=noise, velocity_noise=0.0)
    with wrong('precision: found "half"; expected "double" or "single"'):
        schuler.ErrorFilter(R1, precision="half")  # type: ignore[arg-type]
    with wrong("identification.first_s: must be greater than zero"):
        schuler.AdaptiveFilter(R1, first_s=0.0)
    with wrong("isolation.axes[1]: is not a unit vector within one thousandth"):
        schuler.GyroBlock(np.vstack([np.eye(3)[:1], 2.0 * np.eye(3), np.eye(3)[:1]]))
    with wrong("axes: found 3 rows; expected 5"):
        schuler.GyroBlock(np.eye(3))
    with wrong("sigma: found an array of shape (4,); expected (5,)"):
        schuler.FaultIsolation(sigma=np.ones(4))
    with wrong("rates: found an array of shape (5,); expected (n, 5)"):
        schuler.GyroBlock().parity(np.zeros(5))
    with wrong("without: found 5; expected a gyro, 0 to 4"):
        schuler.GyroBlock().rate(np.zeros((1, 5)), without=5)
    with wrong("spacing_s: found 0; expected a finite number greater than zero"):
        schuler.fit_exponential([1.0, 0.9], 0.0)
    with wrong("floor: found 1; expected a correlation from 0 to below 1"):
        schuler.fit_exponential([1.0, 0.9], 1.0, floor=1.0)


def test_rows_with_missing_readings_are_missing() -> None:
    rates = np.random.default_rng(3).standard_normal((4, 5))
    rates[2, 1] = np.nan
    block = schuler.GyroBlock()
    for found in (block.parity(rates), block.likelihood(rates), block.sequential(rates).ratio, block.rate(rates)):
        np.testing.assert_array_equal(np.isnan(found).any(1), [False, False, True, False])
    # The determinant without gyro 1, and the rate without it, do not contain it.
    assert np.isfinite(block.rate(rates, without=1)).all()
    run = schuler.FaultIsolation(sigma=np.ones(5), range=100.0, rate_limit=10.0).run(rates)
    assert run.verdict.tolist()[2] == schuler.Verdict.FAULT and run.faulty[2] == 1
    assert np.isfinite(run.rate).all()
    assert schuler.IsolationFlags.READING_UNUSABLE in schuler.IsolationFlags(run.flags[2])


def test_cases_as_dictionaries_and_as_files(tmp_path: Path) -> None:
    path = write_case(tmp_path, "gyro", 5, coefficient=0.05)
    from_file = schuler.explain(path)
    assert from_file["verdict"] == "explained"
    assert "bias_temperature" in [member["effect"] for member in from_file["findings"][0]["class"]]
    columns = arrays(5, coefficient=0.05)
    assert schuler.explain(case(), columns) == from_file
    assert schuler.explain(str(path), columns) == from_file
    assert schuler.explain(case(), tmp_path / "gyro.csv") == from_file
    # Without a path, and with columns that lie in another order in memory.
    without_path = case()
    del without_path["recording"]["path"]
    stacked = np.column_stack([columns["t"], columns["gyro_x"], columns["temp_x"]])
    assert schuler.explain(without_path, dict(zip(columns, stacked.T, strict=True))) == from_file
    found = schuler.identify(case(), columns, longest_lag=50)
    assert found["sensors"][0]["id"] == "gyro_x" and len(found["sensors"][0]["autocorrelation"]["covariance"]) == 51


def nested(levels: int, wrap: Any) -> Any:
    value: Any = 1.0
    for _ in range(levels):
        value = wrap(value)
    return value


def endless_dictionary() -> dict[str, Any]:
    about = case()
    about["sensor"][0]["nominal"]["markov"] = about
    return about


def endless_list() -> list[Any]:
    items: list[Any] = []
    items.append(items)
    return items


def doubled(levels: int) -> Any:
    return nested(levels, lambda value: [value, value])


class Endless:
    """Says of itself that it is an array, which is itself."""

    def tolist(self) -> Any:
        return self


@pytest.mark.parametrize(
    "bad",
    [
        endless_dictionary(),
        endless_list(),
        Endless(),
        nested(100_000, lambda value: {"a": value}),
        nested(100_000, lambda value: [value]),
        nested(100_000, lambda value: (value,)),
        doubled(30),
    ],
    ids=["dictionary", "list", "array", "deep dictionaries", "deep lists", "deep tuples", "shared lists"],
)
def test_what_never_ends_is_an_exception(bad: Any) -> None:
    about = case()
    about["title"] = bad
    message = r"^case[^:]*: found (a value nested 32 levels deep|more than 1000000 values); expected"
    with pytest.raises(ValueError, match=message):
        schuler.explain(about, arrays(1))
    if isinstance(bad, dict):
        with pytest.raises(ValueError, match=message):
            schuler.identify(bad, arrays(1))
    with pytest.raises((ValueError, RecursionError)):
        schuler.explain(case(), arrays(1) | {"gyro_x": bad})


def test_missing_values_of_a_recording() -> None:
    columns = arrays(6)
    columns["gyro_x"][100:200] = np.nan
    columns["gyro_x"][300] = np.inf
    found = schuler.identify(case(), columns)
    assert found["sensors"][0]["missing"] == 101
    assert found["warnings"] == ["<arrays>: gyro_x: 1 infinite values are missing"]


def test_wrong_cases(tmp_path: Path) -> None:
    columns = arrays(1, rows=50)
    about = case()
    about["sensor"][0]["unit"] = "deg/min"
    with pytest.raises(ValueError, match=r'^case: sensor\[0\]\.unit: found "deg/min"; expected one of .*$'):
        schuler.explain(about, columns)
    about = case()
    about["sensor"][0]["nominal"]["white"] = float("nan")
    with wrong("case: sensor[0].nominal.white: found nan; expected a number not less than zero"):
        schuler.explain(about, columns)
    about = case()
    about["site"]["latitude_deg"] = None
    with pytest.raises(ValueError, match=r"^case\.site\.latitude_deg: found NoneType; expected a number"):
        schuler.explain(about, columns)
    with pytest.raises(ValueError, match=r'column: found "temp_x"; expected a column of the table'):
        schuler.explain(case(), {"t": columns["t"], "gyro_x": columns["gyro_x"]})
    with wrong('recording["gyro_x"]: found 49 rows; expected 50, as recording["t"] has'):
        schuler.explain(case(), columns | {"gyro_x": columns["gyro_x"][1:]})
    with wrong('recording["gyro_x"]: found an array of shape (50, 1); expected (n,)'):
        schuler.explain(case(), columns | {"gyro_x": columns["gyro_x"][:, None]})
    with pytest.raises(ValueError, match=r"^<arrays>: found no rows"):
        schuler.explain(case(), {name: [] for name in columns})
    with pytest.raises(ValueError, match=r"^case: the recording has 5 rows; expected at least \d+$"):
        schuler.explain(case(), {name: column[:5] for name, column in columns.items()})
    with pytest.raises(ValueError, match=r"^<arrays>.*: t: "):
        schuler.explain(case(), columns | {"t": columns["t"][::-1]})
    with pytest.raises(ValueError, match=r"absent\.toml: cannot read the case: No such file"):
        schuler.explain(tmp_path / "absent.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text('format = "schuler-case/1"\n[recording]\npath = 5\n')
    with pytest.raises(ValueError, match=r"broken\.toml:2: recording\.time: missing, as is step_s; expected .* \(and 1 more\)$"):
        schuler.explain(broken)
    with pytest.raises(ValueError, match=r"probability: found 2; expected a probability between 0 and 1$"):
        schuler.explain(case(), arrays(1), probability=2.0)
    with pytest.raises(TypeError, match=r"^case: found int; expected the path of a case file or a dictionary$"):
        schuler.explain(5)  # type: ignore[arg-type]


def test_work_lets_other_threads_run() -> None:
    z = np.random.default_rng(2).standard_normal(400_000) * 0.05
    ticks = 0
    running = True

    def tick() -> None:
        nonlocal ticks
        while running:
            ticks += 1
            time.sleep(0.001)

    ticker = threading.Thread(target=tick)
    ticker.start()
    while ticks == 0:
        time.sleep(0.001)
    before = ticks
    start = time.perf_counter()
    schuler.ErrorFilter(R1).run(z)
    took = time.perf_counter() - start
    during = ticks - before
    running = False
    ticker.join()
    # Held, it would not have ticked at all.
    assert during >= 2, f"{during} ticks in {took:.3f} s"


def test_threads_agree() -> None:
    z = np.random.default_rng(4).standard_normal((8, 20_000)) * 0.05
    alone = [schuler.ErrorFilter(R1).run(row).estimate for row in z]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda row: schuler.ErrorFilter(R1).run(row).estimate, z))
        explained = list(pool.map(lambda seed: schuler.explain(case(), arrays(seed, coefficient=0.05)), [5, 6, 5, 6]))
    np.testing.assert_array_equal(alone, together)
    assert explained[0] == explained[2] and explained[1] == explained[3] != explained[0]


def test_one_object_is_for_one_thread_at_a_time() -> None:
    filter_ = schuler.ErrorFilter(R1)
    z = np.zeros(2_000_000)
    worker = threading.Thread(target=filter_.run, args=(z,))
    worker.start()
    raised = False
    while worker.is_alive() and not raised:
        try:
            filter_.step(0.0)
        except RuntimeError:
            raised = True
    worker.join()
    assert raised


def test_interrupt_and_progress() -> None:
    columns = arrays(8, rows=40_000, coefficient=0.02)
    told: list[tuple[str, float]] = []
    schuler.explain(case(), arrays(8), progress=lambda phase, part: told.append((phase, part)))
    assert all(0.0 <= part <= 1.0 for _, part in told)
    assert {phase for phase, _ in told} <= {"preparing", "searching", "refining", "judging"}

    # As Ctrl-C does: the signal arrives at the main thread, which is this one. What a shell starts in the
    # background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for work in (schuler.explain, schuler.identify):
        threading.Timer(0.3, _thread.interrupt_main).start()
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            work(case(), columns)
        assert time.monotonic() - begun < 1.3, work.__name__

    class Enough(Exception):
        pass

    def stop(phase: str, part: float) -> None:
        raise Enough

    with pytest.raises(Enough):
        schuler.explain(case(), columns, progress=stop)
