"""The paper's Figures 1 to 7 from our runs, in its scheme (`fdh`) at 44.1 kHz, and what may be read off them; then our
own sequel: order 4, detuning, and what refinement costs in and out of contact."""

import numpy as np

import engine
from bench.accuracy.hard import CASES, RATE
from bench.accuracy.hard import error as relative
from bench.accuracy.metric import ALPHAS, DECADES, preservation
from bench.publish.report import ROOT, figure, pin, publish
from bench.rivals.single_body import simulate
from engine.assembly.build import build
from engine.offline.simulation import Simulation, time_block
from engine.patch.accuracy import Accuracy

Rows = list[list[str]]


def traced(name: str, seconds: float | None = None, **more: object) -> dict[str, np.ndarray]:
    """A shipped patch in the paper's scheme, sample by sample."""
    settings = {"scheme": "fdh"} | more
    rendering = engine.render(engine.load(ROOT / "patches" / f"{name}.toml"), seconds=seconds, trace=True, **settings)
    return rendering.trace


def off(trace: dict[str, np.ndarray]) -> np.ndarray:
    """Energy error (paper, eq. 20)."""
    balance = trace["total"] + trace["dissipated"] - trace["supplied"]
    return np.abs(balance - balance[0]) / np.abs(trace["total"]).max() + 1e-18


def first(rows: Rows) -> None:
    """Mass and barrier, α = 2 and 3, beside the FDN of eq. (4)."""
    with figure("paper_1", 6, 6, nrows=2, sharex=True) as (top, bottom):
        for name, alpha in (("barrier_quadratic", 2), ("barrier_cubic", 3)):
            trace = traced(name, 0.15)
            top.plot(trace["time"], trace["displacement"][:, 0], label=f"FDH α={alpha}")
            bottom.semilogy(trace["time"], off(trace), label=f"FDH α={alpha}")
            rows.append(["1", f"largest energy error, α = {alpha}", "ticks 1e-16 to 1e-12", f"{off(trace).max():.0e}"])
            if alpha == 3:  # FDN has no α = 2
                contact = engine.load(ROOT / "patches" / f"{name}.toml").contact[0]
                case = CASES["soft barrier, α = 1 (Fig. 2)"][1]._replace(
                    wall_stiffness=contact.stiffness, alpha=float(alpha)
                )
                run = simulate("FDN (eq. 4)", case, -0.1, 2.0, 1 / RATE, len(trace["time"]))
                top.plot(trace["time"], run[:, 0], "--", label=f"FDN α={alpha}")
                bottom.semilogy(trace["time"], relative(run) + 1e-18, "--", label=f"FDN α={alpha}")
        labelled(top, bottom)


def second(rows: Rows) -> None:
    """A soft linear barrier, kc = 2.5e3."""
    seconds, body, y, v = CASES["soft barrier, α = 1 (Fig. 2)"]
    part = {"body": "m", "barrier": 0.0, "stiffness": body.wall_stiffness, "exponent": 1.0}
    mass = {"name": "m", "kind": "mass", "mass": 1.0, "displacement": y, "velocity": v}
    scene = engine.Scene.model_validate({"body": [mass], "contact": [part], "pickup": [{"body": "m"}]})
    trace = engine.render(scene, seconds=seconds, scheme="fdh", trace=True).trace
    other = simulate("FDN (eq. 4)", body, y, v, 1 / RATE, len(trace["time"]))
    with figure("paper_2", 6, 6, nrows=2, sharex=True) as (top, bottom):
        for label, place, error in (
            ("FDH", trace["displacement"][:, 0], off(trace)),
            ("FDN", other[:, 0], relative(other)),
        ):
            top.plot(trace["time"], place, label=label)
            bottom.semilogy(trace["time"], error + 1e-18, label=label)
        labelled(top, bottom)
    deepest = trace["displacement"][:, 0].max()
    rows.append(["2", "deepest, v·√(m/kc), m", f"{2 / np.sqrt(2500):.5f}", f"{deepest:.5f}"])
    rows.append(["2", "largest energy error", "ticks 1e-15 to 1e-10", f"{off(trace).max():.0e}"])


def third(rows: Rows) -> None:
    """The metric P over α and β, over more of both than the paper shows."""
    grid = np.array([[preservation(a, 10.0**d) for d in DECADES] for a in ALPHAS])
    with figure("paper_3", 7, 5, subplot_kw={"projection": "3d"}) as axes:
        x, y = np.meshgrid(list(DECADES), ALPHAS)
        axes.plot_surface(x, y, grid, cmap="viridis")
        axes.set(xlabel="log10 β", ylabel="α", zlabel="P", title="P of eq. (21)")
    rows.append(["3", "largest P", "2e-16", f"{grid.max():.1e}"])


