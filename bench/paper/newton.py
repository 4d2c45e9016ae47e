"""Iterations of the contact solve: per patch, over exponents and β, against the tolerance; and beside them those of
Newton's method as the paper has it, from the x of the step before (its sec. 2.1.2: "typically below 6")."""

import functools
import math

import numba
import numpy as np

import engine
from bench.accuracy.metric import ALPHAS, DECADES, RATE, collision
from bench.performance.turns import Replay, time_in_turn
from bench.publish.report import ROOT, figure, pin, publish
from bench.scenes.families import tanpuras
from engine.offline.statistics import newton_statistics
from engine.patch.accuracy import Accuracy

BODIES = 24
CLOSE = 1e-9  # relative change of x at which the paper's iteration ends; rounding in its formula stalls finer ones
MOST = 100  # and then it did not end
FEW = 6
TOLERANCES = (1e-15, 1e-12, 1e-8, 1e-4)


@numba.njit(error_model="numpy")
def paper(s, g, compliance, alpha):
    """Iterations of Newton's method on F(x) = x - g + B·φ(x) for steps in a row, each from the x before.

    s, g: compression at the start of each step and the move without contact, m; compliance: B·kc
    """
    counts, x = np.zeros(s.size, np.int64), g[0]
    for n in range(s.size):
        a = max(s[n], 0.0)
        if s[n] <= 0.0 and s[n] + g[n] <= 0.0:
            x = g[n]
            continue
        while counts[n] < MOST:
            counts[n] += 1
            b = max(s[n] + x, 0.0)
            if abs(x) > 1e-9 * max(a, b):
                mean = (b * b**alpha - a * a**alpha) / ((alpha + 1.0) * x)
                slope = (b**alpha - mean) / x
            else:  # the limit of the same
                mean, slope = a**alpha, 0.5 * alpha * a ** (alpha - 1.0)
            step = (x - g[n] + compliance * mean) / (1.0 + compliance * slope)
            x -= step
            if abs(step) <= CLOSE * max(abs(x), 1e-3 * abs(g[n])):
                break
        if not math.isfinite(x):
            x = g[n]
    return counts


@functools.cache
def counts(alpha: float, beta: float) -> tuple[float, int, float, int, float]:
    """Mean and largest count of a collision, ours and of the paper's iteration, and the share of its that are few."""
    rendering, stiffness = collision(alpha, beta, BODIES)
    ours = rendering.stats["newton"]
    assert ours["unconverged"] == 0
    found = []
    for i in range(BODIES):
        s, v = rendering.trace["compression"][:-1, i], rendering.trace["velocity"][:-1, i]
        found.append(paper(s, v / RATE, 0.5 * stiffness / RATE**2, float(alpha)))
    theirs = np.concatenate(found)
    theirs = theirs[theirs > 0]
    return ours["mean"], ours["max"], float(theirs.mean()), int(theirs.max()), float((theirs <= FEW).mean())


def surface() -> None:
    """Counts over α and β."""
    grid = np.array([[counts(a, 10.0**d) for d in DECADES] for a in ALPHAS])
    names = (
        "this engine, mean",
        "this engine, maximum",
        "paper's iteration, mean",
        "paper's iteration, maximum",
    )
    rows = []
    for alpha, row in zip(ALPHAS, grid, strict=True):
        mean, most, their_mean, their_most, few = row.T
        most_theirs = f"{their_most.max():.0f}" if their_most.max() < MOST else "no convergence (rounding)"
        ours = f"{mean.mean():.2f}", f"{most.max():.0f}"
        rows.append([f"{alpha:g}", *ours, f"{their_mean.mean():.2f}", most_theirs, f"{few.min():.0%}"])
    header = ["α, with β from 1e-3 to 1e8", *names, f"paper's iteration, smallest share of solves within {FEW}"]
    publish("iterations", header, rows, "newton")
    with figure("newton", 11, 8, nrows=2, ncols=2) as axes:
        for n, (plot, name) in enumerate(zip(axes.flat, names, strict=True)):
            image = plot.pcolormesh(list(DECADES), range(len(ALPHAS)), grid[:, :, n], cmap="viridis", vmin=0, vmax=8)
            plot.set_yticks(range(len(ALPHAS)), [f"{a:g}" for a in ALPHAS])
            plot.set(title=f"{name}: up to {grid[:, :, n].max():.3g}", xlabel="log10 β", ylabel="exponent α")
            plot.figure.colorbar(image, extend="max")


def patches() -> None:
    """Counts and solve outcomes of every shipped patch."""
    rows = []
    for path in sorted((ROOT / "patches").glob("*.toml")):
        newton = engine.render(engine.load(path), cores=1).stats.newton
        outcomes = newton.solve_outcomes
        samples = max(1, outcomes.free + outcomes.solved)
        shares = [
            f"{outcomes[name] / samples:.2%}" for name in ("free", "separation", "closed_form", "newton", "capped")
        ]
        histogram = ", ".join(f"{n}: {count}" for n, count in enumerate(newton.histogram) if count)
        counts = [f"{newton.mean:.2f}", str(newton.p99), str(newton.max)] if newton.solves else ["–"] * 3
        rows.append([path.stem, *counts, histogram, *shares, str(newton.unconverged)])
    counts = ["iterations, mean", "iterations, 99th percentile", "iterations, maximum", "iterations: solves"]
    outcomes = ["no contact", "separation", "closed form", "iteration", "iteration limit reached"]
    publish("newton", ["patch", *counts, *outcomes, "failed solves"], rows)


def tolerance() -> None:
    """What a looser tolerance saves."""
    rows = []
    scenes = {
        "Fig. 6, α = 2": engine.load(ROOT / "patches" / "repelled_oscillator.toml"),
        "tanpura, 16 points, α = 1.3": tanpuras(1, 16, 1.3),
    }
    for name, scene in scenes.items():
        for close in TOLERANCES:
            told = scene.model_copy(update={"accuracy": Accuracy(tolerance=close)})
            replay = Replay(told, 0.5, 0.06, metered=True)
            (taken,) = time_in_turn(replay)
            found = newton_statistics(replay.simulation.model, replay.simulation.state)
            error = replay.simulation.energies()["error_max"]
            iterations = f"{found['mean']:.2f} / {found['max']}"
            rows.append([name, f"{close:.0e}", iterations, taken.nanoseconds, f"{error:.0e}"])
    publish(
        "tolerance",
        ["scene", "tolerance", "iterations, mean / maximum", "ns per sample", "energy error"],
        rows,
        "newton",
    )


def run() -> None:
    """Measure, publish and draw."""
    pin()
    patches()
    surface()
    tolerance()
