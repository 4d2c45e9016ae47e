"""Errors of values that are out of range: they name the path once, and the range in plain words."""

import pytest

import engine
from engine.wording import describe_range

BALL = engine.load("bouncing_ball")


@pytest.mark.parametrize(
    ("do", "says"),
    [
        (lambda: BALL.replace("body.ball.mass", -1.0), "-1.0 is out of range; mass, kg, from 1e-12 to 1e9"),
        (lambda: BALL.replace("seconds", 1e9), "length of the sound, s, more than 0, at most 3600"),
        (lambda: BALL.replace("body.ball.mas", 1.0), 'there is no such value; did you mean "body.ball.mass"?'),
        (lambda: BALL.replace("contact.ball.stiffness", 1.0), "contact.ball.stiffness: there is no"),
        (lambda: engine.run_sweep(BALL, {"body.ball.mass": [-1.0, 1.0]}), "-1.0 is out of range; mass,"),
        (lambda: engine.render(BALL, order=3), "order = 3 is out of range; 2, 4 or 6"),
        (lambda: engine.render(BALL, substeps=0), "substeps = 0 is out of range; at least 1"),
        (lambda: engine.render(BALL, tolerance=2.0), "tolerance = 2.0 is out of range; "),
    ],
)
def test_an_error_names_its_path_once_in_plain_words(do, says):
    with pytest.raises(ValueError) as refused:
        do()
    text = str(refused.value)
    assert says in text
    assert not any(word in text for word in ("≥", "≤", "e+", "Input should"))
    path = text.removeprefix("scene").lstrip(": ").partition(":")[0].partition(" ")[0]
    assert text.replace(f'"{path}s"', "").count(path) == 1


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"ge": 1, "le": 12}, "from 1 to 12"),
        ({"gt": 0.0, "le": 1e51}, "more than 0, at most 1e51"),
        ({"ge": -1e-12}, "at least -1e-12"),
        ({"lt": 2.5e10}, "less than 2.5e10"),
        ({}, ""),
    ],
)
def test_ranges_in_words(limits, words):
    assert describe_range(**limits) == words
