"""What accuracy costs: a scene at a ladder of settings, with the error and the time of each.

The reference is refined until it agrees with itself. Errors are taken before the horizon at which a
perturbation of 1e-9, or what two references differ by, has grown to a thousandth of the sound; beyond it, by
measures that chaos leaves alone.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from engine import offline
from engine.accuracy import Accuracy
from engine.build import build
from engine.events import STRIKE
from engine.measures import band_error, decay_error, detuning, first_contact, horizon, impulse, rebound, trajectory
from engine.model import Model, State
from engine.others import others
from engine.parts import CHANNELS, Mass, Oscillator
from engine.runner import Runner, timed
from engine.scene import Scene

SECONDS = 0.5  # of a scene, unless told otherwise
PERTURBATION = 1e-9
AGREES = 0.1  # of the least error on the ladder: how near two references must be
TIMED = 3  # runs, of which the fastest counts
CALLS = 10  # empty ones, of which the fastest is what a call costs
PAYS = 3.0  # times: settings whose errors differ by less are alike


class Setting(NamedTuple):
    """A rung of the ladder."""

    name: str
    changes: dict[str, Any]


class Run(NamedTuple):
    """What a run of a scene gave."""

    audio: np.ndarray  # [frames, channels]
    forces: np.ndarray  # [frames, bodies that touch]
    velocities: np.ndarray  # [frames, the first of these, which are masses or oscillators]
    stats: dict[str, Any]


LOSSLESS = [(2, 1), (2, 2), (2, 4), (2, 16), (4, 1), (4, 2), (4, 4)]
LOSSY = [(2, 1), (2, 2), (2, 4), (2, 8), (2, 16)]


def ladder(scene: Scene) -> list[Setting]:
    """The settings a scene is tried at, coarse to fine."""
    lossy = any(contact.loss > 0.0 for contact in scene.contact)
    rungs = [Setting("fdh", {"scheme": "fdh", "order": 2, "substeps": 1})]
    for order, substeps in LOSSY if lossy else LOSSLESS:
        rungs.append(Setting(f"order {order}, {substeps} ×", {"order": order, "substeps": substeps}))
    rungs.append(Setting("oversample 2", {"order": 2, "substeps": 1, "oversample": 2}))
    rungs.append(Setting("float32 modes", {"order": 2, "substeps": 1, "precision": "float32"}))
    return rungs


def price(
    scene: Scene,
    seconds: float | None = None,
    samplerate: int = 44_100,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Errors and costs of a scene at every setting of its ladder.

    seconds: how much of the scene; half a second, or all of a shorter one, if None
    Returns {"seconds", "horizon" (s), "predictable" (s, by the perturbation alone), "reference", "disagreement",
    "spread_db", "first_contact_ms", "rebound" (m/s), "rows": [...], "others": [...] (engine.others), "verdict"}; a row
    has "setting", "changes", "error" (relative, before the horizon; infinite if that is 0), "bands_db", "decay_db",
    "cents", "first_contact_ms", "rebound", "impulse", "ns_per_sample", "real_time_factor", "newton", "energy_error",
    "front". Raises BuildError as `engine.build.build`.
    """
    seconds = min(scene.seconds, SECONDS) if seconds is None else seconds
    base = scene.accuracy.but(scheme="exact", oversample=1, precision="float64", silence=-np.inf, iterations=200)
    told, columns = _with_contacts(scene)
    rungs = ladder(scene)
    steps = len(rungs) + 4
    done = 0

    def tick() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(min(1.0, done / steps))

    def at(changes: dict[str, Any], perturbed: float = 0.0) -> Run:
        found = _run(told, seconds, samplerate, base.but(**changes), columns, perturbed)
        tick()
        return found

    runs = [at(rung.changes) for rung in rungs]
    reference, name, frames, disagreement, perturbed = _reference(scene, runs, at, samplerate)
    rows = []
    for rung, run in zip(rungs, runs, strict=True):
        oversampled = rung.changes.get("oversample", 1) > 1  # the filter rings, also where there is no contact
        rows.append(
            {
                "setting": rung.name,
                "changes": rung.changes,
                "error": trajectory(run.audio, reference.audio, frames),
                "bands_db": band_error(run.audio, reference.audio, samplerate),
                "impulse": impulse(run.forces, reference.forces),
                "first_contact_ms": math.nan if oversampled else first_contact(run.forces, samplerate),
                "rebound": math.nan if oversampled else _rebound(run),
                "decay_db": decay_error(run.audio, reference.audio, samplerate),
                "cents": detuning(run.audio, reference.audio),
                **_cost(scene, seconds, samplerate, base.but(**rung.changes, silence=scene.accuracy.silence)),
                "newton": {k: run.stats["newton"][k] for k in ("mean", "p99", "max", "unconverged")},
                "energy_error": run.stats["energy"]["error_max"],
            }
        )
    for row in rows:
        row["front"] = not any(
            other["error"] < row["error"] and other["ns_per_sample"] < row["ns_per_sample"] for other in rows
        )
    spread = band_error(perturbed.audio, reference.audio, samplerate)
    found = {
        "seconds": seconds,
        "samplerate": samplerate,
        "horizon": frames / samplerate,
        "predictable": horizon(reference.audio, perturbed.audio, samplerate) / samplerate,
        "reference": name,
        "disagreement": disagreement,
        "spread_db": spread,
        "first_contact_ms": first_contact(reference.forces, samplerate),
        "rebound": _rebound(reference),
        "rows": rows,
        "others": others(scene, reference.audio[:, 0], samplerate, frames),
    }
    return found | {"verdict": verdict(found)}


