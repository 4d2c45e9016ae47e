"""How cost grows: with modes, points of contact, islands, cores and the size of a block; where two cores begin to pay,
and the largest scene of each family that runs in real time."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import engine
from bench.performance.turns import RATE, Replay, time_in_turn
from bench.publish.report import figure, pin, publish
from bench.scenes.families import bank, colliding, hammered, tanpuras
from engine.assembly.build import build
from engine.offline.simulation import Simulation

TURNS = 3
LEAST = 2000  # samples of a run
SAMPLES = 4e7  # of one mode: a run is as long as that many modes allow
MAX_SPREAD = 2.0  # ratio of the sizes that an extrapolation leads to, at most

Family = tuple[Callable[[int], engine.Scene], list[int], float]
FAMILIES: dict[str, Family] = {  # scene of n, sizes, warm-up in s
    "free modes": (bank, [10, 32, 100, 320, 1000, 3200, 10_000, 32_000], 0.0),
    "modes of a hammered string": (lambda n: hammered(1, n, 4.0), [10, 32, 100, 320, 1000], 0.0),
    "contact points of a tanpura string, α = 1": (lambda n: tanpuras(1, n), [2, 4, 8, 16, 32, 64], 0.06),
    "contact points of a tanpura string, α = 1.5": (lambda n: tanpuras(1, n, 1.5), [2, 4, 8, 16, 32], 0.06),
    "hammered strings of 61 modes": (lambda n: hammered(n, 61), [1, 4, 16, 64, 256, 1024], 0.0),
    "tanpura strings, 16-point bridges": (lambda n: tanpuras(n, 16), [1, 2, 4, 8, 16, 32], 0.06),
    "colliding masses": (colliding, [2, 8, 32, 128, 512, 2048], 0.0),
}
BLOCKS = [1, 4, 16, 64, 256, 1024, 4096]


def replay(family: str, size: int, cores: int = 1) -> Replay:
    """A scene of a family, energies measured."""
    scene_of, _, warm = FAMILIES[family]
    scene = scene_of(size)
    modes = build(scene, RATE)[1].p.size
    seconds = max(LEAST, min(SAMPLES / modes / 10, RATE / 2)) / RATE
    return Replay(scene, seconds, warm, cores, metered=True)


def slope(sizes: list[int], costs: list[float]) -> float:
    """Exponent of growth over the upper half of the sizes."""
    upper = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[upper:]), np.log(costs[upper:]), 1)[0])


def largest(sizes: list[int], costs: list[float]) -> str:
    """The largest that runs in real time: between two sizes measured, or beyond them where the slopes between the
    upper ones lead to about the same; if they do not, that it is more than the largest measured."""
    goal = np.log(1e9 / RATE)
    n, c = np.log(sizes), np.log(costs)
    slower = np.flatnonzero(c >= goal)
    if slower.size:
        at = slower[0]
        if at == 0:
            return f"fewer than {sizes[0]}"
        return f"{int(np.exp(np.interp(goal, c[at - 1 : at + 1], n[at - 1 : at + 1])))}"
    upper = len(sizes) // 2
    slopes = np.diff(c[upper - 1 :]) / np.diff(n[upper - 1 :])
    if slopes.min() > 0.0:
        least, most = n[-1] + (goal - c[-1]) / slopes.max(), n[-1] + (goal - c[-1]) / slopes.min()
        if most - least <= np.log(MAX_SPREAD):
            return f"about {float(f'{np.exp((least + most) / 2):.2g}'):.0f}"
    return f"more than {sizes[-1]}"


def growth() -> None:
    """Cost over size, one core."""
    rows = []
    with figure("scaling", 8, 6) as axes:
        for name, (_, sizes, _) in FAMILIES.items():
            costs = [time_in_turn(replay(name, n), turns=TURNS)[0].median * 1e9 for n in sizes]
            axes.loglog(sizes, costs, "o-", label=f"{name}: exponent {slope(sizes, costs):.2f}")
            ends = f"{costs[0]:.0f}", f"{costs[-1]:.0f}", f"{slope(sizes, costs):.2f}", largest(sizes, costs)
            rows.append([name, f"{sizes[0]} … {sizes[-1]}", *ends])
        axes.axhline(1e9 / RATE, color="k", ls=":", label="real time")
        axes.set(xlabel="n", ylabel="ns per sample, one core, energies measured")
        axes.grid(True, which="both", alpha=0.2)
        axes.legend(fontsize=7)
    times = ["ns per sample, smallest n", "ns per sample, largest n"]
    header = ["scene of n", "values of n", *times, "exponent of the growth of cost", "largest n in real time, one core"]
    publish("scaling", header, rows)


def blocks() -> None:
    """Cost over the size of a block."""
    rows = []
    for name, scene in (("one oscillator", colliding(2)), ("hammered string", hammered(1, 61))):
        model, state, _ = build(scene, RATE)
        simulation, found = Simulation(model, state), []
        for size in BLOCKS:
            out, best = np.zeros((size, 1)), np.inf
            for _ in range(200):
                begin = time.perf_counter()
                simulation.render_block(out)
                best = min(best, time.perf_counter() - begin)
            found.append(best / size * 1e9)
        rows.append([name, *(f"{ns:.0f}" for ns in found)])
    publish("blocks", ["ns per sample, in blocks of", *map(str, BLOCKS)], rows, "scaling")


def cores() -> None:
    """Where two cores begin to pay."""
    rows: list[list[Any]] = []
    for name, sizes in (
        ("hammered strings of 61 modes", [2, 4, 8, 16, 64]),
        ("colliding masses", [32, 128, 512, 2048]),
    ):
        for size in sizes:
            one, two = time_in_turn(replay(name, size), replay(name, size, 2))
            rows.append([f"{size} {name}", one.nanoseconds, two.nanoseconds, f"{one.median / two.median:.2f}"])
    publish("threads", ["scene", "ns per sample, one core", "ns per sample, two cores", "ratio"], rows, "scaling")


def run() -> None:
    """Measure, publish and draw. Threads are not pinned where two are used; what one does is."""
    cores()
    pin()
    growth()
    blocks()
