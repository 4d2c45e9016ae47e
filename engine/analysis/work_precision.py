"""Work-precision study: a scene at a ladder of settings, with the error and the time of each.

The reference is refined until it agrees with itself. Errors are taken before the horizon at which a perturbation of
1e-9, or what two references differ by, has grown to a thousandth of the sound; beyond it, by measures that chaos leaves
alone (engine.analysis.metrics).
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from engine.analysis.metrics import (
    band_error,
    decay_error,
    detuning_cents,
    first_contact_ms,
    horizon,
    impulse_error,
    rebound_velocity,
    relative_rms_error,
)
from engine.analysis.silence import explain_silence
from engine.analysis.study_progress import Report, StudyProgress, study_run
from engine.analysis.study_runs import TIMED_RUNS, Run, StudyRuns
from engine.assembly.build import build
from engine.faults import BuildError
from engine.offline.statistics_base import Statistics
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene

DEFAULT_SECONDS = 0.5  # of a scene
PERTURBATION = 1e-9  # relative, of all that a scene begins with
REFERENCE_AGREEMENT = 0.1  # of the smallest error on the ladder: how near two references must be
SIGNIFICANT_RATIO = 3.0  # settings whose errors differ by less count as alike
LADDER = [(2, 1), (2, 2), (2, 4), (2, 16), (4, 1), (4, 2), (4, 4)]  # order, substeps
ORDER_2_LADDER = [(2, 1), (2, 2), (2, 4), (2, 8), (2, 16)]
MAX_ERRORS = [1e-2, 1e-3, 1e-4]
MAX_CHOSEN_STEPS = 256  # per sample, so that a study of a hard scene ends


@dataclass(frozen=True)
class SettingResult(Statistics):
    """Errors and costs of a scene at one setting."""

    setting: str
    changes: dict[str, Any]  # of the scene's Accuracy
    error: float  # relative, before the horizon; infinite if that is 0
    bands_db: float  # of the third-octave band that is farthest off
    impulse: float  # relative, of the contact forces
    first_contact_ms: float
    rebound: float  # m/s
    decay_db: float
    cents: float
    ns_per_sample: float
    real_time_factor: float
    newton: dict[str, Any]
    energy_error: float
    front: bool = False  # Pareto-optimal


@dataclass(frozen=True)
class WorkPrecisionStudy(Statistics):
    """Error and time of each accuracy setting, by the names of `fdh accuracy --json`. There are no rows if errors
    cannot be measured."""

    seconds: float
    samplerate: int
    rows: list[SettingResult]
    unmeasured: str | None  # why nothing can be measured
    verdict: str
    horizon: float | None = None  # s, to which errors can be taken
    predictable: float | None = None  # s, by the perturbation alone
    reference: str | None = None
    disagreement: float | None = None
    spread_db: float | None = None
    first_contact_ms: float | None = None
    rebound: float | None = None  # m/s
    left_out: list[str] = field(default_factory=list)  # names of errors that the reference has too


@dataclass(frozen=True, eq=False)
class Setting:
    """A rung of the ladder."""

    name: str
    changes: dict[str, Any]  # of the scene's Accuracy


class Reference(NamedTuple):
    """The finest run, and how far it can be trusted."""

    run: Run
    name: str
    frames: int  # for which errors can be taken
    disagreement: float  # relative error in these of the reference before
    perturbed: Run  # the same, begun a little off


def settings_ladder(order_2_only: bool) -> list[Setting]:
    """The settings that a scene is tried at, coarse to fine."""
    rungs = [Setting("fdh", {"scheme": "fdh", "order": 2, "substeps": 1})]
    for order, substeps in ORDER_2_LADDER if order_2_only else LADDER:
        rungs.append(Setting(f"order {order}, {substeps} ×", {"order": order, "substeps": substeps}))
    for error in MAX_ERRORS:
        changes = {"order": 2, "substeps": 1, "max_error": error, "max_substeps": MAX_CHOSEN_STEPS}
        rungs.append(Setting(f"max error {error:.0e}".replace("e-0", "e-"), changes))
    rungs.append(Setting("oversample 2", {"order": 2, "substeps": 1, "oversample": 2}))
    return rungs


def measure_work_precision(
    scene: Scene,
    seconds: float | None = None,
    samplerate: int = 44_100,
    report: Report | None = None,
) -> WorkPrecisionStudy:
    """Errors and costs of a scene at every setting of its ladder.

    seconds: how much of the scene; half a second, or all of a shorter one, if None
    report:  called now and then with the share done, what is done now, and the seconds left, or None
    Raises BuildError.
    """
    seconds = min(scene.seconds, DEFAULT_SECONDS) if seconds is None else seconds
    if report is not None:
        report(0.0, "building", None)
    base = scene.accuracy.replace(scheme="exact", oversample=1, silence=-np.inf, iterations=200)
    order_2_only = _allows_order_2_only(scene, samplerate, base)
    ladder = settings_ladder(order_2_only)
    used = {setting: base.replace(**setting.changes) for setting in ladder}
    references = _reference_settings(scene, order_2_only, base)
    progress = StudyProgress(report)
    study_runs = StudyRuns(scene, seconds, samplerate, progress)
    progress.plan(study_runs.planned(accuracy) for accuracy in used.values() for _ in range(1 + TIMED_RUNS))
    progress.plan(study_runs.planned(accuracy) for accuracy in references for _ in range(2))
    plain, *others = sorted(ladder, key=lambda setting: setting is not ladder[1])  # one step of order 2 per sample
    done = {plain: study_runs.run(plain.name, used[plain])}
    if reason := _explain_unmeasurable(scene, done[plain], seconds, samplerate):
        return _empty_study(seconds, samplerate, reason)
    for setting in sorted(others, key=lambda setting: study_runs.planned(used[setting]).urgency):
        done[setting] = study_runs.run(setting.name, used[setting])
    reference = _find_reference([done[setting] for setting in ladder], references, study_runs)
    rows = []
    for setting in ladder:
        accuracy = used[setting].replace(silence=scene.accuracy.silence)
        nanoseconds = study_runs.measure_cost(f"timing {setting.name}", accuracy)
        rows.append(_result_row(setting, done[setting], reference, samplerate, nanoseconds))
    progress.finish("comparing errors")
    finest, frames = reference.run, reference.frames
    study = WorkPrecisionStudy(
        seconds=seconds,
        samplerate=samplerate,
        horizon=frames / samplerate,
        predictable=horizon(finest.audio, reference.perturbed.audio, samplerate) / samplerate,
        reference=reference.name,
        disagreement=reference.disagreement,
        spread_db=band_error(reference.perturbed.audio, finest.audio, samplerate),
        first_contact_ms=first_contact_ms(finest.forces, samplerate),
        rebound=_first_rebound(finest),
        rows=_mark_pareto_optimal(rows),
        unmeasured=None,
        verdict="",
        left_out=study_runs.finer.left_out,
    )
    return replace(study, verdict=summarise(study))


def _mark_pareto_optimal(rows: list[SettingResult]) -> list[SettingResult]:
    """The same results, each with whether no other is faster and no less accurate."""

    def is_optimal(row: SettingResult) -> bool:
        return not any(other.error <= row.error and other.ns_per_sample < row.ns_per_sample for other in rows)

    return [replace(row, front=is_optimal(row)) for row in rows]


def _result_row(setting: Setting, run: Run, reference: Reference, samplerate: int, nanoseconds: float) -> SettingResult:
    """The result of a setting, but for whether it is Pareto-optimal. nanoseconds: per sample"""
    exact = reference.run
    is_filtered = setting.changes.get("oversample", 1) > 1  # the filter rings, also where there is no contact
    return SettingResult(
        setting=setting.name,
        changes=setting.changes,
        error=relative_rms_error(run.audio, exact.audio, reference.frames),
        bands_db=band_error(run.audio, exact.audio, samplerate),
        impulse=impulse_error(run.forces, exact.forces),
        first_contact_ms=math.nan if is_filtered else first_contact_ms(run.forces, samplerate),
        rebound=math.nan if is_filtered else _first_rebound(run),
        decay_db=decay_error(run.audio, exact.audio, samplerate),
        cents=detuning_cents(run.audio, exact.audio),
        ns_per_sample=nanoseconds,
        real_time_factor=1e9 / nanoseconds / samplerate,
        newton={k: run.stats.newton[k] for k in ("mean", "p99", "max", "unconverged")},
        energy_error=run.stats.energy.error_max,
    )


def summarise(study: WorkPrecisionStudy) -> str:
    """Describe the most accurate setting and its cost in a sentence."""
    rows = [row for row in study.rows if row.changes.get("scheme") != "fdh"]
    plain = rows[0]
    best = min(rows, key=lambda row: row.error)
    horizon, predictable = study.horizon or 0.0, study.predictable or 0.0
    if predictable == 0.0:
        return "no setting is better: the motion is chaotic from the start, and all settings are equally valid"
    if horizon == 0.0:
        return "unknown: contact is so stiff that the finest references disagree from the start"
    if best.error * SIGNIFICANT_RATIO >= plain.error:
        return "no setting is better: all have about the same error (stiff contact, or none)"
    cost = best.ns_per_sample / plain.ns_per_sample
    gain = f"{plain.error / best.error:.3g} times smaller" if best.error > 0.0 else "of zero, smaller"
    limit = ""
    if horizon < study.seconds:
        reason = "the motion is chaotic" if predictable < study.seconds else "the references disagree"
        limit = f" up to {horizon * 1e3:.0f} ms; after that, {reason} and errors cannot be measured"
    return f"{best.setting} has an error {gain} than that of one step per sample, at {cost:.2g} times its cost{limit}"


def _allows_order_2_only(scene: Scene, samplerate: int, base: Accuracy) -> bool:
    """True if orders 4 and 6 cannot be built, because bodies are heavily damped."""
    build(scene, samplerate, base.replace(order=2, substeps=1))
    try:
        for order, substeps in ((4, 1), (6, 4)):
            build(scene, samplerate, base.replace(order=order, substeps=substeps))
    except BuildError:
        return True
    return False


def _explain_unmeasurable(scene: Scene, run: Run, seconds: float, samplerate: int) -> str | None:
    """Why a run has nothing of which an error could be taken; None if it has."""
    if len(run.audio) < 2:
        return "it has one sample; give more seconds"
    silence = explain_silence(scene, seconds, samplerate, float(np.abs(run.audio).max()), run.stats)
    return f"silent; {silence}" if silence else None


def _empty_study(seconds: float, samplerate: int, reason: str) -> WorkPrecisionStudy:
    """The study of a scene that gives nothing to measure."""
    return WorkPrecisionStudy(seconds, samplerate, [], reason, f"nothing can be measured: {reason}")


def _first_rebound(run: Run) -> float:
    """Velocity of the mass that touches first, when it lets go, m/s."""
    return rebound_velocity(run.forces[:, : run.velocities.shape[1]], run.velocities)


def _reference_settings(scene: Scene, order_2_only: bool, base: Accuracy) -> list[Accuracy]:
    """The settings that the reference is refined through."""
    loses_at_contacts = any(contact.loss > 0.0 for contact in scene.contact)
    order, counts = (2, (32, 64)) if order_2_only else (4, (16, 32, 64)) if loses_at_contacts else (6, (4, 8, 16))
    return [base.replace(order=order, substeps=substeps) for substeps in counts]


def _find_reference(runs: list[Run], settings: list[Accuracy], study_runs: StudyRuns) -> Reference:
    """Refine until two references differ by less than the smallest error of the runs of the ladder, or settings end."""
    # the finest of the ladder, unless a reference is refined in what no setting of the ladder is
    previous = None if study_runs.finer.is_refined else runs[-3]
    for number, accuracy in enumerate(settings):
        name = f"order {accuracy.order}, {accuracy.substeps} ×"
        finest = study_runs.run(f"refining the reference: {name}", accuracy, is_reference=True)
        perturbed = study_runs.run(f"refining the reference: {name}, perturbed", accuracy, PERTURBATION, True)
        others = [perturbed, previous or perturbed]
        frames = min(horizon(finest.audio, other.audio, study_runs.samplerate) for other in others)
        if previous is None:
            previous = finest
            continue
        disagreement = relative_rms_error(previous.audio, finest.audio, frames)
        smallest = min(relative_rms_error(run.audio, finest.audio, frames) for run in runs)
        if frames > 0 and disagreement <= REFERENCE_AGREEMENT * smallest:
            study_runs.progress.drop(study_run(accuracy) for accuracy in settings[number + 1 :] for _ in range(2))
            break
        previous = finest
    return Reference(finest, name, frames, disagreement, perturbed)
