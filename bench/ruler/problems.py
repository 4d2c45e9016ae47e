"""The scenes of the ruler, as problems: the modes and contacts that the engine builds for them."""

from pathlib import Path

import numpy as np

import engine
from bench.ruler.contact_ruler.library import NAMES
from bench.ruler.contact_ruler.problem import Friction, Problem
from engine.assembly.build import build
from engine.assembly.connection_coordinates import find_stretching
from engine.assembly.contact_points import BodyPoint, offset
from engine.assembly.friction import friction_points
from engine.assembly.layout import Layout
from engine.patch.friction import Friction as FrictionTable

__all__ = ["NAMES", "as_problem", "ruler_scene"]

SCENES = Path(__file__).parent / "scenes"
SAMPLERATE = 44_100


def ruler_scene(name: str) -> engine.Scene:
    """A scene of the ruler."""
    return engine.load(SCENES / f"{name}.toml")


def as_problem(scene: engine.Scene, samplerate: float = SAMPLERATE) -> Problem:
    """The modes and contacts of a scene. What springs join is given in its modes of vibration, without loss."""
    layout = build(scene, samplerate).layout
    assert len(layout.islands.bodies) == 1, "all bodies of a scene of the ruler can touch"
    # those of the bodies, in the order of the scene
    modes = np.concatenate([np.arange(m.start, m.stop) for m in layout.modes.of_body])
    arrays = layout.modes
    omega, sigma, q, p, weight = (a[modes] for a in (arrays.omega, arrays.sigma, arrays.q, arrays.p, arrays.weight))
    (heard,) = layout.points.pickups
    pickup = heard.row.over_island(layout.modes.omega.size)[modes]
    shapes = layout.points.contact_shapes[0].phi[:, modes]
    springs = [(_spring(layout, connection)[modes], connection.stiffness) for connection in scene.connection]
    stretch = _stretch(layout, scene, modes)
    if springs:
        assert not sigma.any() and stretch is None
        matrix = np.diag(omega**2) + sum(k * np.outer(row, row) for row, k in springs)
        squared, vectors = np.linalg.eigh(matrix)
        omega = np.sqrt(np.where(squared > 1e-9 * squared[-1] * 1e-6, squared, 0.0))
        sigma = np.zeros(omega.size)
        q, p, weight, pickup, shapes = (
            vectors.T @ q,
            vectors.T @ p,
            vectors.T @ weight,
            vectors.T @ pickup,
            shapes @ vectors,
        )
    rubbing = friction_points(layout)
    touching = [slot for slot in range(len(layout.islands.contact_points)) if slot not in rubbing]
    points = [layout.islands.contact_points[slot] for slot in touching]
    tables = [scene.contact[k] for k, _ in points]
    return Problem(
        title=scene.title or "",
        samplerate=float(samplerate),
        frames=round(scene.seconds * samplerate),
        omega=omega,
        sigma=sigma,
        weight=weight,
        q=q,
        p=p,
        shapes=shapes[touching],
        barrier=np.array([offset(table, point) for table, (_, point) in zip(tables, points, strict=True)]),
        stiffness=np.array([point.stiffness for _, point in points]),
        exponent=np.array([table.exponent for table in tables]),
        loss=np.array([table.loss for table in tables]),
        pickup=pickup,
        stretch=stretch,
        rubbed=shapes[list(rubbing)] if rubbing else None,
        friction=_friction(list(rubbing.values())) if rubbing else None,
    )


def _friction(tables: list[FrictionTable]) -> np.ndarray:
    """Return the numbers of points of friction [7, points]."""
    assert all(table.contact is None for table in tables), "surfaces of the ruler are pressed by a given force"
    return np.array([[getattr(table, name) for table in tables] for name in Friction._fields])


def _stretch(layout: Layout, scene: engine.Scene, modes: np.ndarray) -> np.ndarray | None:
    """Return the row √K·κ of each body that stretches; None if there are none."""
    rows = []
    for b, body in enumerate(scene.body):
        if (stretching := find_stretching(layout, body.name)) is not None:
            row = np.zeros(layout.modes.omega.size)
            row[layout.modes.of_body[b]] = np.sqrt(stretching.stiffness) * stretching.kappa
            rows.append(row[modes])
    return np.array(rows) if rows else None


def _spring(layout: Layout, connection: object) -> np.ndarray:
    """How the modes stretch a spring, 1/√kg."""
    sides = BodyPoint(connection.body, connection.at, 1.0), BodyPoint(connection.on, connection.on_at, -1.0)
    here, there = (layout.row(side).over_island(layout.modes.omega.size) for side in sides)
    return here + there
