"""Gives every case to `schuler explain --json` and scores the answers by the bars of the design.

    score.py --schuler BINARY --cases DIR --answers DIR [--processes 2] [--out DIR] [--again]

Answers of the tool are kept in --out; those that are there are not asked for again unless --again is given.
"""

import argparse
import json
import subprocess
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from units import factor

LEAST_GAIN = 12.0  # nats from which an effect has to be found
VERDICTS = ("explained", "partly_explained", "no_mismatch", "unexplained")


def run(schuler, case, out, again):
    kept = out / f"{case.name}.json"
    if kept.exists() and not again:
        return json.loads(kept.read_text())
    began = time.monotonic()
    try:
        command = [schuler, "explain", case / "case.toml", "--json", "-q"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=1800)
        status, output, errors = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        status, output, errors = -1, "", "more than half an hour"
    result = {"status": status, "seconds": time.monotonic() - began, "stderr": errors[-2000:]}
    try:
        result["explanation"] = json.loads(output)
    except json.JSONDecodeError as error:
        result["explanation"] = None
        result["stderr"] += f" [JSON: {error}]"
    kept.write_text(json.dumps(result))
    return result


def faults_of_form(result):
    """What in an answer is not as RECORDING has it."""
    faults = []
    if result["status"] != 0:
        return [f"status {result['status']}: {result['stderr'].strip()[-300:]}"]
    answer = result["explanation"]
    if answer is None:
        return ["no JSON"]
    if answer.get("format") != "schuler-explanation/2":
        faults.append("format")
    if answer.get("verdict") not in VERDICTS:
        faults.append(f"verdict {answer.get('verdict')}")
    if answer["verdict"] == "no_mismatch" and answer["findings"]:
        faults.append("no_mismatch with findings")
    if answer["verdict"] in ("explained", "partly_explained") and not answer["findings"]:
        faults.append(f"{answer['verdict']} without findings")
    for finding in answer["findings"]:
        for key in ("sensor", "effect", "probability", "class", "interval_s", "parameters", "evidence"):
            if key not in finding:
                faults.append(f"finding without {key}")
        if (finding["sensor"], finding["effect"]) != pairs(finding)[0]:
            faults.append("the finding is not the first of its class")
        if len(finding["interval_s"]) != 2 or not finding["interval_s"][0] <= finding["interval_s"][1]:
            faults.append(f"interval {finding['interval_s']}")
        for key in ("gain_nats", "p_value"):
            if not isinstance(finding["evidence"].get(key), (int, float)):
                faults.append(f"evidence {key}")
        for parameter in finding["parameters"]:
            if not {"name", "value", "sigma", "unit"} <= set(parameter):
                faults.append(f"parameter {parameter}")
            elif not isinstance(parameter["value"], str) and parameter["unit"] is not None and not knows(parameter["unit"]):
                faults.append(f"unit {parameter['unit']!r} of {finding['effect']} {parameter['name']}")
    for part in ("train", "held_out"):
        for when in ("before", "after"):
            for key in ("nll_per_sample", "rmse", "whiteness_p", "nis_mean"):
                if key not in answer["fit"].get(part, {}).get(when, {}):
                    faults.append(f"fit.{part}.{when}.{key}")
    return faults


def knows(unit):
    try:
        factor(unit)
        return True
    except ValueError:
        return False


def pairs(finding):
    """What a finding may be, itself first."""
    return [(member["sensor"], member["effect"]) for member in finding["class"]]


def names(finding, effect):
    return (finding["sensor"], finding["effect"]) == (effect["sensor"], effect["effect"])


def matches(finding, effect):
    named = set(pairs(finding))
    right = {(effect["sensor"], name) for name in (effect["effect"], *effect["also"])}
    return bool(named & (right | {tuple(pair) for pair in effect.get("also_at", [])}))


def assigned(findings, effects):
    """The finding of each effect, by their places. Of several, one that names the effect itself before one that has it in its class."""
    found = {}
    for match in (names, matches) if len(effects) > 1 else (matches,):
        for number, effect in enumerate(effects):
            free = (i for i, f in enumerate(findings) if i not in found.values() and match(f, effect))
            place = None if number in found else next(free, None)
            if place is not None:
                found[number] = place
    return found


def deviations(finding, effect):
    """(name, error over sigma) of the parameters that answer and finding both give, where the finding's name is right."""
    if not names(finding, effect):
        return
    for parameter in finding["parameters"]:
        name = parameter["name"]
        truth = effect["parameters"].get(name)
        per_unit = effect.get("per_unit")
        if truth is None and per_unit and name == "coefficient":
            truth = per_unit["coefficient"] / factor(per_unit["unit"])
        is_word = isinstance(parameter["value"], str)
        if truth is None or is_word or parameter.get("sigma") is None or not knows(parameter["unit"]):
            continue
        one = factor(parameter["unit"])
        value, sigma = parameter["value"] * one, parameter["sigma"] * one
        if effect["unsigned"] and name == "coefficient":
            value, truth = abs(value), abs(truth)
        yield name, (value - truth) / sigma if sigma > 0 else np.inf, value, truth


