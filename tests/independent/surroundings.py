"""What surrounds a sensor: heat that flows into it, thermometers that read it, supplies, Moon and Sun."""

import numpy as np
from scipy import linalg, signal

from motion import EQUATORIAL_RADIUS


def smooth_wander(rng, count, step_s, correlation_s):
    """A smooth random function of unit standard deviation: white noise twice through a low-pass."""
    spacing = max(correlation_s / 8, step_s)
    knots = max(int(count * step_s / spacing) + 4, 8)
    width = correlation_s / spacing
    window = np.exp(-0.5 * (np.arange(-4 * width, 4 * width + 1) / width) ** 2)
    series = np.convolve(rng.standard_normal(knots + len(window)), window, mode="valid")[:knots]
    series /= np.sqrt(np.sum(window**2))
    return np.interp(np.arange(count) * step_s, np.arange(knots) * spacing, series)


def chamber(rng, t, amplitude):
    """Temperature of the air around the sensor, degC: soaks and ramps, daily and shorter cycles, draughts."""
    duration = t[-1]
    air = np.full_like(t, rng.uniform(10.0, 30.0))
    kind = rng.choice(["soaks", "cycles", "wander"])
    if kind == "soaks":
        levels = rng.uniform(-amplitude, amplitude, int(rng.integers(5, 10)))
        corners = np.linspace(0.0, duration, 2 * len(levels))
        air += np.interp(t, corners, np.repeat(levels, 2))
    elif kind == "cycles":
        for part in (1.0, 0.5):
            period = duration / rng.uniform(2.5, 7.0)
            air += part * amplitude * np.sin(2 * np.pi * t / period + rng.uniform(0, 6.28))
    else:
        step = t[1] - t[0]
        air += 0.7 * amplitude * smooth_wander(rng, len(t), step, duration / rng.uniform(10, 25))
    return air


def rod(t, air, slowest_s, places, cells=12):
    """Temperatures inside a rod one end of which has the temperature of the air and the other is insulated.

    The heat equation on `cells` cells, integrated exactly for air that is linear between samples; `slowest_s` is the
    time constant of the slowest mode; `places` are fractions of the length from the air's end.
    """
    diffusion = np.zeros((cells, cells))
    for cell in range(cells):
        if cell > 0:
            diffusion[cell, cell - 1] += 1
            diffusion[cell, cell] -= 1
        if cell < cells - 1:
            diffusion[cell, cell + 1] += 1
            diffusion[cell, cell] -= 1
    diffusion[0, 0] -= 2
    rates, modes = linalg.eigh(diffusion)
    rates = rates / (-rates[-1] * slowest_s)
    temperature = np.zeros((len(places), len(t)))
    inside = [min(int(place * cells), cells - 1) for place in places]
    for rate, shape in zip(rates, modes.T):
        temperature += np.outer(shape[inside] * shape.sum(), first_order(t, air, -1 / rate))
    return temperature


def first_order(t, driving, tau_s):
    """Solution of tau x' = u - x from equilibrium, exact for u linear between evenly spaced samples."""
    step = t[1] - t[0]
    ratio = step / tau_s
    decay = np.exp(-ratio)
    # x(k+1) = decay x(k) + a u(k) + b u(k+1)
    kept = (1 - decay) / ratio
    a, b = kept - decay, 1 - kept
    series = np.empty_like(driving)
    series[0] = driving[0]
    forced = a * driving[:-1] + b * driving[1:]
    series[1:], _ = signal.lfilter([1.0], [1.0, -decay], forced, zi=[decay * driving[0]])
    return series


def thermometer(rng, temperature):
    """A reading: a little noise, and steps of a converter."""
    step = rng.choice([0.0625, 0.01, 0.1, 0.001])
    noisy = temperature + rng.uniform(0.1, 0.6) * step * rng.standard_normal(len(temperature))
    return step * np.round(noisy / step)


def play(temperature, width):
    """Branch of a play operator: a pointer pushed along by two stops that are `width` apart."""
    position = np.empty_like(temperature)
    held = temperature[0]
    for index, value in enumerate(temperature):
        held = min(max(held, value - width / 2), value + width / 2)
        position[index] = held
    return position - temperature


