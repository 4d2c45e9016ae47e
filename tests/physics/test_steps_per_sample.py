"""However many steps a sample has, the motion is the same but for the square of their length: that of the constrained
system where bodies are joined rigidly, and of the continuous one where they collide."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy

import engine
from bench.ruler.loss import motion_error
from bench.ruler.problems import SAMPLERATE
from engine.assembly.build import build
from engine.assembly.stage_coefficients import motion_of_stages, solve_stages
from engine.patch.accuracy import STAGES

FRAMES = 1000
PUSHED = 40  # frames that the force acts, N
PULSE = {"kind": "pulse", "body": "a", "at": "away", "amplitude": 1.0, "duration": PUSHED / SAMPLERATE}
SUBSTEPS = [1, 2, 3, 4, 5, 6, 8, 16, 32, 64]
SHAPES = {"a": [[1.2, -0.8], [0.7, 1.1]], "b": [[0.9, 1.3], [-1.0, 0.6]]}  # at the joint, and away from it
FREQUENCIES = {"a": [180.0, 415.0], "b": [270.0, 690.0]}
JOINT = {"body": "a", "at": "joint", "on": "b", "on_at": "joint", "rigid": True}


def two_bodies(sigma=0.0, other_sigma=0.0, bodies=(), **keys):
    """Two bodies of two modes each, joined rigidly, that lose unequally; the first is pushed, the second is heard."""
    joined = [
        {
            "name": name,
            "kind": "modes",
            "frequency": FREQUENCIES[name],
            "sigma": [decay, decay],
            "points": dict(zip(("joint", "away"), SHAPES[name], strict=True)),
        }
        for name, decay in (("a", sigma), ("b", other_sigma))
    ]
    pickup = {"body": "b", "at": "away", "quantity": "displacement"}
    scene = {"body": [*joined, *bodies], "connection": [JOINT], "force": [PULSE], "pickup": [pickup]}
    return engine.Scene.model_validate(scene | keys)


def constrained_system(scene, sigma):
    """K, C, push and what is heard of y'' + C·y' + K·y = push·f with q = N·y, N what the joint leaves free."""
    _, _, layout = build(scene, SAMPLERATE, scene.accuracy)
    omega, free = layout.modes.omega, scipy.linalg.null_space(layout.points.coordinate_rows[0])
    k, c = (free.T @ np.diag(of) @ free for of in (omega**2, 2 * np.asarray(sigma)))
    return k, c, free.T @ [*SHAPES["a"][1], 0.0, 0.0], free.T @ [0.0, 0.0, *SHAPES["b"][1]]


def exact_motion(scene, sigma, damped_from=0, sigma_before=None):
    """Displacement at the pickup [FRAMES], m, by the exponential of the matrix of a sample.

    sigma: of each mode, from a frame on; sigma_before: before it
    """
    maps = []
    for decay in (sigma if sigma_before is None else sigma_before, sigma):
        k, c, push, heard = constrained_system(scene, decay)
        n = len(push)
        zero, unit = np.zeros((n, n)), np.eye(n)
        system = np.block([[zero, unit, zero[:, :1]], [-k, -c, push[:, None]], [np.zeros((1, 2 * n + 1))]])
        maps.append(scipy.linalg.expm(system / SAMPLERATE))
    y, audio = np.zeros(2 * n + 1), []
    for frame in range(FRAMES):
        audio.append(heard @ y[:n])
        y[-1] = 1.0 if frame < PUSHED else 0.0
        y = maps[frame >= damped_from] @ y
    return np.array(audio)


def errors_of(scene, wanted, settings):
    """The largest error of each rendering, share of the largest displacement."""
    errors = []
    for setting in settings:
        rendering = engine.render(scene, FRAMES / SAMPLERATE, kernel="general", **setting)
        assert rendering.stats.energy.error_max <= 1e-12
        errors.append(np.abs(rendering.audio[:, 0] - wanted).max() / np.abs(wanted).max())
    return np.array(errors)


# --- rigid joints


@pytest.mark.parametrize("scheme", ["exact", "fdh"])
@pytest.mark.parametrize("sigma", [1.0, 100.0, 1000.0])
def test_a_rigid_joint_of_unequal_losses_moves_as_the_constrained_system(sigma, scheme):
    """The error falls with the square of the step, at odd and even numbers of steps alike."""
    scene = two_bodies(sigma)
    wanted = exact_motion(scene, [sigma, sigma, 0.0, 0.0])
    errors = errors_of(scene, wanted, [{"scheme": scheme, "substeps": n} for n in SUBSTEPS])
    for (n, coarse), (m, fine) in pairwise(zip(SUBSTEPS, errors, strict=True)):
        assert fine <= 1.5 * coarse + 1e-11
        assert fine <= 1.1 * coarse * (n / m) ** 2 + 1e-11


