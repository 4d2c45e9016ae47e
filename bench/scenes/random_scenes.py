"""Random scenes over the whole documented ranges of a patch: half of the values within a quarter of the decades,
and some at the very ends. All of one order have the same effects and law, so that one kernel runs them."""

import numpy as np

import engine
from engine.bodies.string import MAX_TENSION
from engine.patch.tables import max_stiffness

RATE = 44_100


def within(rng: np.random.Generator, low: float, high: float, corners: float = 0.08) -> float:
    """A value whose exponent lies within a quarter of the range low to high, or one of its ends."""
    if rng.random() < corners:
        return float(rng.choice([low, high]))
    a, b = np.log10(low) / 4, np.log10(high) / 4
    return float(10 ** rng.uniform(a, b))


def signed(rng: np.random.Generator, low: float, high: float) -> float:
    """The same of either sign, or 0."""
    return 0.0 if rng.random() < 0.3 else float(rng.choice([-1.0, 1.0])) * within(rng, low, high)


def damped(rng: np.random.Generator, low: float, high: float) -> float:
    return 0.0 if rng.random() < 0.4 else within(rng, low, high)


def scene(seed: int, order: int = 2) -> engine.Scene:
    """Two to four bodies, up to five contacts."""
    rng = np.random.default_rng(seed)
    bodies = [_body(rng, i) for i in range(rng.integers(2, 5))]
    names = [b["name"] for b in bodies]
    contacts = [_contact(rng, bodies) for _ in range(rng.integers(1, 6))]
    spare = {"body": "x", "stiffness": 1.0, "exponent": 7.7}
    contacts += [spare | {"on": "y", "gap": 1e5}, spare | {"barrier": 1e5, "loss": 1.0}]
    bodies += [  # these call for every effect, in each scene
        {"name": "x", "kind": "mass", "mass": 1.0, "damping_rate": 1.0},
        {"name": "y", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "damping_rate": 1.0},
    ]
    forces = [{"kind": "half_sine", "body": "x", "amplitude": 1e-9, "duration": 1e-3}]
    if rng.random() < 0.5:
        name = rng.choice(names)
        at = {"at": 0.3} if next(b for b in bodies if b["name"] == name)["kind"] == "string" else {}
        forces.append({"kind": "pulse", "body": name, "amplitude": signed(rng, 1e-9, 1e6), "duration": 5e-3} | at)
    return engine.Scene.model_validate(
        {
            "gravity": float(rng.choice([0.0, 9.81, within(rng, 1e-4, 1e4), -within(rng, 1e-4, 1e4)])) or 1e-9,
            "accuracy": {"order": order, "scheme": str(rng.choice(["exact", "exact", "fdh"]))},
            "body": bodies,
            "contact": contacts,
            "force": forces,
            "pickup": [{"body": "x"}, {"body": "x", "quantity": "force"}],
        }
    )


def _body(rng: np.random.Generator, i: int) -> dict:
    kind = rng.choice(["mass", "oscillator", "string"], p=[0.45, 0.35, 0.2])
    if kind == "string":
        length, mass = within(rng, 1e-4, 1e4), within(rng, 1e-9, 1e9)
        highest = np.sqrt(0.99 * MAX_TENSION / (4 * length * mass))  # Hz
        return {
            "name": f"b{i}",
            "kind": "string",
            "length": length,
            "mass": mass,
            "frequency": float(min(10 ** rng.uniform(0, 4.2), highest)),
            "modes": int(rng.integers(1, 13)),
            "sigma0": damped(rng, 1e-6, 1e6),
        }
    body = {
        "name": f"b{i}",
        "kind": str(kind),
        "mass": within(rng, 1e-12, 1e9),
        "damping_rate": damped(rng, 1e-6, 1e6),
        "displacement": signed(rng, 1e-12, 1e3),
        "velocity": signed(rng, 1e-9, 1e4),
    }
    if kind == "oscillator":
        body["frequency"] = float(
            rng.choice([0.0, within(rng, 1e-6, 2e4), 10 ** rng.uniform(1, 4.3)], p=[0.1, 0.2, 0.7])
        )
    return body


def _contact(rng: np.random.Generator, bodies: list[dict]) -> dict:
    own, other = (bodies[int(n)] for n in rng.permutation(len(bodies))[:2])
    exponent = float(rng.choice([1.0, 1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 5.0, 12.0]))
    contact = {
        "body": own["name"],
        "side": str(rng.choice(["above", "below"])),
        "stiffness": within(rng, 1e-6, max_stiffness(exponent)),
        "exponent": exponent,
        "loss": damped(rng, 1e-9, 1e9),
    }
    if own["kind"] == "string":
        contact["at"] = float(rng.uniform(0.05, 0.95))
    if rng.random() < 0.5:
        contact |= {"on": other["name"], "gap": signed(rng, 1e-12, 1e6)}
        if other["kind"] == "string":
            contact["on_at"] = float(rng.uniform(0.05, 0.95))
    else:
        contact["barrier"] = signed(rng, 1e-12, 1e6)
    return contact