def wilson(right, count, z=1.96):
    if count == 0:
        return 0.0, 1.0
    share = right / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def stated(right, count):
    low, high = wilson(right, count)
    return f"{right:4} of {count:4}  {100 * right / max(count, 1):5.1f} %  ({100 * low:.1f} to {100 * high:.1f} %)"


def brief(findings):
    return "; ".join(f"{f['sensor']} {f['effect']} {f['evidence']['gain_nats']:.0f} nats"
                     + (f" [{', '.join(' '.join(pair) for pair in pairs(f)[1:])}]" if len(f["class"]) > 1 else "")
                     for f in findings) or "nothing"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schuler", required=True)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--only", type=lambda text: text.split(","), default=None)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    answers = {path.stem: json.loads(path.read_text()) for path in sorted(arguments.answers.glob("*.json"))}
    cases = [arguments.cases / name for name in answers if not arguments.only or name in arguments.only]
    with ThreadPoolExecutor(arguments.processes) as pool:
        results = list(pool.map(lambda case: run(arguments.schuler, case, arguments.out, arguments.again), cases))

    right, second, parameters, onsets = (defaultdict(lambda: [0, 0]) for _ in range(4))
    nulls, form, outside, seconds = [0, 0], [], [], []
    for case, result in zip(cases, results):
        answer = answers[case.name]
        label = f"{case.name} {answer['maker']} ({answer['rows']} rows of {answer['step_s']:g} s)"
        seconds.append((result["seconds"], label))
        faults = faults_of_form(result)
        if faults:
            form.append(label)
            print(f"FORM   {label}: {'; '.join(sorted(set(faults)))}")
        findings = (result["explanation"] or {}).get("findings", [])
        if answer["kind"] == "null":
            nulls[1] += 1
            if findings:
                nulls[0] += 1
                print(f"FALSE  {label}: {brief(findings)}")
            continue
        if answer["kind"] == "out_of_catalogue":
            verdict = (result["explanation"] or {}).get("verdict")
            outside.append(f"{label} {answer['effects'][0]['effect']}: {verdict}: {brief(findings)}")
            continue
        family, taken = answer["family"], set()
        finding_of = assigned(findings, answer["effects"])
        for number, effect in enumerate(answer["effects"]):
            found = finding_of.get(number)
            # Of one effect alone, the first finding has to be it.
            hit = found is not None and (len(answer["effects"]) > 1 or found == 0)
            if effect["gain_nats"] >= LEAST_GAIN:
                right[family][1] += 1
                right[family][0] += hit
                if not hit:
                    print(f"MISS   {label}: {effect['sensor']} {effect['effect']} {effect['gain_nats']:.0f} nats "
                          f"{ {k: f'{v:.4g}' for k, v in effect['parameters'].items()} }; said: {brief(findings)}")
            if found is None:
                continue
            taken.add(found)
            finding = findings[found]
            for name, deviation, value, truth in deviations(finding, effect):
                parameters[family][1] += 1
                parameters[family][0] += abs(deviation) <= 3
                if abs(deviation) > 3:
                    print(f"PARAM  {label}: {effect['effect']} {name} {value:.5g}, true {truth:.5g}, "
                          f"{deviation:.1f} sigma")
            if effect["onset_s"] is not None and finding["effect"] == effect["effect"]:
                off = abs(finding["interval_s"][0] - effect["onset_s"])
                onsets[family][1] += 1
                onsets[family][0] += off <= 0.02 * answer["duration_s"]
                if off > 0.02 * answer["duration_s"]:
                    print(f"ONSET  {label}: {effect['effect']} {effect['gain_nats']:.0f} nats: "
                          f"{finding['interval_s'][0]:.6g}, true {effect['onset_s']:.6g}")
        second[family][1] += 1
        beside = [f for i, f in enumerate(findings) if i not in taken]
        if beside and taken:
            second[family][0] += 1
            print(f"SECOND {label}: {brief(beside)}")
    print()
    for line in outside:
        print(f"OUTSIDE {line}")
    for title, table in (("right", right), ("false beside a true one", second), ("parameters within 3 sigma", parameters),
                         ("onsets within 2 %", onsets)):
        print(f"\n{title}")
        for family in sorted(table):
            print(f"  {family:12} {stated(*table[family])}")
        print(f"  {'all':12} {stated(*(sum(t[i] for t in table.values()) for i in (0, 1)))}")
    print(f"\nfalse where nothing is hidden  {stated(*nulls)}")
    print(f"faults of form {len(form)} of {len(cases)}")
    slow = sorted(seconds, reverse=True)
    print(f"seconds: median {np.median([s for s, _ in slow]):.2f}; slowest " + "; ".join(f"{s:.1f} {l}" for s, l in slow[:4]))


if __name__ == "__main__":
    main()
