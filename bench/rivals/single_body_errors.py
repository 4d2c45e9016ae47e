"""Other methods on one body at walls: their errors and times, beside those of a study of the engine's settings.

Methods that fail stay in the list, with how they failed.
"""

import re
import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.rivals.single_body import METHODS, SingleBody, acceleration, hamiltonian, simulate
from engine.analysis.work_precision import WorkPrecisionStudy
from engine.bodies import Mass, Oscillator
from engine.offline.statistics_base import Statistics
from engine.patch.scene import Scene

UNREACHABLE = 1e3  # m, where a wall is never met
RATE_FACTORS = (1, 4, 16, 64)  # multiples of the sample rate at which methods run
TIMED_RUNS = 3  # at most, of which the fastest counts
MAX_TIMING_SECONDS = 0.5  # after which a method is not run again
SCIPY_TIME_LIMIT = 4.0  # s, of one run
TOLERANCES = (1e-4, 1e-7, 1e-10)  # relative, of SciPy
PICKUP_COLUMNS = ("displacement", "velocity")  # columns of a run, by the quantity of a pickup
METHOD_COLOURS = "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#6b5b95", "#a0522d"
METHOD_MARKERS = "xP^vsD"
BLOW_UP_FACTOR = 10.0  # times the peak of the reference: a run beyond it has failed


class SingleBodyCase(NamedTuple):
    """A scene as other methods have it."""

    body: SingleBody
    y: float  # m, displacement at time 0
    v: float  # m/s, velocity at time 0
    column: int  # of a run, that the pickup hears


def as_single_body(scene: Scene) -> SingleBodyCase | None:
    """The scene as a case for the other methods; None if it is more than one lossless body with a pickup between
    barriers of one power law."""
    body, contacts, pickup = scene.body[0], scene.contact, scene.pickup[0]
    if len(scene.body) > 1 or scene.connection or scene.force or scene.event or len(scene.pickup) > 1 or not contacts:
        return None
    if not isinstance(body, Mass | Oscillator) or body.damping_rate:
        return None
    if pickup.quantity not in PICKUP_COLUMNS or pickup.gain != 1.0:
        return None
    if len({(c.stiffness, c.exponent) for c in contacts}) > 1 or any(c.loss for c in contacts):
        return None
    walls = {c.side: float(c.barrier) for c in contacts if isinstance(c.barrier, float | int)}
    if len(walls) < len(contacts):
        return None
    stiffness = 0.0
    if isinstance(body, Oscillator):
        stiffness = (
            body.stiffness / body.mass if body.stiffness is not None else (2 * np.pi * (body.frequency or 0.0)) ** 2
        )
    single = SingleBody(
        stiffness=stiffness,
        wall_stiffness=contacts[0].stiffness / body.mass,
        alpha=contacts[0].exponent,
        upper_wall=walls.get("above", UNREACHABLE),
        lower_wall=walls.get("below", -UNREACHABLE),
        gravity=scene.gravity,
    )
    return SingleBodyCase(single, body.displacement, body.velocity, PICKUP_COLUMNS.index(pickup.quantity))


@dataclass(frozen=True)
class MethodResult(Statistics):
    """Error and time of a scene by one method."""

    setting: str
    error: float  # relative; NaN if it failed
    energy_error: float  # relative
    ns_per_sample: float
    failed: str  # in what way; "" if it did not


def methods_beside(study: WorkPrecisionStudy, scene: Scene) -> list[MethodResult]:
    """Errors and times of the other methods over the horizon of a study, against its reference; empty if the scene is
    no case for them."""
    if study.reference is None or study.horizon is None or as_single_body(scene) is None:
        return []
    order, substeps = map(int, re.findall(r"\d+", study.reference))
    finest = {"scheme": "exact", "order": order, "substeps": substeps, "oversample": 1, "iterations": 200}
    audio = engine.render(scene, study.seconds, study.samplerate, silence=-np.inf, **finest).audio
    return compare_methods(scene, audio[:, 0], study.samplerate, round(study.horizon * study.samplerate))


def compare_methods(scene: Scene, reference: np.ndarray, samplerate: int, frames: int) -> list[MethodResult]:
    """Errors and times of the other methods over the first frames; empty if the scene is no case for them.

    reference: what the pickup hears [frames]
    """
    case = as_single_body(scene)
    if case is None or frames == 0:
        return []
    reference = reference[:frames]
    rows = []
    for method in METHODS:
        if method.startswith("FDN") and case.body.alpha not in (1.0, 3.0):
            continue
        simulate(method, case.body, case.y, case.v, 1 / samplerate, 2)  # compiled before the clock starts
        for factor in RATE_FACTORS:
            run, nanoseconds = time_method(method, case, samplerate * factor, frames * factor)
            result = method_result(f"{method}, {factor} ×", run[::factor, case.column], reference, nanoseconds * factor)
            rows.append(replace(result, energy_error=relative_energy_change(run[:, 2])))
    return rows + [dop853_with_events(case, reference, samplerate, tolerance) for tolerance in TOLERANCES]


