"""The tension of a step is the only root of its equation, and the engine finds it from any guess."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from engine.compiler.decorators import kernel
from engine.compiler.lanes import splat
from engine.kernel.interactions.tension import StretchingModes, add_stretch_sums, solve_rise
from engine.kernel.modes.ordered_sums import fold

STATES = 1500
TRIED = 8001  # rises of tension, evenly apart; and so many in equal ratios


@kernel
def solve(kick, drift, kappa, q, momentum, memory, half, softest, ends, guess):
    modes = StretchingModes(kick, drift, kappa, q, momentum, 0, q.shape[0], *memory)
    return solve_rise(modes, half, softest, ends, guess)[0]


@kernel
def find_residuals(kick, drift, kappa, q, momentum, memory, half, ends, rises, residuals):
    """Find R(λ) = λ - ½K·(s + s⁺(λ)) for each λ of rises."""
    modes = StretchingModes(kick, drift, kappa, q, momentum, 0, q.shape[0], *memory)
    for i in range(rises.shape[0]):
        zeros = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        sums = fold(add_stretch_sums, (modes, rises[i]), modes.size, zeros)
        residuals[i] = rises[i] - half * (sums[0] + ends[0] + sums[1] + ends[1])


class HostileState(NamedTuple):
    """A body at the begin of a step, with numbers over twelve decades."""

    modes: tuple[Any, ...]  # kick, drift, κ, q, momentum, memory
    half: float  # ½K
    softest: float
    ends: tuple[float, float]

    @staticmethod
    def draw(random):
        count = random.integers(1, 40)

        def decades(low, high):
            return 10 ** random.uniform(low, high, count)

        kappa, kick, drift = decades(-3, 3), decades(-3, 3), decades(-3, 3)
        q, x = (random.normal(size=count) * decades(-3, 3) for _ in range(2))
        half = 0.5 * 10 ** random.uniform(-3, 9)
        ends = tuple(10 ** random.uniform(-6, 6, 2)) if random.random() < 0.3 else (0.0, 0.0)
        softest = np.max(0.5 * kick * drift * kappa)
        return HostileState(
            (kick, drift, kappa, q, 2 * (x - q) / drift, (np.zeros(count), np.zeros(count))), half, softest, ends
        )

    def residuals(self, rises):
        residuals = np.zeros(len(rises))
        find_residuals(*self.modes, self.half, self.ends, np.asarray(rises, float), residuals)
        return residuals

    def bounds(self):
        """Bounds of the root: s⁺ is at least 0, and at most Σκ·(2|x| + |q|)²."""
        _, drift, kappa, q, momentum, _ = self.modes
        x = q + 0.5 * drift * momentum
        low = self.half * (kappa @ q**2 + sum(self.ends))
        return low, low + self.half * (kappa @ (2 * np.abs(x) + np.abs(q)) ** 2)


@pytest.fixture(scope="module")
def states():
    random = np.random.default_rng(1)
    return [HostileState.draw(random) for _ in range(STATES)]


@pytest.mark.hard
def test_the_equation_of_a_step_has_one_root(states):
    assert states
    for state in states:
        low, high = state.bounds()
        low, high = low * (1 - 1e-9), high * 1.01
        rises = np.sort(np.concatenate([np.linspace(low, high, TRIED), np.geomspace(low, high, TRIED)]))
        signs = np.sign(state.residuals(rises))
        assert np.sum(signs[:-1] * signs[1:] < 0) == 1 and signs[0] < 0 < signs[-1]


@pytest.mark.hard
def test_the_root_is_found_from_any_guess(states):
    random = np.random.default_rng(2)
    assert states
    for state in states:
        low, high = state.bounds()
        for guess in (0.0, low, high, low * (high / low) ** random.random(), 10 * high):
            rise = solve(*state.modes, state.half, state.softest, state.ends, guess)
            below, above = state.residuals([rise * (1 - 1e-13), rise * (1 + 1e-13)])
            assert below < 0 < above
