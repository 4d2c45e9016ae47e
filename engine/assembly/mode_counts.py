"""Modes that bodies get beside their own: as many as another build of the scene has, so that tables of one fit the
other (engine.assembly.table_exchange); and residual modes (docs/design.md, "Residual modes").

Residual modes are a few modes near the Nyquist frequency, with the static compliance at contacts of the modes that are
not built.

Modes above 0.49 of the sample rate are not built, or the patch asks for fewer modes. All modes that are left out are
stiff and follow a contact force at once, with the compliance C_r = Σ Φᵢ·Φⱼ/ω² over them. A mode with Φ² = ω²·C_r has
this compliance, and is as passive as any other. A compliance added to that of the contacts alone would not be passive.
"""

import math
from collections.abc import Container, Sequence
from typing import Any

import numpy as np

from engine.assembly.contact_points import contact_points
from engine.bodies.body import ModalBody
from engine.bodies.distributed import DistributedBody
from engine.faults import BuildError, Fault
from engine.patch.scene import Scene


def fit_modes(
    scene: Scene, bodies: Sequence[ModalBody], samplerate: float, like: Sequence[ModalBody], fit: Container[int] = ()
) -> list[ModalBody]:
    """Return the modes of bodies, with residual ones, as many of each as another build has. The highest are left out if
    there are too many. Silent modes, which nothing moves, replace those that are missing.

    fit: numbers of bodies that are as they should be
    Raises BuildError if the two cannot have the same modes.
    """
    cut = [_first_modes(body, other.omega.size - other.residual) for body, other in zip(bodies, like, strict=True)]
    fitted: list[ModalBody] = []
    for i, (body, other) in enumerate(zip(with_residual_modes(scene, cut, samplerate, fit), like, strict=True)):
        if body.residual != other.residual:
            message = "this change needs other modes than those that sound; stop and start again"
            raise BuildError(Fault(f"body[{i}]", message))
        fitted.append(_with_silent_modes(body, other.omega.size - body.omega.size))
    return fitted


def _first_modes(body: ModalBody, count: int) -> ModalBody:
    """Return a body with its first `count` modes; one that has residual modes is as it should be."""
    if body.omega.size <= count or body.residual:
        return body
    rows = (body.omega, body.sigma, body.q, body.p, body.gravity_participation)
    omega, sigma, q, p, gravity_participation = (row[:count] for row in rows)
    return ModalBody(omega, sigma, lambda position: body.shape(position)[..., :count], q, p, gravity_participation)


def _with_silent_modes(body: ModalBody, more: int) -> ModalBody:
    """Return the body with silent modes before its residual ones."""
    if more == 0:
        return body
    first = body.omega.size - body.residual

    def insert(row: np.ndarray, value: float = 0.0) -> np.ndarray:
        return np.insert(row, [first] * more, value, axis=-1)

    def shape(position: Any) -> np.ndarray:
        return insert(body.shape(position))

    omega, sigma = insert(body.omega, float(body.omega[first - 1])), insert(body.sigma, float(body.sigma[first - 1]))
    q, p, participation = insert(body.q), insert(body.p), insert(body.gravity_participation)
    return ModalBody(omega, sigma, shape, q, p, participation, body.residual, more)


FREQUENCY_SHARE = 0.45  # of the sample rate
DAMPING_PER_STEP = 0.045  # σ·h: residual modes hardly ring, and lose as other modes do at every order
MIN_SHARE = 0.03  # of the static compliance: where less is left out, nothing is added unless the patch asks for it
MAX_POINTS = 4  # of contacts on a body: with more, nothing is added unless the patch asks for it
SLOW = 20.0  # Hz
MIN_PART = 1e-3  # of the largest: smaller residual modes are left out


def with_residual_modes(
    scene: Scene, bodies: Sequence[ModalBody], samplerate: float, fit: Container[int] = ()
) -> list[ModalBody]:
    """Return the modes of bodies, with residual modes where they help. samplerate: of the steps, Hz; fit: numbers of
    bodies that are as they should be"""
    places = _contact_places(scene)
    return [
        _with_residual(body, modal, places[body.name], samplerate)
        if isinstance(body, DistributedBody) and body.residual is not False and n not in fit and places.get(body.name)
        else modal
        for n, (body, modal) in enumerate(zip(scene.body, bodies, strict=True))
    ]


def _with_residual(body: DistributedBody, modal: ModalBody, places: list[object], samplerate: float) -> ModalBody:
    """Return the modes of a body with its residual modes, whose shapes are combinations of static deflections."""
    if body.residual is None and len(places) > MAX_POINTS:
        return modal
    highest = float(np.max(modal.omega))
    beyond = body.modes_beyond(highest)
    if beyond is None:
        return modal
    shapes_beyond = np.array([beyond.shape(place) for place in places])
    left_out = shapes_beyond / beyond.omega
    moving = modal.omega > 2 * math.pi * SLOW  # slower modes act as masses on a contact
    built = np.array([modal.shape(place) for place in places])[:, moving] / modal.omega[moving]
    compliance = left_out @ left_out.T  # static, between places [places, places], m/N
    share = np.diag(compliance) / np.maximum(np.diag(compliance) + np.diag(built @ built.T), 1e-300)
    if not np.max(share) > (MIN_SHARE if body.residual is None else 0.0):
        return modal
    value, vector = np.linalg.eigh(compliance)
    kept = value > MIN_PART * value[-1]
    omega = 2 * math.pi * FREQUENCY_SHARE * samplerate
    mixture = omega * vector[:, kept] / np.sqrt(value[kept])  # Φ = ω·C_r(x, places)·V·Λ^(-1/2)
    at_places = (shapes_beyond / beyond.omega**2).T
    rows_at_places = [shapes @ at_places @ mixture for shapes in shapes_beyond]

    def shape(position: object) -> np.ndarray:
        if not isinstance(position, np.ndarray) and position in places:
            row = rows_at_places[places.index(position)]
        else:  # computed again: 20 000 modes of each string of a piano would take 70 MB
            modes = body.modes_beyond(highest)
            assert modes is not None
            row = modes.shape(position) @ (np.array([modes.shape(p) for p in places]) / modes.omega**2).T @ mixture
        return np.concatenate([modal.shape(position), row], axis=-1)

    more = int(np.count_nonzero(kept))
    rows = modal.omega, modal.sigma, modal.q, modal.p, modal.gravity_participation
    ends = omega, DAMPING_PER_STEP * samplerate, 0.0, 0.0, 0.0
    omegas, sigma, q, p, participation = (np.append(row, [end] * more) for row, end in zip(rows, ends, strict=True))
    return ModalBody(omegas, sigma, shape, q, p, participation, more)


def _contact_places(scene: Scene) -> dict[str, list[object]]:
    """Return the positions of each body that contacts touch, each once."""
    bodies = {body.name: body for body in scene.body}
    places: dict[str, list[object]] = {}
    for contact in scene.contact:
        on = None if contact.on is None else bodies[contact.on]
        for point in contact_points(contact, bodies[contact.body], on):
            for name, place in ((contact.body, point.at), (contact.on, point.on_at)):
                if name is not None and place not in places.setdefault(name, []):
                    places[name].append(place)
    return places
