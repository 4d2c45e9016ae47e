"""The tables of the stages of a refined sample (engine.refine)."""

import numpy as np

from engine.accuracy import Accuracy, stages
from engine.compliance import compliances
from engine.layout import Layout, Point
from engine.model import DampedStages, Loss, Modes, Refinement, Rows
from engine.modes import damped_table, heavily_damped, stage_table
from engine.spots import places


def refinement(layout: Layout, modes: Modes, accuracy: Accuracy, samplerate: float) -> Refinement | None:
    """Tables of all stages, be it one; None without contacts."""
    if not layout.spot:
        return None
    lengths = stages(accuracy)
    kinds = sorted(set(lengths))
    omega, sigma = layout.gather("omega"), layout.gather("sigma")
    h = 1.0 / samplerate
    tables = [Modes(*stage_table(modes.kick, omega, accuracy.scheme, length)) for length in kinds]
    heavy = heavily_damped(omega, sigma, h) & (accuracy.scheme == "exact" and accuracy.order == 2)
    damped = _damp(tables, heavy, omega, sigma, kinds, h) if heavy.any() else None
    ends = [layout.ends(k, spot) for k, spot in layout.spot]
    forces = [layout.forces[j] for j in layout.force]
    points = [Point(f.body, places(f.at, layout.scene.body[layout.number[f.body]])[0], 1.0) for f in forces]
    touching = [layout.rows([a for a, _ in ends], table) for table in tables]
    touched = [layout.rows([b for _, b in ends], table) for table in tables]
    pushed = [layout.rows(points, table) for table in tables]
    found = [compliances(layout, table) for table in tables]
    loss = np.array([layout.scene.contact[k].loss for k, _ in layout.spot])
    weight = np.abs(layout.scene.gravity * layout.gather("weight"))
    begin = np.cumsum([0] + [m.size for m in found[0][0]])[:-1]
    return Refinement(
        sequence=np.array([kinds.index(length) for length in lengths]),
        length=np.array(kinds),
        always=accuracy.scheme != "exact",
        kick=np.array([t.kick for t in tables]),
        drift=np.array([t.drift for t in tables]),
        pull=np.array([t.kick * omega**2 for t in tables]),
        touch_kick=_table(touching, "kick"),
        touch_drift=_table(touching, "drift"),
        partner_kick=_table(touched, "kick"),
        partner_drift=_table(touched, "drift"),
        force_kick=_table(pushed, "kick"),
        force_drift=_table(pushed, "drift"),
        compliance=np.array([np.concatenate([np.diag(m) for m in matrices]) for matrices, _ in found]),
        beneath=np.array([beneath for _, beneath in found]),
        rate=np.array([loss * samplerate / length for length in kinds]),
        matrix=np.array([np.concatenate([m.ravel() for m in matrices]) for matrices, _ in found]),
        begin=begin.astype(np.int64),
        # |f''|·h²/8 bounds how far f strays from its chord; f'' is that of damped vibration, or of a coasting mass
        curve=np.where(omega > 0.0, np.minimum(omega * (omega + 2 * sigma) * h**2 / 8, 2.0), sigma * h**2 / 4),
        sag=weight * h**2 / 8 * (1 + 64 * h * sigma),
        damped=damped,
    )


def loss_of(keep: np.ndarray) -> Loss:
    """The loss that keeps so much of each momentum [modes]."""
    return Loss(keep, 0.5 * (1 - keep) * (1 + keep))  # of the rounded share: the two must agree, or the ledger drifts


def _damp(
    tables: list[Modes], heavy: np.ndarray, omega: np.ndarray, sigma: np.ndarray, lengths: list[float], h: float
) -> DampedStages:
    """Give heavily damped modes stages of their own, with their loss in them.

    lengths: of the stages, as shares of a sample of h seconds
    """
    keep, drag = np.ones((2, len(tables), omega.size))
    dragged = np.zeros((len(tables), omega.size))
    for n, (table, length) in enumerate(zip(tables, lengths, strict=True)):
        found = damped_table(omega[heavy], sigma[heavy], length * h)
        table.kick[heavy], table.drift[heavy], keep[n, heavy], drag[n, heavy], dragged[n, heavy] = found
    ends = loss_of(np.where(heavy, 1.0, np.exp(-sigma * h)))
    return DampedStages(ends, *loss_of(keep), drag, dragged)


def _table(rows: list[Rows], field: str) -> np.ndarray:
    return np.array([getattr(r, field) for r in rows])
