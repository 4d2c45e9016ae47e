"""Arrays of bodies whose tension rises as they stretch (engine.kernel.interactions.tension)."""

from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import square
from engine.arithmetic.products import product
from engine.assembly.array_memory import ABSENT, allocate
from engine.assembly.connection_coordinates import find_stretching, stretch_of_ends
from engine.assembly.layout import Layout
from engine.assembly.mode_shape_rows import ShapeRow, mode_shape_rows
from engine.assembly.stiffening import stiffening
from engine.bodies.stretching import Stretching
from engine.kernel.data.axes import Axis
from engine.kernel.data.enums import MovingEnd, Stretch, StretchFactor
from engine.kernel.data.model import Tension
from engine.kernel.data.state import StiffenedConnections, TensionState
from engine.patch.tables import EndConnection

HEARD_DETUNING = 1e-6  # of the detuning that may be left out, of a body whose tension is heard: it ends without a click
CENTS_PER_ENERGY = 1200 / 0.6931471805599453  # 1731·K·E/c⁴: by so many cents at most partials rise


def stretching_bodies(layout: Layout) -> dict[int, Stretching]:
    """Return what stretches bodies, by their numbers in the scene."""
    stretching = {}
    for b, body in enumerate(layout.scene.body):
        if (of_body := find_stretching(layout, body.name)) is not None:
            stretching[b] = of_body
    return stretching


def tension(layout: Layout, least_detuning: float) -> Tension:
    """Return the bodies that stretch; ABSENT if there are none.

    least_detuning: cents by which the pitch of a partial may rise without its being computed
    """
    stretching = stretching_bodies(layout)
    if not stretching:
        return ABSENT
    islands, modes = layout.islands, layout.modes
    count = len(islands.body_order)
    begin, end = np.zeros((2, count), np.int64)
    places, factor = np.full((count, len(MovingEnd)), -1), np.zeros((count, len(StretchFactor)))
    all_kappa, can_stretch = np.zeros(modes.omega.size), np.zeros(len(islands.bodies), np.int64)
    pickups = layout.points.pickups
    heard = {layout.body_index[point.pickup.body] for point in pickups if point.pickup.quantity == "tension"}
    for n, b in enumerate(islands.body_order):
        if b in stretching:
            least = least_detuning * (HEARD_DETUNING if b in heard else 1.0)
            kappa, inside, ends = stretching[b].kappa, modes.of_body[b], _moving_ends(layout, b)
            all_kappa[inside] = kappa
            softest = float(np.max(kappa / square(modes.omega[inside])))
            begin[n], end[n] = modes.in_island[b].start, modes.in_island[b].stop
            places[n] = ends.coordinates
            factor[n] = stretching[b].stiffness, softest, least / CENTS_PER_ENERGY / square(softest), *ends.factors
            can_stretch[islands.of_body[b]] = 1
    heard_bodies = np.array(_heard_bodies(layout), np.int64)
    share = np.array([float(point.pull is None) for point in pickups])
    pull = mode_shape_rows([point.pull or ShapeRow(0, 0, np.empty(0)) for point in pickups])
    pairs = stiffening(layout, list(stretching))
    return Tension(begin, end, all_kappa, places, factor, pairs, can_stretch, heard_bodies, share, pull)


def _heard_bodies(layout: Layout) -> list[int]:
    """Return the body of each pickup that hears the rise of its tension, by its place in the island, -1 of others."""
    islands, order = layout.islands, layout.islands.body_order
    first = [islands.of_body[b] for b in order].index
    hears = [p.pickup.quantity == "tension" or p.pull is not None for p in layout.points.pickups]
    bodies = [layout.body_index[point.pickup.body] for point in layout.points.pickups]
    return [
        order.index(b) - first(islands.of_body[b]) if is_one else -1 for b, is_one in zip(bodies, hears, strict=True)
    ]


class MovingEnds(NamedTuple):
    """Ends of a string that move."""

    coordinates: list[int]  # of slope and displacement of each, -1 of an end that does not move
    factors: list[float]  # of each, and of their product, 1/m


def _moving_ends(layout: Layout, b: int) -> MovingEnds:
    """Return the ends of a string that move, none of another body."""
    items, scene = layout.islands.coordinates[layout.islands.of_body[b]].items, layout.scene
    name, places, ends = scene.body[b].name, list[int](), list[EndConnection]()
    for i, item in enumerate(items):
        end = None if item.slope_of is None else scene.connection[item.slope_of[0]]
        if item.slope_of is not None and isinstance(end, EndConnection) and end.body == name:
            places += [i, i - item.slope_of[1]]
            ends.append(end)
    factors = [stretch_of_ends(layout, end, end) for end in ends] + [0.0] * (2 - len(ends))
    factors.append(stretch_of_ends(layout, *ends) if len(ends) == 2 else 0.0)
    return MovingEnds(places + [-1] * (4 - len(places)), factors)


def initial_tension(layout: Layout, model: Tension, counts: dict[Axis, int]) -> TensionState:
    """Return the state of bodies that stretch, at time 0."""
    stretching, body = stretching_bodies(layout), np.zeros((counts[Axis.BODY], len(Stretch)))
    for n, b in enumerate(layout.islands.body_order):
        if b in stretching:
            stretch = product(stretching[b].kappa, square(layout.modes.q[layout.modes.of_body[b]]))
            body[n, Stretch.STRETCHES] = 1.0
            body[n, [Stretch.LAST, Stretch.SECOND_LAST, Stretch.THIRD_LAST]] = stretching[b].stiffness * stretch
    state: TensionState = allocate(
        TensionState,
        counts,
        body=body,
        connection=allocate(StiffenedConnections, counts) if counts[Axis.CONNECTION] else ABSENT,
        is_active=model.can_stretch.copy(),
    )
    return state
