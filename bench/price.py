"""What accuracy costs, on one page: error against time for the paper's systems and the instruments.

One body at a wall is also computed by other methods, at finer and finer steps; methods that fail stay in the plot,
with how they failed.
"""

import time
from typing import Any

import numpy as np

import engine
from bench.baselines import SCHEMES, Body, hamiltonian, pull, simulate
from bench.hard import FAR, scene_of
from bench.report import ROOT, figure, pin, publish
from engine.price import price

RATE = 44_100
FINER = (1, 4, 16, 64)
GOAL = 1e-2
PATIENCE = 20.0  # s, for one run of SciPy

# seconds, and the one body at a wall that the other methods compute, with its start
SINGLE: dict[str, tuple[float, Body, float, float]] = {
    "repelled_oscillator": (0.05, Body((2 * np.pi * 440) ** 2, 2.5e10, 2.0, -0.93e-3, -FAR, 0.0), -2e-3, 0.0),
    "barrier_quadratic": (0.1, Body(0.0, 2551549.413, 2.0, 0.0, -FAR, 0.0), -0.1, 2.0),
    "stiff_walls": (0.05, Body(0.0, 1e11, 1.0, 1e-3, -1e-3, 0.0), 0.0, 2.0),
}
INSTRUMENTS = ("piano_c2", "piano_c4", "marimba", "ball_on_drum", "guitar_frets", "tanpura", "rattle")


def others(body: Body, y: float, v: float, frames: int, reference: np.ndarray) -> list[dict[str, Any]]:
    """Errors and times of the other methods."""
    rows = []
    size = np.sqrt(np.mean(reference**2))
    for name in SCHEMES:
        if name.startswith("FDN") and body.alpha not in (1.0, 3.0):
            continue
        simulate(name, body, y, v, 1 / RATE, 2)  # compile before the clock starts
        for finer in FINER:
            best = np.inf
            for _ in range(3):
                begin = time.perf_counter()
                run = simulate(name, body, y, v, 1 / RATE / finer, frames * finer)
                best = min(best, time.perf_counter() - begin)
            rows.append(judged(f"{name}, {finer} ×", run[::finer, 0], reference, size, best / frames * 1e9))
            energy = np.abs(run[:, 1] / run[0, 1] - 1).max()
            rows[-1]["energy_error"] = float(energy) if np.isfinite(energy) else np.inf
    for tolerance in (1e-4, 1e-7, 1e-10):
        rows.append(adaptive(body, y, v, frames, reference, size, tolerance))
    return rows


def judged(name: str, run: np.ndarray, reference: np.ndarray, size: float, ns: float) -> dict[str, Any]:
    """A row of the table."""
    with np.errstate(all="ignore"):
        error = float(np.sqrt(np.mean((run[: len(reference)] - reference) ** 2)) / size)
    failed = "" if np.isfinite(run).all() and np.abs(run).max() < 10 * np.abs(reference).max() else "blows up"
    return {"setting": name, "error": error if not failed else np.nan, "ns_per_sample": ns, "failed": failed}


def adaptive(
    body: Body, y: float, v: float, frames: int, reference: np.ndarray, size: float, tolerance: float
) -> dict[str, Any]:
    """SciPy's DOP853, stopped and begun again wherever the body meets the wall or leaves it."""
    from scipy.integrate import solve_ivp

    def above(t: float, x: np.ndarray) -> float:
        return float(x[0] - body.above)

    def below(t: float, x: np.ndarray) -> float:
        return float(x[0] - body.below)

    above.terminal = below.terminal = True  # type: ignore[attr-defined]
    times = np.arange(frames) / RATE
    begin, now, state, run, first = time.perf_counter(), 0.0, [y, v], np.empty(frames), 0
    while first < frames and time.perf_counter() - begin < PATIENCE:
        done = solve_ivp(
            lambda t, x: [x[1], pull(body, x[0])],
            (now, times[-1] + 1 / RATE),
            state,
            method="DOP853",
            events=(above, below),
            rtol=tolerance,
            atol=tolerance * size,
            dense_output=True,
        )
        last = int(np.searchsorted(times, done.t[-1], side="right"))
        if last > first:
            run[first:last] = done.sol(times[first:last])[0]
            first = last
        if done.status != 1:
            break
        now, state = done.t[-1], done.y[:, -1]
        state = [state[0] + np.sign(state[1]) * 1e-15, state[1]]  # off the wall, or it is met again at once
    elapsed = time.perf_counter() - begin
    run[first:] = np.nan  # gave up
    row = judged(f"DOP853, {tolerance:.0e}", run, reference, size, elapsed / frames * 1e9)
    energy = [hamiltonian(body, *x) for x in done.y.T] + [hamiltonian(body, y, v)]
    return row | {"energy_error": float(np.ptp(energy) / energy[-1])}


