"""Motion that is known at every instant: angles and velocities as closed forms, and what ideal sensors feel.

Axes: body from north-east-down by yaw, pitch, roll (3-2-1). Rates are inertial and contain the Earth's; specific force
contains gravity. Radians, metres, seconds.
"""

from dataclasses import dataclass, field

import numpy as np

EARTH_RATE = 7.292115e-5  # rad/s, WGS 84
EQUATORIAL_RADIUS = 6378137.0  # m, WGS 84
FLATTENING = 1 / 298.257223563


def gravity(latitude, altitude_m):
    """Normal gravity, m/s^2: Somigliana's formula at the ellipsoid, second order in height (WGS 84)."""
    square = np.sin(latitude) ** 2
    at_ellipsoid = 9.7803253359 * (1 + 0.00193185265241 * square) / np.sqrt(1 - 0.00669437999013 * square)
    slope = 2 / EQUATORIAL_RADIUS * (1 + FLATTENING + 0.00344978650684 - 2 * FLATTENING * square)
    return at_ellipsoid * (1 - slope * altitude_m + 3 * altitude_m**2 / EQUATORIAL_RADIUS**2)


@dataclass
class Course:
    """A function of time with its first two derivatives: constant + slope + sinusoids + smooth steps."""

    constant: float = 0.0
    slope: float = 0.0
    waves: list = field(default_factory=list)  # amplitude, angular frequency, phase
    steps: list = field(default_factory=list)  # size, time, half duration

    def derivative(self, order, t):
        total = np.zeros_like(t)
        if order == 0:
            total += self.constant + self.slope * t
        elif order == 1:
            total += self.slope
        for amplitude, omega, phase in self.waves:
            total += amplitude * omega**order * np.sin(omega * t + phase + order * np.pi / 2)
        for size, when, half in self.steps:
            x = np.clip((t - when) / half, -30.0, 30.0)
            level = np.tanh(x)
            shape = ((1 + level) / 2, (1 - level**2) / 2 / half, -level * (1 - level**2) / half**2)[order]
            total += size * shape
        return total


@dataclass
class Motion:
    roll: Course
    pitch: Course
    yaw: Course
    north: Course  # velocities, m/s
    east: Course
    down: Course
    latitude: float  # rad
    altitude_m: float

    def attitude(self, t):
        return np.array([axis.derivative(0, t) for axis in (self.roll, self.pitch, self.yaw)])

    def velocity_ned(self, t):
        return np.array([axis.derivative(0, t) for axis in (self.north, self.east, self.down)])

    def into_body(self, t, vector):
        """Rotates columns of north-east-down into the body."""
        roll, pitch, yaw = self.attitude(t)
        x, y, z = vector
        x, y = np.cos(yaw) * x + np.sin(yaw) * y, -np.sin(yaw) * x + np.cos(yaw) * y
        x, z = np.cos(pitch) * x - np.sin(pitch) * z, np.sin(pitch) * x + np.cos(pitch) * z
        y, z = np.cos(roll) * y + np.sin(roll) * z, -np.sin(roll) * y + np.cos(roll) * z
        return np.array([x, y, z])

    def earth_and_transport(self, t):
        """Rate of the Earth, and of the local level over it, in north-east-down."""
        sine, cosine = np.sin(self.latitude), np.cos(self.latitude)
        one = np.ones_like(t)
        earth = EARTH_RATE * np.array([cosine * one, 0 * one, -sine * one])
        north, east, _ = self.velocity_ned(t)
        eccentricity = FLATTENING * (2 - FLATTENING)
        prime = EQUATORIAL_RADIUS / np.sqrt(1 - eccentricity * sine**2)
        meridian = prime * (1 - eccentricity) / (1 - eccentricity * sine**2)
        across = east / (prime + self.altitude_m)
        transport = np.array([across, -north / (meridian + self.altitude_m), -across * sine / cosine])
        return earth, transport

    def rate(self, t):
        """Inertial rate in body axes, rad/s."""
        roll, pitch, _ = self.attitude(t)
        roll_rate, pitch_rate, yaw_rate = (a.derivative(1, t) for a in (self.roll, self.pitch, self.yaw))
        relative = np.array([
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
            -pitch_rate * np.sin(roll) + yaw_rate * np.cos(pitch) * np.cos(roll),
        ])
        earth, transport = self.earth_and_transport(t)
        return relative + self.into_body(t, earth + transport)

    def specific_force(self, t):
        """Specific force in body axes, m/s^2."""
        earth, transport = self.earth_and_transport(t)
        acceleration = np.array([axis.derivative(1, t) for axis in (self.north, self.east, self.down)])
        coriolis = np.cross(2 * earth + transport, self.velocity_ned(t), axis=0)
        down = np.array([0 * t, 0 * t, gravity(self.latitude, self.altitude_m) + 0 * t])
        return self.into_body(t, acceleration + coriolis - down)

    def angular_acceleration(self, t, interval=1e-4):
        return (self.rate(t + interval) - self.rate(t - interval)) / (2 * interval)

    def felt_at(self, t, arm):
        """What accelerometers at `arm` feel beyond those at the origin."""
        arm = np.asarray(arm)[:, None] * np.ones_like(t)
        rate = self.rate(t)
        swept = np.cross(self.angular_acceleration(t), arm, axis=0)
        return swept + np.cross(rate, np.cross(rate, arm, axis=0), axis=0)

    def body_velocity(self, t):
        return self.into_body(t, self.velocity_ned(t))