def verdict(found: dict[str, Any]) -> str:
    """In a sentence, what more accuracy brings."""
    rows = [row for row in found["rows"] if row["changes"].get("scheme") != "fdh"]
    plain = rows[0]
    best = min(rows, key=lambda row: row["error"])
    if found["predictable"] == 0.0:
        return "nothing pays: the motion is chaotic from the start, and all settings are equally right"
    if found["horizon"] == 0.0:
        return "cannot be told: contact is so stiff that the finest references disagree from the start"
    if best["error"] * PAYS > plain["error"]:
        return "nothing pays: every setting errs about as much (stiff contact, or none)"
    dear = best["ns_per_sample"] / plain["ns_per_sample"]
    gain = plain["error"] / best["error"]
    if found["horizon"] < found["seconds"]:
        why = "the motion is chaotic" if found["predictable"] < found["seconds"] else "the references disagree"
        chaos = f" up to {found['horizon'] * 1e3:.0f} ms; beyond, {why} and nothing can be told"
    else:
        chaos = ""
    return f"{best['setting']} errs {gain:.3g} times less than one plain step, for {dear:.2g} times its time{chaos}"


def choose(found: dict[str, Any], error: float, decibels: bool) -> tuple[dict[str, Any], bool]:
    """The cheapest row that meets an error (relative, or dB of the worst band), and whether it does; else the best."""
    key = "bands_db" if decibels else "error"
    good = [row for row in found["rows"] if row[key] <= error]
    if good:
        return min(good, key=lambda row: row["ns_per_sample"]), True
    return min(found["rows"], key=lambda row: row[key]), False


