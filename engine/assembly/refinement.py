"""Coefficients of the stages of a refined sample (engine.kernel.run.refinement)."""

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.mode_coefficients import damped_coefficients, end_loss, loses_in_drift, stage_coefficients
from engine.assembly.step_coefficients import ModeCoefficients, stack, step_coefficients
from engine.kernel.data.model import ContactLoss, ModalLoss, Refinement
from engine.patch.accuracy import Accuracy, stage_lengths

MAX_LOSS_IN_STEP = 0.5  # μ·f·W·h/2, of contact loss between stages: beyond, a step of order 2 is no less accurate


def build_refinement(
    layout: Layout, kick: np.ndarray, accuracy: Accuracy, samplerate: float, finest: Accuracy | None = None
) -> Refinement | None:
    """Return the stages of a sample, even if there is only one; None without contacts and connections.

    kick:   t of each mode in a whole step, s
    finest: the accuracy of the Refinement whose kernel this one is for, if that is another
    """
    if not layout.contact_points and not layout.connection_parts:
        return None
    lengths = stage_lengths(accuracy)
    kinds = sorted(set(lengths))
    omega, sigma = layout.concatenate_modes("omega"), layout.concatenate_modes("sigma")
    h = 1.0 / samplerate
    is_high, has_high_kernel = accuracy.order > 2, (finest or accuracy).order > 2
    contact_loss = _contact_loss(layout, h / accuracy.substeps, is_high) if has_high_kernel else None
    loses_between = contact_loss is not None and is_high
    if loses_between:
        kinds = sorted({*kinds, 1 / accuracy.substeps})
    damped = loses_in_drift(omega, sigma, h, finest or accuracy)
    loses_in_stages = sigma.any() and not has_high_kernel
    modes = [
        _damped_stage(kick, omega, sigma, accuracy.scheme, length, h, damped)
        if loses_in_stages
        else ModeCoefficients(*stage_coefficients(kick, omega, accuracy.scheme, length), None, None)
        for length in kinds
    ]
    return Refinement(
        stages=stack(
            [
                step_coefficients(
                    layout,
                    m,
                    samplerate,
                    length,
                    is_damped=accuracy.order == 2,
                    loses_at_contacts=not loses_between or length == 1 / accuracy.substeps,
                )
                for m, length in zip(modes, kinds, strict=True)
            ]
        ),
        end_loss=end_loss(np.exp(-sigma * h)) if sigma.any() and has_high_kernel else None,
        end_damping=np.full(int(layout.islands.connection[-1]), h / 2 if is_high else 0.0)
        if has_high_kernel and layout.is_damped
        else None,
        contact_loss=contact_loss,
        sequence=np.array([kinds.index(length) for length in lengths]),
        loss_before=h * loss_times(accuracy),
        loss_after=h * loss_times(accuracy)[::-1],
        sequence_in_solve=np.array([kinds.index(1 / accuracy.substeps)] * accuracy.substeps)
        if loses_between
        else np.zeros(0, np.int64),
        length=np.array(kinds),
        refine_free_flight=accuracy.scheme != "exact",
        # |f''|·h²/8 bounds how far f strays from its chord; f'' is that of damped vibration, or of a coasting mass
        chord_deviation=np.where(
            omega > 0.0, np.minimum(omega * (omega + 2 * sigma) * h**2 / 8, 2.0), sigma * h**2 / 4
        ),
        gravity_deviation=np.abs(layout.weights()) * h**2 / 8 * (1 + 64 * h * sigma),
    )


def loss_times(accuracy: Accuracy) -> np.ndarray:
    """Return the duration of contact loss before each stage, as a share of a sample. After the stages, the durations
    are the same in reverse order. In order 2 they are 0, as loss acts in the stages.

    In a step of order 4 or 6 whose first stage has the length γ, loss acts at 0, γ, 1 - γ and 1, with the weights of
    the quadrature of third degree there. The lengths of the stages between have the sum 1 - 2γ.
    """
    lengths = stage_lengths(accuracy.replace(substeps=1))
    times = np.zeros(len(lengths))
    if len(lengths) > 1:
        inner = 1 / (12 * lengths[0] * (1 - lengths[0]))
        times[0], times[-1] = 0.5 - inner, inner
    return np.tile(times / accuracy.substeps, accuracy.substeps)


def _contact_loss(layout: Layout, step: float, acts: bool) -> ContactLoss | None:
    """Return the contact loss between stages, which is 0 if `acts` is False; None if no contact has loss. step: length
    of a substep, s"""
    loss = np.array([layout.scene.contact[k].loss for k, _ in layout.contact_points])
    if not loss.any():
        return None
    shapes = [layout.island_contact_shapes(n) for n in range(layout.islands.contact.size - 1)]  # both sides together
    mobility = np.concatenate([np.sum(phi**2, axis=1) for phi in shapes])
    loss[(mobility == 0.0) | (not acts)] = 0.0
    return ContactLoss(loss, mobility, loss * mobility * step / (2 * MAX_LOSS_IN_STEP))


def _damped_stage(
    kick: np.ndarray, omega: np.ndarray, sigma: np.ndarray, scheme: str, length: float, h: float, damped: np.ndarray
) -> ModeCoefficients:
    """Return the coefficients of modes in a stage with loss, whose length is a share of a sample of h seconds. The
    modes in `damped` also lose in the drift."""
    kicks, drifts = stage_coefficients(kick, omega, scheme, length)
    decay = np.exp(-sigma * length * h)
    if not damped.any():
        return ModeCoefficients(kicks, drifts, end_loss(decay), None)
    drag, dragged = np.ones(omega.size), np.zeros(omega.size)
    values = damped_coefficients(omega[damped], sigma[damped], length * h)
    kicks[damped], drifts[damped], decay[damped], drag[damped], dragged[damped] = values
    return ModeCoefficients(kicks, drifts, end_loss(decay), ModalLoss(drag, dragged))
