"""Synthetic scenes of any size: banks of free modes, hammered strings, tanpuras."""

import math
from typing import Any

import engine

EFFECTS = ("loss", "gravity", "force", "contact", "contact loss", "events")
NOTHING = 1e-300  # as a strength: there, and without any effect


def with_effects(strength: dict[str, float]) -> engine.Scene:
    """A string, a hammer that flies at it and a reed, with the named effects at 1, or at another share of
    their strength."""
    # a residual mode comes with a contact and has a loss: the string would be another
    string = {"name": "string", "kind": "string", "length": 0.62, "mass": 4e-3, "tension": 670.0, "modes": 12}
    string["residual"] = False
    parts: dict[str, Any] = {
        "seconds": 100.0,
        "body": [
            string,
            {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 2.0},
            {"name": "reed", "kind": "oscillator", "mass": 1e-3, "frequency": 90.0, "displacement": 1e-3},
        ],
        "pickup": [{"body": "string", "at": 0.4}, {"body": "hammer", "channel": 2}, {"body": "reed", "channel": 3}],
    }
    if "loss" in strength:
        parts["body"][0]["sigma0"] = 5.0 * strength["loss"]
    if "gravity" in strength:
        parts["gravity"] = 9.81 * strength["gravity"]
    if "force" in strength:
        amplitude = 3.0 * strength["force"]
        parts["force"] = [{"body": "string", "at": 0.3, "kind": "pluck", "amplitude": amplitude, "duration": 0.004}]
    if "contact" in strength:
        felt = {"stiffness": 4e9 * strength["contact"], "exponent": 2.5}
        felt["loss"] = 0.3 * strength.get("contact loss", 0.0)
        parts["contact"] = [{"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12} | felt]
    if "events" in strength:
        when = 0.02 if strength["events"] == 1.0 else 99.0
        parts["event"] = [{"kind": "strike", "time": when, "body": "reed", "velocity": 1.0}]
    return engine.Scene.model_validate(parts)


def bank(modes: int) -> engine.Scene:
    """Free modes with loss, all of which are heard."""
    frequency = [50.0 + 19_950.0 * i / modes for i in range(modes)]
    ear = [math.sin(i + 1.0) for i in range(modes)]
    body = {"name": "bank", "kind": "modes", "frequency": frequency, "sigma": [1.0] * modes, "points": {"ear": ear}}
    return engine.Scene.model_validate({"body": [body], "pickup": [{"body": "bank", "at": "ear"}]})


def hammered(strings: int, modes: int, tension: float = 670.0) -> engine.Scene:
    """Piano strings (C4 of Chaigne & Askenfelt), each struck by a felt hammer of its own at once; a slacker one, in N,
    has more modes below Nyquist, and is then without stiffness."""
    parts: dict[str, list[Any]] = {"body": [], "contact": [], "pickup": []}
    for i in range(strings):
        string, hammer = f"string{i}", f"hammer{i}"
        material = {"length": 0.62, "mass": 3.93e-3, "tension": tension}
        material["inharmonicity"] = 3.77e-4 if tension == 670.0 else 0.0
        loss = {"sigma0": 0.5, "b3": 6.25e-9}
        parts["body"] += [
            {"name": string, "kind": "string", "modes": modes} | material | loss,
            {"name": hammer, "kind": "mass", "mass": 2.97e-3, "displacement": -1e-3, "velocity": 4.0},
        ]
        felt = {"stiffness": 4.5e9, "exponent": 2.5}
        parts["contact"].append({"body": hammer, "on": string, "on_at": 0.12} | felt)
        parts["pickup"].append({"body": string, "at": 0.9})
    return engine.Scene.model_validate(parts)


def tanpuras(strings: int, points: int, exponent: float = 1.0, stiffness: float = 4.39e8) -> engine.Scene:
    """Plucked tanpura strings of 80 modes (van Walstijn, Bridges & Mehes, DAFx-16), each on a bridge."""
    parts: dict[str, list[Any]] = {"body": [], "contact": [], "force": [], "pickup": []}
    for i in range(strings):
        string = f"string{i}"
        material = {"length": 1.0, "linear_density": 4.83e-4, "tension": 33.1, "bending_stiffness": 6.03e-5}
        loss = {"sigma0": 0.6, "sigma_beta": 6.5e-3, "sigma_beta3": 5e-6}
        parts["body"].append({"name": string, "kind": "string", "modes": 80} | material | loss)
        bridge = {"at": 0.01, "width": 2e-3, "points": points, "depth": 1e-5}
        law = {"stiffness": stiffness, "exponent": exponent}
        parts["contact"].append({"body": string, "bridge": bridge, "side": "below"} | law)
        parts["force"].append({"body": string, "at": 0.37, "kind": "pluck", "amplitude": -0.4, "duration": 0.05})
        parts["pickup"].append({"body": string, "at": 0.05})
    return engine.Scene.model_validate(parts)


def colliding(masses: int) -> engine.Scene:
    """Oscillators in pairs, each of which rattles against the other."""
    parts: dict[str, list[Any]] = {"body": [], "contact": [], "pickup": []}
    for i in range(0, masses, 2):
        a, b = f"m{i}", f"m{i + 1}"
        kind = {"kind": "oscillator", "mass": 1e-3}
        parts["body"] += [
            {"name": a, "frequency": 200.0 + i % 300, "displacement": -1e-3} | kind,
            {"name": b, "frequency": 310.0 + i % 300, "displacement": 1e-3} | kind,
        ]
        parts["contact"].append({"body": a, "on": b, "gap": 1e-4, "stiffness": 1e7, "exponent": 1.5})
    parts["pickup"].append({"body": "m0"})
    return engine.Scene.model_validate(parts)
