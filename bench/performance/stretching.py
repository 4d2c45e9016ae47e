"""What it costs that a string stretches: against a step of the same string without it, and against its free flight; and
sums over its modes per sample."""

import time
from typing import Any

import numpy as np

import engine
from bench.performance.connections import BLOCK, REPEATS, fused_passes
from bench.performance.turns import RATE, time_in_turn
from bench.publish.report import pin, publish
from engine.assembly.build import build
from engine.compiler.decorators import kernel
from engine.compiler.lanes import splat
from engine.kernel.data.enums import Stretch, StretchFactor
from engine.kernel.interactions.tension import (
    ROUNDING,
    StretchingModes,
    add_stretch_sums,
    series_of_stretch,
    solve_polynomial,
)
from engine.kernel.modes.ordered_sums import fold
from engine.offline.simulation import Simulation, time_block

MODES = 20, 64, 130, 256
LENGTH, DENSITY, FREQUENCY = 1.2, 6e-3, 65.4  # m, kg/m, Hz
PLUCK_AT, AMPLITUDE = 0.2, 5e-3  # m
RISE = 0.1  # of the tension, at first


def string(modes: int, is_stretching: bool) -> engine.Scene:
    """A plucked string, whose tension rises by a tenth at first."""
    stretch = AMPLITUDE**2 / (LENGTH * PLUCK_AT * (1 - PLUCK_AT))  # ∫u'² dx
    tension = DENSITY * (2 * LENGTH * FREQUENCY) ** 2
    axial = 2 * LENGTH * RISE * tension / stretch
    body = {"name": "string", "kind": "string", "length": LENGTH, "linear_density": DENSITY, "frequency": FREQUENCY}
    body |= {"modes": modes, "residual": False, "sigma0": 0.3, "b3": 6e-9}
    body |= {"displacement": {"kind": "triangle", "at": PLUCK_AT, "amplitude": AMPLITUDE}}
    pickup = {"body": "string", "at": 0.1}
    accuracy = {"least_detuning": 0.0, "silence": float("-inf")}
    stretching = {"axial_stiffness": axial} if is_stretching else {}
    return engine.Scene.model_validate({"body": [body | stretching], "pickup": [pickup], "accuracy": accuracy})


class Moved:
    """A way to move a string; a call returns the seconds of a sample."""

    def __init__(self, modes: int, is_stretching: bool, in_steps: bool) -> None:
        scene = string(modes, is_stretching)
        self._model, self._state, _ = build(scene, RATE, scene.accuracy)
        self._simulation = None if in_steps else Simulation(self._model, self._state, measure_energy=False)
        self._audio = np.zeros((BLOCK, 1))
        self._move()  # the first block compiles

    def _move(self) -> float:
        if self._simulation is not None:
            return time_block(self._simulation, self._audio)
        begin = time.perf_counter()
        fused_passes(self._model.step, self._state.kick_compensation, self._state.q, self._state.p, BLOCK)
        return time.perf_counter() - begin

    def __call__(self) -> float:
        return sum(self._move() for _ in range(REPEATS)) / REPEATS / BLOCK


@kernel  # type: ignore[untyped-decorator]
def change_of_rise(modes: Any, half: float, rise: float, change: Any) -> None:
    """Find by how much a tension differs from its guess after one sum over the modes, and what the series leaves."""
    zeros = splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    sums = series_of_stretch(fold(add_stretch_sums, (modes, rise), modes.size, zeros), (0.0, 0.0))
    change[0] = solve_polynomial(rise, half, sums)
    change[1] = half * abs(sums[4] * change[0] ** 4)


def count_sums(modes: int, seconds: float = 1.0) -> float:
    """Sums over the modes per sample: one where the guess is so near that the series of its sum suffices, else two."""
    scene = string(modes, is_stretching=True)
    model, state, _ = build(scene, RATE, scene.accuracy)
    simulation, audio, counted, frames = (
        Simulation(model, state, kernel="general"),
        np.zeros((1, 1)),
        0,
        round(seconds * RATE),
    )
    kappa, kick, drift = model.tension.kappa, model.step.kick, model.step.drift
    factor, body, change = model.tension.factor[0], state.tension.body[0], np.zeros(2)
    for _ in range(frames):
        q, (last, second, third) = state.q.copy(), body[[Stretch.LAST, Stretch.SECOND_LAST, Stretch.THIRD_LAST]]
        simulation.render_block(audio)
        x = (q + state.q) / 2 * (1 + 0.5 * kick * drift * kappa * body[Stretch.LAST])
        drifting = StretchingModes(kick, drift, kappa, q, 2 * (x - q) / drift, 0, q.size, *np.zeros((2, q.size)))
        guess = max(0.0, 3 * (last - second) + third)
        change_of_rise(drifting, factor[StretchFactor.STIFFNESS] / 2, guess, change)
        is_one = change[1] * factor[StretchFactor.SOFTEST] <= ROUNDING * (guess + change[0])
        counted += 1 if is_one else 2
    return counted / frames


def run() -> None:
    """Measure, print and write the table."""
    pin()
    rows = []
    for modes in MODES:
        ways = Moved(modes, False, False), Moved(modes, False, True), Moved(modes, True, False)
        flight, step, stretching = time_in_turn(*ways)
        ratios = f"{stretching.median / step.median:.1f}", f"{stretching.median / flight.median:.0f}"
        times = flight.nanoseconds, step.nanoseconds, stretching.nanoseconds
        rows.append([f"{modes}", *times, *ratios, f"{count_sums(modes):.4f}"])
    times = [f"{name}, ns per sample" for name in ("free flight", "linear, in steps", "stretching")]
    ratios = ["stretching / steps", "stretching / flight", "sums over the modes per sample"]
    publish("stretching", ["modes", *times, *ratios], rows)


if __name__ == "__main__":
    run()
