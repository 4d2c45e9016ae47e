"""Modes of all bodies side by side: where those of each body are in the kernels' arrays, and their numbers."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from engine.assembly.contact_points import BodyPoint
from engine.assembly.islands import Islands
from engine.assembly.modal_system import ModalSystem
from engine.assembly.mode_shape_rows import ShapeRow
from engine.kernel.data.enums import LANES

MIN_ALIGNED_MODES = 16  # of a connected body: from so many on, it begins and ends where vectors do


class Modes(NamedTuple):
    """Modes of all bodies, in the order of the kernels' arrays.

    Connected bodies with many modes begin, and end, where vectors of their island do. Between them there may be modes
    of no body, which are like the mode before them, but at rest. Nothing moves these, and no pickup depends on them.
    """

    of_body: list[slice]  # of each of the scene's bodies, counted from the first of all
    in_island: list[slice]  # of each of the scene's bodies, counted from the first of its island
    room: list[int]  # number of modes that are reserved for each of the scene's bodies
    of_island: list[slice]  # of each island, counted from the first of all
    omega: np.ndarray  # [modes], rad/s
    sigma: np.ndarray  # [modes], 1/s
    q: np.ndarray  # [modes], √kg·m: displacement at time 0
    p: np.ndarray  # [modes], √kg·m/s: momentum at time 0
    weight: np.ndarray  # [modes], √kg·m/s²: force of gravity
    is_free: np.ndarray  # [modes], bool: True for those of free masses, without restoring force and connection


def arrange_modes(system: ModalSystem, islands: Islands) -> Modes:
    """Return the modes of a scene."""
    sizes, is_connected = [body.omega.size for body in system.modal_bodies], islands.coordinates_of_body
    vectors = [LANES if size >= MIN_ALIGNED_MODES and b in is_connected else 1 for b, size in enumerate(sizes)]
    room = [size + -size % vector for size, vector in zip(sizes, vectors, strict=True)]
    begins, first_of_island, end = [0] * len(sizes), list[int](), 0
    for b in islands.body_order:
        if islands.of_body[b] == len(first_of_island):
            first_of_island.append(end)
        begins[b] = end + -(end - first_of_island[-1]) % vectors[b]
        end = begins[b] + room[b]
    of_body = [slice(begin, begin + size) for begin, size in zip(begins, sizes, strict=True)]
    omega, sigma, q, p, gravity_participation = np.zeros((5, end))
    for b, following in zip(islands.body_order, [*islands.body_order[1:], None], strict=True):
        body, inside = system.modal_bodies[b], of_body[b]
        omega[inside], sigma[inside], q[inside], p[inside] = body.omega, body.sigma, body.q, body.p
        gravity_participation[inside] = body.gravity_participation
        between = slice(inside.stop, end if following is None else begins[following])
        omega[between], sigma[between] = max(body.omega[-1], 1.0), body.sigma[-1]
    is_free = omega == 0.0
    for b in is_connected:
        is_free[of_body[b]] = False
    return Modes(
        of_body=of_body,
        in_island=[
            slice(inside.start - first_of_island[island], inside.stop - first_of_island[island])
            for inside, island in zip(of_body, islands.of_body, strict=True)
        ],
        room=room,
        of_island=[slice(*ends) for ends in pairwise([*first_of_island, end])],
        omega=omega,
        sigma=sigma,
        q=q,
        p=p,
        weight=-system.scene.gravity * gravity_participation,
        is_free=is_free,
    )


def find_row(system: ModalSystem, modes: Modes, point: BodyPoint) -> ShapeRow:
    """Return the mode shapes at a point, with the position of their modes in the arrays."""
    if point.body is None:
        return ShapeRow(0, 0, np.empty(0))
    number = system.body_index[point.body]
    return ShapeRow(modes.in_island[number].start, modes.of_body[number].start, system.shape_at(point))
