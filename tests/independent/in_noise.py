"""Cases whose noise is not what the case believes."""

import copy

import numpy as np

from noise import Noise, divergence, flicker
from settings import any_sensor, bench, log_uniform, target


def sized(case, sensor, wanted, with_size):
    """The size for which the true noise explains `wanted` nats more than the nominal, by bisection of its logarithm."""
    low, high = 1e-6, 1e4
    for _ in range(60):
        middle = np.sqrt(low * high)
        if divergence(with_size(middle), sensor.nominal, len(case.t), case.step_s) < wanted:
            low = middle
        else:
            high = middle
    return low


def prepared(rng, title, least_s=3600.0):
    case = bench(rng, "noise", title, least_s=least_s)
    for instrument in case.instruments:
        # Instruments of one make share the description, never the object that is changed below.
        instrument.nominal = copy.deepcopy(instrument.nominal)
    return case, any_sensor(rng, case)


def noise_white(rng):
    case, sensor = prepared(rng, "A noisier output", least_s=1200.0)
    wanted = target(rng)

    def louder(size):
        truth = copy.deepcopy(sensor.nominal)
        truth.white *= 1 + size
        return truth
    sensor.truth = louder(sized(case, sensor, wanted, louder))
    case.note(sensor.name, "noise_white", {"sigma": sensor.truth.white}, wanted)
    return case


def noise_markov(rng):
    case, sensor = prepared(rng, "A slow part that nobody knows of")
    wanted = target(rng)
    sensor.nominal = Noise(white=sensor.nominal.white)
    tau_s = log_uniform(rng, 15 * case.step_s, case.t[-1] / 20)

    def slower(size):
        return Noise(sensor.nominal.white, [(size * sensor.nominal.white, tau_s)])
    sensor.truth = slower(sized(case, sensor, wanted, slower))
    case.note(sensor.name, "noise_markov", {"sigma": sensor.truth.markov[0][0], "tau_s": tau_s}, wanted)
    return case


def noise_exp_cos(rng):
    case, sensor = prepared(rng, "A resonance in the noise")
    wanted = target(rng) + 20
    sensor.nominal = Noise(white=sensor.nominal.white)
    alpha = 1 / log_uniform(rng, 30 * case.step_s, max(case.t[-1] / 60, 60 * case.step_s))
    beta = alpha * log_uniform(rng, 2.5, 15.0)
    if beta * case.step_s > 1.5:
        beta = 1.5 / case.step_s

    def swinging(size):
        return Noise(sensor.nominal.white, exp_cos=[(size * sensor.nominal.white, alpha, beta)])
    sensor.truth = swinging(sized(case, sensor, wanted, swinging))
    case.note(sensor.name, "noise_exp_cos", {"sigma": sensor.truth.exp_cos[0][0], "alpha": alpha, "beta": beta}, wanted)
    return case


def noise_random_walk(rng):
    case, sensor = prepared(rng, "A bias that walks")
    wanted = target(rng)
    sensor.nominal = Noise(white=sensor.nominal.white)

    def walking(size):
        return Noise(sensor.nominal.white, random_walk=size * sensor.nominal.white / np.sqrt(case.step_s) / 100)
    sensor.truth = walking(sized(case, sensor, wanted, walking))
    case.note(sensor.name, "noise_random_walk", {"sigma": sensor.truth.random_walk}, wanted)
    return case


def noise_flicker(rng):
    case, sensor = prepared(rng, "Flicker", least_s=4 * 3600.0)
    sensor.nominal = Noise(white=sensor.nominal.white)
    instability = sensor.nominal.white * log_uniform(rng, 0.1, 0.5)
    sensor.extra_noise.append(lambda rng, count: flicker(rng, count, case.step_s, instability, 2 * case.t[-1]))
    case.note(sensor.name, "noise_flicker", {}, 50.0)
    return case


def noise_angle_quantisation(rng):
    """A counter of whole pulses of angle or velocity increment, read every step and divided by it."""
    case, sensor = prepared(rng, "Pulses of an integrating output", least_s=1200.0)
    pulse = sensor.nominal.white * case.step_s * log_uniform(rng, 1.5, 6.0)

    def count_pulses(rng, values):
        angle = np.concatenate([[rng.uniform(0, pulse)], values * case.step_s]).cumsum()
        return np.diff(np.floor(angle / pulse)) * pulse / case.step_s
    sensor.spoils.append(count_pulses)
    case.note(sensor.name, "noise_angle_quantisation", {}, 50.0)
    return case


def noise_variance_step(rng):
    case, sensor = prepared(rng, "Noise that grows at some time", least_s=1200.0)
    sensor.nominal = Noise(white=sensor.nominal.white)
    wanted, onset = target(rng), float(rng.uniform(0.2, 0.85) * case.t[-1])
    after = np.sum(case.t >= onset)
    low, high = 1.0, 100.0
    for _ in range(60):
        ratio = np.sqrt(low * high)
        low, high = (ratio, high) if after * 0.5 * (ratio**2 - 1 - 2 * np.log(ratio)) < wanted else (low, ratio)
    sensor.extra_noise.append(lambda rng, count: np.where(
        case.t >= onset, np.sqrt(low**2 - 1) * sensor.nominal.white * rng.standard_normal(count), 0.0))
    case.note(sensor.name, "noise_variance_step", {"onset_s": onset}, wanted, onset_s=onset)
    return case


def noise_outliers(rng):
    case, sensor = prepared(rng, "Spikes", least_s=1200.0)
    count = len(case.t)
    spikes = max(5, int(count * rng.choice([0.0005, 0.002, 0.01])))
    size = sensor.nominal.white * rng.uniform(7, 20)
    case_rows = rng.choice(count, spikes, replace=False)
    sensor.hidden[case_rows] += size * rng.choice([-1, 1], spikes) * rng.uniform(0.7, 1.3, spikes)
    case.note(sensor.name, "noise_outliers", {}, 20.0 * spikes)
    return case


CATALOGUE = {make.__name__: make for make in (
    noise_white, noise_markov, noise_exp_cos, noise_random_walk, noise_flicker, noise_angle_quantisation,
    noise_variance_step, noise_outliers)}
