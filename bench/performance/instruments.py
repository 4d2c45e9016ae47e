"""How fast bodies with many modes run, alone and many at once, on one core and on two."""

import time

import numpy as np

import engine
from bench.publish.report import pin, publish
from bench.scenes.families import bank, hammered, tanpuras
from engine.assembly.build import build
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation
from engine.offline.statistics import newton_statistics

RATE = 44_100
FRAMES = 16_384
REPEATS = 15


def measure(
    scene: engine.Scene,
    seconds: float,
    warm: float = 0.0,
    cores: int = 1,
    metered: bool = False,
    repeats: int = REPEATS,
) -> tuple[float, Simulation, np.ndarray]:
    """Seconds per sample, minimum of the repeats from the state after `warm` seconds; the simulation, and
    the last samples."""
    model, state, _ = build(scene, RATE, scene.accuracy.replace(silence=-np.inf))
    if not state.p.any() and model.force is None:
        state.p[:] = 1.0  # or it would sleep
    simulation = Simulation(model, state, cores, metered)
    out = np.zeros((FRAMES, scene.channels))

    def render(frames: int) -> None:
        for begin in range(0, frames, FRAMES):
            simulation.render_block(out[: min(FRAMES, frames - begin)])

    render(64)  # compiles
    render(max(0, round(warm * RATE) - 64))
    saved = [(array, array.copy()) for array in arrays_of(state)]
    frames = round(seconds * RATE)
    best = np.inf
    for _ in range(repeats):
        for array, copy in saved:
            array[...] = copy
        begin = time.perf_counter()
        render(frames)
        best = min(best, (time.perf_counter() - begin) / frames)
    return best, simulation, out


def alone() -> None:
    """One core."""
    rows = []
    families = [
        ("free bank of 1000 modes", bank(1000), 1000, 0.5, 0.0),
        ("hammer on a string of 61 modes", hammered(1, 61), 62, 2.0, 0.0),
        ("hammers on 250 strings, 20 000 modes", hammered(250, 80), 20_250, 0.2, 0.0),
        *(
            (
                f"tanpura, 80 modes, {points}-point bridge, α = {exponent:g}",
                tanpuras(1, points, exponent),
                80,
                1.0,
                0.06,
            )
            for points in (30, 16)
            for exponent in (1.0, 1.5, 1.3)
        ),
    ]
    for name, scene, modes, seconds, warm in families:
        best, simulation, _ = measure(scene, seconds, warm)
        metered, checked, _ = measure(scene, seconds, warm, metered=True)
        solves = newton_statistics(simulation.model, simulation.state)
        rows.append(
            [
                name,
                f"{1 / best / RATE:.1f}",
                f"{best * 1e9:.0f}",
                f"{best * 1e9 / modes:.2f}",
                f"{1 / metered / RATE:.1f}",
                f"{checked.energies()['error_max']:.0e}",
                f"{solves['mean']:.2f} / {solves['max']}" if solves["solves"] else "none",
            ]
        )
    speeds = ["× real time", "ns per sample", "ns per mode and sample", "× real time, energies measured"]
    header = ["scene, one core", *speeds, "energy error", "iterations, mean / maximum"]
    publish("instruments", header, rows)


def together() -> None:
    """Two cores against one."""
    rows = []
    families = [(f"{n} hammered strings of 61 modes", hammered(n, 61), 2.0) for n in (2, 4, 8, 16, 64)]
    families += [(f"{n} tanpura strings, 16-point bridges", tanpuras(n, 16), 0.4) for n in (2, 16)]
    for name, scene, seconds in families:
        one = two = np.inf
        for _ in range(6):  # in turn, so that a slow phase of the machine meets both
            slow, _, heard = measure(scene, seconds, repeats=4)
            fast, simulation, again = measure(scene, seconds, cores=2, repeats=4)
            one, two = min(one, slow), min(two, fast)
        same = "yes" if np.array_equal(heard, again) else "**no**"
        rows.append(
            [
                name,
                str(simulation.partitions),
                f"{1 / one / RATE:.1f}",
                f"{1 / two / RATE:.1f}",
                f"{one / two:.2f}",
                same,
            ]
        )
    header = ["scene", "partitions", "× real time, one core", "× real time, two cores", "ratio", "same samples"]
    publish("cores", header, rows, "instruments")


def run() -> None:
    """Measure and publish."""
    together()
    pin()
    alone()
