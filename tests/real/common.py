"""What the independent calculations share: where the recordings are, generalised least squares, the answer's form."""

import json
import os
import sys
from pathlib import Path

import numpy as np

PROJECT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCHULER_DATA", PROJECT / "../shared/data"))
STANDARD_GRAVITY = 9.80665
# Descriptions whose scores differ by less are not told apart, and a parameter that gains less is not seen.
ALIKE_NATS = 6.0
LEAST_NATS = 6.0
# Sensors of the pump testbed: column and unit.
SKAB = {"vibration_1": ("Accelerometer1RMS", "g"), "vibration_2": ("Accelerometer2RMS", "g"), "current": ("Current", "A"),
        "pressure": ("Pressure", "bar"), "motor_temperature": ("Temperature", "degC"), "fluid_temperature": ("Thermocouple", "degC"),
        "voltage": ("Voltage", "V"), "flow": ("Volume Flow RateRMS", "l/min")}


def cross_with_axes(v):
    """The three derivatives of v x r with respect to r: (rows, 3 components, 3 elements of r)."""
    return np.stack([np.cross(v, axis) for axis in np.eye(3)], axis=2)


def autoregression(residual, order, sigmas=None):
    """Coefficients and innovation deviation of an autoregression, by least squares over the rows that are complete."""
    lags = np.column_stack([residual[order - k - 1 : len(residual) - k - 1] for k in range(order)])
    known = np.isfinite(lags).all(axis=1) & np.isfinite(residual[order:])
    weights = np.ones(len(lags)) if sigmas is None else 1 / sigmas
    weighted = (lags * weights[:, None])[known], (residual[order:] * weights)[known]
    coefficients = np.linalg.lstsq(*weighted, rcond=None)[0]
    innovation = residual[order:][known] - lags[known] @ coefficients
    return coefficients, np.sqrt(np.mean(innovation**2))


def whiten(values, coefficients):
    order = len(coefficients)
    out = values[order:].copy()
    for k, coefficient in enumerate(coefficients):
        out -= coefficient * values[order - k - 1 : len(values) - k - 1]
    return out


def by_eighths(innovations, shaken):
    """The innovations' deviation in each eighth of the values of a quantity, by rows."""
    edges = np.quantile(shaken, np.arange(1, 8) / 8)
    eighth = np.searchsorted(edges, shaken)
    deviations = [np.sqrt(np.nanmean(innovations[eighth == k] ** 2)) for k in range(8)]
    return np.array(deviations)[eighth]


def long_run_covariance(scores):
    """Covariance of the sum of the rows: autocovariances under Bartlett's weights, 4 (n/100)^(2/9) lags."""
    lags = int(4 * (len(scores) / 100) ** (2 / 9))
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1 - lag / (lags + 1)) * (product + product.T)
    return total


