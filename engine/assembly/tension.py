"""Arrays of bodies whose tension rises as they stretch (engine.kernel.interactions.tension)."""

import math

import numpy as np

from engine.assembly.array_memory import allocate
from engine.assembly.layout import Layout
from engine.bodies.stretching import Stretching
from engine.kernel.data.axes import Axis
from engine.kernel.data.model import Tension
from engine.kernel.data.state import SoftenedConnections, TensionState

CENTS_PER_ENERGY = 1200 / math.log(2)  # 1731·K·E/c⁴: by so many cents at most partials rise


def stretching_bodies(layout: Layout) -> dict[int, Stretching]:
    """Return what stretches bodies, by their numbers in the scene."""
    found = {}
    for b, (body, modal) in enumerate(zip(layout.scene.body, layout.modal_bodies, strict=True)):
        own = modal.omega.size - modal.residual - modal.silent
        if (stretching := body.find_stretching(modal.omega[:own])) is not None:
            found[b] = stretching
    return found


def tension(layout: Layout, least_detuning: float) -> Tension | None:
    """Return the bodies that stretch; None if there are none.

    least_detuning: cents by which the pitch of a partial may rise without its being computed
    """
    found = stretching_bodies(layout)
    if not found:
        return None
    islands, modes = layout.islands, layout.modes
    begin, end = np.zeros((2, len(islands.body_order)), np.int64)
    softest, unheard = np.zeros((2, len(islands.body_order)))
    weight, can_stretch = np.zeros(modes.omega.size), np.zeros(len(islands.bodies), np.int64)
    for place, b in enumerate(islands.body_order):
        if b in found:
            kappa, inside = found[b].weight, modes.of_body[b]
            begin[place], end[place] = modes.in_island[b].start, modes.in_island[b].stop
            weight[inside.start : inside.start + kappa.size] = kappa
            softest[place] = np.max(kappa / modes.omega[inside][: kappa.size] ** 2)
            unheard[place] = least_detuning / CENTS_PER_ENERGY / softest[place] ** 2
            can_stretch[islands.of_body[b]] = 1
    return Tension(begin, end, weight, softest, unheard, can_stretch)


def initial_tension(layout: Layout, model: Tension, counts: dict[Axis, int]) -> TensionState:
    """Return the state of bodies that stretch, at time 0."""
    found, order = stretching_bodies(layout), layout.islands.body_order
    stiffness = np.array([found[b].stiffness if b in found else 0.0 for b in order])
    rise = stiffness * [
        found[b].weight @ layout.modes.q[layout.modes.of_body[b]][: found[b].weight.size] ** 2 if b in found else 0.0
        for b in order
    ]
    state: TensionState = allocate(
        TensionState,
        counts,
        stiffness=stiffness,
        history=np.repeat(rise[:, None], 3, axis=1),
        connection=allocate(SoftenedConnections, counts) if counts[Axis.CONNECTION] else None,
        is_active=model.can_stretch.copy(),
    )
    return state
