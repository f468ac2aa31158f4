"""Many cases on many machines: `python -m schuler.fleet explain` and `python -m schuler.fleet campaign`, over Ray.

Needs the extra `fleet` (`pip install schuler[fleet]`). Without `--address` it starts a Ray of its own on this machine; with it,
cases must lie under the same paths on all machines of the cluster. Only this program writes results:

| | |
| --- | --- |
| `OUT/parts/` | what each case came to, written whole when it was done |
| `OUT/cases.parquet` | one row a case: verdict, answer, time, error |
| `OUT/findings.parquet` | one row a finding |
| `OUT/summary-SEED.json` | the figures of a campaign |

A case that has its part is not done again: whatever was stopped goes on where it was when it is started again with the same
arguments. It is done again where the case file, the table, the options or the version have changed, and where it was lost. A
worker that dies takes nothing with it: its case goes to another, at most `--retries` times, and is then `lost`.

Exit status: 0 every case was answered; 1 cases were lost or failed, or Ray cannot be had; 2 wrong arguments; 3 every case
was done, but some cannot be answered because of what stands in them; 130 stopped.
"""

import argparse
import contextlib
import enum
import fcntl
import glob
import hashlib
import json
import os
import re
import sys
import time
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import ray
from ray.exceptions import RayError

import schuler


class Status(enum.StrEnum):
    """What became of a case."""

    ANSWERED = "answered"
    """It has an answer."""
    BAD_INPUT = "bad_input"
    """It cannot be answered because of what stands in it; the error says what."""
    FAILED = "failed"
    """It should have been answered: a mistake in this package."""
    LOST = "lost"
    """Its worker died, and so did those after it."""


DONE = frozenset({Status.ANSWERED, Status.BAD_INPUT})
"""What is not tried again: the same input gives the same answer."""