def fourth(rows: Rows) -> None:
    """Effective repelling force, eq. (22), against the displacement in the middle of a step."""
    with figure("paper_4", 9, 4, ncols=2) as panels:
        for axes, (alpha, beta) in zip(panels, ((1.0, 0.5), (2.4, 1000.0)), strict=True):
            stiffness, speed = beta * RATE**2, 0.01 * RATE
            part = {"body": "m", "barrier": 0.0, "stiffness": stiffness, "exponent": alpha}
            for shift in np.linspace(0.0, 0.01, 24, endpoint=False):  # runs that meet the barrier between samples
                mass = {"name": "m", "kind": "mass", "mass": 1.0, "displacement": -0.03 - shift, "velocity": speed}
                scene = engine.Scene.model_validate({"body": [mass], "contact": [part], "pickup": [{"body": "m"}]})
                trace = engine.render(scene, seconds=40 / RATE, scheme="fdh", trace=True).trace
                place, force = trace["displacement"][:, 0], trace["force"][1:, 0]
                axes.plot(1e3 * (place[1:] + place[:-1]) / 2, force / 1e6, "k.", ms=3)
            at = np.linspace(-0.01, 0.02, 300)
            axes.plot(1e3 * at, stiffness * np.maximum(at, 0.0) ** alpha / 1e6, "C1", label="kc·y^α")
            axes.set(xlabel="y, mm", ylabel="force, MN", xlim=(-10, 15), title=f"α = {alpha:g}, β = {beta:g}")
            axes.set_ylim(-0.5, 25)
            axes.legend()
            change = -np.diff(trace["velocity"][:, 0]) * RATE  # of the momentum of 1 kg
            apart = np.abs(change - force).max() / force.max()
            rows.append(["4", f"force less -Δp/Δt (eq. 22), over the largest, α = {alpha:g}", "0", f"{apart:.0e}"])
            middle, theory = (place[1:] + place[:-1]) / 2, 0.0
            inside = (place[1:] > 0) & (place[:-1] > 0)
            if inside.any():
                theory = stiffness * middle[inside] ** alpha
                rows.append(
                    [
                        "4",
                        f"force over kc·y^α, both ends inside, α = {alpha:g}",
                        "near 1",
                        f"{np.min(force[inside] / theory):.3f} to {np.max(force[inside] / theory):.3f}",
                    ]
                )


def energies(name: str, number: int, title: str, seconds: float | None = None) -> dict[str, np.ndarray]:
    """Displacement, energies and their error."""
    trace = traced(name, seconds)
    with figure(f"paper_{number}", 6, 7, nrows=3, sharex=True) as (top, middle, bottom):
        top.plot(trace["time"], trace["displacement"][:, 0])
        for part in ("kinetic", "potential", "contact", "total"):
            middle.plot(trace["time"], trace[part], label=part)
        middle.legend(loc="center right", ncols=2)
        bottom.semilogy(trace["time"], off(trace), ".", ms=1)
        top.set(ylabel="displacement, m", title=title)
        middle.set(ylabel="energy, J")
        bottom.set(ylabel="energy error", xlabel="time, s")
    return trace


def fifth(rows: Rows) -> None:
    """The bouncing ball."""
    ball = energies("bouncing_ball", 5, "Fig. 5: lossless bouncing ball", 1.5)
    tops = ball["displacement"][round(0.3 * RATE) : round(0.55 * RATE), 0].max()
    rows.append(["5", "height of return, m", "0.2", f"{tops:.6f}"])
    rows.append(["5", "largest energy error", "ticks to 5e-13", f"{off(ball).max():.0e}"])


def sixth(rows: Rows) -> None:
    """The repelled oscillator."""
    oscillator = energies("repelled_oscillator", 6, "Fig. 6: oscillator and barrier", 0.005)
    rows.append(
        ["6", "energy, ½k·y0², J", f"{0.5 * (2 * np.pi * 440) ** 2 * 4e-6:.3f}", f"{oscillator['total'][-1]:.3f}"]
    )
    rows.append(["6", "largest energy error", "ticks to 1e-15", f"{off(oscillator).max():.0e}"])


