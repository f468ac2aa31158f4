"""A fleet over a Ray of two workers on this machine, whose workers and driver are killed."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import write_case

import schuler

pytest.importorskip(
    "ray", reason="RAY IS NOT INSTALLED: schuler.fleet is not tested (pip install -r tests/requirements-fleet.txt)"
)
pq = pytest.importorskip("pyarrow.parquet", reason="PYARROW IS NOT INSTALLED: schuler.fleet is not tested")

PATIENCE_S = 900.0
"""For a machine that has other things to do."""


def cases(directory: Path, count: int, rows: int) -> list[Path]:
    """Cases of which every second has something to be found."""
    return [write_case(directory, f"case_{k:02}", k, rows, 0.05 * (k % 2)) for k in range(count)]


def command_line(*arguments: str | Path) -> list[str]:
    """The command line."""
    return [sys.executable, "-m", "schuler.fleet", *map(str, arguments)]


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs it to its end."""
    return subprocess.run(command_line(*arguments), capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def rows(out: Path, name: str = "cases") -> list[dict[str, Any]]:
    """Rows of a result."""
    found: list[dict[str, Any]] = pq.read_table(out / f"{name}.parquet").to_pylist()
    return found


def parts(out: Path) -> list[Path]:
    """Parts of the cases that are done."""
    return sorted((out / "parts" / "cases").glob("*.parquet"))


def descendants(parent: int) -> dict[int, str]:
    """Processes that a process has started, and those that they have, by their command lines."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                after_name = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            children.setdefault(int(after_name[1]), []).append(int(entry.name))
    found: dict[int, str] = {}
    open_ = [parent]
    while open_:
        for child in children.get(open_.pop(), []):
            open_.append(child)
            try:
                found[child] = (Path("/proc") / str(child) / "cmdline").read_text().replace("\0", " ").strip()
            except OSError:
                continue
    return found


def wait(condition: Any, process: subprocess.Popen[str]) -> Any:
    """Waits until it holds."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert process.poll() is None, f"ended with {process.returncode} before"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return found


def started(*arguments: str | Path) -> subprocess.Popen[str]:
    """Starts it in the background, in a session of its own."""
    return subprocess.Popen(
        command_line(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def check_answers(out: Path, paths: list[Path]) -> None:
    """Every case has been answered once, and as by a single process."""
    found = rows(out)
    assert [row["case"] for row in found] == [str(path) for path in paths]
    expected = [schuler.explain(path) for path in paths]
    findings = rows(out, "findings")
    for row, answer in zip(found, expected, strict=True):
        assert row["status"] == "answered" and row["error"] is None and row["time_s"] > 0.0
        assert json.loads(row["answer"]) == answer
        assert row["verdict"] == answer["verdict"] and row["findings"] == len(answer["findings"])
        of_case = [it for it in findings if it["case"] == row["case"]]
        assert [it["rank"] for it in of_case] == list(range(len(answer["findings"])))
        for it, whole in zip(of_case, answer["findings"], strict=True):
            assert (it["sensor"], it["effect"], it["class"]) == (whole["sensor"], whole["effect"], whole["class"])
            assert [it["start_s"], it["end_s"]] == whole["interval_s"]
            assert it["gain_nats"] == whole["evidence"]["gain_nats"]
            assert [p["name"] for p in it["parameters"]] == [p["name"] for p in whole["parameters"]]
            # A column of a table holds numbers or words: words stand in one of their own.
            assert all(p["value"] is None or p.get("text") is None for p in it["parameters"])
            told = [p.get("text") if p["value"] is None else p["value"] for p in it["parameters"]]
            assert told == [p["value"] for p in whole["parameters"]]
            assert [p["stated"] for p in it["parameters"]] == [p.get("stated") for p in whole["parameters"]]
    assert {row["verdict"] for row in found} >= {"explained", "no_mismatch"}
    assert not list((out / "parts").rglob(".*")), "a part was left half written"


def test_killed_workers_and_a_killed_driver_lose_nothing(tmp_path: Path) -> None:
    paths = cases(tmp_path / "cases", 12, 3000)
    out = tmp_path / "out"
    arguments = ("explain", tmp_path / "cases", "--out", out, "--workers", "2")

    # The driver dies with some cases done.
    process = started(*arguments)
    wait(lambda: len(parts(out)) >= 2, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    before = {path: path.stat().st_mtime_ns for path in parts(out)}
    assert 2 <= len(before) < len(paths)

    # The next one goes on there, and a worker dies in the midst of its case.
    process = started(*arguments)

    def working() -> list[int]:
        return [pid for pid, command in descendants(process.pid).items() if command.startswith("ray::attempt")]

    victim = wait(working, process)[0]
    os.kill(victim, signal.SIGKILL)
    assert len(parts(out)) < len(paths), "everything was done before the worker was killed"
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, output + errors
    assert f"{len(before)} of {len(paths)} cases are done already" in errors
    assert f"{len(paths)} cases: " in output
    check_answers(out, paths)
    for path, changed in before.items():
        assert path.stat().st_mtime_ns == changed, "done again"

    # Nothing is left to do, so not even Ray is started.
    again = run(*arguments)
    assert again.returncode == 0 and f"{len(paths)} of {len(paths)} cases are done already" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.filterwarnings("ignore")
def test_a_lost_machine_loses_nothing(tmp_path: Path) -> None:
    from ray.cluster_utils import Cluster

    paths = cases(tmp_path / "cases", 6, 3000)
    out = tmp_path / "out"
    about: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80_000_000}
    cluster: Any = Cluster(initialize_head=True, head_node_args=about | {"include_dashboard": False})
    try:
        second = cluster.add_node(**about)
        process = started("explain", tmp_path / "cases", "--out", out, "--address", cluster.address)
        wait(lambda: parts(out), process)
        cluster.remove_node(second, allow_graceful=False)
        assert len(parts(out)) < len(paths), "everything was done before the machine was lost"
        output, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        cluster.shutdown()
    assert process.returncode == 0, output + errors
    check_answers(out, paths)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """Three cases, one of them broken, that have been run."""
    directory = tmp_path_factory.mktemp("small")
    cases(directory / "cases", 2, 1200)
    broken = directory / "cases" / "broken.toml"
    broken.write_text('format = "schuler-case/1"\n[recording]\npath = 5\n')
    (directory / "cases" / "plan.toml").write_text('format = "schuler-plan/1"\n')
    out = directory / "out"
    done = run("explain", directory / "cases", "--out", out, "--workers", "2")
    assert done.returncode == 3, done.stdout + done.stderr
    assert "broken.toml:2: recording.time: missing" in done.stdout
    yield directory, out


def test_what_is_wrong_with_one_case_is_its_own(small: tuple[Path, Path]) -> None:
    directory, out = small
    found = {Path(row["case"]).name: row for row in rows(out)}
    assert set(found) == {"broken.toml", "case_00.toml", "case_01.toml"}
    broken = found.pop("broken.toml")
    assert broken["status"] == "bad_input" and broken["answer"] is None and broken["verdict"] is None
    with pytest.raises(ValueError) as raised:
        schuler.explain(directory / "cases" / "broken.toml")
    assert broken["error"] == str(raised.value)
    assert {row["status"] for row in found.values()} == {"answered"}


def test_what_has_changed_is_done_again(small: tuple[Path, Path]) -> None:
    directory, out = small
    before = {row["case"]: row for row in rows(out)}
    changed = write_case(directory / "cases", "case_00", 0, 1200, coefficient=0.1)
    names = directory / "list.txt"
    names.write_text("# what to do\ncases/case_0*.toml\n\ncases/case_01.toml\n")
    done = run("explain", "--list", names, "--out", out, "--workers", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 2 cases are done already" in done.stderr
    after = {row["case"]: row for row in rows(out)}
    assert len(after) == 2
    for case, row in after.items():
        assert (row == before[case]) is (case != str(changed))
    assert after[str(changed)]["verdict"] == "explained"


def test_a_campaign_in_shards_is_the_campaign(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        'format = "schuler-plan/1"\ntitle = "Two"\nmost_rows = 1200\n[[group]]\nname = "nothing"\ncases = 1\n'
        '[[group]]\nname = "additive"\ncases = 2\nfamilies = ["additive"]\n'
    )
    out = tmp_path / "out"
    arguments = ("campaign", plan, "--seed", "7", "--seed", "8", "--only", "0", "2", "--out", out, "--workers", "2")
    done = run(*arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    found = rows(out)
    assert [(row["seed"], row["index"]) for row in found] == [(7, 0), (7, 2), (8, 0), (8, 2)]
    for seed in (7, 8):
        expected = [schuler.campaign_case(plan, seed=seed, index=index) for index in (0, 2)]
        scores = [json.loads(row["answer"]) for row in found if row["seed"] == seed]
        for score, whole in zip(scores, expected, strict=True):
            # How long it took, nobody can repeat, and every answer is sealed with a number drawn for it.
            assert set(score) == set(whole)
            for name in set(score) - {"time_s", "fingerprint"}:
                assert score[name] == dict(whole)[name], name
        summary = json.loads((out / f"summary-{seed}.json").read_text())
        assert summary == schuler.campaign_summary(plan, scores)


def test_wrong_arguments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from schuler import fleet

    plan = tmp_path / "plan.toml"
    plan.write_text('format = "schuler-plan/1"\ntitle = "One"\n[[group]]\nname = "nothing"\ncases = 1\n')
    expected: list[tuple[list[str | Path], str]] = [
        (["explain"], "found no case; expected case files"),
        (["explain", tmp_path / "absent"], "found no case; expected a case file, a directory or a pattern"),
        (["explain", "--list", tmp_path / "absent"], "cannot read the list: No such file"),
        (["explain", plan, "--probability", "2"], "--probability: found 2.0; expected a probability"),
        (["explain", plan, "--workers", "0"], "--workers: found 0; expected at least 1"),
        (["campaign", tmp_path / "absent", "--seed", "1"], "No such file"),
        (["campaign", plan, "--seed", "1", "--only", "1"], "--only: found 1; expected a number below 1"),
    ]
    for arguments, message in expected:
        with pytest.raises(SystemExit) as ended:
            fleet.main([*map(str, arguments), "--out", str(tmp_path / "out")])
        assert ended.value.code == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
