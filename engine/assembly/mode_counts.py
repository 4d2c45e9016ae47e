"""Bodies with as many modes as another build of the scene has, so that tables of one fit the other
(engine.assembly.table_exchange)."""

import math
from collections.abc import Container, Sequence
from typing import Any

import numpy as np

from engine.assembly.residual_modes import with_residual_modes
from engine.bodies.body import ModalBody
from engine.faults import BuildError, Fault
from engine.patch.scene import Scene


def fit_modes(
    scene: Scene,
    bodies: Sequence[ModalBody],
    samplerate: float,
    steps: float,
    like: Sequence[ModalBody],
    fit: Container[int] = (),
) -> list[ModalBody]:
    """Return the modes of bodies, with residual ones, as many of each as another build has. The highest are left out if
    there are too many. Silent modes, which nothing moves, replace those that are missing.

    steps: of each sample, for residual modes
    fit: numbers of bodies that are as they should be
    Raises BuildError if the two cannot have the same modes.
    """
    cut = [_first_modes(body, other.omega.size - other.residual) for body, other in zip(bodies, like, strict=True)]
    fitted: list[ModalBody] = []
    least = [0.0 if other.residual else math.inf for other in like]
    completed = with_residual_modes(scene, cut, samplerate, steps, fit, least)
    for i, (body, other) in enumerate(zip(completed, like, strict=True)):
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
