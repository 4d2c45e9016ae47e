"""Coefficients of the stages of a refined sample (engine.kernel.run.refinement)."""

import math

import numpy as np

from engine.arithmetic.elementary import square
from engine.assembly.array_memory import ABSENT
from engine.assembly.force_shapes import force_shapes
from engine.assembly.layout import Layout
from engine.assembly.one_way_drive import DriveForce
from engine.assembly.stage_coefficients import stage_coefficients
from engine.assembly.step_coefficients import stack, step_coefficients
from engine.assembly.tension import stretching_bodies
from engine.kernel.data.model import AdaptiveSteps, ContactLoss, Refinement, StepCoefficients
from engine.patch.accuracy import STAGES, Accuracy, Stage, StageLoss, step_stages
from engine.patch.tables import ChangeEvent

LOCAL_SHARE = 0.03  # of the error that is asked for: what twice the steps may change in a sample
MAX_LOSS_IN_STEP = 0.5  # μ·f·W·h/2, of contact loss between stages: beyond, a step of order 2 is no less accurate


def build_refinement(
    layout: Layout,
    accuracy: Accuracy,
    samplerate: float,
    has_events: bool,
    finest: Accuracy | None = None,
    seconds: float = math.inf,
) -> Refinement | None:
    """Return the stages of a sample, even if there is only one; None without anything that acts within a sample.

    has_events: True if a score may act, or events of live sound
    finest:  the accuracy of the Refinement whose kernel this one is for, if that is another
    seconds: of the sound
    """
    acts = layout.points.contacts or layout.points.connection_parts or has_events
    acts = acts or any(not isinstance(force, DriveForce) for force in layout.islands.forces)
    if not (acts or stretching_bodies(layout)):
        return None
    omega, sigma, h = layout.modes.omega, layout.modes.sigma, 1.0 / samplerate
    is_high, has_high_kernel = accuracy.order > 2, (finest or accuracy).order > 2
    contact_loss = _contact_loss(layout, h / accuracy.substeps, is_high) if has_high_kernel else ABSENT
    kinds_of_levels, stages = list[list[Stage]](), list[StepCoefficients]()
    for level in range(accuracy.levels + 1):
        kinds = step_stages(accuracy, level)
        if contact_loss is not ABSENT and is_high:
            kinds += step_stages(accuracy.replace(order=2), level)
        kinds = list(dict.fromkeys(kinds))
        kinds_of_levels.append(kinds)
        steps = accuracy.substeps << level
        for kind, modes in zip(kinds, stage_coefficients(layout.modes, kinds, accuracy, h, steps), strict=True):
            stages.append(step_coefficients(layout, modes, samplerate, kind.length, kind.loss is StageLoss.ALL))
    kinds = kinds_of_levels[0]
    in_solve = step_stages(accuracy.replace(order=2)) if contact_loss is not ABSENT and is_high else []
    loses_between = contact_loss is not ABSENT or (has_high_kernel and _is_damped(layout))
    return Refinement(
        stages=stack(stages),
        contact_loss=contact_loss,
        sequence=np.array([kinds.index(kind) for kind in step_stages(accuracy)]),
        sequence_in_solve=np.array([kinds.index(kind) for kind in in_solve], np.int64),
        loss_before=h * loss_times(accuracy) if loses_between else ABSENT,
        loss_after=h * loss_times(accuracy)[::-1] if loses_between else ABSENT,
        damper_share=damper_shares(accuracy),
        force=force_shapes(layout.islands.forces, samplerate, seconds, accuracy),
        length=np.array([kind.length for kinds in kinds_of_levels for kind in kinds]),
        steps=accuracy.substeps,
        kinds=len(kinds),
        adaptive=adaptive_steps(accuracy) if (finest or accuracy).max_error is not None else ABSENT,
        refine_free_flight=accuracy.scheme != "exact",
        # |f''|·h²/8 bounds how far f strays from its chord; f'' is that of damped vibration, or of a coasting mass
        chord_deviation=np.where(
            omega > 0.0, np.minimum(omega * (omega + 2 * sigma) * square(h) / 8, 2.0), sigma * square(h) / 4
        ),
        gravity_deviation=np.abs(layout.modes.weight) * square(h) / 8 * (1 + 64 * h * sigma),
    )


def adaptive_steps(accuracy: Accuracy) -> AdaptiveSteps:
    """Return how many steps a sample may have; with one level, it has as many as `substeps` says."""
    return AdaptiveSteps(accuracy.levels, local_limit(accuracy))


def local_limit(accuracy: Accuracy) -> float:
    """Return what twice the steps may change the motion in a sample, relative to the largest motion."""
    return LOCAL_SHARE * (accuracy.max_error or 0.0)


def _is_damped(layout: Layout) -> bool:
    """True if connections have dampers, or may get them."""
    changed = any(isinstance(e, ChangeEvent) and e.damping_coefficient for e in layout.scene.event)
    items = [item for coordinates in layout.islands.coordinates for item in coordinates.items]
    return changed or any(layout.islands.is_variable) or any(item.damping for item in items)


def loss_times(accuracy: Accuracy) -> np.ndarray:
    """Return how long contacts and dampers lose before each stage of a step, as a share of a sample. After the stages,
    it is as long in reverse order. In order 2 they lose in the stages, and not between them.

    In a step of order 4 or 6 whose first stage has the length γ, loss acts at 0, γ, 1 - γ and 1, with the weights of
    the quadrature of third degree there. The lengths of the stages between have the sum 1 - 2γ.
    """
    lengths = [stage.length for stage in STAGES[accuracy.order]]
    times = np.zeros(len(lengths))
    if len(lengths) > 1:
        inner = 1 / (12 * lengths[0] * (1 - lengths[0]))
        times[0], times[-1] = 0.5 - inner, inner
    return times / accuracy.substeps


def damper_shares(accuracy: Accuracy) -> np.ndarray:
    """Return for which share of a sample dampers of events act at either end of a step, and after its first stage and
    before its last; of a step as it is where steps have been doubled as often as they may."""
    within = float(loss_times(accuracy)[-1]) if accuracy.order > 2 else 0.0
    doublings: int = 1 << accuracy.levels
    return np.array([0.5 / accuracy.substeps - within, within]) / doublings


def _contact_loss(layout: Layout, step: float, acts: bool) -> ContactLoss:
    """Return the contact loss between stages, which is 0 if `acts` is False; ABSENT if no contact has loss.

    step: length of a substep, s
    """
    loss = np.array([layout.touching[k].loss for k, _ in layout.islands.contact_points])
    if not loss.any():
        return ABSENT
    mobility = np.concatenate([np.sum(square(shapes.phi), axis=1) for shapes in layout.points.contact_shapes])
    loss[(mobility == 0.0) | (not acts)] = 0.0
    return ContactLoss(loss, mobility, loss * mobility * step / (2 * MAX_LOSS_IN_STEP))
