"""Independent simulations of a bowed string, and of a mass on a belt: the law of friction in continuous time, followed
through its two states, sticking and sliding, by explicit steps. Nothing of the engine is in it.

Sticking: F = k·z + c·z', z' = w. Sliding, from N·μ_s on: F = ±N·μ(u), u = w - (F - k·z)/c, what the bristle does not
take, z' = (F - k·z)/c, and at once where F falls below k·z; until u turns. Modes move exactly under the force of each
step.
"""

import math
from typing import NamedTuple

import numba
import numpy as np


class Bowed(NamedTuple):
    """A string on two rigid ends, of all modes below 0.49 of a sample rate, and a bow."""

    pitch: float  # Hz
    rate: float  # Hz, of the samples
    force: float  # N, of the bow
    velocity: float  # m/s
    position: float = 0.11
    length: float = 0.325  # m
    impedance: float = 0.286  # kg/s
    a: float = 1.0  # 1/s, decay of all modes
    b: float = 5e-3  # 1/s for each Hz
    static: float = 0.8
    dynamic: float = 0.3
    speed: float = 0.1  # m/s
    bristle: float = 1e5  # N/m
    damping: float = 2.0  # kg/s

    @property
    def density(self) -> float:
        """kg/m"""
        return self.impedance / (2 * self.length * self.pitch)

    def patch(self, seconds: float) -> dict:
        """Return this as a patch."""
        string = {"name": "string", "kind": "string", "length": self.length, "linear_density": self.density}
        string |= {"frequency": self.pitch, "decay": {"kind": "linear", "a": self.a, "b": self.b}}
        bow = {"name": "bow", "body": "string", "at": self.position, "velocity": self.velocity, "force": self.force}
        heard = {"body": "string", "at": 0, "quantity": "end_force"}
        return {"seconds": seconds, "body": [string], "bow": [bow], "pickup": [heard]}

    def simulate(self, seconds: float, steps: int) -> np.ndarray:
        """Return the force on the end [samples], N, in so many steps a sample."""
        n = np.arange(1, int(0.49 * self.rate / self.pitch) + 1)
        omega, sigma = 2 * np.pi * self.pitch * n, self.a + self.b * self.pitch * n
        norm = math.sqrt(2 / (self.density * self.length))
        shape, wave = norm * np.sin(np.pi * n * self.position), np.pi * n / self.length
        at_end = norm * wave * self.density * (2 * self.length * self.pitch) ** 2
        law = (self.force, self.static, self.dynamic, self.speed, self.bristle, self.damping, self.velocity)
        return _follow(omega, sigma, shape, at_end, 1 / (self.rate * steps), round(seconds * self.rate), steps, law)


