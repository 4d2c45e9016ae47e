"""Random scenes of the kind that people make: hammers, balls and stops of everyday size."""

from typing import Any

import numpy as np

import engine


def random_collision(seed: int) -> engine.Scene:
    """A hammer on a string, an oscillator at a stop, a ball on a bar, or a string over frets; seconds: 0.1."""
    rng = np.random.default_rng(seed)
    parts = [_hammer, _stop, _ball, _frets][seed % 4](rng)
    return engine.Scene.model_validate({"seconds": 0.1} | parts)


def _law(rng: np.random.Generator, force: float, depth: float) -> dict[str, Any]:
    """A contact law that gives a force (N) at a depth (m), within a decade."""
    exponent = float(rng.choice([1.0, 1.3, 1.5, 2.0, 2.5, 3.0]))
    stiffness = force / depth**exponent * 10 ** rng.uniform(-1, 1)
    return {"stiffness": stiffness, "exponent": exponent, "loss": float(rng.choice([0.0, 0.02, 0.3]))}


def _string(rng: np.random.Generator, **more: Any) -> dict[str, Any]:
    pitch = float(10 ** rng.uniform(1.7, 3.2))
    string = {"name": "string", "kind": "string", "length": 0.7, "mass": float(10 ** rng.uniform(-3, -1.5))}
    loss = {"sigma0": float(rng.uniform(0.1, 3.0)), "b3": 1e-8}
    return string | {"frequency": pitch, "modes": int(rng.integers(8, 60)), "inharmonicity": 1e-4} | loss | more


def _hammer(rng: np.random.Generator) -> dict[str, Any]:
    hammer = {"name": "hammer", "kind": "mass", "mass": float(10 ** rng.uniform(-3, -2)), "displacement": -1e-3}
    contact = {"body": "hammer", "on": "string", "on_at": float(rng.uniform(0.07, 0.5))} | _law(rng, 10.0, 5e-4)
    bodies = [_string(rng), hammer | {"velocity": float(rng.uniform(0.5, 5.0))}]
    return {"body": bodies, "contact": [contact], "pickup": [{"body": "string", "at": 0.9, "quantity": "velocity"}]}


def _stop(rng: np.random.Generator) -> dict[str, Any]:
    reed = {"name": "reed", "kind": "oscillator", "mass": 1e-3, "frequency": float(10 ** rng.uniform(1.7, 3))}
    reed |= {"damping_rate": float(rng.uniform(0.0, 20.0)), "velocity": float(rng.uniform(0.3, 3.0))}
    stop = {"body": "reed", "barrier": float(rng.uniform(0.0, 3e-4))} | _law(rng, 5.0, 1e-4)
    return {"body": [reed], "contact": [stop], "pickup": [{"body": "reed", "quantity": "velocity"}]}


def _ball(rng: np.random.Generator) -> dict[str, Any]:
    bar = {"name": "bar", "kind": "bar", "length": 0.3, "mass": 0.05, "frequency": float(10 ** rng.uniform(2, 3.3))}
    bar |= {"sigma0": float(rng.uniform(1.0, 10.0)), "modes": int(rng.integers(2, 12))}
    ball = {"name": "ball", "kind": "mass", "mass": float(10 ** rng.uniform(-3, -1.5)), "displacement": 1e-4}
    contact = {"body": "ball", "on": "bar", "on_at": float(rng.uniform(0.1, 0.5)), "side": "below"}
    bodies = [bar, ball | {"velocity": -float(rng.uniform(0.5, 3.0))}]
    pickup = [{"body": "bar", "at": 0.43, "quantity": "velocity"}]
    return {"gravity": 9.81, "body": bodies, "contact": [contact | _law(rng, 30.0, 1e-4)], "pickup": pickup}


def _frets(rng: np.random.Generator) -> dict[str, Any]:
    shape = {"kind": "triangle", "at": float(rng.uniform(0.5, 0.9)), "amplitude": float(rng.uniform(1e-3, 4e-3))}
    frets = [
        {"body": "string", "at": at, "side": "below", "barrier": -8e-4} | _law(rng, 3.0, 1e-4) for at in (0.2, 0.35)
    ]
    string = _string(rng, displacement=shape, modes=int(rng.integers(8, 40)))
    return {"body": [string], "contact": frets, "pickup": [{"body": "string", "at": 0.9, "quantity": "velocity"}]}