def at_rest(latitude, altitude_m, roll, pitch, yaw):
    still = Course()
    return Motion(Course(roll), Course(pitch), Course(yaw), still, still, still, latitude, altitude_m)


def tumble(rng, duration_s, step_s, latitude, altitude_m):
    """A body turned by hand or by a table into one position after another, of all three angles."""
    positions = int(rng.integers(8, 25))
    dwell = duration_s / positions
    # Slow enough that samples of the angles tell the rate between them.
    half = max(float(rng.uniform(0.02, 0.06)) * dwell, 12 * step_s)
    angles = []
    for choices in ([0, 45, 90, 135, 180, -90, -45], [0, 30, 45, 60, -30, -60, 75], [0, 90, 180, 270, 45]):
        course = Course(np.radians(rng.choice(choices)))
        value = course.constant
        for position in range(1, positions):
            if rng.random() < 0.75:
                following = np.radians(rng.choice(choices))
                course.steps.append((following - value, position * dwell, half))
                value = following
        angles.append(course)
    still = Course()
    return Motion(*angles, still, still, still, latitude, altitude_m)


def swing(rng, period_s, latitude, altitude_m, amplitude=(0.05, 0.5), leaning=0.4):
    """A table that swings about three axes at once, each with two frequencies near 1/period."""
    angles = []
    for _ in range(3):
        course = Course(rng.uniform(-leaning, leaning))
        for _ in range(2):
            omega = 2 * np.pi / period_s * rng.uniform(0.5, 1.6)
            course.waves.append((rng.uniform(*amplitude), omega, rng.uniform(0, 2 * np.pi)))
        angles.append(course)
    still = Course()
    return Motion(*angles, still, still, still, latitude, altitude_m)


def voyage(rng, duration_s, latitude, altitude_m, speed, turn_s):
    """A vehicle on legs: turns of the heading, changes of speed along and across, a little roll and pitch."""
    legs = int(np.clip(duration_s / (8 * turn_s), 4, 30))
    yaw = Course(rng.uniform(-np.pi, np.pi))
    north, east = Course(rng.uniform(-speed, speed)), Course(rng.uniform(-speed, speed))
    down = Course(0.0, waves=[(0.01 * speed, 2 * np.pi / (6 * turn_s), 0.0)])
    for leg in range(1, legs):
        when = (leg + rng.uniform(-0.25, 0.25)) * duration_s / legs
        half = turn_s * rng.uniform(0.3, 1.0)
        yaw.steps.append((rng.uniform(-2.5, 2.5), when, half))
        north.steps.append((rng.uniform(-speed, speed) - north.derivative(0, np.array([duration_s]))[0], when, half))
        east.steps.append((rng.uniform(-speed, speed) - east.derivative(0, np.array([duration_s]))[0], when, half))
    sway = 2 * np.pi / (1.7 * turn_s)
    roll = Course(rng.uniform(-0.02, 0.02), waves=[(rng.uniform(0.01, 0.06), sway, 0.3)])
    pitch = Course(rng.uniform(-0.02, 0.02), waves=[(rng.uniform(0.005, 0.03), 0.83 * sway, 1.1)])
    return Motion(roll, pitch, yaw, north, east, down, latitude, altitude_m)
