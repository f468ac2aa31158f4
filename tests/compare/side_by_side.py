"""Which method finds a concealed effect in coloured noise, and which finds effects that are not there: one table.

Run it by tests/compare/run. For each method, noise and amplitude: records with a false term, mean number of terms, exact set,
share of false among the terms chosen, the true term found, median time.
"""

import argparse
import json
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from methods import all_methods
from records import NOISES, TRUE_TERM, Record

AMPLITUDES = [0.0, 0.5, 0.25]


def run(method, seeds, amplitude, noise, rows):
    chosen, seconds = [], []
    for seed in range(seeds):
        record = Record(seed, amplitude, noise, rows)
        start = time.perf_counter()
        chosen.append(method(record))
        seconds.append(time.perf_counter() - start)
    found = [any(term.startswith(TRUE_TERM) for term in terms) for terms in chosen]
    named = [TRUE_TERM in terms for terms in chosen]
    false = [sum(not term.startswith(TRUE_TERM) for term in terms) for terms in chosen]
    if amplitude == 0.0:
        false = [len(terms) for terms in chosen]
    total = sum(map(len, chosen))
    return {
        "records": seeds,
        "with_false_term": float(np.mean([count > 0 for count in false])),
        "mean_terms": float(np.mean([len(terms) for terms in chosen])),
        "exact": float(np.mean([f and not wrong for f, wrong in zip(found, false)])),
        "false_share": sum(false) / total if total else 0.0,
        "found": float(np.mean(found)),
        "named": float(np.mean(named)),
        "median_s": float(np.median(seconds)),
        "chosen": chosen,
    }


def percent(share):
    return f"{100 * share:.0f} %"


def table(results, ours):
    print("| method | noise | null records with a false term (terms) | A = 0.5: found / exact set / false discoveries | "
          "A = 0.25: found / exact set / false discoveries | time of a record (ratio to ours) |")
    print("| --- | --- | --- | --- | --- | --- |")
    for (method, noise), by_amplitude in results.items():
        null = by_amplitude[0.0]
        cells = [f"{percent(null['with_false_term'])} ({null['mean_terms']:.1f})"]
        for amplitude in AMPLITUDES[1:]:
            r = by_amplitude[amplitude]
            cells.append(f"{percent(r['found'])} / {percent(r['exact'])} / {percent(r['false_share'])}")
        seconds = np.median([r["median_s"] for r in by_amplitude.values()])
        own = results.get((ours, noise))
        ratio = f" ({seconds / np.median([r['median_s'] for r in own.values()]):.2g})" if own else ""
        print(f"| {method} | {noise} | {' | '.join(cells)} | {seconds:.2g} s{ratio} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schuler", default="target/release/schuler", help="the command")
    parser.add_argument("--seeds", type=int, default=50, help="records of each kind")
    parser.add_argument("--hours", type=float, default=24.0, help="length of a record")
    parser.add_argument("--only", help="comma-separated parts of names of methods")
    parser.add_argument("--noises", default=",".join(NOISES), help="comma-separated")
    parser.add_argument("--json", type=Path, help="where to write every choice of every method")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    methods = all_methods(options.schuler)
    if options.only:
        methods = {name: m for name, m in methods.items() if any(part in name for part in options.only.split(","))}
    results = {}
    for noise in options.noises.split(","):
        for name, method in methods.items():
            print(f"{name}, {noise}", file=sys.stderr)
            results[name, noise] = {a: run(method, options.seeds, a, noise, int(3600 * options.hours)) for a in AMPLITUDES}
    table(results, "schuler explain")
    if options.json:
        options.json.write_text(json.dumps([{"method": m, "noise": n, **{str(a): r for a, r in by.items()}}
                                            for (m, n), by in results.items()], indent=1))


if __name__ == "__main__":
    main()
