"""Strings in two directions: ends that follow a share of what carries them, and strings with two polarisations."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

import engine
from bench.recordings.decay import median_decays, partial_decays
from bench.recordings.keys import key_frequency, key_number
from bench.recordings.partials import read_partials
from bench.recordings.patches import strike_once
from bench.scenes.choirs import choir

C4 = {"kind": "string", "length": 0.62, "mass": 3.93e-3, "inharmonicity": 3e-4, "sigma0": 0.5, "b3": 6e-9}
BOARD = {"name": "board", "kind": "plate", "size": [0.8, 0.5], "frequency": 70.0, "area_density": 4.0, "modes": 40}
BOARD |= {"decay": {"kind": "loss_factor", "eta": 0.02}}
HAMMER = {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 2.0}
FELT = {"body": "hammer", "on": "s", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5}
HEARD = {"body": "board", "at": [0.45, 0.55], "quantity": "velocity"}
BENT = {"kind": "triangle", "at": 0.2, "amplitude": 3e-3}
EXACT = 1e-11  # of the largest value: rounding


def string(name="s", **more):
    return {"name": name, "frequency": 261.6, **C4, **more}


def end(body="s", **more):
    return {"kind": "end", "body": body, "at": 1.0, "on": "board", "on_at": [0.3, 0.4], **more}


def pluck(body, amplitude, **more):
    return {"kind": "pluck", "body": body, "at": 0.2, "amplitude": amplitude, "duration": 2e-3, **more}


def rendered(pickups, seconds=0.2, **parts):
    pickups = [{"channel": n + 1, **pickup} for n, pickup in enumerate(pickups)]
    result = engine.render(engine.Scene.model_validate({"pickup": pickups, **parts}), seconds)
    assert result.stats.energy.error_max <= 1e-13
    return result.audio


def assert_same(one, other):
    assert np.abs(one - other).max(axis=0) == pytest.approx(0.0, abs=EXACT * float(np.abs(other).max()))


# --- shares


def test_an_end_without_a_share_is_fixed():
    parts = {"body": [string(displacement=BENT, axial_stiffness=1e4), BOARD]}
    ears = [{"body": "s", "at": 0.3}, {"body": "s", "at": 1.0, "quantity": "end_force"}]
    fixed = rendered(ears, **parts)
    assert np.array_equal(rendered(ears, **parts, connection=[end(share=0.0)]), fixed)
    nearly = rendered(ears, **parts, connection=[end(share=1e-5)])
    assert 0.0 < np.abs(nearly - fixed).max() < 1e-8 * np.abs(fixed).max()


@pytest.mark.parametrize("axial", [0.0, 1e4])
def test_a_share_is_a_lever_to_the_body(axial):
    """An end that follows x·y on a mass m is as one that follows y on a mass m/x²; at both ends of a string."""
    shares = (0.5, -0.7)

    def scene(levers):
        bodies, ends = [string(displacement=BENT, axial_stiffness=axial, modes=60)], []
        for n, (share, x) in enumerate(zip(shares, levers, strict=True)):
            scale = (x / share) ** 2
            bridge = {"kind": "oscillator", "mass": 0.02 * scale, "stiffness": 2e4 * scale}
            bodies.append({"name": f"bridge_{n}", **bridge, "damping_rate": 2.0})
            ends.append({"kind": "end", "body": "s", "at": float(n), "on": f"bridge_{n}", "share": x})
        return {"body": bodies, "connection": ends}

    ears = [{"body": "s", "at": 0.3}, {"body": "s", "at": 1.0, "quantity": "end_force", "gain": 1e-2}]
    assert_same(rendered(ears, **scene(shares)), rendered(ears, **scene((1.0, 1.0))))


def test_a_string_that_drives_one_way_pushes_with_its_share():
    parts = {"body": [string(displacement=BENT), BOARD]}
    whole = rendered([HEARD], **parts, connection=[end(one_way=True)])
    assert_same(rendered([HEARD], **parts, connection=[end(one_way=True, share=-0.25)]), -0.25 * whole)


# --- two polarisations

ANGLE, CENTS, PLUCKED = 0.5, 3.0, 0.7  # rad, cents, rad
SECOND = 261.6 * 2 ** (CENTS / 1200)
SHARES = {"s": math.cos(ANGLE), "t": math.sin(ANGLE)}
TWO = {"polarisations": 2, "polarisation_detuning": CENTS, "polarisation_angle": ANGLE}


@pytest.mark.parametrize(
    ("modes", "ends", "frequency"),
    [
        ({}, [{}], None),
        ({"modes": 20}, [{}], 270.0),
        ({"modes": 20}, [{}, {"at": 0.0, "on_at": [0.6, 0.7], "share": -0.5}], None),
        ({}, [{"one_way": True}], None),
    ],
)
def test_two_polarisations_are_two_strings_that_share_a_bridge(modes, ends, frequency):
    """A hammer strikes the first, and a finger plucks both at an angle; their pitch glides together."""
    glide = {"kind": "change", "time": 0.05, "duration": 0.02, "parameter": "body.s.frequency", "value": frequency}
    ratio = SECOND / 261.6
    one = rendered(
        [HEARD, {"body": "s", "at": 0.3, "angle": math.pi / 2}, {"body": "s", "at": 1.0, "quantity": "end_force"}],
        body=[string(**modes, **TWO), BOARD, HAMMER],
        contact=[FELT],
        connection=[end(**keys) for keys in ends],
        force=[pluck("s", 5.0, angle=PLUCKED)],
        event=[glide] if frequency else [],
    )
    forces = [{"body": b, "at": 1.0, "quantity": "end_force", "gain": x, "channel": 3} for b, x in SHARES.items()]
    two = rendered(
        [HEARD, {"body": "t", "at": 0.3}, *forces],
        body=[string(**modes), string("t", **modes | {"frequency": SECOND}), BOARD, HAMMER],
        contact=[FELT],
        connection=[end(b, **keys | {"share": x * keys.get("share", 1.0)}) for b, x in SHARES.items() for keys in ends],
        force=[pluck("s", 5.0 * math.cos(PLUCKED)), pluck("t", 5.0 * math.sin(PLUCKED))],
        event=[glide, glide | {"parameter": "body.t.frequency", "value": ratio * frequency}] if frequency else [],
    )
    for channel in range(3):
        assert_same(one[:, channel], two[:, channel])
    assert np.abs(one[:, 1]).max() > 0.1  # m/s: the second polarisation moves


def test_a_string_moves_alike_in_all_directions():
    """Also where it stretches: both polarisations have one tension."""
    parts = {"body": [string(polarisations=2, axial_stiffness=2e4)]}
    first = rendered([{"body": "s", "at": 0.3}], **parts, force=[pluck("s", 20.0)])
    ears = [{"body": "s", "at": 0.3, "angle": PLUCKED + turn} for turn in (0.0, math.pi / 2)]
    turned = rendered(ears, **parts, force=[pluck("s", 20.0, angle=PLUCKED)])
    assert_same(turned[:, 0], first[:, 0])
    assert np.abs(turned[:, 1]).max() < EXACT * np.abs(first).max()
    linear = {"body": [string(polarisations=2)]}
    assert np.abs(rendered([ears[0]], **linear, force=[pluck("s", 20.0)]) - first).max() > 0.1 * np.abs(first).max()


@pytest.mark.parametrize("accuracy", [{}, {"order": 4}, {"substeps": 3}])
def test_energy_is_exact_where_two_polarisations_stretch(accuracy):
    """Struck and plucked, on a board, with a damper that falls."""
    scene = engine.Scene.model_validate(
        {
            "body": [string(**TWO, axial_stiffness=2e4, modes=40), BOARD, HAMMER],
            "connection": [end(share=-0.8)],
            "contact": [FELT | {"loss": 0.1}],
            "force": [pluck("s", 20.0, angle=PLUCKED, start=0.02)],
            "event": [{"kind": "damp", "time": 0.1, "duration": 0.05, "body": "s", "sigma": 30.0}],
            "pickup": [HEARD],
        }
    )
    stats = engine.render(scene, 0.2, **accuracy).stats
    assert stats.energy.error_max <= 1e-13 and stats.newton.solve_outcomes.failed == 0


def test_a_first_shape_is_one_of_the_first_polarisation():
    ears = [{"body": "s", "at": 0.3, "angle": angle} for angle in (0.0, math.pi / 2)]
    for kind in (BENT, {"kind": "mode", "number": 3, "amplitude": 1e-3}):
        plane = rendered(ears[:1], body=[string(displacement=kind)])
        both = rendered(ears, body=[string(displacement=kind, polarisations=2)])
        assert_same(both[:, :1], plane)
        assert np.abs(both[:, 1]).max() < EXACT * np.abs(plane).max()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"body": [string(polarisations=3)]}, "less than or equal to 2"),
        ({"body": [string(polarisation_angle=0.5)]}, "it has one polarisation; give polarisations = 2"),
        ({"body": [string(polarisation_detuning=1.0)]}, "it has one polarisation; give polarisations = 2"),
        ({"force": [pluck("s", 1.0, angle=0.5)]}, "moves in one direction; leave out the angle, or give the string"),
        ({"event": [pluck("s", 1.0, angle=0.5, time=0.1)]}, "moves in one direction"),
        ({"pickup": [HEARD | {"angle": 0.5}]}, "only a string can move in two"),
        ({"pickup": [{"body": "s", "at": 1, "quantity": "end_force", "angle": 0.5}]}, "end_force and angle are both"),
        ({"connection": [end(share=1.5)]}, "less than or equal to 1"),
    ],
)
def test_directions_that_there_are_not_are_refused_with_a_reason(changed, message):
    scene = {"body": [string()], "pickup": [{"body": "s", "at": 0.3}]} | changed
    if "board" in str(changed):
        scene["body"] = [*scene["body"], BOARD]
    with pytest.raises(ValidationError, match=message):
        engine.Scene.model_validate(scene)


# --- two rates of decay


def late_decay(**more):
    """Late decay of the first partial of a string on a piano's board, dB/s."""
    scene = choir(1, seconds=6.0)
    scene["body"][0] |= more
    scene["force"] = [{"kind": "half_sine", "body": "string_0", "at": 0.12, "amplitude": 10.0, "duration": 2e-3}]
    audio = engine.render(engine.Scene.model_validate(scene)).audio
    return partial_decays(audio, 44_100, read_partials(audio, 44_100, 261.6256))[0, 1]


@pytest.mark.hard
def test_one_string_dies_away_twice_if_it_turns():
    """At one pitch it does not turn, and the bridge never gets what it does not take at first."""
    plane = late_decay()
    assert late_decay(**TWO) > 0.5 * plane
    assert late_decay(**TWO | {"polarisation_detuning": 0.0}) == pytest.approx(plane, rel=1e-3)


@pytest.mark.hard
def test_a_grand_piano_dies_away_as_recorded_ones():
    """Early over late decay of C4, the mean of three velocities; recorded are 3.4 to 4.6."""
    ratios = []
    for velocity in (4, 10, 16):
        result = engine.render(strike_once(engine.load("grand_c4"), velocity), 10.0)
        partials = read_partials(result.audio, 44_100, key_frequency(key_number("C4")))
        early, late = median_decays(result.audio, 44_100, partials)
        ratios.append(early / late)
        assert result.stats.energy.error_max <= 1e-13
    assert 3.4 <= np.mean(ratios) <= 4.6