def draw(name: str, ours: list[dict[str, Any]], theirs: list[dict[str, Any]], verdict: str) -> None:
    """One plot of error against time."""
    with figure(f"price_{name}", 8.0, 5.5) as axes:
        methods: dict[str, list[dict[str, Any]]] = {}
        for row in theirs:
            methods.setdefault(row["setting"].rpartition(",")[0], []).append(row)
        for method, rows in methods.items():
            axes.plot([r["ns_per_sample"] for r in rows], [r["error"] for r in rows], "x--", lw=0.8, label=method)
            for row in rows:
                if row["failed"]:
                    axes.annotate(f"{row['setting']} {row['failed']}", (row["ns_per_sample"], 1.0), fontsize=7)
        for start in ("order 2", "order 4", "fdh", "oversample", "float32"):
            rows = [r for r in ours if r["setting"].startswith(start)]
            axes.plot([r["ns_per_sample"] for r in rows], [r["error"] for r in rows], "o-", label=start)
        told = any(np.isfinite(r["error"]) for r in ours)  # else the references disagree
        scale = "log" if told else "linear"
        axes.set(xscale="log", yscale=scale, xlabel="ns per sample", ylabel="relative error")
        axes.set_title(f"{name}: {verdict}", size=9)
        axes.grid(True, which="both", alpha=0.2)
        axes.legend(fontsize=7)


def best(rows: list[dict[str, Any]], goal: float = GOAL) -> str:
    """The cheapest row that meets the goal."""
    good = [r for r in rows if r["error"] <= goal]
    if not good:
        return "none"
    row = min(good, key=lambda r: r["ns_per_sample"])
    return f"{row['setting']}: {row['ns_per_sample']:.0f} ns"


def run() -> None:
    """Price all scenes."""
    pin()
    lines = []
    for name in (*SINGLE, *INSTRUMENTS):
        if name in SINGLE:
            seconds, *case = SINGLE[name]
            scene = scene_of(*case)
        else:
            seconds, scene = None, engine.load(ROOT / "patches" / f"{name}.toml")
        found = price(scene, seconds)
        ours, theirs = found["rows"], []
        if name in SINGLE:
            fine = engine.render(scene, seconds=seconds, order=6, substeps=16).audio[:, 0]
            theirs = others(*case, len(fine), fine[: round(found["horizon"] * RATE)])
        publish(
            f"price_{name}",
            ["setting", "error", "ns per sample", "energy error", "third-octave bands, dB", "Newton mean / max"],
            [
                [
                    r["setting"],
                    r.get("failed") or f"{r['error']:.1e}",
                    f"{r['ns_per_sample']:.0f}",
                    f"{r['energy_error']:.0e}",
                    f"{r['bands_db']:.2f}" if "bands_db" in r else "",
                    f"{r['newton']['mean']:.2f} / {r['newton']['max']}" if "newton" in r else "",
                ]
                for r in [*ours, *theirs]
            ],
            "price",
        )
        draw(name, ours, theirs, found["verdict"])
        plain = next(r for r in ours if r["setting"] == "order 2, 1 ×")
        lines.append(
            [
                f"[{name}](bench/figures/price_{name}.png)",
                f"{plain['error']:.0e}, {plain['ns_per_sample']:.0f} ns",
                best(ours),
                best(theirs) if theirs else "",
                f"{found['horizon'] * 1e3:.0f}",
                found["verdict"],
            ]
        )
    header = ["scene", "one plain step", f"cheapest under {GOAL:.0e}", "of other methods", "predictable, ms", "learnt"]
    publish("price", header, lines)