@numba.njit
def _follow(omega, sigma, shape, at_end, h, samples, steps, law):
    force, static, dynamic, speed, k, c, velocity = law
    modes, ringing = omega.size, np.sqrt(omega**2 - sigma**2)
    fade, cos, sin = np.exp(-sigma * h), np.cos(ringing * h), np.sin(ringing * h)
    qq, qp = fade * (cos + sigma / ringing * sin), fade * sin / ringing
    pq, pp = -(omega**2) * qp, fade * (cos - sigma / ringing * sin)
    qf, pf = shape * (1 - qq) / omega**2, shape * qp
    q, p, heard = np.zeros(modes), np.zeros(modes), np.zeros(samples)
    z, slip, side = 0.0, 0.0, 0.0
    for n in range(samples * steps):
        w = -velocity
        for m in range(modes):
            w += shape[m] * p[m]
        f = k * z + c * w
        if side == 0.0 and abs(f) > force * static:
            side, slip = math.copysign(1.0, f), 0.0
        if side != 0.0:
            for _ in range(50):
                f = side * force * (dynamic + (static - dynamic) * speed / (speed + slip))
                after = side * (w - (f - k * z) / c)
                if abs(after - slip) < 1e-12 * speed or after <= 0.0:
                    break
                slip = after
            slip = after
            if after <= 0.0:
                side, f = 0.0, k * z + c * w
        z += h * (w if side == 0.0 else (f - k * z) / c)
        if side != 0.0 and abs(z) > abs(f) / k:
            z = f / k
        total = 0.0
        for m in range(modes):
            moved = qq[m] * q[m] + qp[m] * p[m] - qf[m] * f
            p[m] = pq[m] * q[m] + pp[m] * p[m] - pf[m] * f
            q[m] = moved
            total += at_end[m] * moved
        if n % steps == steps - 1:
            heard[n // steps] = total
    return heard


class Belt(NamedTuple):
    """A mass on a spring and on a belt that moves, the benchmark of friction models (Canudas de Wit et al., IEEE Trans.
    Automatic Control 40, 1995): it breaks away at 1.5 N and slips at 1 N."""

    mass: float = 1.0  # kg
    spring: float = 2.0  # N/m
    velocity: float = 0.1  # m/s, of the belt
    most: float = 1.5  # N
    slip: float = 1.0  # N
    speed: float = 1e-3  # m/s
    bristle: float = 1e5  # N/m
    damping: float = math.sqrt(1e5)  # kg/s

    def patch(self, seconds: float) -> dict:
        """Return this as a patch."""
        block = {"name": "block", "kind": "oscillator", "mass": self.mass, "stiffness": self.spring}
        belt = {"body": "block", "velocity": self.velocity, "force": 1.0, "static": self.most, "dynamic": self.slip}
        belt |= {"speed": self.speed, "bristle": self.bristle, "bristle_damping": self.damping}
        heard = {"body": "block", "quantity": "displacement"}
        return {"seconds": seconds, "body": [block], "friction": [belt], "pickup": [heard]}

    def simulate(self, seconds: float, rate: float) -> np.ndarray:
        """Return the displacement [samples], m, with a coefficient that falls as an exponential."""
        law = (self.most, self.slip, self.speed, self.bristle, self.damping, self.velocity)
        return _follow_belt(self.mass, self.spring, 1 / rate, round(seconds * rate), law)

    def period(self, moved: np.ndarray, rate: float) -> float:
        """Return the time from slip to slip, s, in the mean of all but the first two."""
        middle = self.slip / self.spring
        falls = np.flatnonzero((moved[:-1] > middle) & (moved[1:] <= middle))
        return float(np.mean(np.diff(falls[1:]))) / rate

    @property
    def coulomb_period(self) -> float:
        """The period if the force falls at once, s: 2·(most - slip)/(spring·velocity) of sticking, and what the mass
        needs back."""
        omega, rise = math.sqrt(self.spring / self.mass), (self.most - self.slip) / self.spring
        return 2 * rise / self.velocity + (math.pi + 2 * math.atan(self.velocity / (omega * rise))) / omega


@numba.njit
def _follow_belt(mass, spring, h, samples, law):
    most, least, at, k, c, velocity = law
    moved, speed, z, slip, side, found = 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(samples)
    for n in range(samples):
        w = speed - velocity
        f = k * z + c * w
        if side == 0.0 and abs(f) > most:
            side, slip = math.copysign(1.0, f), 0.0
        if side != 0.0:
            after = slip
            for _ in range(200):
                f = side * (least + (most - least) * math.exp(-((slip / at) ** 2)))
                after = side * (w - (f - k * z) / c)
                if abs(after - slip) < 1e-9 * at or after <= 0.0:
                    break
                slip = after
            slip = after
            if after <= 0.0:
                side, f = 0.0, k * z + c * w
        z += h * (w if side == 0.0 else (f - k * z) / c)
        if side != 0.0 and abs(z) > abs(f) / k:
            z = f / k
        speed -= h * (spring * moved + f) / mass
        moved += h * speed
        found[n] = moved
    return found


def cents_of(sound: np.ndarray, rate: float, pitch: float) -> float:
    """Return how far the first partial of a sound is above a pitch, cents."""
    spectrum = np.log(np.abs(np.fft.rfft(sound * np.blackman(sound.size), 8 * sound.size)) + 1e-300)
    hertz = np.arange(spectrum.size) * rate / (8 * sound.size)
    i = int(np.argmax(np.where(np.abs(hertz / pitch - 1) < 0.2, spectrum, -np.inf)))
    before, here, after = spectrum[i - 1 : i + 2]
    peak = hertz[i] + 0.5 * (before - after) / (before - 2 * here + after) * hertz[1]
    return 1200 * math.log2(peak / pitch)