def tide(unix_s, latitude, longitude, altitude_m):
    """Upward pull of Moon and Sun on the yielding Earth, m/s^2. An accelerometer with its axis up reads it with a minus.

    Geocentric places of Moon and Sun by the leading terms of their theories (Meeus, Astronomical Algorithms, chapters
    25 and 47, to 0.1 degree), gravity by the difference of attraction at the site and at the Earth's centre, and the
    gravimetric factor 1.16 of the solid Earth.
    """
    centuries = (unix_s / 86400.0 + 2440587.5 - 2451545.0) / 36525.0
    radians = np.radians
    moon_longitude = 218.3164477 + 481267.88123421 * centuries
    elongation = radians(297.8501921 + 445267.1114034 * centuries)
    sun_anomaly = radians(357.5291092 + 35999.0502909 * centuries)
    moon_anomaly = radians(134.9633964 + 477198.8675055 * centuries)
    argument = radians(93.2720950 + 483202.0175233 * centuries)
    longitude_terms = [
        (6.288774, moon_anomaly), (1.274027, 2 * elongation - moon_anomaly), (0.658314, 2 * elongation),
        (0.213618, 2 * moon_anomaly), (-0.185116, sun_anomaly), (-0.114332, 2 * argument),
        (0.058793, 2 * elongation - 2 * moon_anomaly), (0.057066, 2 * elongation - sun_anomaly - moon_anomaly),
        (0.053322, 2 * elongation + moon_anomaly), (0.045758, 2 * elongation - sun_anomaly),
        (-0.040923, sun_anomaly - moon_anomaly), (-0.034720, elongation), (-0.030383, sun_anomaly + moon_anomaly),
    ]
    latitude_terms = [
        (5.128122, argument), (0.280602, moon_anomaly + argument), (0.277693, moon_anomaly - argument),
        (0.173237, 2 * elongation - argument), (0.055413, 2 * elongation - moon_anomaly + argument),
        (0.046271, 2 * elongation - moon_anomaly - argument),
    ]
    distance_terms = [
        (-20905.355e3, moon_anomaly), (-3699.111e3, 2 * elongation - moon_anomaly), (-2955.968e3, 2 * elongation),
        (-569.925e3, 2 * moon_anomaly), (48.888e3, sun_anomaly), (246.158e3, 2 * elongation - 2 * moon_anomaly),
        (-204.586e3, 2 * elongation - sun_anomaly), (-170.733e3, 2 * elongation + moon_anomaly),
    ]
    moon_longitude = radians(moon_longitude + sum(a * np.sin(x) for a, x in longitude_terms))
    moon_latitude = radians(sum(a * np.sin(x) for a, x in latitude_terms))
    moon_distance = 385000.56e3 + sum(a * np.cos(x) for a, x in distance_terms)
    sun_longitude = radians(280.46646 + 36000.76983 * centuries + 1.914602 * np.sin(sun_anomaly)
                            + 0.019993 * np.sin(2 * sun_anomaly))
    sun_distance = 1.495978707e11 * (1.00014 - 0.01671 * np.cos(sun_anomaly) - 0.00014 * np.cos(2 * sun_anomaly))
    obliquity = radians(23.43929 - 0.0130042 * centuries)
    sidereal = radians(280.46061837 + 360.98564736629 * 36525.0 * centuries)
    local = sidereal + longitude
    geocentric = np.arctan(0.99330562 * np.tan(latitude))
    radius = EQUATORIAL_RADIUS * (1 - np.sin(latitude) ** 2 / 298.257) + altitude_m
    up = np.array([np.cos(latitude) * np.cos(local), np.cos(latitude) * np.sin(local), np.sin(latitude) + 0 * local])
    site = radius * np.array([np.cos(geocentric) * np.cos(local), np.cos(geocentric) * np.sin(local),
                              np.sin(geocentric) + 0 * local])
    total = 0.0
    for gm, ecliptic_longitude, ecliptic_latitude, distance in (
        (4.9028e12, moon_longitude, moon_latitude, moon_distance),
        (1.32712440018e20, sun_longitude, 0.0 * sun_longitude, sun_distance),
    ):
        x = np.cos(ecliptic_latitude) * np.cos(ecliptic_longitude)
        y = np.cos(ecliptic_latitude) * np.sin(ecliptic_longitude)
        z = np.sin(ecliptic_latitude)
        body = distance * np.array([x, np.cos(obliquity) * y - np.sin(obliquity) * z,
                                    np.sin(obliquity) * y + np.cos(obliquity) * z])
        towards = body - site
        pull = gm * (towards / np.linalg.norm(towards, axis=0) ** 3 - body / distance**3)
        total = total + np.sum(pull * up, axis=0)
    return 1.16 * total
