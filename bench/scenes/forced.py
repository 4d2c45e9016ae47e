"""Random scenes that are driven and changed as they sound: strings and oscillators of everyday size under forces of all
kinds, with glides, dampers and strikes at times between two samples, contacts, and joints."""

from typing import Any

import numpy as np

import engine

SECONDS = 0.1
KINDS = "forces", "glides", "contacts", "joints"  # what a scene has in any case, by its seed

Tables = dict[str, list[dict[str, Any]]]


def random_forced_scene(seed: int) -> engine.Scene:
    """Return a scene of SECONDS with what KINDS says, and each of the others with even odds."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    tables: Tables = {
        "body": [_string(rng), _oscillator(rng)],
        "force": [],
        "event": [],
        "contact": [],
        "connection": [],
    }
    for name, add in (("joints", _join), ("contacts", _touch), ("forces", _push), ("glides", _change)):
        if name == kind or rng.random() < 0.5:
            add(rng, tables)
    at = float(rng.uniform(0.05, 0.95))
    quantity = str(rng.choice(["velocity", "displacement"]))
    pickup = [{"body": "string", "at": at, "quantity": quantity}, {"body": "reed", "quantity": quantity, "channel": 2}]
    return engine.Scene.model_validate({"seconds": SECONDS, "pickup": pickup[: 1 + seed % 2]} | tables)


def _decades(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _time(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.0, 0.4 * SECONDS))


def _string(rng: np.random.Generator) -> dict[str, Any]:
    string = {"name": "string", "kind": "string", "length": 0.65, "linear_density": _decades(rng, 3e-4, 5e-3)}
    string |= {"tension": _decades(rng, 30.0, 200.0), "modes": int(rng.integers(5, 40)), "residual": False}
    string |= {"sigma0": float(rng.uniform(0.1, 5.0)), "b3": 1e-8}
    shape = {"kind": "triangle", "at": float(rng.uniform(0.1, 0.5)), "amplitude": float(rng.uniform(2e-4, 2e-3))}
    return string | {"displacement": shape}


def _oscillator(rng: np.random.Generator) -> dict[str, Any]:
    reed = {
        "name": "reed",
        "kind": "oscillator",
        "mass": _decades(rng, 2e-3, 0.1),
        "velocity": _decades(rng, 0.03, 1.0),
    }
    return reed | {"frequency": _decades(rng, 60.0, 5000.0), "damping_rate": float(rng.uniform(0.0, 60.0))}


def _join(rng: np.random.Generator, tables: Tables) -> None:
    """The string ends on the oscillator, or a spring joins them."""
    if rng.random() < 0.5:
        tables["connection"].append({"kind": "end", "body": "string", "at": 1.0, "on": "reed"})
    else:
        spring = {"name": "spring", "kind": "spring", "body": "string", "at": 0.8, "on": "reed"}
        spring |= {"stiffness": _decades(rng, 1e3, 1e5), "damping_coefficient": float(rng.choice([0.0, 0.1]))}
        tables["connection"].append(spring)


def _touch(rng: np.random.Generator, tables: Tables) -> None:
    """A hammer strikes the string, or the oscillator hits a stop."""
    exponent, loss = float(rng.choice([1.0, 1.5, 2.0, 2.5, 3.0])), float(rng.choice([0.0, 0.0, 0.3]))
    law = {"stiffness": 10.0 * _decades(rng, 0.3, 3.0) / 5e-4**exponent, "exponent": exponent, "loss": loss}
    if rng.random() < 0.5:
        hammer = {"name": "hammer", "kind": "mass", "mass": _decades(rng, 1e-3, 1e-2), "displacement": -3e-3}
        tables["body"].append(hammer | {"velocity": float(rng.choice([0.0, 2.0]))})
        tables["contact"].append({"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12} | law)
        strike = {"kind": "strike", "time": _time(rng), "body": "hammer", "velocity": float(rng.uniform(0.5, 4.0))}
        tables["event"].append(strike)
    else:
        barrier = float(rng.uniform(0.0, 3e-4))
        tables["contact"].append({"name": "stop", "body": "reed", "barrier": barrier} | law)


def _push(rng: np.random.Generator, tables: Tables) -> None:
    """One or two forces of any kind."""
    for kind in rng.choice(["sine", "noise", "band", "half_sine", "pluck", "pulse", "ramp"], rng.integers(1, 3)):
        where = {"body": "reed"} if rng.random() < 0.5 else {"body": "string", "at": float(rng.uniform(0.1, 0.5))}
        force = where | {"amplitude": _decades(rng, 0.3, 5.0), "start": _time(rng)}
        fade = float(rng.choice([0.0, 5e-3]))
        if kind == "sine":
            force |= {"kind": "sine", "frequency": _decades(rng, 50.0, 10e3), "duration": 0.05, "fade": fade}
        elif kind in ("noise", "band"):
            force |= {"kind": "noise", "duration": 0.05, "fade": fade, "seed": int(rng.integers(1000))}
            force |= {"band": [100.0, _decades(rng, 500.0, 8e3)]} if kind == "band" else {}
        elif kind == "pluck":
            force |= {"kind": "pluck", "duration": _decades(rng, 1e-3, 0.02), "release": _decades(rng, 1e-4, 1e-3)}
        elif kind == "ramp":
            force |= {"kind": "constant", "envelope": [[0.0, 0.0], [_decades(rng, 1e-3, 0.03), 1.0], [0.05, 0.0]]}
        else:
            force |= {"kind": str(kind), "duration": _decades(rng, 3e-4, 5e-3)}
        tables["force"].append(force)


def _change(rng: np.random.Generator, tables: Tables) -> None:
    """A glide of what the scene has, or a damper."""
    change = {"kind": "change", "time": _time(rng), "duration": _decades(rng, 1e-3, 0.02)}
    springs = [one for one in tables["connection"] if "name" in one]
    stops = [one for one in tables["contact"] if "barrier" in one]
    tension = tables["body"][0]["tension"] * float(rng.uniform(1.02, 1.2))
    targets: list[dict[str, Any]] = [{"parameter": "body.string.tension", "value": tension}]
    targets += [{"connection": spring["name"], "stiffness": 2.0 * spring["stiffness"]} for spring in springs]
    targets += [{"contact": stop["name"], "barrier": stop["barrier"] - 2e-4} for stop in stops]
    changes = [change | target for target in targets]
    damp = {"kind": "damp", "time": _time(rng), "body": "reed", "sigma": _decades(rng, 10.0, 500.0)}
    choices = [*changes, damp]
    tables["event"] += [choices[n] for n in {int(n) for n in rng.integers(len(choices), size=2)}]
