"""Random scenes in which everything acts together: strings, oscillators and masses of everyday size, joined by springs,
dampers, rigid joints and ends on a board, under weight and external forces, some heavily damped, with contacts between
them and with stops."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import engine
from bench.scenes.choirs import board

SECONDS = 0.03
EXPONENTS = 1.0, 1.3, 1.5, 2.0, 2.5, 3.0
ACCURACIES: Sequence[dict[str, Any]] = (  # two of three scenes have one step per sample, of either scheme
    *({}, {}, {}, {"scheme": "fdh"}),
    *({"substeps": 2}, {"substeps": 3}, {"order": 4}),
)


def random_joined_scene(seed: int, refined: bool | None = None) -> engine.Scene:
    """Return a scene of SECONDS. refined: whether a sample has several steps; either if None"""
    rng = np.random.default_rng(seed)
    choices = [a for a in ACCURACIES if refined is None or ("substeps" in a or "order" in a) == refined]
    accuracy = dict(choices[rng.integers(len(choices))])
    bodies = [_body(rng, n, "order" in accuracy) for n in range(rng.integers(2, 6))]
    connections = [_connection(rng, bodies, "order" in accuracy) for _ in range(rng.integers(0, 4))]
    if rng.random() < 0.4:
        bodies.append(board({"a": (0.3, 0.4), "b": (0.6, 0.2)}, modes=int(rng.integers(3, 30))))
        connections += [_end(rng, body) for body in bodies if body["kind"] == "string"]
    contacts = [_contact(rng, bodies, "order" in accuracy) for _ in range(rng.integers(1, 6))]
    name = bodies[0]["name"]
    pickups = [{"body": name, "at": 0.3} if bodies[0]["kind"] == "string" else {"body": name}]
    return engine.Scene.model_validate(
        {
            "seconds": SECONDS,
            "gravity": float(rng.choice([0.0, 9.81])),
            "accuracy": accuracy,
            "body": bodies,
            "connection": connections,
            "contact": contacts,
            "force": [_force(rng, bodies) for _ in range(rng.integers(0, 3))],
            "pickup": pickups,
        }
    )


def _body(rng: np.random.Generator, n: int, is_composed: bool) -> dict[str, Any]:
    kind = str(rng.choice(["string", "oscillator", "mass"], p=[0.45, 0.3, 0.25]))
    body: dict[str, Any] = {"name": f"b{n}", "kind": kind, "mass": float(10 ** rng.uniform(-3, -1))}
    if kind == "string":
        triangle = {"kind": "triangle", "at": 0.3, "amplitude": float(rng.uniform(1e-4, 2e-3))}
        pitch = {"length": 0.7, "frequency": float(10 ** rng.uniform(1.8, 3)), "modes": int(rng.integers(1, 40))}
        start = {"displacement": triangle} if rng.random() < 0.6 else {}
        return body | pitch | start | {"sigma0": float(rng.uniform(0.0, 3.0)), "inharmonicity": 1e-4}
    heavy = 10 ** rng.uniform(3, 3.8 if is_composed else 4.5)  # steps that go backwards have a limit
    body["damping_rate"] = float(rng.choice([0.0, 1.0, heavy], p=[0.4, 0.4, 0.2]))
    body |= {"displacement": -float(rng.uniform(0, 1e-3)), "velocity": float(rng.uniform(-0.5, 3.0))}
    return body | ({"frequency": float(10 ** rng.uniform(1, 3.5))} if kind == "oscillator" else {})


def _place(rng: np.random.Generator, body: dict[str, Any], key: str) -> dict[str, Any]:
    """Where something acts on a body."""
    if body["kind"] == "string":
        return {key: float(rng.uniform(0.08, 0.92))}
    return {key: str(rng.choice(["a", "b"]))} if body["kind"] == "modes" else {}


def _two(rng: np.random.Generator, bodies: list[dict[str, Any]]) -> tuple[dict[str, Any], dict[str, Any]]:
    first, second = rng.choice(len(bodies), 2, replace=False)
    return bodies[first], bodies[second]


def _connection(rng: np.random.Generator, bodies: list[dict[str, Any]], is_composed: bool) -> dict[str, Any]:
    """A spring, with a damper unless steps go backwards, between two bodies or a body and the ground."""
    first, second = _two(rng, bodies)
    joint = {"body": first["name"], "stiffness": float(10 ** rng.uniform(2, 6))} | _place(rng, first, "at")
    if rng.random() < 0.5 and not is_composed:
        joint["damping_coefficient"] = float(10 ** rng.uniform(-2, 1))
    return joint | ({"on": second["name"]} | _place(rng, second, "on_at") if rng.random() < 0.6 else {})


def _end(rng: np.random.Generator, string: dict[str, Any]) -> dict[str, Any]:
    place = str(rng.choice(["a", "b"]))
    return {"kind": "end", "body": string["name"], "at": 1.0, "on": "board", "on_at": place}


def _contact(rng: np.random.Generator, bodies: list[dict[str, Any]], is_composed: bool) -> dict[str, Any]:
    """A contact of about 5 N at half a millimetre, between two bodies or with a stop."""
    first, second = _two(rng, bodies)
    exponent = float(rng.choice(EXPONENTS))
    law = {"stiffness": 5.0 / 5e-4**exponent * 10 ** rng.uniform(-1, 2), "exponent": exponent}
    law["loss"] = float(rng.choice([0.0, 0.02] if is_composed else [0.0, 0.1, 1.0]))
    law |= {"side": str(rng.choice(["above", "below"]))} | _place(rng, first, "at")
    gap = float(rng.uniform(1e-4, 3e-3))
    if rng.random() < 0.6:
        return {"body": first["name"], "on": second["name"], "gap": gap} | law | _place(rng, second, "on_at")
    return {"body": first["name"], "barrier": gap if law["side"] == "above" else -gap} | law


def _force(rng: np.random.Generator, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    body = bodies[rng.integers(len(bodies))]
    kind = {"kind": str(rng.choice(["half_sine", "pulse"])), "duration": float(rng.uniform(1e-3, 2e-2))}
    return {"body": body["name"], "amplitude": float(rng.uniform(-5.0, 5.0))} | kind | _place(rng, body, "at")
