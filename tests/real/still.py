"""A triad of accelerometers at rest in many attitudes: where it is at rest, and what it is from |f| = g alone.

The first axis of the frame is that of the first accelerometer, the second lies in the plane of the first two: three scale factors,
three angles, three biases. Gauss and Newton's method on the magnitudes of the means.
"""

import numpy as np
import pandas as pd
from common import STANDARD_GRAVITY

# Elements of the matrix that are free, row by row.
FREE = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


def standstills(rates, length, quietest):
    """(first, last) rows of stretches of at least `length` rows in which the rates' deviation over `length` rows stays below
    `quietest`; the ends of a stretch, where the motion begins, are left out."""
    deviation = np.linalg.norm(pd.DataFrame(rates).rolling(length, center=True).std().to_numpy(), axis=1)
    quiet = np.nan_to_num(deviation, nan=np.inf) < quietest
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    stretches = [(a + length // 4, b - length // 4) for a, b in zip(edges[::2], edges[1::2])]
    return [(a, b) for a, b in stretches if b - a >= length // 2]


def self_calibration(means, gravity=STANDARD_GRAVITY):
    """(matrix, bias, sigmas of both, true forces): mean = (1 + matrix) force + bias."""
    parameters = np.zeros(9)

    def forces(parameters):
        matrix = np.eye(3)
        for (i, j), value in zip(FREE, parameters):
            matrix[i, j] += value
        return np.linalg.solve(matrix, (means - parameters[6:]).T).T

    def residual(parameters):
        return np.linalg.norm(forces(parameters), axis=1) - gravity

    for _ in range(20):
        there = residual(parameters)
        steps = np.eye(9) * 1e-6
        jacobian = np.column_stack([(residual(parameters + step) - there) / 1e-6 for step in steps])
        change = np.linalg.lstsq(jacobian, -there, rcond=None)[0]
        parameters = parameters + change
        if np.abs(change).max() < 1e-10:
            break
    left = residual(parameters)
    spread = np.sqrt(np.sum(left**2) / max(len(means) - 9, 1))
    sigmas = spread * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    matrix = np.zeros((3, 3))
    deviations = np.zeros((3, 3))
    for k, (i, j) in enumerate(FREE):
        matrix[i, j], deviations[i, j] = parameters[k], sigmas[k]
    true = forces(parameters)
    true *= gravity / np.linalg.norm(true, axis=1)[:, None]
    return matrix, parameters[6:], deviations, sigmas[6:], true, left
