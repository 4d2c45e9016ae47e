"""Pickups of the tension of a body: it rises with the square of the motion."""

import math

import numpy as np
import pytest

import engine

RATE = 44_100
LENGTH, DENSITY, TENSION, AXIAL = 0.65, 4e-4, 73.0, 1e4
KAPPA = (math.pi / LENGTH) ** 2 / DENSITY
PHI = math.sqrt(2 / (DENSITY * LENGTH))
STIFFNESS = AXIAL / (2 * LENGTH)

STRING = {"name": "string", "kind": "string", "length": LENGTH, "linear_density": DENSITY, "tension": TENSION}
STRING |= {"axial_stiffness": AXIAL, "modes": 1, "residual": False}
BEND = {"displacement": {"kind": "mode", "number": 1, "amplitude": 3e-3}}
HEARD = {"body": "string", "quantity": "tension"}


def render(body, *pickups, seconds=0.2, **more):
    scene = engine.Scene.model_validate({"body": [body], "pickup": list(pickups), **more})
    return engine.render(scene, seconds=seconds, samplerate=RATE)


def test_the_tension_rises_by_the_stretch_at_both_ends_of_a_step():
    """λ = ½K·(s + s⁺), s = κ·q² of one mode."""
    motion = {"body": "string", "at": 0.5, "quantity": "displacement", "channel": 2}
    rise, displacement = render(STRING | BEND, HEARD | {"gain": 2.0}, motion).audio.T
    stretch = STIFFNESS * KAPPA * (displacement / PHI) ** 2
    assert rise[1:] / 2 == pytest.approx((stretch[1:] + stretch[:-1]) / 2, rel=1e-9, abs=1e-12)
    assert rise[0] / 2 == pytest.approx(stretch[0])


@pytest.mark.hard
def test_only_the_string_that_is_heard_is_heard():
    """A louder string beside it, in the same subsystem and in another one, is not."""
    other = STRING | {"name": "other", "displacement": {"kind": "mode", "number": 1, "amplitude": 6e-3}}
    spring = {"kind": "spring", "body": "string", "at": 0.5, "on": "other", "on_at": 0.5, "stiffness": 1e-9}
    alone = render(STRING | BEND, HEARD).audio[:, 0]
    for bodies in ([STRING | BEND, other], [other, STRING | BEND]):
        for connections in ([], [spring]):
            scene = {"body": bodies, "pickup": [HEARD], "connection": connections}
            heard = engine.render(engine.Scene.model_validate(scene), seconds=0.2, samplerate=RATE).audio[:, 0]
            assert heard == pytest.approx(alone, abs=1e-6 * alone.max())


def test_a_stiff_string_has_phantom_partials_at_twice_its_frequencies():
    """Those of twice the frequency of a mode lie below the partials of twice its number."""
    bend = {"displacement": {"kind": "triangle", "at": 0.3, "amplitude": 1e-3}, "inharmonicity": 2e-3}
    motion = {"body": "string", "at": 0.13, "quantity": "displacement", "channel": 2}
    audio = render(STRING | bend | {"modes": 8}, HEARD, motion, seconds=3.0).audio
    spectra = np.abs(np.fft.rfft(audio * np.hanning(len(audio))[:, None], axis=0))
    frequencies = np.fft.rfftfreq(len(audio), 1 / RATE)

    def level(channel, frequency):
        return spectra[np.abs(frequencies - frequency) < 3.0, channel].max() / spectra[20:, channel].max()

    def partial(n):
        near = np.abs(frequencies - n * 164.5 * 2 * math.sqrt(1 + 2e-3 * n * n)) < 20
        return frequencies[near][np.argmax(spectra[near, 1])]

    for n in (2, 4):
        assert partial(2 * n) - 2 * partial(n) > 10
        assert level(0, 2 * partial(n)) > 100 * level(0, partial(2 * n))
        assert level(1, partial(2 * n)) > 100 * level(1, 2 * partial(n))


