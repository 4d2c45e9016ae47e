"""The coefficients of the stages of a refined sample (engine.kernel.refinement)."""

import numpy as np

from engine.build.layout import Layout
from engine.build.mode_coefficients import damped_coefficients, is_heavily_damped, stage_coefficients
from engine.build.step_coefficients import ModeCoefficients, stack, step_coefficients
from engine.kernel.model import ModalLoss, Refinement
from engine.patch.accuracy import Accuracy, stage_lengths


def build_refinement(layout: Layout, kick: np.ndarray, accuracy: Accuracy, samplerate: float) -> Refinement | None:
    """Stages of a sample, be it one; None without contacts and connections. kick: t of each mode in a whole step, s."""
    if not layout.contact_points and not layout.connection_parts:
        return None
    lengths = stage_lengths(accuracy)
    kinds = sorted(set(lengths))
    omega, sigma = layout.concatenate_modes("omega"), layout.concatenate_modes("sigma")
    h = 1.0 / samplerate
    damped = is_heavily_damped(omega, sigma, h) & (accuracy.scheme == "exact" and accuracy.order == 2)
    modes = [_stage_of_modes(kick, omega, sigma, accuracy.scheme, length, h, damped) for length in kinds]
    weight = np.abs(layout.scene.gravity * layout.concatenate_modes("gravity_participation"))
    return Refinement(
        stages=stack(
            [
                step_coefficients(layout, m, samplerate, length, is_damped=accuracy.order == 2)
                for m, length in zip(modes, kinds, strict=True)
            ]
        ),
        end_loss=end_loss(np.where(damped, 1.0, np.exp(-sigma * h))) if sigma.any() else None,
        end_damping=np.full(int(layout.islands.connection[-1]), h / 2)
        if accuracy.order > 2 and layout.is_damped
        else None,
        sequence=np.array([kinds.index(length) for length in lengths]),
        length=np.array(kinds),
        refine_free_flight=accuracy.scheme != "exact",
        # |f''|·h²/8 bounds how far f strays from its chord; f'' is that of damped vibration, or of a coasting mass
        chord_deviation=np.where(
            omega > 0.0, np.minimum(omega * (omega + 2 * sigma) * h**2 / 8, 2.0), sigma * h**2 / 4
        ),
        gravity_deviation=weight * h**2 / 8 * (1 + 64 * h * sigma),
    )


def end_loss(decay_factor: np.ndarray) -> ModalLoss:
    """The half-step of loss that leaves such a share of each momentum [modes]."""
    # of the rounded share: the two must agree, or the ledger drifts
    return ModalLoss(decay_factor, 0.5 * (1 - decay_factor) * (1 + decay_factor))


def _stage_of_modes(
    kick: np.ndarray, omega: np.ndarray, sigma: np.ndarray, scheme: str, length: float, h: float, damped: np.ndarray
) -> ModeCoefficients:
    """The modes in a stage, whose length is a share of a sample of h seconds; heavily damped ones lose in it."""
    kicks, drifts = stage_coefficients(kick, omega, scheme, length)
    if not damped.any():
        return ModeCoefficients(kicks, drifts, None, None)
    decay, drag, dragged = np.ones(omega.size), np.ones(omega.size), np.zeros(omega.size)
    values = damped_coefficients(omega[damped], sigma[damped], length * h)
    kicks[damped], drifts[damped], decay[damped], drag[damped], dragged[damped] = values
    return ModeCoefficients(kicks, drifts, end_loss(decay), ModalLoss(drag, dragged))
