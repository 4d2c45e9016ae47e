"""What other methods make of one body at walls: errors and times beside those of the engine.

Methods that fail stay in the list, with how they failed.
"""

import math
import time
from typing import Any

import numpy as np

from engine.baselines import SCHEMES, Body, hamiltonian, pull, simulate
from engine.parts import Mass, Oscillator
from engine.scene import Scene

FAR = 1e3  # m, where no wall is met
FINER = (1, 4, 16, 64)  # times the sample rate
RUNS = 3  # of which the fastest counts
ENOUGH = 0.5  # s, after which a method is not run again
PATIENCE = 4.0  # s, for one run of SciPy
TOLERANCES = (1e-4, 1e-7, 1e-10)
HEARD = ("displacement", "velocity")  # columns of a run
BLOWN = 10.0  # times the largest of the reference


def one_body(scene: Scene) -> tuple[Body, float, float, int] | None:
    """The scene as the other methods have it (of unit mass), its place and velocity at the start and the column
    that is heard; None if it is more than one lossless body between barriers of one power law."""
    body, walls, heard = scene.body[0], scene.contact, scene.pickup[0]
    if len(scene.body) > 1 or scene.force or scene.event or len(scene.pickup) > 1 or not walls:
        return None
    if not isinstance(body, Mass | Oscillator) or body.damping or heard.quantity not in HEARD or heard.gain != 1.0:
        return None
    if len({(c.stiffness, c.exponent) for c in walls}) > 1 or any(c.loss for c in walls):
        return None
    at = {c.side: float(c.barrier) for c in walls if isinstance(c.barrier, float | int)}
    if len(at) < len(walls):
        return None
    spring = 0.0
    if isinstance(body, Oscillator):
        spring = (
            body.stiffness / body.mass if body.stiffness is not None else (2 * np.pi * (body.frequency or 0.0)) ** 2
        )
    wall = walls[0].stiffness / body.mass
    told = Body(spring, wall, walls[0].exponent, at.get("above", FAR), at.get("below", -FAR), scene.gravity)
    return told, body.displacement, body.velocity, HEARD.index(heard.quantity)


def others(scene: Scene, reference: np.ndarray, samplerate: int, frames: int) -> list[dict[str, Any]]:
    """Errors and times of other methods over some samples; none if they do not run.

    reference: what is heard [frames]
    Rows have "setting", "error", "energy_error", "ns_per_sample" and "failed": how, or nothing.
    """
    case = one_body(scene)
    if case is None or frames == 0:
        return []
    body, y, v, column = case
    told = reference[:frames]
    rows = []
    for name in SCHEMES:
        if name.startswith("FDN") and body.alpha not in (1.0, 3.0):
            continue
        simulate(name, body, y, v, 1 / samplerate, 2)  # compile before the clock starts
        for finer in FINER:
            run, ns = timed(name, body, y, v, samplerate * finer, frames * finer)
            row = judged(f"{name}, {finer} ×", run[::finer, column], told, ns * finer)
            rows.append(row | {"energy_error": drift(run[:, 2])})
    return rows + [adaptive(case, told, samplerate, tolerance) for tolerance in TOLERANCES]


def timed(name: str, body: Body, y: float, v: float, rate: int, steps: int) -> tuple[np.ndarray, float]:
    """A run, and ns per step of the fastest of some."""
    best = total = np.inf
    for i in range(RUNS):
        begin = time.perf_counter()
        run = simulate(name, body, y, v, 1 / rate, steps)
        elapsed = time.perf_counter() - begin
        best, total = min(best, elapsed), elapsed if i == 0 else total + elapsed
        if total > ENOUGH:
            break
    return run, best / steps * 1e9


def judged(name: str, run: np.ndarray, reference: np.ndarray, ns: float) -> dict[str, Any]:
    """A row."""
    failed = ""
    if not np.isfinite(run).all() or np.abs(run).max() > BLOWN * np.abs(reference).max():
        failed = "blows up"
    with np.errstate(all="ignore"):
        error = float(np.sqrt(np.mean((run - reference) ** 2) / np.mean(reference**2)))
    return {"setting": name, "error": np.nan if failed else error, "ns_per_sample": ns, "failed": failed}


def drift(energy: np.ndarray) -> float:
    """Largest change of an energy, relative to what it was at first; infinite if that is nothing, or it blows up."""
    with np.errstate(all="ignore"):
        found = float(np.abs(energy / energy[0] - 1).max())
    return found if np.isfinite(found) else np.inf


def adaptive(
    case: tuple[Body, float, float, int], reference: np.ndarray, samplerate: int, tolerance: float
) -> dict[str, Any]:
    """SciPy's DOP853, stopped and begun again wherever the body meets a wall or leaves it."""
    from scipy.integrate import solve_ivp

    body, y, v, column = case
    walls = [wall for wall in (body.above, body.below) if abs(wall) < FAR]
    events = [_crossing(wall) for wall in walls]
    frames = len(reference)
    times = np.arange(frames) / samplerate
    scale = tolerance * np.array([max(abs(y), 1e-9), max(abs(v), 1e-6)])
    if body.stiffness:
        swing = max(np.hypot(y, v / np.sqrt(body.stiffness)), 1e-9)  # with no tolerance there would be no end
        scale = tolerance * swing * np.array([1.0, np.sqrt(body.stiffness)])
    begin, now, state, run, first = time.perf_counter(), 0.0, [y, v], np.empty(frames), 0
    energy = [hamiltonian(body, y, v)]

    def slope(t: float, x: Any) -> list[float]:
        late = time.perf_counter() - begin > PATIENCE
        return [math.nan, math.nan] if late else [x[1], pull(body, x[0])]  # the step fails, and SciPy gives up

    while first < frames and time.perf_counter() - begin < PATIENCE:
        done = solve_ivp(
            slope,
            (now, times[-1] + 1 / samplerate),
            state,
            method="DOP853",
            events=events,
            rtol=tolerance,
            atol=scale,
            dense_output=True,
        )
        if done.t[-1] == now:  # out of patience
            break
        last = int(np.searchsorted(times, done.t[-1], side="right"))
        if last > first:
            run[first:last] = done.sol(times[first:last])[column]
            first = last
        now, state = done.t[-1], done.y[:, -1]
        energy.append(hamiltonian(body, *state))
        if done.status != 1:
            break
        state = [state[0] + np.sign(state[1]) * 1e-15, state[1]]  # off the wall, or it is met again at once
    elapsed = time.perf_counter() - begin
    row = judged(f"DOP853, {tolerance:.0e}", run[:first], reference[:first], elapsed / max(1, first) * 1e9)
    if first < frames:
        row |= {"error": np.nan, "failed": f"gave up at {first / samplerate * 1e3:.0f} ms"}
    return row | {"energy_error": drift(np.array(energy))}


def _crossing(wall: float) -> Any:
    def crossing(t: float, x: np.ndarray) -> float:
        return float(x[0] - wall)

    crossing.terminal = True  # type: ignore[attr-defined]
    return crossing