def test_the_tension_dies_away_without_a_click():
    """A string that is heard so stretches on, where another would be taken for linear; then it is silent."""
    rise = render(STRING | BEND | {"sigma0": 20.0}, HEARD, seconds=1.5).audio[:, 0]
    assert rise[-1] == 0.0
    end = np.flatnonzero(rise)[-1]
    assert np.max(rise[end - 500 :]) < 1e-6 * rise.max()


def test_the_tension_is_heard_through_contacts_and_stages():
    hammer = {"name": "hammer", "kind": "mass", "mass": 5e-3, "velocity": 5.0}
    strike = {"body": "hammer", "on": "string", "on_at": 0.31, "stiffness": 1e7, "exponent": 2.5}
    heard = []
    for accuracy in ({}, {"order": 4}, {"substeps": 4}):
        bodies = [STRING | {"modes": 20}, hammer]
        scene = {"body": bodies, "contact": [strike], "pickup": [HEARD], "accuracy": accuracy}
        heard.append(engine.render(engine.Scene.model_validate(scene), seconds=0.02, samplerate=RATE).audio[:, 0])
    first, *others = heard
    assert len(others) == 2 and first.max() > 0.0
    for other in others:
        assert np.max(np.abs(other - first)) < 0.1 * first.max()


def test_an_end_is_pulled_by_the_risen_tension():
    """F = (T + λ)·∂y/∂x at the end, of one mode."""
    force = {"body": "string", "at": 0, "quantity": "end_force"}
    motion = {"body": "string", "at": 0.5, "quantity": "displacement", "channel": 2}
    pull, displacement, rise = render(STRING | BEND, force, motion, HEARD | {"channel": 3}).audio.T
    assert rise.max() > 0.005 * TENSION
    assert pull == pytest.approx((TENSION + rise) * math.pi / LENGTH * displacement, rel=1e-9, abs=1e-9)


def test_what_carries_an_end_is_moved_by_the_force_that_is_heard_there():
    """m·a of a bridge is the force of the string on its end, also as the tension rises."""
    bridge = {"name": "bridge", "kind": "mass", "mass": 2e-3}
    end = {"kind": "end", "body": "string", "at": 1, "on": "bridge"}
    force = {"body": "string", "at": 1, "quantity": "end_force"}
    moved = {"body": "bridge", "quantity": "acceleration", "channel": 2}
    bend = {"displacement": {"kind": "mode", "number": 1, "amplitude": 2e-2}}
    string = STRING | bend | {"modes": 12, "residual": True}
    scene = {"body": [string, bridge], "connection": [end], "pickup": [force, moved], "accuracy": {"substeps": 8}}
    pull, acceleration = engine.render(engine.Scene.model_validate(scene), seconds=0.05, samplerate=RATE).audio.T
    linear = scene | {"body": [string | {"axial_stiffness": None}, bridge]}
    without = engine.render(engine.Scene.model_validate(linear), seconds=0.05, samplerate=RATE).audio[:, 0]
    assert np.max(np.abs(pull - without)) > 0.2 * np.max(np.abs(pull))
    mean = 0.5 * (pull[1:] + pull[:-1])
    assert 2e-3 * acceleration[1:] == pytest.approx(mean, abs=2e-3 * np.max(np.abs(pull)))


@pytest.mark.parametrize(
    ("body", "pickup", "message"),
    [
        (STRING | {"axial_stiffness": None}, HEARD, "does not stretch.*axial_stiffness or young"),
        (STRING, HEARD | {"at": 0.3}, "the same all over"),
        ({"name": "string", "kind": "mass", "mass": 1.0}, HEARD, "only strings, membranes and plates"),
    ],
)
def test_a_tension_that_cannot_be_heard_is_refused_with_a_reason(body, pickup, message):
    with pytest.raises(ValueError, match=message):
        engine.Scene.model_validate({"body": [body], "pickup": [pickup]})
