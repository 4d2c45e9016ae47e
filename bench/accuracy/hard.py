"""Hard cases, by other schemes and by ours: who blows up, who sticks, who drifts. And what silence costs."""

import time

import numpy as np

import engine
from bench.publish.report import figure, pin, publish
from bench.rivals.single_body import METHODS, SingleBody, simulate
from engine.assembly.build import build
from engine.offline.simulation import Simulation

RATE = 44_100
FAR = 1e3  # m, where no wall is met
# case: (seconds, body, place, velocity), unit mass
CASES = {
    "soft barrier, α = 1 (Fig. 2)": (0.15, SingleBody(0.0, 2.5e3, 1.0, 0.0, -FAR, 0.0), -0.1, 2.0),
    "soft barrier, α = 3 (Fig. 1)": (0.15, SingleBody(0.0, 2.5e7, 3.0, 0.0, -FAR, 0.0), -0.1, 2.0),
    "between walls, α = 1, kc = 1e13": (1.0, SingleBody(0.0, 1e13, 1.0, 1e-3, -1e-3, 0.0), 0.0, 2.0),
    "between walls, α = 3, kc = 1e16": (1.0, SingleBody(0.0, 1e16, 3.0, 1e-3, -1e-3, 0.0), 0.0, 2.0),
    "repelled oscillator, α = 2 (Fig. 6)": (
        5.0,
        SingleBody((2 * np.pi * 440) ** 2, 2.5e10, 2.0, FAR, -0.93e-3, 0.0),
        2e-3,
        0.0,
    ),
    "ball on a floor, α = 1.5, kc = 1e11": (3.0, SingleBody(0.0, 1e11, 1.5, FAR, 0.0, 9.81), 0.02, 0.0),
    "squeezed, α = 1.5, kc = 1e11": (1.0, SingleBody((2 * np.pi * 300) ** 2, 1e11, 1.5, -1e-4, 1e-4, 0.0), 0.0, 0.1),
}


def scene_of(body: SingleBody, y: float, v: float) -> engine.Scene:
    """A case as a scene, with a pickup of its displacement."""
    walls = {"above": body.upper_wall, "below": body.lower_wall}
    kind = {"kind": "oscillator", "stiffness": body.stiffness} if body.stiffness else {"kind": "mass"}
    return engine.Scene.model_validate(
        {
            "gravity": body.gravity,
            "body": [{"name": "b", "mass": 1.0, "displacement": y, "velocity": v} | kind],
            "contact": [
                {"body": "b", "side": side, "barrier": at, "stiffness": body.wall_stiffness, "exponent": body.alpha}
                for side, at in walls.items()
                if abs(at) < FAR
            ],
            "pickup": [{"body": "b", "quantity": "displacement"}],
        }
    )


def ours(body: SingleBody, y: float, v: float, steps: int) -> np.ndarray:
    """The same case by this engine."""
    trace = engine.render(scene_of(body, y, v), seconds=steps / RATE, scheme="fdh", trace=True).trace
    return np.column_stack([trace[name].reshape(steps, -1)[:, 0] for name in ("displacement", "velocity", "total")])


def error(run: np.ndarray) -> np.ndarray:
    """Energy error over time, relative to the energy at the start."""
    return np.abs(run[:, -1] - run[0, -1]) / run[0, -1]


def verdict(run: np.ndarray, body: SingleBody) -> str:
    """What became of a lossless scene, and its largest energy error."""
    off = error(run)
    if not np.isfinite(off).all() or off.max() > 100.0:
        return "**blows up**"
    place = run[-len(run) // 5 :, 0]
    walled = body.upper_wall > body.lower_wall
    if walled and (place.min() > body.upper_wall or place.max() < body.lower_wall):
        return "**sticks**"
    if walled and off[-1] > 0.5 and run[-1, -1] < run[0, -1]:
        return f"**decays** {off.max():.0e}"
    return f"**drifts** {off.max():.0e}" if off.max() > 1e-3 else f"{off.max():.0e}"


def compare() -> None:
    """The table and the plot."""
    rows = []
    with figure("hard", 13, 7, nrows=2, ncols=4) as axes:
        for plot, (name, (seconds, body, y, v)) in zip(axes.flat, CASES.items(), strict=False):
            steps = round(seconds * RATE)
            row = [name]
            for n, scheme in enumerate([*METHODS, "this engine"]):
                if scheme == "FDN (eq. 4)" and body.alpha not in (1.0, 3.0):
                    row.append("not defined")
                    continue
                with np.errstate(all="ignore"):
                    run = (
                        ours(body, y, v, steps)
                        if scheme == "this engine"
                        else simulate(scheme, body, y, v, 1 / RATE, steps)
                    )
                    row.append(verdict(run, body))
                    off = np.clip(np.nan_to_num(error(run), nan=1e6), 1e-17, 1e6)
                thin = max(1, steps // 2000)
                late = np.maximum.reduceat(off, np.arange(0, steps, thin))
                ink = (
                    {"color": "black", "linewidth": 2}
                    if scheme == "this engine"
                    else {"color": f"C{n}", "linewidth": 1}
                )
                plot.semilogy(np.arange(late.size) * thin / RATE, late, label=scheme, **ink)
            plot.set_title(name, fontsize=9)
            plot.set_ylim(1e-17, 1e6)
            rows.append(row)
        axes[0, 0].set_ylabel("energy error / initial energy")
        axes[1, 0].set_ylabel("energy error / initial energy")
        axes[1, 0].set_xlabel("time [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        axes[1, 3].axis("off")
        axes[1, 3].legend(handles, labels, loc="center")
    publish("hard", ["lossless case", *METHODS, "this engine"], rows)


def tails() -> None:
    """Cost per sample when all has decayed into subnormal numbers, against that at the start."""
    rows = []
    for bodies, contacts in ((1, False), (64, False), (1, True), (64, True)):
        names = [f"b{i}" for i in range(bodies)]
        scene = engine.Scene.model_validate(
            {
                "body": [
                    {
                        "name": n,
                        "kind": "oscillator",
                        "frequency": 200.0 + 10 * i,
                        "mass": 1.0,
                        "damping_rate": 300.0,
                        "displacement": 1e-3,
                    }
                    for i, n in enumerate(names)
                ],
                "contact": [
                    {"body": n, "barrier": 0.0, "side": "below", "stiffness": 1e8, "exponent": 2.3}
                    for n in names
                    if contacts
                ],
                "pickup": [{"body": n} for n in names],
            }
        )
        early, late = np.inf, np.inf
        for _ in range(6):
            model, state, _ = build(scene, RATE)
            simulation = Simulation(model, state, measure_energy=False)
            out = np.zeros((2048, 1))
            for i in range(150):  # 7 s: exp(-150·7) is below the smallest number
                begin = time.perf_counter()
                simulation.render_block(out)
                took = (time.perf_counter() - begin) / len(out)
                early, late = (min(early, took) if i < 8 else early), (min(late, took) if i >= 110 else late)
        what = f"{bodies} oscillator{'s' * (bodies > 1)}" + (" against barriers" if contacts else "")
        rows.append([what, f"{early * 1e9:.1f}", f"{late * 1e9:.1f}", f"{late / early:.2f}"])
    publish(
        "tails",
        ["decaying scene", "ns per sample at the start", "ns per sample at subnormal amplitudes", "ratio"],
        rows,
        "hard",
    )


def run() -> None:
    """Measure, publish and draw."""
    pin()
    compare()
    tails()
