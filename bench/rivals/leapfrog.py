"""Leapfrog with the discrete gradient of the contact's potential over two steps, in NumPy: one Python call for each
operation on the masses, and Newton's method in Python. The scheme of physsynth's mallet (f on the compressions one step
before and one after), on the masses that the mass-interaction models are given."""

import numpy as np

from bench.performance.turns import RATE


class Leapfrog:
    """A hammer that flies at masses joined by springs.

    masses, mass, spring: of the chain; kg, N/m
    hit, heard:           the mass that the hammer meets, and the mass with the pickup
    stiffness, exponent:  of the contact, N/m^α
    hammer:               mass, displacement and velocity at the start; kg, m, m/s
    """

    def __init__(
        self,
        chain: tuple[int, float, float, int],
        heard: int,
        contact: tuple[float, float],
        hammer: tuple[float, float, float],
    ) -> None:
        self.masses, mass, spring, self.hit = chain
        self.heard = min(heard, self.masses - 1)
        self.stiffness, self.exponent = contact
        hammer_mass, self.displacement, velocity = hammer
        self.mass, self.spring, self.hammer_mass, self.velocity = mass, spring, hammer_mass, velocity
        self.pull = spring / mass / RATE**2
        self.given = 1 / (mass * RATE**2), 1 / (hammer_mass * RATE**2)  # m per newton
        self.reset()

    def reset(self) -> None:
        """Back to the start: the sample before it is known, for there is no force yet."""
        self.now, self.before = np.zeros(self.masses), np.zeros(self.masses)
        self.hammer, self.hammer_before = self.displacement, self.displacement - self.velocity / RATE

    def potential(self, compression: float) -> float:
        """V = k/(α + 1)·[s]₊^(α + 1), J."""
        return self.stiffness / (self.exponent + 1) * max(compression, 0.0) ** (self.exponent + 1)

    def force(self, free: float, before: float) -> float:
        """The force for which s = free - g·f and f = (V(s) - V(before))/(s - before), N, by Newton's method from where
        no force acts, in a bracket."""
        give, start = sum(self.given), self.potential(before)
        low, high, s = -np.inf, free, free
        for _ in range(60):
            if abs(s - before) < 1e-12:
                middle = max(0.5 * (s + before), 0.0)
                f = self.stiffness * middle**self.exponent
                slope = 0.5 * self.stiffness * self.exponent * middle ** (self.exponent - 1) if middle else 0.0
            else:
                f = (self.potential(s) - start) / (s - before)
                slope = (self.stiffness * max(s, 0.0) ** self.exponent - f) / (s - before)
            miss = s - free + give * f
            if abs(miss) <= 1e-15 * (abs(free) + abs(before)):
                break
            low, high = (low, s) if miss > 0 else (s, high)
            s -= miss / (1 + give * slope)
            if not low < s < high:
                s = 0.5 * (low + high) if np.isfinite(low) else high - 2 * abs(miss)
        return f

    def step(self) -> None:
        """One sample."""
        now = self.now
        if self.masses > 1:
            bend = -2 * now
            bend[1:] += now[:-1]
            bend[:-1] += now[1:]
        else:
            bend = -now
        following, hammer = 2 * now - self.before + self.pull * bend, 2 * self.hammer - self.hammer_before
        before = self.hammer_before - self.before[self.hit]
        free = hammer - following[self.hit]
        if free > 0.0 or before > 0.0:
            f = self.force(free, before)
            following[self.hit] += self.given[0] * f
            hammer -= self.given[1] * f
        self.before, self.now = now, following
        self.hammer_before, self.hammer = self.hammer, hammer

    def energy(self) -> float:
        """What the scheme conserves, J: kinetic energy between two samples, and the mean of the contact's at both."""
        speeds, speed = (self.now - self.before) * RATE, (self.hammer - self.hammer_before) * RATE
        now, before = ((np.diff(np.pad(u, 1)) if self.masses > 1 else u) for u in (self.now, self.before))
        compressions = self.hammer - self.now[self.hit], self.hammer_before - self.before[self.hit]
        kinetic = 0.5 * self.mass * (speeds @ speeds) + 0.5 * self.hammer_mass * speed**2
        return float(kinetic + 0.5 * self.spring * (now @ before) + 0.5 * sum(map(self.potential, compressions)))

    def block(self, out: np.ndarray) -> None:
        """Displacements of the mass with the pickup and of the hammer into out [2, frames], m."""
        for n in range(out.shape[1]):
            out[0, n], out[1, n] = self.now[self.heard], self.hammer
            self.step()