@pytest.mark.hard
@pytest.mark.parametrize("sigma", [1.0, 100.0, 1000.0])
def test_errors_under_a_smooth_push_fall_with_the_square_of_the_step(sigma):
    """Under a half sine, whose mean over each step acts; within a factor of two."""
    seconds = 2e-3
    push = PULSE | {"kind": "half_sine", "duration": seconds}
    scene = two_bodies(sigma, force=[push])
    k, c, shape, heard = constrained_system(scene, [sigma, sigma, 0.0, 0.0])
    n = len(shape)

    def accelerate(t, y):
        return np.concatenate(
            [y[n:], -k @ y[:n] - c @ y[n:] + shape * (math.sin(math.pi * t / seconds) * (t < seconds))]
        )

    times, tight = np.arange(FRAMES) / SAMPLERATE, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    pushed = scipy.integrate.solve_ivp(accelerate, (0.0, seconds), np.zeros(2 * n), dense_output=True, **tight)
    free = scipy.integrate.solve_ivp(accelerate, (seconds, times[-1]), pushed.y[:, -1], dense_output=True, **tight)
    motion = np.where(times < seconds, pushed.sol(np.minimum(times, seconds)), free.sol(np.maximum(times, seconds)))
    errors = errors_of(scene, heard @ motion[:n], [{"substeps": n} for n in SUBSTEPS])
    steps = np.array(SUBSTEPS)
    assert (np.diff(errors) < 0.0).all()
    assert (errors[1:] * steps[1:] ** 2 <= 2.0 * errors[1] * steps[1] ** 2).all() and errors[1] < 0.5 * errors[0]
    assert errors.max() <= 5e-4


@pytest.mark.parametrize("sigma", [10.0, 100.0, 1000.0])
def test_a_damper_on_a_joined_body_acts_alike_at_any_number_of_steps(sigma):
    """It begins within a sample of its time: the error is below what a sample of its loss amounts to."""
    start = 128
    damp = {"kind": "damp", "time": start / SAMPLERATE, "body": "a", "sigma": sigma, "duration": 1.0}
    scene = two_bodies(event=[damp])
    wanted = exact_motion(scene, [sigma, sigma, 0.0, 0.0], start, np.zeros(4))
    settings = [{"substeps": n} for n in SUBSTEPS] + [{"order": 4, "substeps": n} for n in (1, 2, 3)]
    assert errors_of(scene, wanted, settings).max() <= sigma / SAMPLERATE


@pytest.mark.parametrize("order", [4, 6])
def test_a_rigid_joint_of_unequal_losses_moves_as_the_constrained_system_at_higher_orders(order):
    """The error falls with the square of the step, at odd and even numbers of steps alike."""
    scene = two_bodies(100.0)
    numbers = [1, 2, 3, 4, 8, 16]
    errors = errors_of(
        scene, exact_motion(scene, [100.0, 100.0, 0.0, 0.0]), [{"order": order, "substeps": n} for n in numbers]
    )
    assert errors[0] <= 1e-5
    np.testing.assert_allclose(errors * np.square(numbers), errors[0], rtol=0.05)


@pytest.mark.parametrize("order", [4, 6])
def test_the_stages_of_a_step_are_the_exact_damped_motion(order):
    """Modes all over the range, of a matrix exponential; loss takes energy in each stage."""
    omega = np.concatenate([[0.0], np.geomspace(1e-4, 3.1, 40)])
    for sigma in (1e-8, 1e-4, 0.02, 0.15):
        lost = np.full(omega.size, sigma)
        scale, share = solve_stages(omega, lost, 1.0, STAGES[order])
        assert np.all((share > 0.0) & (share < 1.0))
        turn = np.maximum(omega, 1e-7)
        a, b, d = motion_of_stages(turn, lost, STAGES[order], scale, share)
        wanted = np.array([scipy.linalg.expm(np.array([[0.0, w], [-w, -2 * sigma]])) for w in turn])
        np.testing.assert_allclose(np.transpose([[a, b], [-b, d]], (2, 0, 1)), wanted, rtol=0.0, atol=3e-12)