class Fit:
    """Generalised least squares of several channels on common regressors.

    Each channel's noise is an autoregression of its own, of the given order, estimated in turns with the coefficients
    (Cochrane and Orcutt). `channels` is a list of (y, X) with equal columns and rows in all X; NaN = missing.

    `sigmas` do not trust that autoregression: they are those of the sandwich of Newey and West (1987, lags of 1994) where
    these are larger.

    `shaken` is a quantity that the noise may be louder by, one value a row: the innovations have a deviation of their own in
    each eighth of its values.
    """

    def __init__(self, channels, order, rounds=8, shaken=None):
        columns = channels[0][1].shape[1]
        complete = [np.isfinite(y) & np.isfinite(X).all(axis=1) for y, X in channels]
        stacked_y = np.concatenate([y[ok] for (y, _), ok in zip(channels, complete)])
        stacked_x = np.vstack([X[ok] for (_, X), ok in zip(channels, complete)])
        self.coefficients = np.linalg.lstsq(stacked_x, stacked_y, rcond=None)[0]
        for _ in range(rounds):
            normal, right, self.noise, likelihood = np.zeros((columns, columns)), np.zeros(columns), [], 0.0
            whitened = []
            for y, X in channels:
                residual = y - X @ self.coefficients
                coefficients, sigma = autoregression(residual, order)
                sigmas = np.full(len(y) - order, sigma)
                if shaken is not None:
                    sigmas = by_eighths(whiten(residual, coefficients), shaken[order:])
                    coefficients, _ = autoregression(residual, order, sigmas)
                wy, wx = whiten(y, coefficients) / sigmas, whiten(X, coefficients) / sigmas[:, None]
                known = np.isfinite(wy) & np.isfinite(wx).all(axis=1)
                normal += wx[known].T @ wx[known]
                right += wx[known].T @ wy[known]
                likelihood -= np.log(sigmas[known]).sum()
                self.noise.append((coefficients, sigma, int(known.sum())))
                whitened.append((np.where(known, wy, 0.0), np.where(known[:, None], wx, 0.0)))
            scale = np.sqrt(np.diag(normal))
            self.covariance = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)
            self.coefficients = self.covariance @ right
        scores = sum(wx * (wy - wx @ self.coefficients)[:, None] for wy, wx in whitened)
        sandwich = self.covariance @ long_run_covariance(scores) @ self.covariance
        self.sigmas = np.sqrt(np.maximum(np.diag(self.covariance), np.diag(sandwich)))
        self.log_likelihood = likelihood
        # Schwarz's, in nats.
        self.score = likelihood - 0.5 * columns * np.log(sum(known for *_, known in self.noise))
        self.residuals = [y - X @ self.coefficients for y, X in channels]

    def innovations(self, channel=0):
        coefficients, _, _ = self.noise[channel]
        return whiten(self.residuals[channel], coefficients)


def held_out_gain(channels, order, nuisance, share=0.7, gap=50):
    """Nats per sample that the regressors beyond `nuisance` gain on the last part, fitted on the first."""
    rows = len(channels[0][0])
    end = int(share * rows)
    train = [(y[:end], X[:, :][:end]) for y, X in channels]
    test = [(y[end + gap :], X[end + gap :]) for y, X in channels]

    def nll(columns):
        fit = Fit([(y, X[:, columns]) for y, X in train], order)
        total, count = 0.0, 0
        for (y, X), (coefficients, sigma, _) in zip(test, fit.noise):
            error = whiten(y - X[:, columns] @ fit.coefficients, coefficients)
            error = error[np.isfinite(error)]
            total += np.sum(0.5 * (error / sigma) ** 2 + np.log(sigma))
            count += len(error)
        return total / count

    return nll(nuisance) - nll(list(range(channels[0][1].shape[1])))


class Report:
    """Estimates by case, printed as JSON."""

    def __init__(self, name):
        self.set, self.cases = name, {}

    def case(self, name):
        return self.cases.setdefault(name, {"estimates": [], "names": {}, "required": [], "remarks": []})

    def estimate(self, case, sensor, effect, parameter, value, sigma, unit, gain=None, **more):
        """An estimate; `gain` in nats, by default that of the parameter alone."""
        gain = 0.5 * (value / sigma) ** 2 if gain is None else gain
        row = {"sensor": sensor, "effect": effect, "parameter": parameter, "value": float(value)}
        row |= {"sigma": float(sigma), "unit": unit, "gain_nats": float(gain)} | more
        self.case(case)["estimates"].append(row)

    def allow(self, case, sensor, *effects):
        """Names that describe rightly what is there."""
        names = self.case(case)["names"].setdefault(sensor, [])
        names.extend(effect for effect in effects if effect not in names)

    def require(self, case, sensor, effect):
        """What is beyond doubt, by one of its names (a|b): an explanation without it is not one."""
        self.allow(case, sensor, *effect.split("|"))
        self.case(case)["required"].append([sensor, effect])

    def remark(self, case, text):
        self.case(case)["remarks"].append(text)

    def print(self):
        json.dump({"set": self.set, "cases": self.cases}, sys.stdout, indent=1)
        print()