def _with_contacts(scene: Scene) -> tuple[Scene, tuple[int, int]]:
    """The scene with channels, after those that are heard, of the contact forces on the bodies that touch (masses
    first), then of the velocities of masses, as many as there are channels for; and where the two begin."""
    heard = max(p.channel for p in scene.pickup)
    lumped = [b.name for b in scene.body if isinstance(b, Mass | Oscillator)]
    touching = list(dict.fromkeys(name for c in scene.contact for name in (c.body, c.on) if name))
    touching.sort(key=lambda name: name not in lumped)
    speeds = [name for name in touching if name in lumped][: (CHANNELS - heard) // 2]
    touching = touching[: CHANNELS - heard - len(speeds)]
    told = [(name, "force") for name in touching] + [(name, "velocity") for name in speeds]
    more = [{"body": name, "quantity": what, "channel": heard + 1 + i} for i, (name, what) in enumerate(told)]
    pickups = [p.model_dump(exclude_none=True) for p in scene.pickup] + more
    found = Scene.model_validate(scene.model_dump(exclude_none=True) | {"pickup": pickups})
    return found, (heard, heard + len(touching))


def _rebound(run: Run) -> float:
    """Velocity of the mass that touches first, when it lets go, m/s."""
    return rebound(run.forces[:, : run.velocities.shape[1]], run.velocities)


def _reference(
    scene: Scene, runs: list[Run], at: Callable[..., Run], samplerate: int
) -> tuple[Run, str, int, float, Run]:
    """The finest run, its name, how many samples of it are sure, how far the one before is from it in these,
    and the same run begun a little off."""
    lossy = any(contact.loss > 0.0 for contact in scene.contact)
    order, counts = (2, (32, 64)) if lossy else (6, (4, 8, 16))
    before = runs[-3]  # the finest of the ladder
    for substeps in counts:
        changes = {"order": order, "substeps": substeps}
        finest = at(changes)
        perturbed = at(changes, PERTURBATION)
        frames = min(horizon(finest.audio, other.audio, samplerate) for other in (perturbed, before))
        disagreement = trajectory(before.audio, finest.audio, frames)
        least = min(trajectory(run.audio, finest.audio, frames) for run in runs)
        if frames > 0 and disagreement <= AGREES * least:
            break
        before = finest
    return finest, f"order {order}, {substeps} ×", frames, disagreement, perturbed


def _run(
    scene: Scene, seconds: float, samplerate: int, accuracy: Accuracy, columns: tuple[int, int], perturbed: float
) -> Run:
    """A run, begun a little off."""
    model, state, _ = build(scene, samplerate * accuracy.oversample, accuracy, seconds=seconds)
    if perturbed:
        _perturb(model, state, perturbed)
    runner = Runner(model, state)
    frames = max(1, round(seconds * samplerate))
    fine = frames * accuracy.oversample
    out = np.zeros((fine + offline.beyond(accuracy.oversample), max(p.channel for p in scene.pickup)))
    runner.block(out[:fine])
    stats = offline.statistics(runner)
    if accuracy.oversample > 1:
        runner.block(out[fine:])
        out = offline.decimated(out, accuracy.oversample, frames)
    forces, velocities = columns
    return Run(out[:, :forces], out[:, forces:velocities], out[:, velocities:], stats)


def _perturb(model: Model, state: State, by: float) -> None:
    """Scale all that the scene begins with, and is driven by."""
    state.q[:] *= 1 + by
    state.p[:] *= 1 + by
    state.compression[:] = (1 + by) * (state.compression + state.barrier) - state.barrier
    if model.force is not None:
        model.force.table[:] *= 1 + by
        model.force.after[:] *= 1 + by
    if model.events is not None:
        model.events.b[model.events.kind == STRIKE] *= 1 + by


def _cost(scene: Scene, seconds: float, samplerate: int, accuracy: Accuracy) -> dict[str, float]:
    """Time per sample of the output, of the scene as it is, without that of the call; the fastest of some runs."""
    frames = max(1, round(seconds * samplerate))
    out = np.zeros((frames * accuracy.oversample, max(p.channel for p in scene.pickup)))
    best = np.inf
    for _ in range(TIMED):
        model, state, _ = build(scene, samplerate * accuracy.oversample, accuracy, seconds=seconds)
        runner = Runner(model, state)
        call = min(timed(runner, out[:0]) for _ in range(CALLS))
        best = min(best, timed(runner, out) - call)
    return {"ns_per_sample": best / frames * 1e9, "real_time_factor": frames / samplerate / best}
