"""Hammers on strings that are joined to a board: a step that looks only at contacts that are near does what one does
that looks at all."""

from typing import Any

import numpy as np
import pytest

import engine
from bench.scenes.choirs import board, string

STRINGS = 12
SILENT = {"kind": "pluck", "body": "string_0", "at": 0.2, "amplitude": 1e-30, "duration": 1e-3}  # then all is looked at


def keyboard(seed: int, **more: Any) -> dict[str, Any]:
    """Strings on a board, each with a hammer before it that comes sooner or later, slowly or fast, or not at all; and
    weights on springs beneath the board, which it may reach."""
    chance = np.random.default_rng(seed)
    points = {f"place_{i}": (0.15 + 0.06 * i, 0.3 + 0.03 * i) for i in range(STRINGS)}
    bodies: list[dict[str, Any]] = [board(points | {"ear": (0.3, 0.6)}, modes=40)]
    contacts, connections = [], []
    for i in range(STRINGS):
        gap, speed = 10 ** chance.uniform(-5, -1.3), chance.choice([0.0, 0.3, 1.0, 4.0])
        bodies.append(string(f"string_{i}", cents=100.0 * i, modes=12))
        bodies.append(
            {"name": f"hammer_{i}", "kind": "oscillator", "mass": 8e-3, "frequency": 5.0, "velocity": speed}
            | ({"displacement": -gap} if i % 3 else {})
        )
        bodies.append({"name": f"weight_{i}", "kind": "oscillator", "mass": 0.02, "frequency": 30.0})
        connections.append({"kind": "end", "body": f"string_{i}", "at": 1.0, "on": "board", "on_at": f"place_{i}"})
        felt = {"stiffness": 4.5e8, "exponent": 2.5, "loss": 0.3} if i % 2 else {"stiffness": 1e7, "exponent": 1.5}
        contacts.append({"body": f"hammer_{i}", "on": f"string_{i}", "on_at": 0.12, "gap": gap * (i % 3 == 0)} | felt)
        contacts.append(
            {"body": f"weight_{i}", "on": "board", "on_at": f"place_{i}", "gap": 10 ** chance.uniform(-7, -2)}
            | {"stiffness": 1e7, "exponent": 1.5}
        )
    pickups = [{"body": "board", "at": "ear"}, {"body": "hammer_1", "channel": 2}, {"body": "string_5", "at": 0.3}]
    return {"body": bodies, "contact": contacts, "connection": connections, "pickup": pickups, **more}


def rendered(document: dict[str, Any], seconds: float = 0.03) -> engine.Rendering:
    """With its trace."""
    return engine.render(engine.Scene.model_validate(document), seconds, trace=True)


@pytest.mark.parametrize("seed", range(3))
def test_contacts_that_are_left_out_would_not_have_closed(seed):
    near, all_of_them = rendered(keyboard(seed)), rendered(keyboard(seed, force=[SILENT]))
    assert np.count_nonzero(all_of_them.trace["force"].max(axis=0)) > STRINGS // 2
    for name in ("compression", "force", "displacement", "velocity"):
        a, b = near.trace[name], all_of_them.trace[name]
        assert np.abs(a - b).max() <= 1e-9 * np.abs(b).max(), name
    assert np.array_equal(near.trace["force"] > 0.0, all_of_them.trace["force"] > 0.0)
    assert near.stats.energy.error_max <= 1e-12


@pytest.mark.hard
@pytest.mark.parametrize("seed", range(3, 40))
def test_many_keyboards(seed):
    test_contacts_that_are_left_out_would_not_have_closed(seed)


def test_events_meet_contacts_that_were_left_out():
    """A hammer is thrown, a gap closes and a stiffness falls while other hammers touch."""
    events = [
        {"kind": "strike", "time": 2e-3, "body": "hammer_4", "displacement": -1e-3, "velocity": 3.0},
        {"kind": "change", "time": 4e-3, "contact": "felt", "gap": -2e-4, "duration": 1e-3},
        {"kind": "change", "time": 9e-3, "contact": "felt", "stiffness": 1e6, "duration": 0.0},
        {"kind": "damp", "time": 6e-3, "body": "string_2", "sigma": 50.0, "duration": 4e-3},
    ]
    document = keyboard(7, event=events)
    document["contact"][14]["name"] = "felt"
    near, all_of_them = rendered(document), rendered(document | {"force": [SILENT]})
    assert np.abs(near.trace["force"] - all_of_them.trace["force"]).max() <= 1e-8 * all_of_them.trace["force"].max()
    assert near.stats.energy.error_max <= 1e-12


def test_blocks_of_any_size_give_the_same_keyboard():
    scene = engine.Scene.model_validate(keyboard(1))
    from engine.assembly.build import build
    from engine.offline.simulation import Simulation

    outputs = []
    for size in (2000, 37):
        model, state, _ = build(scene, 44_100)
        simulation, out = Simulation(model, state), np.zeros((2000, scene.channels))
        for begin in range(0, 2000, size):
            simulation.render_block(out[begin : begin + size])
        outputs.append(out)
    assert outputs[0].tobytes() == outputs[1].tobytes()
