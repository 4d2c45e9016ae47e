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


def keyboard(places: int = 12, **more: Any) -> dict[str, Any]:
    """The strings of a piano's 88 keys, one to three for each, that end on so many places of one board: 207 strings, of
    8 to 120 modes up to 9 kHz."""
    points = {f"place_{n}": (0.8 - 0.5 * (n + 0.5) / places, 0.1 + 0.7 * (n + 0.5) / places) for n in range(places)}
    strings, connections = [], []
    for key in range(88):
        frequency, length = 27.5 * 2 ** (key / 12), 0.09 * (1.95 / 0.09) ** (1 - key / 87)  # Hz, m
        stiffness = math.exp(np.interp(key, [0, 15, 39, 75, 87], np.log([3e-4, 8.9e-5, 2.9e-4, 6e-3, 1.5e-2])))
        partials = np.arange(1, 121)
        modes = int(np.sum(partials * frequency * np.sqrt(1 + stiffness * partials**2) < 9000.0))
        for n, cents in enumerate(CENTS[: 1 if key < 12 else 2 if key < 30 else 3]):
            name, mass = f"string_{key}_{n}", 750.0 / (4 * length * frequency**2)  # kg, of a tension of 750 N
            shape = {"length": length, "mass": mass, "inharmonicity": float(stiffness), "modes": max(modes, 8)}
            strings.append(string(name, **shape | {"frequency": frequency * 2 ** (cents / 1200)}))
            on = f"place_{key * places // 88}"
            connections.append({"kind": "end", "body": name, "at": 1.0, "on": "board", "on_at": on})
    ear = {"ear": (0.3, 0.6)}
    return {
        "body": [*strings, board(points | ear)],
        "connection": connections,
        "pickup": [{"body": "board", "at": "ear"}],
        **more,
    }
