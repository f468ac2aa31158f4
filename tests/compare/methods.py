"""The methods: each takes a record and gives the names of the terms that it says are there."""

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pysindy
from records import TRUE_TERM
from scipy import stats
from statsmodels.stats.multitest import multipletests
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares


def stlsq(threshold):
    def select(record):
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold, alpha=0.0), feature_library=pysindy.IdentityLibrary()
        )
        centred = record.reading - record.reading.mean()
        model.fit(record.matrix, t=1.0, x_dot=centred[:, None], feature_names=record.names)
        return [name for name, value in zip(record.names, model.coefficients()[0]) if value != 0.0]
    return select


def ensemble(record):
    """Bagging of 20 models; terms that nine in ten of them hold."""
    optimiser = pysindy.EnsembleOptimizer(pysindy.STLSQ(threshold=0.1, alpha=0.0), bagging=True, n_models=20)
    model = pysindy.SINDy(optimizer=optimiser, feature_library=pysindy.IdentityLibrary())
    np.random.seed(0)
    model.fit(record.matrix, t=1.0, x_dot=(record.reading - record.reading.mean())[:, None])
    inclusion = np.mean(np.array(optimiser.coef_list)[:, 0, :] != 0.0, axis=0)
    return [name for name, share in zip(record.names, inclusion) if share >= 0.9]


def frols(model_type):
    def select(record):
        # The regressors are read at the row before (lag 1): they are smooth over a second.
        model = FROLS(
            order_selection=True, n_info_values=22, info_criteria="bic", ylag=1, xlag=[[1]] * len(record.names),
            estimator=LeastSquares(), basis_function=Polynomial(degree=1), model_type=model_type,
        )
        X, y = record.matrix, (record.reading - record.reading.mean())[:, None]
        if model_type == "NARMAX":
            model.elag = 1
        model.fit(X=X, y=y)
        chosen = []
        for code in np.ravel(model.final_model):
            # 1000 = constant, 1001 = y(k-1), 2001 = x1(k-1), 3001 = x2(k-1) ...
            regressor = int(code) // 1000
            if regressor >= 2:
                chosen.append(record.names[regressor - 2])
        return chosen
    return select


def of_means(method, length=10):
    """For methods that take too long with all rows: with the means of ten, which leaves the colour as it is."""
    return lambda record: method(record.means(length))


def least_squares(record):
    """Ordinary least squares, Benjamini and Hochberg at 5 %."""
    return significant(record, record.reading, record.matrix)


def gls_ar1(record):
    """Generalised least squares with first-order autoregressive errors, Benjamini and Hochberg at 5 %."""
    y, X = record.reading, record.matrix
    coefficients = np.zeros(X.shape[1])
    for _ in range(5):
        residual = y - X @ coefficients
        residual = residual - residual.mean()
        rho = residual[1:] @ residual[:-1] / (residual[:-1] @ residual[:-1])
        wy, wx = y[1:] - rho * y[:-1], X[1:] - rho * X[:-1]
        coefficients = np.linalg.lstsq(np.column_stack([np.ones(len(wy)), wx]), wy, rcond=None)[0][1:]
    return significant(record, wy, wx)


def significant(record, y, X):
    X = np.column_stack([np.ones(len(y)), X])
    inverse = np.linalg.inv(X.T @ X)
    coefficients = inverse @ X.T @ y
    variance = np.sum((y - X @ coefficients) ** 2) / (len(y) - X.shape[1])
    t = coefficients[1:] / np.sqrt(variance * np.diag(inverse)[1:])
    rejected = multipletests(2 * stats.norm.sf(np.abs(t)), alpha=0.05, method="fdr_bh")[0]
    return [name for name, sure in zip(record.names, rejected) if sure]


# What our answer calls the terms.
AUXILIARIES = {
    "temperature": "temperature", "temperature_2": "temperature", "voltage": "voltage", "current": "current",
    "pressure": "pressure", "field_x": "magnetic_field_x", "field_y": "magnetic_field_y", "field_z": "magnetic_field_z",
    "vibration": "vibration_rms", "speed": "speed", "humidity": "other", "light": "other",
}
CASE = """format = "schuler-case/1"
title = "record"
[recording]
path = "record.csv"
time = "t"
step_s = 1.0
[motion]
kind = "static"
attitude_deg = {{ roll = 0.0, pitch = 0.0, heading = 0.0 }}
[[sensor]]
id = "gyro"
kind = "fog"
column = "gyro"
unit = "deg/h"
axis = [0.0, 0.0, 1.0]
relative = true
[sensor.nominal]
white = 0.0
markov = {{ sigma = 1.0, tau_s = 300.0 }}
{auxiliaries}"""


def schuler(command):
    """`schuler explain` with what was recorded (its catalogue makes the terms, and many more); findings of noise are no terms.

    The nominal noise is the Markov process, whatever the record has. A finding counts as the true term when it is the
    sensor's dependence on the rate of the first temperature, or when that is in its class of what cannot be told apart.
    """
    def select(record):
        with tempfile.TemporaryDirectory() as folder:
            table = pd.DataFrame({"t": record.time, "gyro": record.reading, **record.auxiliaries})
            table.to_csv(Path(folder) / "record.csv", index=False, float_format="%.9g")
            auxiliaries = "".join(
                f'[[aux]]\ncolumn = "{name}"\nquantity = "{quantity}"\nunit = "degC"\n' for name, quantity in AUXILIARIES.items()
            )
            (Path(folder) / "case.toml").write_text(CASE.format(auxiliaries=auxiliaries))
            ran = subprocess.run([command, "explain", "--json", Path(folder) / "case.toml"], capture_output=True, text=True)
            if ran.returncode != 0:
                raise RuntimeError(ran.stderr.strip())
        terms = []
        for finding in json.loads(ran.stdout)["findings"]:
            if finding["effect"].startswith("noise_"):
                continue
            column = [p["value"] for p in finding["parameters"] if p["name"] == "column"]
            of_first = column in ([], ["temperature"])
            named = finding["effect"] == "bias_temperature_rate" and of_first
            in_class = any(member["effect"] == "bias_temperature_rate" for member in finding["class"]) and of_first
            terms.append(TRUE_TERM if named else f"{TRUE_TERM} (class)" if in_class else f"{finding['effect']} {column}")
        return terms
    return select


def all_methods(command):
    return {
        "pysindy STLSQ, threshold 0.1": stlsq(0.1),
        "pysindy STLSQ, threshold 0.3": stlsq(0.3),
        "pysindy ensemble, inclusion >= 0.9 (10 s means)": of_means(ensemble),
        "SysIdentPy FROLS, NFIR + BIC (10 s means)": of_means(frols("NFIR")),
        "SysIdentPy FROLS, NARMAX + BIC (10 s means)": of_means(frols("NARMAX")),
        "OLS + Benjamini-Hochberg": least_squares,
        "GLS with AR(1) + Benjamini-Hochberg": gls_ar1,
        "schuler explain": schuler(command),
    }
