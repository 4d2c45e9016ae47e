"""Arrays of bodies whose tension rises as they stretch (engine.kernel.interactions.tension)."""

import math

import numpy as np

from engine.assembly.array_memory import allocate
from engine.assembly.connection_coordinates import find_stretching, stretch_of_ends
from engine.assembly.layout import Layout
from engine.bodies.stretching import Stretching
from engine.kernel.data.axes import Axis
from engine.kernel.data.model import Tension
from engine.kernel.data.state import SoftenedConnections, TensionState

CENTS_PER_ENERGY = 1200 / math.log(2)  # 1731·K·E/c⁴: by so many cents at most partials rise


def stretching_bodies(layout: Layout) -> dict[int, Stretching]:
    """Return what stretches bodies, by their numbers in the scene."""
    found = {}
    for b, body in enumerate(layout.scene.body):
        if (stretching := find_stretching(layout, body.name)) is not None:
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
    ends, end_weights = np.full((len(begin), 4), -1), np.zeros((len(begin), 3))
    softest, unheard = np.zeros((2, len(islands.body_order)))
    weight, can_stretch = np.zeros(modes.omega.size), np.zeros(len(islands.bodies), np.int64)
    for place, b in enumerate(islands.body_order):
        if b in found:
            kappa, inside = found[b].weight, modes.of_body[b]
            ends[place], end_weights[place] = _moving_ends(layout, b)
            begin[place], end[place] = modes.in_island[b].start, modes.in_island[b].stop
            weight[inside] = kappa
            softest[place] = np.max(kappa / modes.omega[inside] ** 2)
            unheard[place] = least_detuning / CENTS_PER_ENERGY / softest[place] ** 2
            can_stretch[islands.of_body[b]] = 1
    return Tension(begin, end, weight, softest, unheard, ends, end_weights, can_stretch)


def _moving_ends(layout: Layout, b: int) -> tuple[list[int], list[float]]:
    """Return the coordinates of the slope and of the displacement of the moving ends of a string, -1 of an end that
    does not move, and the weights of both ends and of their product."""
    items, scene = layout.islands.coordinates[layout.islands.of_body[b]].items, layout.scene
    name, places, at = scene.body[b].name, list[int](), list[float]()
    for i, item in enumerate(items):
        if item.slope_of is not None and scene.connection[item.slope_of[0]].body == name:
            places += [i, i - item.slope_of[1]]
            at.append(scene.connection[item.slope_of[0]].at)
    weights = [stretch_of_ends(layout, name, end, end) for end in at] + [0.0] * (2 - len(at))
    return places + [-1] * (4 - len(places)), [*weights, stretch_of_ends(layout, name, *at) if len(at) == 2 else 0.0]


def initial_tension(layout: Layout, model: Tension, counts: dict[Axis, int]) -> TensionState:
    """Return the state of bodies that stretch, at time 0."""
    found, order = stretching_bodies(layout), layout.islands.body_order
    stiffness = np.array([found[b].stiffness if b in found else 0.0 for b in order])
    rise = stiffness * [
        found[b].weight @ layout.modes.q[layout.modes.of_body[b]] ** 2 if b in found else 0.0 for b in order
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
