"""Units of answers: `deg/h/(K/h)`, `ug/K^2`, `1/s` … as a factor to SI units."""

import re

import numpy as np

DEGREE = np.pi / 180.0
FACTORS = {
    "1": 1.0, "rad": 1.0, "deg": DEGREE, "arcsec": DEGREE / 3600, "mrad": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0,
    "ms": 1e-3, "K": 1.0, "degC": 1.0, "mK": 1e-3, "m": 1.0, "mm": 1e-3, "g": 9.80665, "mg": 9.80665e-3,
    "ug": 9.80665e-6, "mGal": 1e-5, "ppm": 1e-6, "%": 1.0, "V": 1.0, "A": 1.0, "mA": 1e-3,
    "Pa": 1.0, "hPa": 100.0, "kPa": 1000.0,
    "T": 1.0, "uT": 1e-6, "G": 1e-4, "Hz": 1.0, "sqrt(s)": 1.0, "sqrt(h)": 60.0, "√s": 1.0, "√h": 60.0,
}


def factor(unit):
    """Factor of a unit to SI units. Raises ValueError for what it does not know."""
    plain = unit.replace("²", "^2").replace("³", "^3").replace(" ", "·")
    tokens = re.findall(r"sqrt\(\w+\)|√\w+|[A-Za-z%]+|\d+|[/*·^()-]", plain)
    value, rest = product(tokens)
    if rest:
        raise ValueError(f"unit {unit!r}")
    return value


def product(tokens):
    value, tokens = power(tokens)
    while tokens and tokens[0] in "/*·":
        operator = tokens[0]
        other, tokens = power(tokens[1:])
        value = value / other if operator == "/" else value * other
    return value, tokens


def power(tokens):
    if not tokens:
        raise ValueError("unit ends early")
    if tokens[0] == "(":
        value, tokens = product(tokens[1:])
        tokens = tokens[1:]
    else:
        if tokens[0] not in FACTORS:
            raise ValueError(f"unit {tokens[0]!r}")
        value, tokens = FACTORS[tokens[0]], tokens[1:]
    if tokens and tokens[0] == "^":
        sign, tokens = (-1, tokens[2:]) if tokens[1] == "-" else (1, tokens[1:])
        value, tokens = value ** (sign * int(tokens[0])), tokens[1:]
    return value, tokens
