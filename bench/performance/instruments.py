"""How fast bodies with many modes run, alone and many at once, on one core and on two."""

import numpy as np

from bench.performance.turns import RATE, Replay, time_in_turn
from bench.publish.report import pin, publish
from bench.scenes.families import bank, hammered, tanpuras
from engine.offline.statistics import newton_statistics


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
        plain, checked = Replay(scene, seconds, warm), Replay(scene, seconds, warm, metered=True)
        time, metered = time_in_turn(plain, checked)
        solves = newton_statistics(plain.simulation.model, plain.simulation.state)
        rows.append(
            [
                name,
                f"{1 / time.median / RATE:.1f}",
                time.nanoseconds,
                f"{time.median * 1e9 / modes:.2f}",
                f"{1 / metered.median / RATE:.1f}",
                f"{checked.simulation.energies()['error_max']:.0e}",
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
        alone, both = Replay(scene, seconds), Replay(scene, seconds, cores=2)
        one, two = time_in_turn(alone, both)
        same = "yes" if np.array_equal(alone.audio, both.audio) else "**no**"
        speeds = f"{1 / one.median / RATE:.1f}", f"{1 / two.median / RATE:.1f}", f"{one.median / two.median:.2f}"
        spread = f"{100 * max(one.spread, two.spread):.0f} %"
        rows.append([name, str(both.simulation.partitions), *speeds, spread, same])
    header = [
        "scene",
        "partitions",
        "× real time, one core",
        "× real time, two cores",
        "ratio",
        "spread",
        "same samples",
    ]
    publish("cores", header, rows, "instruments")


def run() -> None:
    """Measure and publish."""
    together()
    pin()
    alone()