def driven(rows: Rows) -> None:
    """Displacement, force and energies of the driven ball, and its rest after 20 s."""
    trace = traced("driven_ball", 20.0)
    force = engine.load(ROOT / "patches" / "driven_ball.toml").force[0]
    now = trace["time"] - 0.1
    shape = np.where((now >= 0) & (now <= 0.16), 60.0 * np.sin(np.pi * now / 0.16), 0.0)
    assert (force.amplitude, force.duration) == (60.0, 0.16)  # type: ignore[union-attr]
    with figure("paper_7", 6, 7, nrows=3, sharex=True) as (top, middle, bottom):
        top.plot(trace["time"], trace["displacement"][:, 0])
        middle.plot(trace["time"], shape)
        for part in ("kinetic", "potential", "contact", "total"):
            bottom.plot(trace["time"], trace[part], label=part)
        bottom.legend()
        top.set(ylabel="displacement, m", xlim=(0, 4), title="Fig. 7: driven and damped")
        middle.set(ylabel="force, N")
        bottom.set(ylabel="energy, J", xlabel="time, s")
    free = trace["time"] > 0.26  # after the force
    rise = max(0.0, np.diff(trace["total"][free]).max()) / trace["total"].max()
    rows.append(["7", "largest rise of energy in a step without force, over the peak", "0 (eq. 39)", f"{rise:.0e}"])
    rows.append(
        ["7", "speed left after 20 s, m/s", "0, no limit cycle", f"{np.abs(trace['velocity'][-4410:]).max():.0e}"]
    )


def sequel(rows: Rows) -> None:
    """What the paper leaves open: order 4, dispersion, and refinement."""
    with figure("sequel", 13, 4, ncols=3) as (left, middle, right):
        for order in (2, 4):
            trace = traced("repelled_oscillator", 2.0, scheme="exact", order=order)
            left.semilogy(trace["time"][::20], off(trace)[::20], ".", ms=2, label=f"order {order}")
            rows.append(["sequel", f"energy error, order {order}, 2 s of Fig. 6", "", f"{off(trace).max():.0e}"])
        left.set(xlabel="time, s", ylabel="energy error", title="energy is exact at any order")
        left.legend()
        frequency = np.geomspace(100, 20_000, 200)
        warped = RATE / np.pi * np.arctan(np.pi * frequency / RATE)
        middle.semilogx(frequency, 1200 * np.log2(warped / frequency), label="fdh")
        middle.semilogx(frequency, 0 * frequency, label="exact")
        middle.set(xlabel="frequency, Hz", ylabel="detuning, cents", title="dispersion of free vibration")
        middle.legend()
        rows.append(
            [
                "sequel",
                "detuning of fdh at 10 kHz, cents",
                "",
                f"{1200 * np.log2(np.interp(1e4, frequency, warped) / 1e4):.0f}",
            ]
        )
        names, costs = refinement()
        for shift, (label, values) in zip((-0.2, 0.2), costs.items(), strict=True):
            right.bar(np.arange(len(names)) + shift, values, 0.4, label=label)
        right.set_xticks(np.arange(len(names)), names)
        right.set(ylabel="ns per sample", title="refinement costs where there is contact")
        right.legend()
        for label, values in costs.items():
            rows.append(
                ["sequel", f"order 4, 4 × over one step, {label}", "", f"{values[-1] / values[0]:.2f} × the time"]
            )


def refinement() -> tuple[list[str], dict[str, list[float]]]:
    """ns per sample of a hammer on a string, touching and after, at some settings."""
    settings = {"one step": {}, "order 2, 4 ×": {"substeps": 4}, "order 4, 4 ×": {"order": 4, "substeps": 4}}
    scene = engine.load(ROOT / "patches" / "piano_c2.toml")
    lossless = [c.model_copy(update={"loss": 0.0}) for c in scene.contact]
    scene = scene.model_copy(update={"contact": lossless, "event": []})
    costs: dict[str, list[float]] = {"in contact": [], "after": []}
    for changes in settings.values():
        accuracy = Accuracy().replace(silence=-np.inf, **changes)
        best = {"in contact": np.inf, "after": np.inf}
        for _ in range(5):
            model, state, _ = build(scene, RATE, accuracy)
            simulation, out = Simulation(model, state), np.zeros((RATE, scene.channels))
            simulation.render_block(out[:60])  # the hammer is on its way
            idle = min(time_block(simulation, out[:0]) for _ in range(20))
            for label, frames in (("in contact", 100), ("after", RATE - 1000)):
                best[label] = min(best[label], (time_block(simulation, out[:frames]) - idle) / frames * 1e9)
                if label == "in contact":
                    simulation.render_block(out[:600])
        for label, ns in best.items():
            costs[label].append(ns)
    return list(settings), costs


def labelled(top: object, bottom: object) -> None:
    top.set(ylabel="displacement, m")  # type: ignore[attr-defined]
    bottom.set(ylabel="energy error", xlabel="time, s")  # type: ignore[attr-defined]
    top.legend()  # type: ignore[attr-defined]


def run() -> None:
    """Draw all, and publish what may be read off."""
    pin()
    rows: Rows = []
    first(rows)
    second(rows)
    third(rows)
    fourth(rows)
    fifth(rows)
    sixth(rows)
    driven(rows)
    sequel(rows)
    publish("figures", ["figure", "quantity", "paper", "ours"], rows)
