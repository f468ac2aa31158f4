"""Records with one concealed effect in coloured noise, and the terms that every method may choose from.

24 h at 1 Hz. What was recorded beside the sensor: two thermometers, voltage, current, pressure, three components of the
magnetic field, vibration, speed, humidity, light. Of these 21 terms are made, as an engineer would who fears what he fears. All are
smooth processes with correlation times of 5 min to 2 h, as such quantities are; the temperature has a daily cycle and
heating that comes and goes, so that it is apart from its rate. The effect is A times the standardised rate of the first
temperature; the noise has a standard deviation of 1.
"""

import copy

import numpy as np
from scipy.signal import lfilter

STEP_S = 1.0
TRUE_TERM = "dT/dt"
NOISES = ["markov", "markov + white", "exp-cos"]
TAU_S = 300.0
WHITE = 1.0
ALPHA, BETA = 1 / 600.0, 2 * np.pi / 900.0


def gauss_markov(random, rows, tau, settle=0):
    a = np.exp(-STEP_S / tau)
    drive = np.sqrt(1 - a * a) * random.standard_normal(rows + settle)
    start = random.standard_normal()
    return lfilter([1.0], [1.0, -a], drive, zi=[a * start])[0][settle:]


def smooth(random, rows, tau):
    """A second-order process: a Gauss-Markov process through a low-pass of the same time constant."""
    settle = int(10 * tau)
    a = np.exp(-STEP_S / tau)
    return standardised(lfilter([1 - a], [1.0, -a], gauss_markov(random, rows + settle, tau))[settle:])


def standardised(values):
    return (values - values.mean()) / values.std()


def noise(random, rows, kind):
    if kind == "exp-cos":
        a, angle = np.exp(-ALPHA * STEP_S), BETA * STEP_S
        drive = random.standard_normal(rows) + 1j * random.standard_normal(rows)
        start = random.standard_normal() + 1j * random.standard_normal()
        rotation = a * np.exp(1j * angle)
        state = lfilter([1.0], [1.0, -rotation], np.sqrt(1 - a * a) * drive, zi=[rotation * start])[0]
        return state.real
    values = gauss_markov(random, rows, TAU_S)
    return values + WHITE * random.standard_normal(rows) if kind == "markov + white" else values


class Record:
    """`auxiliaries`: what was recorded; `terms`: the 21 standardised candidates; `reading`."""

    def __init__(self, seed, amplitude, kind, rows=86_400):
        random = np.random.default_rng([seed, NOISES.index(kind)])
        time = STEP_S * np.arange(rows)
        hours = time / 3600
        phases = random.uniform(0, 2 * np.pi, 3)
        temperature = 25 + 4 * np.sin(2 * np.pi * hours / 24 + phases[0]) + 1.5 * smooth(random, rows, 1200.0)
        second = 30 + 3 * np.sin(2 * np.pi * hours / 24 + phases[1]) + 1.5 * smooth(random, rows, 1800.0)
        taus = {"voltage": 300, "current": 600, "pressure": 3600, "field_x": 400, "field_y": 800, "field_z": 1200,
                "vibration": 200, "speed": 500, "humidity": 2400, "light": 400}
        recorded = {name: smooth(random, rows, tau) for name, tau in taus.items()}
        keep = np.exp(-STEP_S / 5400)
        lagged = lfilter([1 - keep], [1, -keep], temperature - temperature[0])
        deviation = temperature - temperature.mean()
        terms = {
            "T": temperature, TRUE_TERM: np.gradient(temperature, STEP_S), "T^2": deviation**2, "T^3": deviation**3,
            "T lagged 5400 s": lagged, "T2 - T": second - temperature, "dT2/dt": np.gradient(second, STEP_S),
            **recorded, "vibration^2": recorded["vibration"] ** 2, "current^2": recorded["current"] ** 2,
            "t": time, "exp(-t/3600)": np.exp(-time / 3600),
        }
        assert len(terms) == 21
        self.time = time
        self.terms = {name: standardised(values) for name, values in terms.items()}
        self.auxiliaries = {"temperature": temperature, "temperature_2": second, **recorded}
        self.reading = amplitude * self.terms[TRUE_TERM] + noise(random, rows, kind)
        self.names = list(self.terms)
        self.matrix = np.column_stack(list(self.terms.values()))

    def means(self, length):
        """A copy with the means of `length` rows in place of the rows."""
        def mean(values):
            whole = len(values) // length * length
            return values[:whole].reshape(-1, length, *values.shape[1:]).mean(axis=1)
        coarse = copy.copy(self)
        coarse.reading, coarse.matrix = mean(self.reading), mean(self.matrix)
        return coarse