CASES = pa.schema(
    [
        pa.field("case", pa.string(), nullable=False),
        pa.field("seed", pa.uint64()),
        pa.field("index", pa.uint32()),
        pa.field("status", pa.string(), nullable=False),
        pa.field("verdict", pa.string()),
        pa.field("findings", pa.uint32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("error", pa.string()),
        pa.field("answer", pa.string()),
        pa.field("fingerprint", pa.string(), nullable=False),
        pa.field("version", pa.string(), nullable=False),
    ]
)
"""One row a case. `answer` is the JSON document, `time_s` how long it took in seconds, `seed` and `index` a campaign's."""

PARAMETER = pa.struct(
    [
        pa.field("name", pa.string()),
        pa.field("value", pa.float64()),
        pa.field("sigma", pa.float64()),
        pa.field("unit", pa.string()),
        pa.field("text", pa.string()),
        pa.field("plausible", pa.bool_()),
        pa.field("stated", pa.float64()),
    ]
)

MEMBER = pa.struct(
    [
        pa.field("sensor", pa.string()),
        pa.field("effect", pa.string()),
        pa.field("probability", pa.float64()),
        pa.field("separated_by", pa.string()),
    ]
)

FINDINGS = pa.schema(
    [
        pa.field("case", pa.string(), nullable=False),
        pa.field("seed", pa.uint64()),
        pa.field("index", pa.uint32()),
        pa.field("rank", pa.uint32(), nullable=False),
        pa.field("sensor", pa.string(), nullable=False),
        pa.field("effect", pa.string(), nullable=False),
        pa.field("probability", pa.float64()),
        pa.field("class", pa.list_(MEMBER)),
        pa.field("start_s", pa.float64()),
        pa.field("end_s", pa.float64()),
        pa.field("gain_nats", pa.float64()),
        pa.field("p_value", pa.float64()),
        pa.field("parameters", pa.list_(PARAMETER)),
        pa.field("sentence", pa.string()),
    ]
)
"""One row a finding, by their place in the answer `rank`; a campaign's have sensor and effect only."""


@dataclass(frozen=True)
class Job:
    """A case to be done."""

    case: str
    """Path of the case, or of the plan."""
    probability: float = 0.95
    """Probability of a false finding."""
    seed: int | None = None
    """Seed of the campaign."""
    index: int | None = None
    """Number of the case in the campaign."""

    @property
    def key(self) -> str:
        """Name of its parts."""
        return hashlib.sha256(json.dumps([self.case, self.seed, self.index]).encode()).hexdigest()[:32]

    def fingerprint(self) -> str:
        """What the answer depends on: a case file and a plan by their content, a table by size and time of change."""
        about: list[Any] = [schuler.__version__, self.probability, self.seed, self.index]
        try:
            text = Path(self.case).read_bytes()
            about.append(hashlib.sha256(text).hexdigest())
            table = Path(self.case).parent / tomllib.loads(text.decode())["recording"]["path"]
            stat = table.stat()
            about.extend([str(table), stat.st_size, stat.st_mtime_ns])
        except (OSError, ValueError, KeyError, TypeError):
            # A plan has no table; what else is wrong, the answer will say.
            pass
        return hashlib.sha256(json.dumps(about).encode()).hexdigest()


@dataclass(frozen=True)
class Result:
    """What a case came to."""

    status: Status
    time_s: float
    answer: str | None = None
    error: str | None = None


def attempt(job: Job) -> Result:
    """Does a case, in a worker. Nothing that is wrong with the case ends anything else."""
    start = time.perf_counter()
    answer: Any = None
    error = None
    status = Status.ANSWERED
    try:
        if job.seed is None or job.index is None:
            answer = schuler.explain(job.case, probability=job.probability)
        else:
            answer = schuler.campaign_case(job.case, seed=job.seed, index=job.index)
    except ValueError as wrong:
        status, error = Status.BAD_INPUT, str(wrong)
    except KeyboardInterrupt:
        # How Ray cancels.
        raise
    except BaseException as failure:
        # A panic is no Exception.
        status, error = Status.FAILED, f"{type(failure).__name__}: {failure}"
    time_s = time.perf_counter() - start
    return Result(status, time_s, None if answer is None else json.dumps(answer), error)


class Store:
    """The directory of the results."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.cases = out / "parts" / "cases"
        self.findings = out / "parts" / "findings"
        for directory in (self.cases, self.findings):
            directory.mkdir(parents=True, exist_ok=True)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else writes here meanwhile; the operating system gives the lock back whatever happens."""
        with open(self.out / ".lock", "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BlockingIOError(f"{self.out}: another fleet is writing here") from None
            # What a driver was writing when it was killed.
            for directory in (self.out, self.cases, self.findings):
                for half in directory.glob(".*.parquet.*"):
                    half.unlink()
            yield

    def is_done(self, job: Job) -> bool:
        """Whether the case has an answer to what it is now."""
        try:
            part = pq.read_table(self.cases / f"{job.key}.parquet", columns=["fingerprint", "status"]).to_pylist()
        except (OSError, pa.ArrowInvalid, KeyError):
            return False
        return len(part) == 1 and part[0]["fingerprint"] == job.fingerprint() and part[0]["status"] in DONE

    def keep(self, job: Job, fingerprint: str, result: Result) -> None:
        """Keeps a result. The row of the case comes last: with it the case is done."""
        answer = json.loads(result.answer) if result.answer is not None else {}
        found = [finding(job, rank, it) for rank, it in enumerate(answer.get("findings", []))]
        write(pa.Table.from_pylist(found, schema=FINDINGS), self.findings / f"{job.key}.parquet")
        row = {
            "case": job.case,
            "seed": job.seed,
            "index": job.index,
            "status": result.status.value,
            "verdict": answer.get("verdict"),
            "findings": len(found),
            "time_s": result.time_s,
            "error": result.error,
            "answer": result.answer,
            "fingerprint": fingerprint,
            "version": schuler.__version__,
        }
        write(pa.Table.from_pylist([row], schema=CASES), self.cases / f"{job.key}.parquet")

    def merge(self, jobs: Sequence[Job]) -> pa.Table:
        """Puts the parts of all cases together, in the order of the cases; returns the cases."""
        tables = []
        for directory, schema, name in ((self.findings, FINDINGS, "findings"), (self.cases, CASES, "cases")):
            parts = [directory / f"{job.key}.parquet" for job in jobs]
            table = pa.concat_tables([schema.empty_table(), *(pq.read_table(part) for part in parts if part.exists())])
            write(table, self.out / f"{name}.parquet")
            tables.append(table)
        return tables[-1]


def finding(job: Job, rank: int, found: Any) -> dict[str, Any]:
    """The row of a finding: a whole one, or the [sensor, effect] of a score."""
    row: dict[str, Any] = {"case": job.case, "seed": job.seed, "index": job.index, "rank": rank}
    if isinstance(found, list):
        return row | {"sensor": found[0], "effect": found[1]}
    start_s, end_s = found["interval_s"]
    columns = ("sensor", "effect", "probability", "class", "parameters", "sentence")
    row |= {name: found[name] for name in columns} | {"start_s": start_s, "end_s": end_s}
    row["parameters"] = [
        # A column of a table holds numbers or words.
        parameter | {"value": None, "text": parameter["value"]} if isinstance(parameter["value"], str) else parameter
        for parameter in found["parameters"]
    ]
    return row | dict(found["evidence"])


def write(table: pa.Table, path: Path) -> None:
    """Writes a file that is whole or not there."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with open(temporary, "wb") as file:
        pq.write_table(table, file, compression="zstd")
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


@dataclass(frozen=True)
class Cluster:
    """Where the work is done."""

    address: str | None = None
    """Address of a Ray that is there; None starts one on this machine."""
    workers: int | None = None
    """Cases at once; None: as many as there are processors."""
    retries: int = 3
    """How often a case is given to another worker when its worker has died."""
    object_store_mb: int = 100
    """Memory of the object store of a Ray that is started here, in 10⁶ bytes: only answers pass through it."""

    @contextlib.contextmanager
    def connected(self) -> Iterator[int]:
        """Connects, and says how many cases can be done at once."""
        # Every worker has one processor, so a case must not spread over all.
        environment = {"env_vars": {"RAYON_NUM_THREADS": "1"}}
        options: dict[str, Any] = {"runtime_env": environment, "log_to_driver": False, "logging_level": "ERROR"}
        if self.address is None:
            options |= {"num_cpus": self.workers, "object_store_memory": self.object_store_mb * 1_000_000}
            options |= {"include_dashboard": False}
        else:
            options |= {"address": self.address}
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        ray.init(**options)
        try:
            resources: dict[str, float] = ray.cluster_resources()
            yield self.workers or max(1, int(resources.get("CPU", 1)))
        finally:
            ray.shutdown()


def run(jobs: Sequence[Job], out: Path, cluster: Cluster, *, quiet: bool = False) -> pa.Table:
    """Does the cases that are not done yet, and returns the table of all, in the order of `jobs`.

    Raises BlockingIOError where another fleet writes into `out`, and ConnectionError where there is no Ray.
    """
    out.mkdir(parents=True, exist_ok=True)
    store = Store(out)
    with store.alone():
        waiting = [job for job in jobs if not store.is_done(job)]
        progress = Progress(len(jobs), len(jobs) - len(waiting), quiet)
        if waiting:
            with cluster.connected() as at_once:
                remote = ray.remote(num_cpus=1, max_retries=cluster.retries)(attempt)
                progress.start = time.monotonic()
                for job, fingerprint, result in results(remote, waiting, at_once):
                    store.keep(job, fingerprint, result)
                    progress.tell(result)
        return store.merge(jobs)


def results(remote: Any, jobs: Iterable[Job], at_once: int) -> Iterator[tuple[Job, str, Result]]:
    """The results as they come. Few more cases than can be done at once are handed out, so that an end comes soon."""
    waiting = iter(jobs)
    running: dict[Any, tuple[Job, str]] = {}
    while True:
        while len(running) <= at_once and (job := next(waiting, None)) is not None:
            # Before it is done: what changes meanwhile makes the answer stale.
            running[remote.remote(job)] = (job, job.fingerprint())
        if not running:
            return
        for reference in ray.wait(list(running), num_returns=1)[0]:
            job, fingerprint = running.pop(reference)
            try:
                result = ray.get(reference)
            except RayError as lost:
                result = Result(Status.LOST, 0.0, error=f"{type(lost).__name__}: {str(lost).splitlines()[0]}")
            yield job, fingerprint, result


class Progress:
    """Progress on standard error, at most a line a second."""

    def __init__(self, cases: int, done: int, quiet: bool) -> None:
        self.cases, self.done, self.before, self.quiet = cases, done, done, quiet
        self.bad = 0
        self.start = self.said = time.monotonic()
        if done and not quiet:
            print(f"schuler.fleet: {done} of {cases} cases are done already", file=sys.stderr)

    def tell(self, result: Result) -> None:
        """One more is done."""
        self.done += 1
        self.bad += result.status != Status.ANSWERED
        now = time.monotonic()
        if self.quiet or (now - self.said < 1.0 and self.done < self.cases):
            return
        self.said = now
        left_s = (now - self.start) / (self.done - self.before) * (self.cases - self.done)
        without = f", {self.bad} without an answer" if self.bad else ""
        print(f"schuler.fleet: {self.done} of {self.cases} cases{without}, {left_s:.0f} s left", file=sys.stderr)


def find(arguments: Sequence[str], lists: Sequence[str] = ()) -> list[str]:
    """Absolute paths of the cases that files, directories, patterns and lists of them name, each once, in order.

    Raises ValueError where one of them names no case.
    """
    entries = [(Path(), argument) for argument in arguments]
    for name in lists:
        try:
            lines = Path(name).read_text(encoding="utf-8").splitlines()
        except OSError as error:
            raise ValueError(f"{name}: cannot read the list: {error.strerror}") from None
        entries += [(Path(name).parent, line) for line in map(str.strip, lines) if line and not line.startswith("#")]
    found: dict[str, None] = {}
    for directory, entry in entries:
        path = directory / entry
        if path.is_dir():
            cases = [case for case in sorted(path.rglob("*.toml")) if is_case(case)]
        elif path.is_file():
            cases = [path]
        else:
            cases = [Path(match) for match in sorted(glob.glob(str(path), recursive=True)) if is_case(Path(match))]
        if not cases:
            raise ValueError(f"{path}: found no case; expected a case file, a directory or a pattern of them")
        found |= dict.fromkeys(str(case.absolute()) for case in cases)
    return list(found)


def is_case(path: Path) -> bool:
    """Whether a file means to be a case; what is wrong with it, the answer says."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return re.search(r"""^\s*format\s*=\s*["']schuler-case/""", text, re.MULTILINE) is not None


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m schuler.fleet", description="Many cases on many machines.")
    commands = parser.add_subparsers(dest="command", required=True)
    explain = commands.add_parser("explain", help="explain cases")
    explain.add_argument("cases", nargs="*", metavar="CASE", help="case file, directory of cases, or pattern")
    explain.add_argument("--list", action="append", default=[], metavar="FILE", help="file with one of these a line")
    explain.add_argument("--probability", type=float, default=0.95, help="from which on a finding is told")
    campaign = commands.add_parser("campaign", help="run campaigns of cases with concealed effects")
    campaign.add_argument("plan", help="plan file")
    campaign.add_argument("--seed", type=int, action="append", required=True, help="seed; several make several campaigns")
    campaign.add_argument("--only", type=int, nargs="+", metavar="CASE", help="only these cases")
    for command in (explain, campaign):
        command.add_argument("--out", "-o", type=Path, required=True, help="directory for the results")
        command.add_argument("--address", help="address of a Ray cluster; without it one is started here")
        command.add_argument("--workers", type=int, help="cases at once; by default one a processor")
        command.add_argument("--retries", type=int, default=3, help="retries of a case whose worker has died")
        command.add_argument("--object-store-mb", type=int, default=100, help="memory of the object store, 10^6 bytes")
        command.add_argument("--quiet", "-q", action="store_true", help="no progress")
    given = parser.parse_args(arguments)
    if given.workers is not None and given.workers < 1:
        parser.error(f"--workers: found {given.workers}; expected at least 1")
    if given.retries < 0:
        parser.error(f"--retries: found {given.retries}; expected at least 0")
    try:
        jobs = explanations(given) if given.command == "explain" else campaigns(given)
    except ValueError as error:
        parser.error(str(error))
    cluster = Cluster(given.address, given.workers, given.retries, given.object_store_mb)
    try:
        table = run(jobs, given.out, cluster, quiet=given.quiet)
    except KeyboardInterrupt:
        print("schuler.fleet: stopped; what was done is kept", file=sys.stderr)
        return 130
    except (OSError, RayError, RuntimeError) as error:
        print(f"schuler.fleet: {error}", file=sys.stderr)
        return 1
    if given.command == "campaign":
        summarise(table, given.out)
    return report(table, given.out)


def explanations(given: argparse.Namespace) -> list[Job]:
    """The cases to explain."""
    if not 0.0 < given.probability < 1.0:
        raise ValueError(f"--probability: found {given.probability}; expected a probability between 0 and 1")
    if not given.cases and not given.list:
        raise ValueError("found no case; expected case files, directories, patterns or --list")
    return [Job(case, probability=given.probability) for case in find(given.cases, given.list)]


def campaigns(given: argparse.Namespace) -> list[Job]:
    """The cases of the campaigns."""
    plan = str(Path(given.plan).absolute())
    cases = schuler.campaign_cases(plan)
    wrong = [index for index in given.only or [] if not 0 <= index < cases]
    if wrong:
        raise ValueError(f"--only: found {wrong[0]}; expected a number below {cases}")
    if any(not 0 <= seed < 1 << 53 for seed in given.seed):
        raise ValueError("--seed: expected a number from 0 to 2^53")
    return [Job(plan, seed=seed, index=index) for seed in given.seed for index in given.only or range(cases)]


def summarise(table: pa.Table, out: Path) -> None:
    """Writes the figures of each campaign."""
    scores: dict[int, list[Any]] = {}
    plan = ""
    for row in table.to_pylist():
        if row["answer"] is not None:
            plan = row["case"]
            scores.setdefault(row["seed"], []).append(json.loads(row["answer"]))
    for seed, of_seed in scores.items():
        path = out / f"summary-{seed}.json"
        temporary = path.with_name(f".{path.name}")
        temporary.write_text(json.dumps(schuler.campaign_summary(plan, of_seed), indent=1) + "\n", encoding="utf-8")
        os.replace(temporary, path)


def report(table: pa.Table, out: Path) -> int:
    """Says what came of it; returns the exit status."""
    rows = table.select(["case", "status", "verdict", "time_s", "error"]).to_pylist()
    verdicts: dict[str, int] = {}
    for row in rows:
        name = row["verdict"] or row["status"]
        verdicts[name] = verdicts.get(name, 0) + 1
    counts = ", ".join(f"{count} {name}" for name, count in sorted(verdicts.items()))
    print(f"{len(rows)} cases: {counts}; {sum(row['time_s'] for row in rows):.1f} s of work")
    for row in rows:
        if row["status"] != Status.ANSWERED:
            # Bad input names its file itself.
            print(f"  {row['error']}" if row["status"] == Status.BAD_INPUT else f"  {row['case']}: {row['error']}")
    print(f"{out / 'cases.parquet'}\n{out / 'findings.parquet'}")
    statuses = {row["status"] for row in rows}
    if statuses & {Status.LOST, Status.FAILED}:
        return 1
    return 3 if Status.BAD_INPUT in statuses else 0


if __name__ == "__main__":
    # By the module's own name, so that the workers import what they are to run.
    from schuler import fleet

    sys.exit(fleet.main())