@pytest.mark.parametrize("order", [4, 6])
@pytest.mark.parametrize("sigma", [0.0, 100.0, 1000.0])
def test_orders_hold_through_a_smooth_contact_whatever_the_modes_lose(order, sigma):
    """A hammer of α = 3 on a body of two modes: the error falls with the fourth power, or the sixth without loss, until
    rounding is reached."""
    hammer = {"name": "hammer", "kind": "mass", "mass": 0.3, "displacement": -1e-5, "velocity": 1.0}
    felt = {"body": "hammer", "on": "a", "on_at": "away", "stiffness": 3e11, "exponent": 3.0}
    pickup = {"body": "a", "at": "away", "quantity": "displacement"}
    scene = two_bodies(sigma, bodies=[hammer], contact=[felt], connection=[], force=[], pickup=[pickup])
    settings = [{"order": order, "substeps": n} for n in (1, 2, 4)]
    wanted = engine.render(scene, FRAMES / SAMPLERATE, order=4, substeps=64, kernel="general").audio[:, 0]
    coarse, middle, fine = errors_of(scene, wanted, settings)
    power = 4 if order == 4 or sigma else 6
    assert coarse <= 1e-7 and middle <= 1.5 * coarse / 2**power + 1e-11 and fine <= 1.5 * middle / 2**power + 1e-11


@pytest.mark.hard
def test_a_hammer_on_joined_bodies_has_no_floor():
    """With loss at the ends of samples it had one, which fell with the square of the sample alone."""
    hammer = {"name": "hammer", "kind": "mass", "mass": 0.3, "displacement": -1e-5, "velocity": 1.0}
    felt = {"body": "hammer", "on": "a", "on_at": "away", "stiffness": 1e7, "exponent": 1.5}
    scene = two_bodies(1000.0, bodies=[hammer], contact=[felt], force=[])
    wanted = engine.render(scene, FRAMES / SAMPLERATE, samplerate=16 * SAMPLERATE, substeps=32, kernel="general")
    errors = errors_of(scene, wanted.audio[::16, 0], [{"substeps": n} for n in (1, 2, 4, 8, 16, 32, 64)])
    assert np.all(errors[2:] <= 0.35 * errors[1:-1])
    assert errors[-1] <= 1e-7


# --- collisions of bodies that lose


@pytest.mark.hard
def test_a_collision_of_a_body_that_loses_converges_to_the_continuous_motion():
    """A body of two modes thrown against a stop, against DOP853: a quarter of the error for twice the steps."""
    omega, sigma, shape = 2 * math.pi * np.array([150.0, 1100.0]), np.array([40.0, 400.0]), np.array([1.0, 0.7])
    body = {"name": "body", "kind": "modes", "frequency": [150.0, 1100.0], "sigma": [40.0, 400.0]}
    stop = {"body": "body", "at": "tip", "barrier": 2e-5, "stiffness": 1e11, "exponent": 2.0}
    scene = engine.Scene.model_validate(
        {
            "body": [body | {"points": {"tip": [1.0, 0.7]}}],
            "contact": [stop],
            "force": [PULSE | {"body": "body", "at": "tip", "amplitude": 100.0}],
            "pickup": [{"body": "body", "at": "tip", "quantity": "displacement"}],
        }
    )

    def accelerate(t, y, force):
        q, p = y[:2], y[2:]
        squeezed = max(0.0, shape @ q - 2e-5)
        return np.concatenate([p, -(omega**2) * q - 2 * sigma * p + shape * (force - 1e11 * squeezed**2)])

    times, y, heard = np.arange(FRAMES) / SAMPLERATE, np.zeros(4), [0.0]
    for begin, end in pairwise(times):
        force = 100.0 if begin < (PUSHED - 0.5) / SAMPLERATE else 0.0
        y = scipy.integrate.solve_ivp(
            accelerate, (begin, end), y, args=(force,), method="DOP853", rtol=1e-12, atol=1e-16
        ).y[:, -1]
        heard.append(shape @ y[:2])
    errors = errors_of(scene, np.array(heard), [{"substeps": n} for n in (4, 8, 16, 32, 64)])
    assert np.all(errors[1:] <= 0.3 * errors[:-1])
    assert errors[-1] <= 1e-6


@pytest.mark.hard_for("snare-limits5", "tanpura-limits6", "frets-limits4", "drum-limits2", "joined-limits3")
@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("hammer_c2", {(6, 16): 1e-11}),
        ("hammer_c4", {(2, 64): 8.5e-7, (2, 256): 5.5e-8, (2, 1024): 3.5e-9, (4, 64): 1e-9}),
        ("drum", {(2, 64): 2.5e-7, (2, 256): 1.5e-8, (2, 1024): 1e-9, (4, 64): 1e-9}),
        ("joined", {(4, 64): 1e-11}),
        ("frets", {(4, 1024): 1e-6}),
        ("snare", {(2, 64): 6e-4, (2, 1024): 6e-5}),
        ("tanpura", {(2, 1024): 1.2e-4, (4, 1024): 1e-6}),
    ],
)
def test_more_steps_come_nearer_to_the_certified_motion(name, limits):
    """Of modes that lose, at every order."""
    for (order, substeps), limit in limits.items():
        assert motion_error(name, order, substeps) <= limit