def draw_methods(axes: Any, rows: list[MethodResult]) -> None:
    """Draw error against time of other methods, a line each; those that failed stand along the top."""
    methods: dict[str, list[MethodResult]] = {}
    for row in rows:
        methods.setdefault(row.setting.rpartition(",")[0], []).append(row)
    for n, (method, runs) in enumerate(methods.items()):
        valid, colour = [r for r in runs if not r.failed], METHOD_COLOURS[n % len(METHOD_COLOURS)]
        times, errors = [r.ns_per_sample for r in valid], [r.error for r in valid]
        marker = METHOD_MARKERS[n % len(METHOD_MARKERS)]
        axes.plot(times, errors, f"{marker}--", ms=5, lw=0.8, color=colour, label=method)
        failed = [r.ns_per_sample for r in runs if r.failed]
        if failed:
            failures = sorted({r.failed.partition(" at ")[0] for r in runs if r.failed})
            label = f"{method}: {', '.join(failures)}"
            height = np.full(len(failed), 0.98 - 0.03 * n)  # of the axes
            axes.plot(failed, height, "X", color=colour, label=label, transform=axes.get_xaxis_transform())
    axes.legend(loc="lower left")


def time_method(method: str, case: SingleBodyCase, rate: int, steps: int) -> tuple[np.ndarray, float]:
    """Run a method. Returns the run (`simulate`), and the time of the fastest of some runs, ns per step."""
    best = total = np.inf
    for i in range(TIMED_RUNS):
        begin = time.perf_counter()
        run = simulate(method, case.body, case.y, case.v, 1 / rate, steps)
        elapsed = time.perf_counter() - begin
        best, total = min(best, elapsed), elapsed if i == 0 else total + elapsed
        if total > MAX_TIMING_SECONDS:
            break
    return run, best / steps * 1e9


def method_result(setting: str, run: np.ndarray, reference: np.ndarray, nanoseconds: float) -> MethodResult:
    """The result of a run: its relative error, NaN if it blew up, and its time, ns per sample. Both are [frames]."""
    failed = ""
    if not np.isfinite(run).all() or np.abs(run).max(initial=0.0) > BLOW_UP_FACTOR * np.abs(reference).max(initial=0.0):
        failed = "blows up"
    with np.errstate(all="ignore"):
        error = float(np.sqrt(np.mean((run - reference) ** 2) / np.mean(reference**2)))
    return MethodResult(setting, np.nan if failed else error, np.nan, nanoseconds, failed)


def relative_energy_change(energy: np.ndarray) -> float:
    """Largest change of an energy [steps] relative to its first value; infinite if that is 0, or it blows up."""
    with np.errstate(all="ignore"):
        change = float(np.abs(energy / energy[0] - 1).max())
    return change if np.isfinite(change) else np.inf


def dop853_with_events(case: SingleBodyCase, reference: np.ndarray, samplerate: int, tolerance: float) -> MethodResult:
    """The result of SciPy's DOP853, stopped and begun again wherever the body meets a wall or leaves it.

    reference: what the pickup hears [frames]; tolerance: relative
    """
    begin = time.perf_counter()
    run, energy = _integrate(case, len(reference), samplerate, tolerance)
    elapsed = time.perf_counter() - begin
    frames, setting, change = len(run), f"DOP853, {tolerance:.0e}", relative_energy_change(energy)
    nanoseconds = elapsed / max(1, frames) * 1e9
    if frames < len(reference):
        return MethodResult(setting, np.nan, change, nanoseconds, f"stopped at {frames / samplerate * 1e3:.0f} ms")
    return replace(method_result(setting, run, reference, nanoseconds), energy_error=change)


def _integrate(case: SingleBodyCase, frames: int, samplerate: int, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the motion with SciPy until its time limit; return the displacement at the pickup [at most frames], and
    the energies at the times where the integration stopped."""
    from scipy.integrate import solve_ivp

    body, y, v, column = case
    events = [_wall_crossing(wall) for wall in (body.upper_wall, body.lower_wall) if abs(wall) < UNREACHABLE]
    scale = tolerance * np.array([max(abs(y), 1e-9), max(abs(v), 1e-6)])
    if body.stiffness:
        amplitude = max(np.hypot(y, v / np.sqrt(body.stiffness)), 1e-9)  # a tolerance of 0 would never be met
        scale = tolerance * amplitude * np.array([1.0, np.sqrt(body.stiffness)])
    deadline = time.perf_counter() + SCIPY_TIME_LIMIT

    def derivative(t: float, x: Any) -> list[float]:
        if time.perf_counter() > deadline:
            raise TimeoutError  # a NaN would do, but as the first value of a run it keeps SciPy for ever
        return [x[1], acceleration(body, x[0])]

    times = np.arange(frames) / samplerate
    now, state = 0.0, [y, v]
    run, first, energy = np.empty(frames), 0, [hamiltonian(body, y, v)]
    while first < frames and time.perf_counter() < deadline:
        span = (now, times[-1] + 1 / samplerate)
        options: dict[str, Any] = {"method": "DOP853", "events": events, "dense_output": True}
        try:
            part = solve_ivp(derivative, span, state, rtol=tolerance, atol=scale, **options)
        except TimeoutError:
            break
        if part.t[-1] == now:  # no step is possible
            break
        last = int(np.searchsorted(times, part.t[-1], side="right"))
        if last > first:
            run[first:last] = part.sol(times[first:last])[column]
            first = last
        now, state = part.t[-1], part.y[:, -1]
        energy.append(hamiltonian(body, *state))
        if part.status != 1:
            break
        state = [state[0] + np.sign(state[1]) * 1e-15, state[1]]  # off the wall, or it is met again at once
    return run[:first], np.array(energy)


def _wall_crossing(wall: float) -> Any:
    """An event of SciPy that stops where the displacement crosses a wall (m)."""

    def crossing(t: float, x: np.ndarray) -> float:
        return float(x[0] - wall)

    crossing.terminal = True  # type: ignore[attr-defined]
    return crossing
