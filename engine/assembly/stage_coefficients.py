"""Coefficients of the stages of a sample (engine.kernel.run.refinement). The stages together are the exact motion over
the sample, also of modes that lose, so that more of them converge to the motion of the model.

In order 2 each stage is the exact damped step (engine.assembly.mode_coefficients.damped_coefficients). In orders 4 and
6 some stages go back in time, where loss would create energy. There, momenta lose at both ends of some stages that go
forwards, and all stages are rotations. Two numbers make their product exact: a factor of the angles, which is nearly 1,
and the share of the loss at stages of the first kind. For slow modes this share is the weight of a quadrature of third
degree: what loss adds to the error is of order 4, but for what is of second order in the decay rate.
"""

import math
from collections.abc import Sequence

import numpy as np

from engine.arithmetic import plain_numbers
from engine.arithmetic.elementary import exp, sin, sin_and_cos, square, tan
from engine.assembly.array_memory import ABSENT
from engine.assembly.mode_coefficients import ModeCoefficients, add_loss, end_loss, exact_motion
from engine.assembly.modes import Modes
from engine.kernel.data.model import ModalLoss
from engine.patch.accuracy import STAGES, Accuracy, Stage, StageLoss

LEAST_LOSS = 1e-8  # σh, for which the number of iterations is found
ANGLE_OF_FREE_MASS = 1e-3  # rad: as if it had a weak spring, so that it falls, too, as it does in one step
LEAST_ANGLE = 1e-7  # rad: with so weak a spring it coasts as without
LEAST_SENSITIVITY = 1e-9  # of the motion to the share: below, any share is as good


def stage_coefficients(
    modes: Modes, kinds: Sequence[Stage], accuracy: Accuracy, h: float, steps: int
) -> list[ModeCoefficients]:
    """Return the coefficients of each kind of stage in a sample of so many steps. h: length of the sample, s"""
    omega, sigma, step = modes.omega, modes.sigma, h / steps
    is_exact, stages = accuracy.scheme == "exact", STAGES[accuracy.order]
    scale, share = np.ones(omega.size), np.zeros(omega.size)
    if accuracy.order > 2 and sigma.any():
        scale, share = solve_stages(omega, sigma if is_exact else np.zeros(omega.size), step, stages)
    damped = (sigma > 0.0) & is_exact
    coefficients = []
    for kind in kinds:
        kick = np.full(omega.size, kind.length * h / 2)
        if is_exact:
            kick = scale * kick
            kick[omega > 0.0] = tan(omega * kick)[omega > 0.0] / omega[omega > 0.0]
        drift = 2 * kick / (1 + square(omega * kick))
        if not sigma.any():
            coefficients.append(ModeCoefficients(kick, drift, ABSENT, ABSENT))
        elif kind.loss is StageLoss.ALL:
            coefficients.append(add_loss(kick, drift, modes, damped, h, kind.length))
        else:
            drag = ModalLoss(np.ones(omega.size), np.zeros(omega.size)) if damped.any() else ABSENT
            loss = end_loss(exp(-sigma * step * loss_share(kind.loss, stages, share)))
            coefficients.append(ModeCoefficients(kick, drift, loss, drag))
    return coefficients


def loss_share(loss: StageLoss, stages: Sequence[Stage], share: np.ndarray) -> np.ndarray:
    """Return how long momenta lose at either end of a stage, over the length of the step [modes].

    share: of the loss at stages of the first kind [modes]
    """
    if loss is StageLoss.NONE:
        return np.zeros(share.size)
    of_kind = share if loss is StageLoss.FIRST else 1 - share
    return of_kind / sum(stage.loss is loss for stage in stages)


def solve_stages(
    omega: np.ndarray, sigma: np.ndarray, step: float, stages: Sequence[Stage]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the factor of the angles, and the share of loss at stages of the first kind, with which the stages of a
    step are the exact motion of each mode [modes]. Newton's method, with the derivatives for little loss.

    step: s
    """
    turn, lost = np.where(omega > 0.0, omega * step, ANGLE_OF_FREE_MASS), sigma * step
    change, share = sum_of_nodes(turn, stages)
    scale, sensitivity = np.ones(turn.size), 2 * lost * exp(-lost) * change
    (sine, cosine), gain = sin_and_cos(turn), exp(lost)
    stay, move, brake = exact_motion(turn, lost, 1.0)
    ratio = max(LEAST_LOSS, float(lost.max(initial=0.0)))  # of the errors of two iterations
    for _ in range(2 + math.ceil(plain_numbers.log(np.finfo(float).eps) / plain_numbers.log(ratio))):
        a, b, d = motion_of_stages(turn, lost, stages, scale, share)
        angle = ((b - turn * move) * cosine - 0.5 * (a + d - stay - brake) * sine) * gain
        uneven = (a - d) - (stay - brake)
        scale -= angle / turn
        share += np.where(sensitivity > LEAST_SENSITIVITY, uneven / np.maximum(sensitivity, LEAST_SENSITIVITY), 0.0)
    free = omega == 0.0
    turn, lost = np.full(np.count_nonzero(free), LEAST_ANGLE), lost[free]
    _, coasted, _ = motion_of_stages(turn, lost, stages, scale[free], share[free])
    scale[free] *= turn * exact_motion(turn, lost, 1.0)[1] / coasted
    return scale, share


def motion_of_stages(
    turn: np.ndarray, lost: np.ndarray, stages: Sequence[Stage], scale: np.ndarray, share: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a, b and d of the motion ωq ← a·ωq + b·p, p ← d·p - b·ωq over the stages [modes].

    turn, lost: ω and σ times the length of the step
    """
    q_of_q, q_of_p = np.ones(turn.size), np.zeros(turn.size)
    p_of_q, p_of_p = np.zeros(turn.size), np.ones(turn.size)
    for stage in stages:
        keep = exp(-lost * loss_share(stage.loss, stages, share))
        sine, cosine = sin_and_cos(scale * turn * stage.length)
        half_q, half_p = keep * p_of_q, keep * p_of_p
        p_of_q, p_of_p = keep * (cosine * half_q - sine * q_of_q), keep * (cosine * half_p - sine * q_of_p)
        q_of_q, q_of_p = cosine * q_of_q + sine * half_q, cosine * q_of_p + sine * half_p
    return q_of_q, q_of_p, p_of_p


def sum_of_nodes(turn: np.ndarray, stages: Sequence[Stage]) -> tuple[np.ndarray, np.ndarray]:
    """Return how much more loss at stages of the first kind changes a - d (motion_of_stages) than at those of the
    second, for little loss; and the share of loss at the first with which a - d is right then: the mean of
    cos (2t - 1)ωh over the times t of loss, in steps, is to be that over the step, sin(ωh)/ωh [modes]."""
    ends = np.cumsum([0.0, *(stage.length for stage in stages)])

    def missing(kind: StageLoss) -> np.ndarray:
        """1 less the mean at stages of a kind."""
        times = [time for i, stage in enumerate(stages) if stage.loss is kind for time in ends[i : i + 2]]
        return np.asarray(np.mean([2 * square(sin((time - 0.5) * turn)) for time in times], axis=0))

    first, second = missing(StageLoss.FIRST), missing(StageLoss.SECOND)
    x = turn * turn
    series = x / 6 * (1 - x / 20 * (1 - x / 42 * (1 - x / 72)))
    of_step = np.where(turn < 0.3, series, 1 - sin(turn) / turn)
    return first - second, (of_step - second) / (first - second)
