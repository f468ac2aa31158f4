"""Writes cases as somebody else would who has read nothing but the description of the format and the list of effects.

    make_cases.py --cases DIR --answers DIR [--count 200] [--seed N] [--only EFFECT,...]

Every effect of the list has its turn, in an order drawn anew; one case in six hides nothing, one in twenty hides what no
list has. The answers stand in a folder of their own. The seed is drawn afresh unless it is given, and is printed.
"""

import argparse
import json
import secrets
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

import at_rest
import case_file
import in_motion
import in_noise
import schuler_loop
import several
import unknown_motion

MAKERS = {**at_rest.CATALOGUE, **in_noise.CATALOGUE, **in_motion.CATALOGUE, **unknown_motion.CATALOGUE,
          **schuler_loop.CATALOGUE, **several.CATALOGUE}


def plan(rng, count, only):
    """Names of makers, one for each case."""
    if only:
        return [only[index % len(only)] for index in range(count)]
    names = []
    while len(names) < count:
        round_ = list(rng.permutation(list(MAKERS))) + 3 * list(several.CATALOGUE)
        names += list(rng.permutation(round_ + ["nothing"] * (len(round_) // 5) + ["outside"] * (len(round_) // 16)))
    return [str(name) for name in names[:count]]


def make(task):
    index, name, seed, cases, answers = task
    rng = np.random.default_rng([seed, index])
    maker = {"nothing": several.nothing, "outside": several.outside, **MAKERS}[name]
    case = maker(rng)
    folder = f"case_{index:04}"
    case_file.write(case, rng, cases / folder)
    (answers / f"{folder}.json").write_text(json.dumps({"maker": name, **case.answer()}, indent=1))
    return folder


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, required=True)
    parser.add_argument("--answers", type=Path, required=True)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--only", type=lambda text: text.split(","), default=None)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    seed = secrets.randbelow(2**48) if arguments.seed is None else arguments.seed
    print(f"seed {seed}")
    for folder in (arguments.cases, arguments.answers):
        folder.mkdir(parents=True, exist_ok=True)
    names = plan(np.random.default_rng(seed), arguments.count, arguments.only)
    tasks = [(index, name, seed, arguments.cases, arguments.answers) for index, name in enumerate(names)]
    with ProcessPoolExecutor(arguments.processes) as pool:
        for _ in pool.map(make, tasks):
            pass


if __name__ == "__main__":
    main()
