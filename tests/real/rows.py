"""One row a real recording: what was known before, what is said, what an independent calculation bears out, what stays open.

    rows.py --cases FOLDER [--said RECORD.jsonl …] [--only SCRIPT …] --out records/real.toml

FOLDER holds what make_cases.py and more_cases.py write; a record is one of `schuler campaign freeze`. A finding is borne out if the
calculation allows its name on its sensor, by itself or by its class; of a case without a calculation nothing is said about that.
"""

import argparse
import json
import subprocess
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
SCRIPTS = ["gravimeter", "static_mems", "doppler", "gyro_array", "motion", "thermal", "poses", "at_rest", "turned_by_hand", "redundant",
           "clocks", "testbed", "pairs"]
# Estimates with less evidence are not in the table, nor more of a case than fit on a screen.
LEAST_NATS, MOST = 12.0, 30


def calculated(folder, kept, scripts):
    """Cases of the scripts; what a script printed is kept, and not calculated again."""
    cases = {}
    for script in scripts:
        path = kept / f"{script}.json"
        if not path.exists():
            done = subprocess.run([sys.executable, HERE / f"{script}.py", folder], capture_output=True, text=True, check=True)
            path.write_text(done.stdout)
        cases |= json.loads(path.read_text())["cases"]
    return cases


def is_borne_out(finding, names):
    """Members of a class are names on the finding's sensor, or `sensor effect`."""
    pairs = [(finding["sensor"], finding["effect"])]
    for member in finding.get("class", []):
        sensor, _, effect = member.rpartition(" ")
        pairs.append((sensor or finding["sensor"], effect))
    return any(effect in names.get(sensor, []) for sensor, effect in pairs)


def is_there(required, findings):
    sensor, effects = required
    def named(finding):
        return {finding["effect"], *finding.get("class", [])} & set(effects.split("|"))
    return any(finding["sensor"] == sensor and named(finding) for finding in findings)


def said(row, case):
    """What an engine says of a case, as a table of texts."""
    if "failure" in row:
        return {"failure": row["failure"]}
    findings = row["told"]
    nats = [f" ({f['gain_nats']:.0f})" if f.get("gain_nats") is not None else "" for f in findings]
    table = {"verdict": row["verdict"], "findings": [f"{f['sensor']} {f['effect']}{n}" for f, n in zip(findings, nats)]}
    if case:
        names = case["names"]
        table["not_borne_out"] = [f"{f['sensor']} {f['effect']}" for f in findings if not is_borne_out(f, names)]
        table["missing"] = [f"{s} {e}" for s, e in case["required"] if not is_there((s, e), findings)]
    return table | {"processor_s": row["processor_s"]}


def estimates(case):
    """Estimates with evidence, the strongest first, each name of a sensor once."""
    best = {}
    for row in case["estimates"]:
        key = row["sensor"], row["effect"], row["parameter"], row.get("axis"), row.get("column")
        if row["gain_nats"] >= LEAST_NATS and row["gain_nats"] > best.get(key, row | {"gain_nats": -1.0})["gain_nats"]:
            best[key] = row
    rows = sorted(best.values(), key=lambda row: -row["gain_nats"])
    def text(row):
        where = "".join(f" {row[key]}" for key in ("axis", "column") if row.get(key))
        return f"{row['sensor']} {row['effect']}{where} {row['parameter']} {row['value']:.4g} ± {row['sigma']:.1g} {row['unit']}"
    return [text(row) for row in rows[:MOST]]


def toml(value):
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(round(float(value), 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--said", type=Path, nargs="*", default=[])
    parser.add_argument("--only", nargs="*", default=SCRIPTS, help="calculations; without it all, which take half an hour")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    known = tomllib.loads((HERE / "known.toml").read_text())
    kept = arguments.cases / "calculated"
    kept.mkdir(exist_ok=True)
    cases = calculated(arguments.cases, kept, arguments.only)
    records, heads = {}, []
    for path in arguments.said:
        head, *rows = [json.loads(line) for line in path.read_text().splitlines()]
        heads.append(f"{head['engine']} at {head['commit']}, {head['date']}")
        for row in rows:
            records.setdefault(row["case"], {})[head["engine"]] = row
    text = "# Written by tests/real/rows.py; `known` and `open` stand in tests/real/known.toml.\n"
    text += f"engines = {toml(sorted(set(heads)))}\n"
    for folder, about in known.items():
        text += f"\n[set.{folder}]\nknown = {toml(about['known'])}\nopen = {toml(about['open'])}\n"
        names = sorted(name for name in {*cases, *records} if name.startswith(f"{folder}/"))
        for name in names:
            case = cases.get(name)
            text += f'\n[set.{folder}.case."{name.removeprefix(f"{folder}/")}"]\n'
            text += f"checked = {toml(estimates(case) if case else [])}\nremarks = {toml(case['remarks'] if case else [])}\n"
            for engine, row in sorted(records.get(name, {}).items()):
                text += "".join(f"{engine}.{key} = {toml(value)}\n" for key, value in said(row, case).items())
    tomllib.loads(text)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(text)


if __name__ == "__main__":
    main()
