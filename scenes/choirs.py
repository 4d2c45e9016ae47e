"""Strings on a board that moves."""

import math
from typing import Any

import numpy as np

BOARD_SIZE, BOARD_MASS, BOARD_RIGIDITY = (1.4, 0.9), 9.0, 500.0  # m, kg, N·m
LOSS_FACTOR = 0.02
BOARD_MODES = 261
CENTS = (0.0, 0.65, -0.7)  # of the strings of a choir


def board(points: dict[str, tuple[float, float]], modes: int = BOARD_MODES) -> dict[str, Any]:
    """A board of simply supported edges as a body of measured modes, with a loss factor: σ = η·ω/2."""
    a, b = BOARD_SIZE
    density = BOARD_MASS / (a * b)
    m, n = (grid.ravel() for grid in np.meshgrid(np.arange(1, 80), np.arange(1, 80)))
    omega = ((math.pi * m / a) ** 2 + (math.pi * n / b) ** 2) * math.sqrt(BOARD_RIGIDITY / density)
    order = np.argsort(omega)[:modes]
    m, n, omega = m[order], n[order], omega[order]
    shapes = {
        name: 2 / math.sqrt(BOARD_MASS) * np.sin(math.pi * m * x) * np.sin(math.pi * n * y)
        for name, (x, y) in points.items()
    }
    return {
        "name": "board",
        "kind": "modes",
        "frequency": (omega / (2 * math.pi)).tolist(),
        "sigma": (LOSS_FACTOR * omega / 2).tolist(),
        "points": {name: shape.tolist() for name, shape in shapes.items()},
    }


def string(name: str, cents: float = 0.0, **more: Any) -> dict[str, Any]:
    """A string of a grand piano's C4 (Chaigne & Askenfelt 1994)."""
    body = {"name": name, "kind": "string", "length": 0.62, "mass": 3.93e-3, "inharmonicity": 3.7702e-4}
    return body | {"frequency": 261.6256 * 2 ** (cents / 1200), "sigma0": 0.5, "b3": 6.25e-9} | more


def choir(strings: int = 3, **more: Any) -> dict[str, Any]:
    """Strings whose far end rides on one point of a board."""
    names = [f"string_{i}" for i in range(strings)]
    return {
        "body": [
            *(string(name, cents, modes=54) for name, cents in zip(names, CENTS, strict=False)),
            board({"bridge": (0.42, 0.37), "ear": (0.3, 0.6)}),
        ],
        "connection": [{"kind": "end", "body": name, "at": 1.0, "on": "board", "on_at": "bridge"} for name in names],
        "pickup": [{"body": "board", "at": "ear"}],
        **more,
    }


def struck_choir(strings: int = 3, **more: Any) -> dict[str, Any]:
    """The same, struck by one hammer."""
    scene = choir(strings, **more)
    scene["body"].append({"name": "hammer", "kind": "mass", "mass": 8.9e-3, "displacement": -1e-3, "velocity": 2.5})
    felt = {"body": "hammer", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5}
    scene["contact"] = [felt | {"on": f"string_{i}"} for i in range(strings)]
    return scene
