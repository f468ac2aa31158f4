"""Writes the error filter and the determinants to fifty digits (mpmath, fractions), which crates/schuler-core/tests/numerics.rs
compares its double-double reference with.

    make_precision.py > crates/schuler-core/tests/fifty_digits.txt

Ten hours of the filter of FILTER (FIL-3 and FIL-5 to FIL-8): Φ is the exponential of F Δ, Q the integral of Φ(s) L Φ(s)ᵀ by Gauss-Legendre
quadrature (the Rust reference takes both from one exponential of Van Loan's block). Determinants of [A y] without a row (FDI-3)
are rational numbers. Each line: what, its input or step, and numbers as two doubles whose sum has 106 bits. Needs mpmath
(1.4.1; with gmpy2 it takes a quarter of a minute).
"""

import fractions
import functools
import itertools
import struct

import mpmath
from mpmath import mp

mp.dps = 50
STEPS = 36_000
SHOWN = (1, 2, 60, 600, 601, 3600, 21_600, STEPS)
AXES = [
    [0.97204, 0.0, -0.23482],
    [-0.60075, -0.77653, -0.18997],
    [0.0, 0.47992, 0.87731],
    [0.0, -0.47992, 0.87731],
    [-0.60075, 0.77653, -0.18997],
]


def single(value):
    """The number of single precision that the flight configuration has."""
    return struct.unpack("f", struct.pack("f", value))[0]


def pair(value):
    """A number as the double nearest to it and the double nearest to what is left."""
    high = float(value)
    return f"{high!r} {float(value - type(value)(high))!r}"


def velocity(step):
    """What is measured: exact in single precision, a quarter of a metre a second at most; missing at times."""
    if step % 7 == 3 or 601 <= step % 3600 <= 700:
        return None
    return ((step * 2654435761) % 2**20) / 2**21 - 0.25


def filter_lines():
    radius, gravity, noise = 6_371_000.0, single(9.80665), single(0.1)
    accelerometer, gyro = (single(9.80665e-4), 60.0), (single(4.84814e-7), 1800.0)
    first = (single(0.1), single(1e-4), accelerometer[0], gyro[0])
    rates = mpmath.matrix(4, 4)
    rates[0, 1], rates[0, 2] = -mpmath.mpf(gravity), 1
    rates[1, 0], rates[1, 3] = 1 / mpmath.mpf(radius), 1
    rates[2, 2], rates[3, 3] = -1 / mpmath.mpf(accelerometer[1]), -1 / mpmath.mpf(gyro[1])
    levels = mpmath.diag([0, 0, *(2 * mpmath.mpf(sigma) ** 2 / tau for sigma, tau in (accelerometer, gyro))])

    @functools.cache
    def spread(age):
        moved = mpmath.expm(rates * age, method="taylor")
        return moved * levels * moved.T

    transition = mpmath.expm(rates, method="taylor")
    def integral(i, j):
        return mpmath.quad(lambda age: spread(age)[i, j], [0, 1], method="gauss-legendre")

    f = [[transition[i, j] for j in range(4)] for i in range(4)]
    q = [[integral(i, j) for j in range(4)] for i in range(4)]
    p = [[mpmath.mpf(first[i]) ** 2 if i == j else mpmath.mpf(0) for j in range(4)] for i in range(4)]
    x = [mpmath.mpf(0)] * 4
    variance = mpmath.mpf(noise) ** 2
    four = range(4)
    for step in range(1, STEPS + 1):
        x = [sum(f[i][k] * x[k] for k in four) for i in four]
        fp = [[sum(f[i][k] * p[k][j] for k in four) for j in four] for i in four]
        p = [[sum(fp[i][k] * f[j][k] for k in four) + q[i][j] for j in four] for i in four]
        measured = velocity(step)
        if measured is not None:
            gain = [p[i][0] / (p[0][0] + variance) for i in four]
            innovation = measured - x[0]
            x = [x[i] + gain[i] * innovation for i in four]
            p = [[p[i][j] - gain[i] * p[0][j] for j in four] for i in four]
        if step in SHOWN:
            upper = [p[i][j] for i in four for j in range(i, 4)]
            yield f"filter {step} " + " ".join(pair(number) for number in (*x, *upper))


def determinant(rows):
    """By the sum over all permutations."""
    total = fractions.Fraction(0)
    for order in itertools.permutations(range(4)):
        inversions = sum(a > b for a, b in itertools.combinations(order, 2))
        product = fractions.Fraction((-1) ** inversions)
        for row, column in enumerate(order):
            product *= rows[row][column]
        total += product
    return total


def determinant_lines():
    for trial in range(1, 21):
        rate = (0.0, 7.3e-5, 0.5)[trial % 3]
        direction = (0.6, -0.64, 0.48)
        readings = [
            rate * sum(a * b for a, b in zip(axis, direction)) + 1e-7 * (((trial * 5 + k) * 2654435761 % 2**20) / 2**19 - 1)
            for k, axis in enumerate(AXES)
        ]
        rows = [[fractions.Fraction(number) for number in (*axis, reading)] for axis, reading in zip(AXES, readings)]
        exact = [determinant([row for k, row in enumerate(rows) if k != removed]) for removed in range(5)]
        yield f"determinants {' '.join(map(repr, readings))} " + " ".join(pair(value) for value in exact)


if __name__ == "__main__":
    for line in itertools.chain(filter_lines(), determinant_lines()):
        print(line)
