"""The paper's energy preservation metric P (eq. 21) over exponents α and β = kc·h²/m: its Fig. 3, and beyond."""

import functools

import numpy as np

import engine
from bench.publish.report import figure, publish

RATE = 44_100
BODIES = 192  # P of a collision of two samples is a multiple of half a rounding: take the mean of many
ALPHAS = [1, 1.3, 1.5, 2, 2.5, 3, 4, 5, 6, 8]
DECADES = range(-3, 9)


def collision(alpha: float, beta: float, bodies: int) -> tuple[engine.Rendering, float]:
    """A collision with a barrier, traced: unit masses that start between 1.6 and 2 m/s (the paper's Figs. 1 and 2:
    2 m/s) and 10 to 20 mm from it; and the barrier's stiffness. β in m^(1-α)."""
    stiffness = beta * RATE**2
    rng = np.random.default_rng(7)
    speeds, places = rng.uniform(1.6, 2.0, bodies), -rng.uniform(0.01, 0.02, bodies)
    deepest = ((alpha + 1) * 4.0 / (2 * stiffness)) ** (1 / (alpha + 1))
    names = [f"b{i}" for i in range(bodies)]
    law = {"barrier": 0.0, "stiffness": stiffness, "exponent": float(alpha)}
    scene = engine.Scene.model_validate(
        {
            "body": [
                {"name": n, "kind": "mass", "mass": 1.0, "displacement": y, "velocity": v}
                for n, y, v in zip(names, places.tolist(), speeds.tolist(), strict=True)
            ],
            "contact": [{"body": n} | law for n in names],
            "pickup": [{"body": "b0"}],
        }
    )
    return engine.render(scene, seconds=0.022 + 8 * deepest, scheme="fdh", trace=True), stiffness


@functools.cache
def preservation(alpha: float, beta: float) -> float:
    """P: mean |H(n+1) - H(n)|/H(0) over the samples of a collision with a barrier; mean over many bodies."""
    rendering, stiffness = collision(alpha, beta, BODIES)
    # evaluated in extended precision: the error of the states, not of this line
    speed, compression = (rendering.trace[name].astype(np.longdouble) for name in ("velocity", "compression"))
    compression = np.maximum(compression, 0.0)
    total = 0.5 * speed**2 + np.longdouble(stiffness) / (alpha + 1) * compression * compression**alpha
    found = []
    for i in range(BODIES):
        touching = np.flatnonzero(rendering.trace["force"][:, i])
        first, last = touching[0] - 1, touching[-1]
        steps = np.abs(np.diff(total[first : last + 1, i]))
        found.append(steps.sum() / ((last - first + 1) * total[0, i]))
    return float(np.mean(found))


def run() -> None:
    """Measure, publish and draw."""
    grid = np.array([[preservation(a, 10.0**d) for d in DECADES] for a in ALPHAS])
    rows = [[f"{a:g}", f"{row.min():.1e}", f"{row.max():.1e}"] for a, row in zip(ALPHAS, grid, strict=True)]
    publish("metric", ["α", "smallest P over β = 1e-3 … 1e8", "largest P"], rows)
    with figure("metric", 7, 4) as plot:
        image = plot.pcolormesh(list(DECADES), range(len(ALPHAS)), grid, vmin=0.0, vmax=2e-16, cmap="viridis")
        plot.set_yticks(range(len(ALPHAS)), [f"{a:g}" for a in ALPHAS])
        plot.set_xlabel("log10 β")
        plot.set_ylabel("exponent α")
        plot.set_title(f"P of eq. (21): at most {grid.max():.1e}; the paper's Fig. 3 ends at 2e-16")
        plot.figure.colorbar(image, label="P")
