"""Adds up the terms of a model that is data (schuler-model/1), written from the documentation of the format alone.

Usage: read_model.py model.json inputs.csv. Terms that go through a delay or a bandwidth are left out.
"""
import json
import sys

import numpy as np

FUNCTIONS = {
    "power": lambda x, it: x ** it["exponent"],
    "magnitude": lambda x, it: np.abs(x),
    "sign": lambda x, it: np.sign(x),
    "step": lambda x, it: (x >= 0.0).astype(float),
    "ramp": lambda x, it: np.maximum(x, 0.0),
    "decay": lambda x, it: np.exp(-x / it["tau_s"]),
    "cosine": lambda x, it: np.cos(2.0 * np.pi * it["frequency_hz"] * x),
    "sine": lambda x, it: np.sin(2.0 * np.pi * it["frequency_hz"] * x),
    "dead_zone": lambda x, it: np.where(np.abs(x) < it["threshold"], -x, 0.0),
    "clipped": lambda x, it: np.clip(x, -it["limit"], it["limit"]) - x,
}


def named(word):
    """A word, or a word with its parameters."""
    return (word, {}) if isinstance(word, str) else next(iter(word.items()))


def summed(signal, inputs):
    total = 0.0 * inputs["time_s"]
    for product in signal["sum"]:
        value = product["coefficient"] + 0.0 * total
        for factor in product["factors"]:
            x = sum(it["weight"] * inputs[it["input"]] for it in factor["of"]) - factor["reference"]
            name, it = named(factor["function"])
            value = value * FUNCTIONS[name](x, it)
        total = total + value
    return total


def through(memory, it, t, x):
    y = x.copy()
    played = x[0]
    for k in range(len(x)):
        if memory == "lag" and k > 0:
            h, tau = t[k] - t[k - 1], it["tau_s"]
            slope = (x[k] - x[k - 1]) / h
            # Particular solution for a straight line, and what decays of the difference.
            y[k] = x[k] - slope * tau + np.exp(-h / tau) * (y[k - 1] - x[k - 1] + slope * tau)
        elif memory == "branch":
            played = min(max(played, x[k] - it["half_width"]), x[k] + it["half_width"])
            y[k] = (x[k] - played) / it["half_width"]
    return y


model = json.load(open(sys.argv[1]))
assert model["format"] == "schuler-model/1"
table = np.genfromtxt(sys.argv[2], delimiter=",", names=True)
inputs = {it["name"]: table[it["name"]] for it in model["inputs"]}
outputs = {it["sensor"]: 0.0 * inputs["time_s"] for it in model["outputs"]}
for term in model["terms"]:
    signal = term["signal"]
    x = summed(signal, inputs)
    if "memory" in signal:
        memory, it = named(signal["memory"])
        if memory not in ("lag", "branch"):
            continue
        x = through(memory, it, inputs["time_s"], x)
    outputs[term["output"]] = outputs[term["output"]] + term["amplitude"] * x
print("time_s," + ",".join(str(k) for k in range(len(outputs))))
for row in zip(inputs["time_s"], *outputs.values()):
    print(",".join(repr(float(value)) for value in row))
