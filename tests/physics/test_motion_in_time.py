"""Where the motion depends on when something happens, or on how many steps a sample has: against the equation in
continuous time (tests/physics/modal_ode.py).

Strings that stretch and are joined to others, blows at any frame, numbers that glide and forces within a sample, and
bows that are pressed later.
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy

import engine
from engine.analysis.profile import profile_scene
from tests.live.two_ways import GAIN, make_player
from tests.physics.modal_ode import RATE, ModalOde, solve_pickups

NO_LIMITS = {"silence": -math.inf, "iterations": 200}


def render(scene: dict, frames: int, **accuracy: Any) -> engine.Rendering:
    """Render so many frames of a scene, with a trace."""
    return engine.render(
        engine.load(scene), seconds=frames / RATE, samplerate=RATE, trace=True, **(NO_LIMITS | accuracy)
    )


def displacement_at(*points: tuple[str, Any]) -> list[dict]:
    """Return a pickup for each point of a body, each with a channel of its own."""
    pickups = []
    for channel, (body, at) in enumerate(points, 1):
        pickup = {"body": body, "quantity": "displacement", "channel": channel}
        pickups.append(pickup if at is None else pickup | {"at": at})
    return pickups


def error_of(audio: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest error of any signal, as a share of the largest value of all [frames, signals]."""
    return float(np.abs(audio - reference).max() / np.abs(reference).max())


def count_reversals(rendering: engine.Rendering) -> int:
    """Count the steps in which a body is where it was, and its velocity has the other sign, to the last bit."""
    assert rendering.trace is not None
    x, v = rendering.trace["displacement"], rendering.trace["velocity"]
    is_reversed = (v[1:] == -v[:-1]) & (v[1:] != 0.0) & (x[1:] == x[:-1])
    return int(np.count_nonzero(is_reversed.any(axis=1)))


def assert_solved(rendering: engine.Rendering) -> None:
    """Assert that no step was turned back."""
    assert count_reversals(rendering) == 0
    assert rendering.stats.newton.unconverged == 0


# --- strings that stretch, joined to others


STRETCHING = {"least_detuning": 0.0}
MOTION_FRAMES, REVERSAL_FRAMES = 1323, 13_230  # 0.03 s and 0.3 s
JOINTS = ("oscillator", "plate", "modes", "two ends", "spring", "rigid")
REFINED = ({"substeps": 16}, {"order": 4, "substeps": 4}, {"order": 6, "substeps": 2})
FORMERLY_REVERSED = (9, 15, 26, 60, 66)  # seeds


