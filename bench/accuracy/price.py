"""Accuracy and cost, on one page: error against time for the paper's systems and the instruments.

One body at a wall is also computed by other methods, at finer and finer steps; methods that fail stay in the plot,
with how they failed.
"""

from typing import Any, NamedTuple

import engine
from bench.accuracy import dial
from bench.accuracy.hard import scene_of
from bench.publish.report import ROOT, figure, pin, publish
from bench.rivals.single_body import SingleBody
from bench.rivals.single_body_errors import MethodResult, draw_methods, methods_beside
from engine.analysis.work_precision import WorkPrecisionStudy, measure_work_precision
from engine.report.work_precision_plot import draw_work_precision

GOAL = 1e-2

# seconds of each
PAPERS = {"repelled_oscillator": 0.05, "barrier_quadratic": 0.1, "bouncing_ball": 0.5}
WALLS = SingleBody(0.0, 1e11, 1.0, 1e-3, -1e-3, 0.0), 0.0, 2.0  # stiff, 2 mm apart
SHOWN = {"repelled_oscillator": "oscillator at a stop", "stiff_walls": "between stiff walls", "piano_c4": "piano, C4"}
SETTINGS = [f"order {order}, {n} ×" for order, n in ((2, 1), (2, 4), (2, 16), (4, 1), (4, 4))]
SETTINGS += [f"{method}, {n} ×" for method in ("RK4", "Störmer-Verlet") for n in (1, 64)]
INSTRUMENTS = ("piano_c2", "piano_c4", "marimba", "ball_on_drum", "guitar_frets", "tanpura", "rattle")


class Priced(NamedTuple):
    """A scene's errors and times, at the settings of this engine and by other methods."""

    study: WorkPrecisionStudy
    others: list[MethodResult]


def best(rows: list[dict[str, Any]], goal: float = GOAL) -> str:
    """The cheapest row that meets the goal."""
    good = [r for r in rows if r["error"] <= goal]
    if not good:
        return "none"
    row = min(good, key=lambda r: r["ns_per_sample"])
    return f"{row['setting']}: {row['ns_per_sample']:.0f} ns"


def table() -> None:
    """Measure error and time of all scenes."""
    lines, priced = list[list[str]](), dict[str, Priced]()
    for name in (*PAPERS, "stiff_walls", *INSTRUMENTS):
        scene = scene_of(*WALLS) if name == "stiff_walls" else engine.load(ROOT / "patches" / f"{name}.toml")
        found = measure_work_precision(scene, 0.05 if name == "stiff_walls" else PAPERS.get(name))
        ours, theirs = found["rows"], methods_beside(found, scene)
        priced[name] = Priced(found, theirs)
        publish(
            f"price_{name}",
            ["setting", "error", "ns per sample", "energy error", "third-octave bands, dB", "Newton mean / max"],
            [
                [
                    r["setting"],
                    ("failed" in r and r["failed"]) or f"{r['error']:.1e}",
                    f"{r['ns_per_sample']:.0f}",
                    f"{r['energy_error']:.0e}",
                    f"{r['bands_db']:.2f}" if "bands_db" in r else "",
                    f"{r['newton']['mean']:.2f} / {r['newton']['max']}" if "newton" in r else "",
                ]
                for r in [*ours, *theirs]
            ],
            "price",
        )
        with figure(f"price_{name}", 9.0, 6.0) as axes:
            axes.set_title(f"{name}: {found['verdict']}", size=9)
            draw_work_precision(axes, found)
            if theirs:
                draw_methods(axes, theirs)
        plain = next(r for r in ours if r["setting"] == "order 2, 1 ×")
        lines.append(
            [
                f"[{name}](bench/figures/price_{name}.png)",
                f"{plain['error']:.0e}, {plain['ns_per_sample']:.0f} ns",
                best(ours),
                best(theirs) if theirs else "",
                f"{found['horizon'] * 1e3:.0f}",
                f"{max(r['energy_error'] for r in ours):.0e}",
                found["verdict"],
            ]
        )
    cheapest = [f"cheapest {kind} with an error below {GOAL:.0e}" for kind in ("setting", "other method")]
    header = ["scene", "one step per sample: error, time", *cheapest, "predictability horizon, ms"]
    publish("price", [*header, "largest energy error", "result"], lines)
    beside(priced)


def beside(priced: dict[str, Priced]) -> None:
    """Error, time and energy error at some settings, three scenes beside each other."""
    lines = []
    for setting in SETTINGS:
        rows = [
            [r for r in [*priced[name].study["rows"], *priced[name].others] if r["setting"] == setting]
            for name in SHOWN
        ]
        line = [setting]
        for row in (r[0] if r else None for r in rows):
            line.append(("failed" in row and row["failed"]) or f"{row['error']:.0e}" if row else "")
            line.append(f"{row['ns_per_sample']:.0f}" if row else "")
        lines.append([*line, f"{max(r[0]['energy_error'] for r in rows if r):.0e}"])
    head = [f"{scene}: {what}" for scene in SHOWN.values() for what in ("error", "ns")]
    publish("first", ["", *head, "energy error"], lines, "price")


def run() -> None:
    """Measure error and time of all scenes, then the requirements on the accuracy settings."""
    pin()
    table()
    dial.run()
