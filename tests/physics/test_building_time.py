"""Scenes at the corners of what a patch may say: built within seconds, or refused at once with the limit."""

import time
from typing import Any

import pytest

import engine
from engine.assembly.build import build
from engine.faults import BuildError

SECONDS = 5.0  # of processor time
BOARD = {"kind": "soundboard", "size": [1.4, 0.9], "thickness": 8e-3}
RIBS = {"count": 64, "width": 0.02, "height": 0.42}
SHELL = {"kind": "shell", "radius": 0.18, "length": 0.15, "thickness": 3e-3, "young": 7e10, "density": 2700.0}
TUNED = {"kind": "string", "length": 0.62, "mass": 4e-3, "frequency": 261.6, "sigma0": 1e6}
END = {"kind": "end", "body": "string", "at": 1, "on": "body", "on_at": [0.3, 0.4], "one_way": True}


def build_body(body: dict[str, Any], **more: Any) -> Any:
    """Build a scene of a body and other tables, in time."""
    bodies = [{"name": "body"} | body, *more.pop("others", [])]
    scene = engine.load({"body": bodies, "pickup": [{"body": "body", "at": [0.3, 0.4]}]} | more)
    begin = time.process_time()
    try:
        return build(scene, 44_100)
    finally:
        assert time.process_time() - begin < SECONDS


@pytest.mark.hard_for("high ribs", "modes of a board", "modes of a board with ribs", "highest ribs")
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            SHELL | {"length": 1000.0},
            "needs .* functions of its height for each of 2 orders of its modes; at most 1128 ",
        ),
        (BOARD | {"ribs": RIBS}, "needs .* by .* functions for its modes; at most 400 of a side and 7368 in all, "),
        (BOARD | {"ribs": RIBS | {"height": 1.0}}, "needs .* functions for its modes; at most 400 of a side and 7368"),
        (BOARD | {"modes": 20_000}, "needs 87 by 103 functions for its modes; at most 400 of a side and 7368 in all, "),
        (BOARD | {"modes": 20_000, "ribs": RIBS | {"count": 12}}, "needs .* at most 400 of a side and 7368 in all, "),
    ],
    ids=["long shell", "high ribs", "highest ribs", "modes of a board", "modes of a board with ribs"],
)
def test_a_body_that_would_take_minutes_is_refused(body, message):
    with pytest.raises(BuildError, match=message + ".*or they take minutes: fewer modes"):
        build_body(body)


@pytest.mark.hard
@pytest.mark.parametrize(
    "body",
    [
        pytest.param(SHELL | {"length": 10.0}, marks=pytest.mark.hard, id="shell of ten metres"),
        pytest.param(
            BOARD | {"ribs": RIBS | {"count": 12}}, marks=pytest.mark.hard, id="ribs half as high as the board"
        ),
        pytest.param(SHELL | {"thickness": 1e-5}, id="shell of foil"),
    ],
)
def test_a_body_far_from_any_instrument_is_built_in_time(body):
    assert build_body(body).model.step.kick.size > 100


def test_a_string_that_stops_at_once_and_ends_on_a_board_is_refused():
    plate = {"kind": "plate", "size": [1.4, 0.9], "area_density": 7.0, "flexural_rigidity": 1000.0, "modes": 261}
    others = [{"name": "string"} | TUNED]
    with pytest.raises(BuildError, match=r"order 6 has steps back in time.*decay rates up to 6615 1/s"):
        build_body(plate, others=others, connection=[END], accuracy={"order": 6})
    build_body(plate, others=others, connection=[END], accuracy={"order": 2})