def draw_joined_string(seed: int, joint: str, release: float = 2e-3) -> dict:
    """Draw a plucked string that stretches, and is joined to another body. release: of the pluck, s"""
    rng = np.random.default_rng([62, seed])

    def decade(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    length, frequency, density = float(rng.uniform(0.3, 1.2)), decade(1.8, 2.6), decade(-3.5, -2.0)
    tension, modes = (2.0 * length * frequency) ** 2 * density, int(rng.integers(5, 61))
    string = {"name": "string", "kind": "string", "length": length, "linear_density": density, "tension": tension}
    string |= {"axial_stiffness": tension * decade(1.0, 3.0), "sigma0": 0.5, "modes": modes, "residual": False}
    mass = length * density * decade(0.0, 2.0)

    def oscillator(name: str) -> dict:
        return {"name": name, "kind": "oscillator", "mass": mass, "frequency": decade(1.3, 2.6)}

    bodies, end, at = [string, oscillator("body")], {"kind": "end", "body": "string", "at": 1, "on": "body"}, None
    connections = [end]
    if joint == "plate":
        at = [0.6, 0.4]
        plate = {"size": [0.4, 0.3], "area_density": 3.0 * mass / 0.12, "frequency": decade(1.8, 2.4)}
        bodies[1] = {"name": "body", "kind": "plate", "modes": 40, "sigma0": 5.0, "residual": False} | plate
    elif joint == "soundboard":
        at = [0.6, 0.4]
        bodies[1] = {"name": "body", "kind": "soundboard", "size": [0.48, 0.36], "thickness": 2.8e-3, "modes": 40}
        bodies[1] |= {"residual": False}
    elif joint == "modes":
        at = "u"
        shape = (rng.uniform(-1.0, 1.0, 8) / math.sqrt(mass)).tolist()
        frequencies = sorted((10.0 ** rng.uniform(1.8, 3.5, 8)).tolist())
        bodies[1] = {"name": "body", "kind": "modes", "frequency": frequencies, "sigma": [3.0] * 8}
        bodies[1] |= {"points": {"u": shape}}
    elif joint == "two ends":
        bodies.append(oscillator("other"))
        connections.append({"kind": "end", "body": "string", "at": 0, "on": "other"})
    elif joint == "spring":
        connections = [{"kind": "spring", "body": "string", "at": 0.97, "on": "body", "stiffness": decade(3.0, 5.0)}]
    elif joint == "rigid":
        connections = [{"kind": "spring", "body": "string", "at": 0.3, "on": "body", "rigid": True}]
    if at is not None:
        end["on_at"] = at
    deflection = length * decade(-2.5, -1.7)
    pluck = {"kind": "pluck", "body": "string", "at": 0.2, "amplitude": tension * deflection / (0.16 * length)}
    pluck |= {"start": 0.001, "duration": 0.005, "release": release}
    pickups = displacement_at(("string", 0.9), ("body", at))
    return {"body": bodies, "connection": connections, "force": [pluck], "pickup": pickups}


def hard(value: Any) -> Any:
    """Return a case that is among the hard."""
    return pytest.param(value, marks=pytest.mark.hard)


def hard_beyond(kept: tuple[int, ...], count: int) -> list[Any]:
    """Return seeds, of which all but the kept ones are among the hard."""
    return [seed if seed in kept else hard(seed) for seed in range(count)]


@pytest.mark.slow_but_each(4)
@pytest.mark.hard
@pytest.mark.parametrize("seed", hard_beyond((1, 4, 5, *FORMERLY_REVERSED), 72))
def test_a_stretching_string_joined_to_a_body_moves_as_its_equation_says(seed):
    scene = draw_joined_string(seed, JOINTS[seed % len(JOINTS)])
    assert_solved(render(scene, REVERSAL_FRAMES))
    reference = solve_pickups(scene, MOTION_FRAMES)
    for settings in REFINED:
        rendering = render(scene, MOTION_FRAMES, **STRETCHING, **settings)
        assert_solved(rendering)
        assert error_of(rendering.audio, reference) <= 1e-3, settings


@pytest.mark.hard
@pytest.mark.parametrize("seed", hard_beyond((15,), 24))
def test_errors_of_a_joined_string_fall_with_the_square_of_the_substep(seed):
    """From an initial shape, so that nothing but the solve of each step matters."""
    scene = draw_joined_string(seed, JOINTS[seed % 5])  # no rigid joint, which would bend the shape
    length = scene["body"][0]["length"]
    scene["body"][0] |= {"displacement": {"kind": "mode", "number": 1, "amplitude": 0.005 * length}}
    scene, frames = scene | {"force": []}, MOTION_FRAMES // 3
    reference = solve_pickups(scene, frames)
    renderings = [render(scene, frames, **STRETCHING, substeps=n) for n in (4, 16, 64)]
    errors = [error_of(rendering.audio, reference) for rendering in renderings]
    assert errors[0] <= 3e-3 and all(fine <= max(coarse / 10.0, 1e-8) for coarse, fine in pairwise(errors)), errors


@pytest.mark.slow_but_each(3)
@pytest.mark.hard
@pytest.mark.parametrize("seed", range(24))
def test_a_string_released_at_once_moves_as_its_equation_says(seed):
    """A pluck without a release moves the highest modes too, so that its force has to be right within the sample."""
    scene = draw_joined_string(seed, JOINTS[seed % len(JOINTS)], release=0.0)
    reference = solve_pickups(scene, MOTION_FRAMES // 2)
    for substeps, most in ((16, 3e-3), (64, 1e-3)):
        rendering = render(scene, MOTION_FRAMES // 2, **STRETCHING, substeps=substeps)
        assert_solved(rendering)
        assert error_of(rendering.audio, reference) <= most, substeps


@pytest.mark.hard
@pytest.mark.parametrize("seed", range(6))
def test_a_stretching_string_on_a_soundboard_moves_as_with_many_steps(seed):
    scene = draw_joined_string(seed, "soundboard")
    assert_solved(render(scene, REVERSAL_FRAMES))
    reference = render(scene, MOTION_FRAMES, **STRETCHING, substeps=256)
    for settings in REFINED:
        assert error_of(render(scene, MOTION_FRAMES, **STRETCHING, **settings).audio, reference.audio) <= 1e-3


def touch_joined_string(seed: int, by: str) -> dict:
    """Draw a joined string that a hammer strikes, a bow rubs, or three frets stop."""
    scene = draw_joined_string(seed, JOINTS[seed % len(JOINTS)])
    rng = np.random.default_rng([63, seed])
    string, pluck = scene["body"][0], scene["force"][0]
    length, tension = string["length"], string["tension"]
    deflection = pluck["amplitude"] * 0.16 * length / tension
    exponent = float(rng.choice([1.5, 2.0, 2.5]))
    if by == "hammer":
        speed = math.pi / length * math.sqrt(tension / string["linear_density"]) * deflection
        mass = length * string["linear_density"] * float(10.0 ** rng.uniform(-0.5, 0.5))
        rate = 2.0 * math.pi * float(10.0 ** rng.uniform(2.2, 2.8))  # of the hammer on its felt, rad/s
        felt = {"stiffness": mass * rate**2 / (speed / rate) ** (exponent - 1.0), "exponent": exponent}
        felt |= {"body": "hammer", "on": "string", "on_at": 0.2, "side": "below"}
        felt["loss"] = float(rng.choice([0.0, 0.1])) / speed
        hammer = {"name": "hammer", "kind": "mass", "mass": mass, "velocity": -speed, "displacement": 1e-4}
        return scene | {"body": [*scene["body"], hammer], "contact": [felt], "force": []}
    if by == "bow":
        bow = {"body": "string", "at": 0.12, "velocity": float(rng.uniform(0.1, 0.4)), "memory": 2e-3, "dynamic": 0.4}
        bow |= {"force": tension * float(10.0 ** rng.uniform(-2.5, -1.5)), "speed": 0.3}
        return scene | {"friction": [bow | {"bristle": 300.0 * tension / length, "bristle_damping": 0.0}]}
    height = -0.4 * deflection
    frets = {"body": "string", "frets": {"at": [0.5, 0.6, 0.8], "height": height}, "exponent": exponent}
    frets["stiffness"] = 30.0 * tension / length / abs(height) ** (exponent - 1.0)
    down = pluck | {"amplitude": -pluck["amplitude"]}
    return scene | {"contact": [frets], "force": [down]}


@pytest.mark.slow_but_each(5)
@pytest.mark.hard
@pytest.mark.parametrize("seed", hard_beyond((9,), 24))
@pytest.mark.parametrize("by", ["hammer", "bow", "frets"])
def test_a_joined_string_that_is_touched_moves_as_its_equation_says(by, seed):
    scene = touch_joined_string(seed, by)
    assert_solved(render(scene, REVERSAL_FRAMES))
    frames = MOTION_FRAMES // 2
    reference = solve_pickups(scene, frames)
    rendering = render(scene, frames, **STRETCHING, substeps=16)
    assert_solved(rendering)
    assert error_of(rendering.audio, reference) <= 1e-3


def string_on_moving_end(axial_stiffness: float = 1e3, modes: int = 40, speed: float = 1.0) -> dict:
    """Return a string that stretches, at rest, one end of which is on a light oscillator that moves."""
    string = {"name": "string", "kind": "string", "length": 0.65, "linear_density": 3.8e-4, "tension": 73.0}
    string |= {"axial_stiffness": axial_stiffness, "modes": modes, "residual": False}
    body = {"name": "body", "kind": "oscillator", "mass": 0.02, "frequency": 80.0, "velocity": speed}
    end = {"kind": "end", "body": "string", "at": 1, "on": "body"}
    return {"body": [string, body], "connection": [end], "pickup": displacement_at(("string", 0.9), ("body", None))}


@pytest.mark.hard
def test_a_string_on_a_moving_end_is_never_turned_back():
    """At one step per sample too: the error falls with the square of the step."""
    scene, frames = string_on_moving_end(), RATE // 20
    reference = solve_pickups(scene, frames)
    for settings, most in (({}, 1e-2), ({"substeps": 2}, 3e-3), ({"substeps": 16}, 1e-4), ({"order": 4}, 1e-3)):
        rendering = render(scene, frames, **settings)
        assert_solved(rendering)
        assert error_of(rendering.audio, reference) <= most, settings


@pytest.mark.slow_but_each(4)
@pytest.mark.hard
@pytest.mark.parametrize("modes", [12, 16, 20, 40, 60])
@pytest.mark.parametrize("axial_stiffness", [1e3, 3e3, 1e4])
def test_a_string_of_many_modes_on_a_fast_end_is_never_turned_back(modes, axial_stiffness):
    scene, frames = string_on_moving_end(axial_stiffness, modes, speed=6.0), RATE * 15 // 1000
    reference = solve_pickups(scene, frames)
    for settings in ({}, {"substeps": 2}, {"substeps": 4}, {"substeps": 16}, {"order": 4}, {"order": 4, "substeps": 4}):
        rendering = render(scene, frames, **settings)
        assert_solved(rendering)
        if settings.get("substeps", 1) * settings.get("order", 2) >= 16:
            assert error_of(rendering.audio, reference) <= 1e-3, settings


# --- the same blow at any frame


BLOW_FRAMES, LATEST = 1500, 140
SAME = 1e-3  # of the peak: two sounds are the same
WAYS = ("half sine", "pluck", "pluck event", "spring", "end", "rigid", "bow", "lump", "hammer")
THINNED = (0, 1, 63, 64, 65, 100, 105)


def string_that_stretches(axial_stiffness: float = 1e4) -> dict:
    """Return a steel string of 8 modes, at rest."""
    string = {"name": "string", "kind": "string", "length": 0.65, "linear_density": 3.8e-4, "tension": 73.0}
    return string | {"axial_stiffness": axial_stiffness, "modes": 8, "residual": False}


def struck_at_frame(way: str, frame: int, amplitude: float = 5.0) -> dict:
    """Return a string that is struck from a frame on: by a force, or by a body that a force pushes or that flies."""
    time = frame / RATE
    blow = {"body": "string", "at": 0.2, "amplitude": amplitude, "duration": 0.002}
    scene = {"body": [string_that_stretches()], "pickup": displacement_at(("string", 0.31))}
    if way in ("half sine", "pluck"):
        return scene | {"force": [blow | {"kind": way.replace(" ", "_"), "start": time}]}
    if way == "pluck event":
        return scene | {"event": [blow | {"kind": "pluck", "time": time}]}
    mass = {"name": "other", "kind": "mass", "mass": 0.02}
    if way in ("lump", "hammer"):
        speed, felt = (4.0, 1e6) if way == "lump" else (8.0, 1e8)
        flying = {"name": "hammer", "velocity": -speed, "displacement": 3e-4 + speed * time}
        bodies = [*scene["body"], mass | flying]
        law = {"side": "below", "stiffness": felt, "exponent": 1.5}
        contacts = [law | {"body": "hammer", "on": "string", "on_at": 0.2}]
        if way == "lump":
            bodies.append({"name": "lump", "kind": "mass", "mass": 2e-3})
            contacts = [law | {"body": "lump", "on": "string", "on_at": 0.2, "gap": 1e-5}]
            contacts.append(law | {"body": "hammer", "on": "lump"})
        return scene | {"body": bodies, "contact": contacts}
    push = {"kind": "half_sine", "body": "other", "amplitude": 100.0, "start": time, "duration": 0.001}
    oscillator = mass | {"kind": "oscillator", "frequency": 80.0}
    if way == "end":
        end = {"kind": "end", "body": "string", "at": 1, "on": "other"}
        harder = push | {"amplitude": 200.0}
        return scene | {"body": [*scene["body"], oscillator], "connection": [end], "force": [harder]}
    joint, string = {"body": "string", "at": 0.2, "on": "other"}, string_that_stretches(1e5)
    if way == "bow":
        bow = joint | {"force": 30.0, "static": 1.0, "dynamic": 1.0, "bristle": 2e4, "bristle_damping": 0.0}
        return scene | {"body": [string, mass], "friction": [bow], "force": [push]}
    spring = joint | {"kind": "spring"} | ({"rigid": True} if way == "rigid" else {"stiffness": 2e5})
    other = oscillator if way == "rigid" else mass
    return scene | {"body": [string, other], "connection": [spring], "force": [push]}


def assert_same_at_frames(way: str, frames: tuple[int, ...] | range, **accuracy: Any) -> None:
    """Assert that a blow at any of these frames gives the sound of one at frame 0, later."""
    always = render(struck_at_frame(way, 0), BLOW_FRAMES, least_detuning=0.0, **accuracy).audio
    errors = {}
    for frame in frames:
        audio = render(struck_at_frame(way, frame), BLOW_FRAMES, **accuracy).audio
        errors[frame] = error_of(audio[frame:], always[: BLOW_FRAMES - frame])
    assert {frame: error for frame, error in errors.items() if error > SAME} == {}


@pytest.mark.hard_for("hammer", "rigid", "spring", "bow")
@pytest.mark.parametrize("way", WAYS)
def test_a_blow_gives_the_same_sound_at_any_frame(way):
    assert_same_at_frames(way, THINNED)


@pytest.mark.slow_but_each(5)
@pytest.mark.hard
@pytest.mark.parametrize(
    "settings", [{}, {"substeps": 4}, {"order": 4}, {"max_error": 1e-4, "max_substeps": 16}], ids=str
)
@pytest.mark.parametrize("way", WAYS)
def test_a_blow_gives_the_same_sound_at_all_frames(way, settings):
    if way == "bow" and "order" in settings:
        pytest.skip("friction has order 2")
    every = 20 if "max_error" in settings else 3 if settings else 1
    assert_same_at_frames(way, range(0, LATEST, every), **settings)


@pytest.mark.hard
@pytest.mark.parametrize("way", ["half sine", "end"])
def test_a_blow_moves_a_string_as_its_equation_says(way):
    for frame in (0, 64):
        scene = struck_at_frame(way, frame)
        reference = solve_pickups(scene, BLOW_FRAMES)
        assert error_of(render(scene, BLOW_FRAMES, substeps=16).audio, reference) <= SAME, frame


def test_a_string_that_is_struck_weakly_stays_linear():
    """Nothing near it could raise its partials by the least detuning: it costs what a linear string does."""
    scene = engine.load(struck_at_frame("half sine", 5000, amplitude=0.01))
    (of_string,) = profile_scene(scene, 0.5, RATE).stretching
    assert sum(end - begin for begin, end in of_string.intervals) < 2 * 64 / RATE
    (of_loud,) = profile_scene(engine.load(struck_at_frame("half sine", 5000)), 0.5, RATE).stretching
    assert of_loud.intervals[-1] == [pytest.approx(5000 / RATE, abs=0.004), pytest.approx(0.5, abs=0.004)]


# --- numbers that glide, and forces within a sample


SUBSTEPS = (1, 4, 16, 64)
EFFECT_FRAMES = 441
ROUNDING = 1e-9  # of errors: they fall no further
BEGIN, LENGTH = 60 / RATE, 200 / RATE  # s, of a glide
OFF_SAMPLE = 0.00123  # s
Tables = dict[str, list[dict]]


def change(table: str, **values: float) -> dict:
    """Return an event that changes numbers of the thing that all effects call `it`."""
    return {"kind": "change", "time": BEGIN, "duration": LENGTH, table: "it"} | values


def glide_of(table: str, start: dict, **values: float) -> Callable[[dict], Tables]:
    """Return an effect: a spring, a contact or friction whose numbers glide."""
    kind = {"kind": "spring"} if table == "connection" else {}
    return lambda on: {table: [{"name": "it"} | kind | on | start], "event": [change(table, **values)]}


def push_by(kind: str, **values: Any) -> Callable[[dict], Tables]:
    """Return an effect: a force."""
    return lambda on: {"force": [{"kind": kind, "amplitude": 5.0} | on | values]}


SPRING = {"stiffness": 5e3, "damping_coefficient": 0.1}
PRESSED = {"barrier": -2e-3, "stiffness": 2e4, "exponent": 1.0}  # always in contact
FELT = {"barrier": -2e-3, "stiffness": 2e5, "exponent": 1.5}
SLIDING = {"velocity": 3.0, "static": 0.5, "dynamic": 0.5, "bristle": 2e4, "bristle_damping": 0.0}
STUCK = SLIDING | {"force": 500.0, "velocity": 0.3, "static": 5.0, "dynamic": 5.0}
GLIDES = {
    "stiffness": glide_of("connection", SPRING, stiffness=3e4),
    "rest": glide_of("connection", {"stiffness": 2e4}, rest=1e-3),
    "damping": glide_of("connection", SPRING, damping_coefficient=3.0),
    "three of a spring": glide_of("connection", SPRING, stiffness=2e4, damping_coefficient=1.0, rest=-5e-4),
    "barrier": glide_of("contact", PRESSED, barrier=-3e-3),
    "barrier that is left": glide_of("contact", PRESSED | {"barrier": 2e-4}, barrier=-6e-4),
    "contact stiffness": glide_of("contact", PRESSED, stiffness=4e4),
    "exponent": glide_of("contact", FELT, exponent=1.8),
    "lossy contact": glide_of("contact", FELT | {"loss": 0.2}, stiffness=4e5, barrier=-1e-3),
    "bow force": glide_of("friction", SLIDING | {"force": 1e-6}, force=4.0),
    "bow velocity": glide_of("friction", STUCK, velocity=-0.3),
    "one after another": lambda on: {
        "connection": [{"name": "it", "kind": "spring", "stiffness": 5e3} | on],
        "event": [
            change("connection", stiffness=3e4),
            change("connection", stiffness=1e4, rest=5e-4) | {"time": BEGIN + LENGTH / 2},
        ],
    },
}
FORCES = {
    "sine": push_by("sine", frequency=300.0, start=OFF_SAMPLE, duration=0.006, fade=0.002, phase=0.5),
    "envelope": push_by("constant", envelope=[[0.0, 0.0], [0.002, 1.0], [0.006, -1.0]]),
    "half sine": push_by("half_sine", start=OFF_SAMPLE, duration=0.004),
    "short half sine": push_by("half_sine", amplitude=20.0, start=OFF_SAMPLE, duration=2e-4),
    "pluck": push_by("pluck", start=OFF_SAMPLE, duration=0.004, release=0.001),
    "sudden pluck": push_by("pluck", start=OFF_SAMPLE, duration=0.004),
    "pulse": push_by("pulse", start=OFF_SAMPLE, duration=0.00415),
    "pluck event": lambda on: {
        "event": [{"kind": "pluck", "time": BEGIN, "amplitude": 5.0, "duration": 0.00317, "release": 0.00051} | on]
    },
}
EFFECTS = GLIDES | FORCES
DAMPERS = {
    "for a while": {"kind": "damp", "time": BEGIN, "duration": LENGTH, "sigma": 300.0},
    "for good": {"kind": "damp", "time": BEGIN, "sigma": 80.0},
}

OSCILLATOR = {"name": "body", "kind": "oscillator", "mass": 0.01, "frequency": 220.0, "displacement": 1e-3}
CARRIER = {"name": "other", "kind": "oscillator", "mass": 0.02, "frequency": 130.0}
HEAVY_STRING = {"name": "body", "kind": "string", "length": 0.65, "linear_density": 0.03, "tension": 2400.0, "modes": 6}
HEAVY_STRING |= {"sigma0": 3.0, "displacement": {"kind": "mode", "number": 1, "amplitude": 1e-3}, "residual": False}
SHEET = {"name": "body", "kind": "plate", "size": [0.3, 0.2], "area_density": 0.6, "frequency": 180.0, "modes": 6}
SHEET |= {"displacement": {"kind": "mode", "number": 1, "amplitude": 1e-3}, "residual": False}
MEASURED = {"name": "body", "kind": "modes", "frequency": [190.0, 410.0, 900.0], "sigma": [2.0, 5.0, 9.0]}
MEASURED |= {"points": {"u": [8.0, -5.0, 4.0]}}
ON_CARRIER = {"body": "body", "on": "other"}
BODIES: dict[str, tuple[list[dict], list[dict], Any]] = {  # bodies, connections, position of the effect
    "oscillator": ([OSCILLATOR], [], None),
    "string": ([HEAVY_STRING], [], 0.3),
    "plate": ([SHEET], [], [0.4, 0.3]),
    "modes": ([MEASURED], [{"kind": "spring", "body": "body", "at": "u", "stiffness": 2e3, "rest": 5e-4}], "u"),
    "stretching": ([HEAVY_STRING | {"axial_stiffness": 1e7}], [], 0.3),
    "end": ([HEAVY_STRING, CARRIER], [{"kind": "end", "at": 1} | ON_CARRIER], 0.3),
    "stretching end": (
        [HEAVY_STRING | {"axial_stiffness": 1e7}, CARRIER],
        [{"kind": "end", "at": 1} | ON_CARRIER],
        0.3,
    ),
    "rigid": ([HEAVY_STRING, CARRIER | {"displacement": 0.0}], [{"kind": "spring", "at": 0.5, "rigid": True}], 0.3),
}
BODIES["rigid"] = (
    [HEAVY_STRING | {"displacement": {"kind": "mode", "number": 2, "amplitude": 1e-3}}, CARRIER],
    [{"kind": "spring", "at": 0.5, "rigid": True} | ON_CARRIER],  # where the second mode is at rest
    0.3,
)
OTHER_BODIES = [name for name in BODIES if name != "oscillator"]


def act_on(bodies: str, effect: Callable[[dict], Tables]) -> dict:
    """Return a scene of bodies on which an effect acts."""
    tables, connections, at = BODIES[bodies]
    on = {"body": "body"} if at is None else {"body": "body", "at": at}
    acting = effect(on)
    joints = [*connections, *acting.get("connection", [])]
    pickups = displacement_at(("body", at), *([("other", None)] if len(tables) > 1 else []))
    return {"body": tables, "pickup": pickups} | acting | ({"connection": joints} if joints else {})


def errors_of(scene: dict, reference: np.ndarray, order: int, substeps: tuple[int, ...]) -> list[float]:
    """Return the error at each number of substeps."""
    renderings = (render(scene, EFFECT_FRAMES, **STRETCHING, order=order, substeps=n) for n in substeps)
    return [error_of(rendering.audio, reference) for rendering in renderings]


def assert_falls(errors: list[float], least_ratio: float) -> None:
    """Assert that errors fall by a ratio from each number of substeps to the next, from the second on."""
    assert all(fine <= max(coarse / least_ratio, ROUNDING) for coarse, fine in pairwise(errors[1:])), errors
    assert errors[-1] <= errors[0] + ROUNDING, errors


def assert_converges(scene: dict) -> None:
    """Assert that errors fall with the square of the substep, and are no larger at higher orders."""
    reference = solve_pickups(scene, EFFECT_FRAMES, tolerance=1e-12)
    errors = errors_of(scene, reference, 2, SUBSTEPS)
    if any(force["kind"] == "pulse" for force in scene.get("force", [])):
        # by the square on the whole, but a jump may happen to fall on the edge of a step
        assert all(error <= 3.0 * errors[0] / n**2 for error, n in zip(errors, SUBSTEPS, strict=True)), errors
    else:
        assert_falls(errors, 10.0)
    if "friction" not in scene:
        for order in (4, 6):
            higher = errors_of(scene, reference, order, SUBSTEPS[:3])
            assert all(a <= 1.1 * b + ROUNDING for a, b in zip(higher, errors, strict=False)), (order, higher, errors)


@pytest.mark.hard_but("bow velocity", "bow force", "envelope", "pluck", "pulse", "short half sine")
@pytest.mark.parametrize("effect", EFFECTS)
def test_errors_of_glides_and_forces_fall_with_the_square_of_the_substep(effect):
    assert_converges(act_on("oscillator", EFFECTS[effect]))


@pytest.mark.slow_but_each(3)
@pytest.mark.hard
@pytest.mark.parametrize("bodies", OTHER_BODIES)
@pytest.mark.parametrize("effect", EFFECTS)
def test_errors_of_glides_and_forces_on_any_body_fall_with_the_square_of_the_substep(effect, bodies):
    assert_converges(act_on(bodies, EFFECTS[effect]))


@pytest.mark.hard
def test_a_pitch_that_glides_in_steps_of_its_tables_follows_the_glide():
    """It glides in equal ratios; its tables change each 5 ms, amid the time for which they hold."""
    begin, duration, low, high, frames = 882 / RATE, 0.05, 220.0, 250.0, 4410

    def slope(time: float, state: np.ndarray) -> tuple[float, float]:
        share = min(max((time - begin) / duration, 0.0), 1.0)
        return state[1], -((2.0 * math.pi * low * (high / low) ** share) ** 2) * state[0]

    times = np.arange(frames) / RATE
    reference = scipy.integrate.solve_ivp(
        slope, (0.0, times[-1]), (1e-3, 0.0), "DOP853", times, rtol=1e-10, atol=1e-14, max_step=1e-4
    )
    body = {"name": "body", "kind": "oscillator", "mass": 0.01, "frequency": low, "displacement": 1e-3}
    event = {"kind": "change", "time": begin, "parameter": "body.body.frequency", "value": high, "duration": duration}
    for settings in ({}, {"substeps": 4}, {"order": 4}):
        scene = {"body": [body], "event": [event], "pickup": displacement_at(("body", None))}
        assert error_of(render(scene, frames, **settings).audio[:, 0], reference.y[0]) <= 0.02


@pytest.mark.parametrize("bodies", ["oscillator", *(hard(b) for b in OTHER_BODIES)])
@pytest.mark.parametrize("damper", DAMPERS)
def test_errors_of_dampers_fall_with_the_substep(damper, bodies):
    events = {"event": [DAMPERS[damper] | {"body": "body"}]}
    scene = act_on(bodies, lambda _: events)
    reference = solve_pickups(scene, EFFECT_FRAMES, tolerance=1e-12)
    for order in (2, 4, 6):
        assert_falls(errors_of(scene, reference, order, SUBSTEPS), 3.5)


@pytest.mark.parametrize("effect", ["stiffness", "barrier", "bow force", "half sine"])
def test_steps_chosen_by_error_follow_glides_and_forces(effect):
    scene = act_on("oscillator", EFFECTS[effect])
    reference = solve_pickups(scene, EFFECT_FRAMES)
    assert error_of(render(scene, EFFECT_FRAMES, max_error=1e-5).audio, reference) <= 1e-4


@pytest.mark.hard
@pytest.mark.parametrize("bodies", ["oscillator", "end", *(hard(b) for b in BODIES if b not in ("oscillator", "end"))])
def test_without_glides_and_forces_errors_fall_with_the_square_of_the_substep(bodies):
    """Springs, dampers and contacts that stay as they are: the reference and the engine agree."""
    for table, start in (("connection", SPRING | {"rest": 5e-4}), ("contact", FELT), ("friction", STUCK)):
        constant = act_on(bodies, lambda on, table=table, start=start: glide_of(table, start)(on) | {"event": []})
        assert_converges(constant)


# --- pressed later


PRESS_FRAMES = 2205
BLOCK = {"name": "block", "kind": "oscillator", "mass": 0.01, "frequency": 200.0, "damping_rate": 20.0}
BOWED = {"name": "block", "kind": "string", "length": 0.325, "tension": 43.0, "linear_density": 1.18e-3, "modes": 30}
BOWED |= {"sigma0": 2.0, "b3": 1e-8, "residual": False}
MOVING = {"name": "other", "kind": "mass", "mass": 0.3, "velocity": 0.2}
ONE = {"substeps": 1}
FINER = (
    {"substeps": 2},
    {"substeps": 3},
    {"substeps": 16},
    {"max_error": 1e-2},
    {"max_error": 1e-3},
    {"max_error": 1e-5},
)


def press(time: float, **values: float) -> dict:
    """Return an event that changes the friction of a scene."""
    return {"kind": "change", "time": time, "friction": "rub"} | values


def rub(body: dict, events: list[dict], *others: dict, **friction: Any) -> dict:
    """Return a scene in which a surface rubs a body, pressed by nothing at first."""
    rubbing = {"name": "rub", "body": "block", "force": 0.0, "memory": 5e-4, "bristle": 1e5}
    rubbing |= {"bristle_damping": 0.0} | friction
    if "on" not in friction:
        rubbing = {"velocity": 0.2} | rubbing
    pickups = displacement_at(("block", 0.3 if body["kind"] == "string" else None))
    return {"body": [body, *others], "friction": [rubbing], "event": events, "pickup": pickups}


LATER = {
    "block": rub(BLOCK, [press(0.01, force=0.5)]),
    "string": rub(BOWED, [press(0.01, force=0.5, duration=0.02)], at=0.11),
    "second stroke": rub(BLOCK, [press(0.01, force=0.0), press(0.03, force=0.8)], force=0.5),
    "two bodies": rub(BLOCK, [press(0.01, force=0.5)], MOVING, on="other"),
    "constant coefficient": rub(BLOCK, [press(0.01, force=0.5)], static=0.4, dynamic=0.4, memory=0.0),
}


@cache
def press_as_equation_says(name: str) -> tuple[np.ndarray, float]:
    """Return the displacement of what is rubbed, m, and the largest friction, N."""
    ode = ModalOde(LATER[name])
    motion = ode.solve(np.arange(PRESS_FRAMES) / RATE, 1e-9)
    return motion.q @ ode.row("block", 0.3), float(np.abs(motion.friction).max())


@pytest.mark.hard_for("string-{'substeps': 2}", "string-{'substeps': 3}", "string-{'substeps': 16}")
@pytest.mark.parametrize("settings", FINER, ids=str)
@pytest.mark.parametrize("name", LATER)
def test_a_surface_that_is_pressed_later_rubs_at_any_number_of_steps(name, settings):
    displacement, friction = press_as_equation_says(name)
    rendering = render(LATER[name], PRESS_FRAMES, **settings)
    assert np.abs(rendering.trace["friction"]).max() == pytest.approx(friction, rel=0.03)
    assert error_of(rendering.audio[:, 0], displacement) <= 0.01


@pytest.mark.parametrize("settings", FINER, ids=str)
def test_what_a_contact_presses_later_rubs_at_any_number_of_steps(settings):
    weight = {"name": "weight", "kind": "mass", "mass": 0.2, "displacement": 0.01, "velocity": -1.0}
    ground = {"name": "ground", "body": "weight", "side": "below", "barrier": 0.0, "stiffness": 1e6}
    ground |= {"exponent": 1.5, "loss": 0.2}
    scene = rub(BLOCK, [], weight) | {"contact": [ground]}
    scene["friction"] = [{"name": "rub", "body": "block", "contact": "ground", "velocity": 0.2}]
    expected, found = (np.abs(render(scene, PRESS_FRAMES, **a).trace["friction"]).max() for a in (ONE, settings))
    assert found == pytest.approx(expected, rel=0.05) and found > 1.0


def bow_with_strokes() -> dict:
    """Return the bowed string of docs/friction.md: its strokes begin at 0, and after a lift."""
    string = {"name": "string", "kind": "string", "length": 0.325, "tension": 43.0, "linear_density": 1.18e-3}
    string |= {"decay": {"kind": "linear", "a": 1.0, "b": 5e-3}}
    strokes = [{"time": 0.0, "duration": 0.12}, {"time": 0.2, "duration": 0.2, "velocity": 0.4, "force": 1.0}]
    bow = {"name": "bow", "body": "string", "at": 0.11, "velocity": 0.25, "force": 0.6, "strokes": strokes}
    pickup = {"body": "string", "at": 0, "quantity": "end_force"}
    return {"seconds": 0.4, "body": [string], "bow": [bow], "pickup": [pickup]}


@pytest.mark.hard_for("{'max_error': 0.01}")
@pytest.mark.parametrize("settings", [{"substeps": 2}, {"max_error": 1e-2}], ids=str)
def test_each_stroke_of_a_bow_is_felt_at_any_number_of_steps(settings):
    scene, frames = bow_with_strokes(), RATE * 2 // 5
    one, more = (render(scene, frames, **accuracy) for accuracy in (ONE, settings))
    time = one.trace["time"]
    for begin, end in ((0.0, 0.15), (0.2, 0.4)):
        inside = (time >= begin) & (time < end)
        expected, found = (np.abs(rendering.trace["friction"][inside]).max() for rendering in (one, more))
        assert found == pytest.approx(expected, rel=0.15) and expected > 0.3  # 64 steps have 7 % less, too
    assert np.std(more.audio) == pytest.approx(np.std(one.audio), rel=0.25)


@pytest.mark.hard
def test_the_bowed_vibraphone_sounds_with_two_steps():
    one, two = (engine.render(engine.load("bowed_vibraphone"), seconds=0.5, trace=True, substeps=n) for n in (1, 2))
    tops = [np.abs(rendering.trace["friction"]).max() for rendering in (one, two)]
    assert tops[1] == pytest.approx(tops[0], rel=0.05) and tops[0] > 0.1
    assert np.std(two.audio) == pytest.approx(np.std(one.audio), rel=0.25)


@pytest.mark.parametrize("block", [64, 1000])
@pytest.mark.parametrize("settings", [{"substeps": 2}, {"max_error": 1e-3}], ids=str)
def test_a_force_that_is_set_live_rubs_at_any_number_of_steps(settings, block):
    sounds = []
    for accuracy in ({}, settings):
        scene = rub(BLOCK, []) | {"accuracy": NO_LIMITS | accuracy}
        player = make_player(engine.load(scene))
        audio = np.zeros((6000, player.channels), np.float32)
        for begin in range(0, len(audio), block):
            if begin <= 2000 < begin + block:
                player.set("friction.rub.force", 0.5)
            player.render_into(audio[begin : begin + block])
        sounds.append(audio.astype(float) / GAIN)
    assert sounds[0].any()
    assert np.std(sounds[1]) == pytest.approx(np.std(sounds[0]), rel=0.05, abs=0.0)
