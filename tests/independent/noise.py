"""Noise of a sensor: samples of it, its spectrum, and what an effect in it is worth.

All in SI units. A noise is white + first-order Markov parts + exponential-cosine parts + a random walk, as RECORDING
states them: R(tau) = sigma^2 exp(-|tau|/tau_s), R(tau) = sigma^2 exp(-alpha |tau|) cos(beta tau).
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, signal

# Frequencies on which the divergence of two spectra is summed.
SPECTRAL_POINTS = 1 << 16


@dataclass
class Noise:
    """Standard deviations in SI units; of the random walk, per root second."""

    white: float = 0.0
    markov: list = field(default_factory=list)  # (sigma, tau_s)
    exp_cos: list = field(default_factory=list)  # (sigma, alpha 1/s, beta rad/s)
    random_walk: float = 0.0

    def sample(self, rng, count, step_s):
        total = self.white * rng.standard_normal(count)
        for sigma, tau_s in self.markov:
            total += ornstein_uhlenbeck(rng, count, step_s, sigma, tau_s)
        for sigma, alpha, beta in self.exp_cos:
            total += rotating_pair(rng, count, step_s, sigma, alpha, beta)
        if self.random_walk > 0.0:
            total += np.cumsum(self.random_walk * np.sqrt(step_s) * rng.standard_normal(count))
        return total

    def spectrum(self, omega, step_s):
        """Sum over k of R(k) exp(-i omega k); omega in radians a sample."""
        density = np.full_like(omega, self.white**2)
        z = np.exp(-1j * omega)
        for sigma, tau_s in self.markov:
            decay = np.exp(-step_s / tau_s)
            density += sigma**2 * (1 - decay**2) / np.abs(1 - decay * z) ** 2
        for sigma, alpha, beta in self.exp_cos:
            decay = np.exp(-alpha * step_s)
            for turn in (np.exp(1j * beta * step_s), np.exp(-1j * beta * step_s)):
                density += 0.5 * sigma**2 * (1 - decay**2) / np.abs(1 - decay * turn * z) ** 2
        if self.random_walk > 0.0:
            density += self.random_walk**2 * step_s / np.abs(1 - z) ** 2
        return density

    def state_space(self, step_s):
        """(F, Q, H, R, covariance of the first state)."""
        transition, driving, output, first = [], [], [], []
        for sigma, tau_s in self.markov:
            decay = np.exp(-step_s / tau_s)
            transition.append([[decay]])
            driving.append([[sigma**2 * (1 - decay**2)]])
            output += [1.0]
            first += [sigma**2]
        for sigma, alpha, beta in self.exp_cos:
            decay, angle = np.exp(-alpha * step_s), beta * step_s
            turn = decay * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            transition.append(turn)
            driving.append(sigma**2 * (1 - decay**2) * np.eye(2))
            output += [1.0, 0.0]
            first += [sigma**2, sigma**2]
        if self.random_walk > 0.0:
            transition.append([[1.0]])
            driving.append([[self.random_walk**2 * step_s]])
            output += [1.0]
            first += [0.0]
        if not output:
            return None, None, None, self.white**2, None
        # A noise without a white part is given a trace of one, for the equation of the filter to have a solution.
        white = max(self.white**2, 1e-8 * sum(first))
        return linalg.block_diag(*transition), linalg.block_diag(*driving), np.array([output]), white, np.diag(first)

    def plus(self, other):
        return Noise(np.hypot(self.white, other.white), self.markov + other.markov, self.exp_cos + other.exp_cos,
                     np.hypot(self.random_walk, other.random_walk))

    def gain(self, error, step_s, free_constant=False):
        """Nats that knowing `error` is expected to gain in this noise."""
        return gain_in(self.state_space(step_s), error, free_constant)


def ornstein_uhlenbeck(rng, count, step_s, sigma, tau_s):
    decay = np.exp(-step_s / tau_s)
    driving = sigma * np.sqrt(1 - decay**2) * rng.standard_normal(count)
    driving[0] = sigma * rng.standard_normal()
    return signal.lfilter([1.0], [1.0, -decay], driving)


def rotating_pair(rng, count, step_s, sigma, alpha, beta):
    """Real part of a complex Ornstein-Uhlenbeck process that turns with beta."""
    pole = np.exp((-alpha + 1j * beta) * step_s)
    driving = rng.standard_normal(count) + 1j * rng.standard_normal(count)
    driving[1:] *= np.sqrt(1 - np.abs(pole) ** 2)
    return sigma * signal.lfilter([1.0], [1.0, -pole], driving).real


def flicker(rng, count, step_s, bias_instability, slowest_s):
    """1/f noise by its spectrum: S(f) = B^2 / (2 pi f) above 1/slowest_s, B the bias instability."""
    frequency = np.fft.rfftfreq(2 * count, step_s)
    density = bias_instability**2 / (2 * np.pi * np.maximum(frequency, 1.0 / slowest_s))
    amplitude = np.sqrt(density * count / step_s / 2.0)
    phases = rng.standard_normal(len(frequency)) + 1j * rng.standard_normal(len(frequency))
    series = np.fft.irfft(amplitude * phases, 2 * count)[:count]
    return series


def gain_in(model, error, free_constant=False):
    """Half the squared norm of `error` whitened by the steady filter of a model, less what the unknown first state
    and, on request, an unknown constant can imitate."""
    transition, driving, output, white, first = model
    count = len(error)
    if transition is None:
        centred = error - error.mean() if free_constant else error
        return 0.5 * float(centred @ centred) / white
    covariance = linalg.solve_discrete_are(transition.T, output.T, driving, np.array([[white]]))
    innovation = float((output @ covariance @ output.T)[0, 0]) + white
    closed = transition - transition @ covariance @ output.T @ output / innovation
    sections = signal.zpk2sos(linalg.eigvals(transition), linalg.eigvals(closed), 1.0)

    def whitened(series):
        return signal.sosfilt(sections, series, axis=0) / np.sqrt(innovation)

    columns, power = output.copy(), transition.copy()
    while len(columns) < count:
        columns = np.vstack([columns, columns @ power])
        power = power @ power
    columns = columns[:count]
    prior = first - covariance
    if free_constant:
        columns = np.column_stack([columns, np.ones(count)])
        prior = linalg.block_diag(prior, 1e6 * (np.abs(error).max() ** 2 + white))
    whitened_error, whitened_columns = whitened(error), whitened(columns)
    normal = whitened_columns.T @ whitened_columns
    right = whitened_columns.T @ whitened_error
    imitated = right @ prior @ np.linalg.solve(np.eye(len(right)) + normal @ prior, right)
    return 0.5 * (float(whitened_error @ whitened_error) - float(imitated))


def divergence(truth, nominal, count, step_s):
    """Expected nats by which the true noise explains `count` samples better than the nominal (Whittle)."""
    omega = np.pi * (np.arange(SPECTRAL_POINTS) + 0.5) / SPECTRAL_POINTS
    # Nothing slower than the record shows in it.
    omega = omega[omega > np.pi / count]
    ratio = truth.spectrum(omega, step_s) / nominal.spectrum(omega, step_s)
    return 0.5 * count / SPECTRAL_POINTS * float(np.sum(ratio - 1 - np.log(ratio)))
