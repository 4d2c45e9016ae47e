"""What joined bodies cost: a choir on a board in real time, and joined bodies in free vibration against one fused pass
over the same modes; the error of energy beside."""

import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

import engine
from bench.performance.turns import RATE, Replay, time_in_turn
from bench.publish.report import figure, pin, publish
from bench.scenes.choirs import choir, keyboard, struck_choir
from engine.assembly.build import build
from engine.kernel.modes.mode_step import Motion, free_step
from engine.offline.simulation import Simulation, time_block

BLOCK = 256
REPEATS = 40  # blocks of a turn
UNHEARD = [{"body": "board", "quantity": "force"}]  # no contacts: the pickup costs nothing


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def fused_passes(h: Any, compensation: np.ndarray, q: np.ndarray, p: np.ndarray, frames: int) -> float:
    """So many steps of modes on which nothing acts. Returns the energy lost, J."""
    lost = 0.0
    for _ in range(frames):
        lost += free_step(h, Motion(q, p, compensation))
    return lost


def fused_pass(scene: engine.Scene) -> Callable[[], float]:
    """Return what steps the modes of a scene as if nothing were joined, and returns the seconds of a step."""
    model, state, _ = build(scene, RATE)
    state.p[:] = 1.0

    def run() -> float:
        begin = time.perf_counter()
        for _ in range(REPEATS):
            fused_passes(model.step, state.kick_compensation, state.q, state.p, BLOCK)
        return (time.perf_counter() - begin) / REPEATS / BLOCK

    run()  # compiles
    return run


def joined(scene: engine.Scene) -> Callable[[], float]:
    """Return what renders a scene in free vibration, and returns the seconds of a sample."""
    model, state, _ = build(scene, RATE, scene.accuracy.replace(silence=-np.inf))
    state.p[:] = 1.0
    simulation, audio = Simulation(model, state, measure_energy=False), np.zeros((BLOCK, 1))
    return lambda: sum(time_block(simulation, audio) for _ in range(REPEATS)) / REPEATS / BLOCK


def first_partial(scene: engine.Scene) -> tuple[np.ndarray, np.ndarray]:
    """The level of a C4's first partial, dB, and when, s."""
    audio, size, hop = engine.render(scene, 4.5).audio[:, 0], 8192, 1024
    wave = np.hanning(size) * np.exp(-2j * np.pi * 261.6256 * np.arange(size) / RATE)
    starts = np.arange(0, len(audio) - size, hop)
    return (starts + size / 2) / RATE, 20 * np.log10([abs(audio[s : s + size] @ wave) for s in starts])


def draw_two_stages() -> None:
    """How the shipped choir dies away, and one string of it alone."""
    choir_scene = engine.load("piano_choir").model_copy(update={"event": []})
    gone = {"left", "right"}
    table = choir_scene.model_dump(exclude_none=True)
    for section, keys in (("body", ("name",)), ("connection", ("body",)), ("contact", ("on",))):
        table[section] = [item for item in table[section] if not {item.get(key) for key in keys} & gone]
    with figure("two_stages", 7, 4) as axes:
        for name, scene in (("three strings", choir_scene), ("one string", engine.Scene.model_validate(table))):
            seconds, level = first_partial(scene)
            axes.plot(seconds, level - level.max(), label=name)
        axes.set(xlabel="time, s", ylabel="first partial of the board, dB", ylim=(-70, 3))
        axes.grid(True, alpha=0.2)
        axes.legend()


def run() -> None:
    """Measure, print and write the tables."""
    pin()
    free = []
    for strings, table in (("1", choir(1)), ("3", choir(3)), ("207", keyboard())):
        scene = engine.Scene.model_validate(table | {"pickup": UNHEARD})
        modes = build(scene, RATE)[1].q.size
        fused, whole = time_in_turn(fused_pass(scene), joined(scene))
        ratio = f"{whole.median / fused.median:.2f}"
        free.append([f"{strings} + board", f"{modes}", fused.nanoseconds, whole.nanoseconds, ratio])
    times = ["unconnected modes, ns per sample", "connected bodies, ns per sample"]
    publish("joined", ["strings", "modes", *times, "ratio"], free, "connections")
    rows = []
    for name, scene in (("three strings, a board and a hammer", engine.Scene.model_validate(struck_choir())),):
        found = []
        for settings in ({}, {"substeps": 2}, {"order": 4}):
            changed = scene.model_copy(update={"accuracy": scene.accuracy.replace(**settings)})
            (taken,) = time_in_turn(Replay(changed, 1.0, metered=True), turns=5)
            found.append(f"{1 / (taken.median * RATE):.0f}")
            error = engine.render(changed, 10.0).stats.energy.error_max
            found.append(f"{error:.0e}")
        rows.append([name, *found])
    header = ["scene"]
    for setting in ("order 2", "two substeps", "order 4"):
        header += [f"{setting}, × real time", "energy error in 10 s"]
    publish("choir", header, rows, "connections")
    draw_two_stages()


if __name__ == "__main__":
    run()
