"""The references of the ruler: their digests, their energies, and the two methods that they are made by."""

import json
import math

import numpy as np
import pytest
import scipy

from bench.ruler import reference
from bench.ruler.contact_ruler.problem import Friction, Problem, energy_of, read_problem, stretching_force
from bench.ruler.make_references import DIGESTS, FOLDER, MAX_DIFFERENCE, digest_arrays
from bench.ruler.problems import NAMES, as_problem, ruler_scene
from bench.ruler.taylor import solve_by_series

SAMPLERATE = 44_100.0
LOSSLESS = ("barrier", "repelled_oscillator", "bouncing_ball", "walls", "stretching_string", "joined")
CHEAP = ("repelled_oscillator", "lossy_bounce")
LONGER = (
    "barrier",
    "bouncing_ball",
    "walls",
    "hammer_c2",
    "hammer_c4",
    "stretching_string",
    "bowed_string",
    "joined",
    "drum",
)
# the solvers refuse to run without; x86, and so CI, has them
needs_extended_precision = pytest.mark.skipif(np.finfo(np.longdouble).eps > 2e-19, reason="needs 80-bit numbers")


def one_mode(**changes):
    """A unit mass at rest at 0 below a barrier at 0."""
    values = {
        "title": "one mode",
        "samplerate": SAMPLERATE,
        "frames": 400,
        "omega": 0.0,
        "sigma": 0.0,
        "weight": 0.0,
        "q": 0.0,
        "p": 0.0,
        "shapes": [[1.0]],
        "barrier": 0.0,
        "stiffness": 1e6,
        "exponent": 1.0,
        "loss": 0.0,
        "pickup": 1.0,
    } | changes
    arrays = {k: np.atleast_1d(v) for k, v in values.items() if k not in ("title", "samplerate", "frames")}
    return Problem(**(values | arrays))


def displacements(problem):
    """What the two methods make of a problem."""
    return reference.solve(problem).displacement, solve_by_series(problem)[0]


@pytest.mark.parametrize("name", NAMES)
def test_the_digest_is_that_of_the_arrays(name):
    row, (problem, known) = json.loads(DIGESTS.read_text())[name], read_problem(FOLDER / f"{name}.npz")
    assert row["sha256"] == digest_arrays(problem, known)
    assert row["horizon"] == known.horizon > 0
    assert known.agreement == row["agreement"] <= MAX_DIFFERENCE
    assert known.other_agreement == row["other_agreement"] <= MAX_DIFFERENCE
    assert len(known.displacement) == len(known.energy) == problem.frames + 1 == len(known.force) + 1


@pytest.mark.parametrize("name", NAMES)
def test_the_problem_is_that_of_the_scene(name):
    problem, made = read_problem(FOLDER / f"{name}.npz")[0], as_problem(ruler_scene(name))
    for field in ("samplerate", "frames", "title"):
        assert getattr(problem, field) == getattr(made, field)
    for field in ("omega", "sigma", "q", "p", "barrier", "stiffness", "exponent", "loss"):
        a, b = np.abs(getattr(problem, field)), np.abs(getattr(made, field))  # a mode may have either sign
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(a).max(initial=0)), field
    assert (problem.stretch is None) == (made.stretch is None) == (name != "stretching_string")
    if problem.stretch is not None:
        assert np.allclose(problem.stretch, made.stretch, rtol=1e-9)
    assert (problem.friction is None) == (made.friction is None) == (name != "bowed_string")
    if problem.friction is not None:
        assert np.array_equal(problem.friction, made.friction)
        assert np.allclose(np.abs(problem.rubbed), np.abs(made.rubbed), rtol=1e-9, atol=1e-9)


def test_all_references_are_small():
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 2e6


@pytest.mark.parametrize("name", LOSSLESS)
def test_energy_is_constant_without_loss(name):
    _, known = read_problem(FOLDER / f"{name}.npz")
    assert np.abs(known.energy / known.energy[0] - 1).max() < 1e-14


@pytest.mark.parametrize("name", [n for n in NAMES if n not in (*LOSSLESS, "bowed_string")])
def test_energy_never_grows_with_loss(name):
    _, known = read_problem(FOLDER / f"{name}.npz")
    assert np.diff(known.energy).max() < 1e-14 * known.energy[0]
    assert known.energy[-1] < known.energy[0]


def test_a_bow_supplies_all_energy_that_its_string_gains():
    problem, known = read_problem(FOLDER / "bowed_string.npz")
    supplied = -Friction(*problem.friction).velocity[0] * known.force / problem.samplerate
    gained = np.diff(known.energy)
    assert np.max(gained - supplied) < 1e-14 * known.energy[0]
    assert gained.max() > 1e-3 * known.energy[0]  # while it sticks
    assert np.sum(gained - supplied) < -known.energy[0]  # heat


@pytest.mark.hard
@needs_extended_precision
def test_an_oscillator_on_a_spring_moves_by_sines():
    omega, stiffness, speed = 2000.0, 3e7, 0.7
    t = np.arange(401).astype(np.longdouble) / SAMPLERATE
    high = np.sqrt(np.longdouble(omega) ** 2 + stiffness)
    pi = 4 * np.arctan(np.longdouble(1))
    away, pressed = pi / omega, pi / high
    turn = t % (away + pressed)
    exact = np.where(turn < away, -np.sin(omega * turn) / omega, np.sin(high * (turn - away)) / high) * speed
    motions = list(displacements(one_mode(omega=omega, p=-speed, stiffness=stiffness)))
    assert motions
    for found in motions:
        assert np.abs(found - exact).max() < 1e-16 * np.abs(exact).max()


@pytest.mark.hard
@needs_extended_precision
def test_a_mass_falls_on_a_spring_by_parabolas_and_sines():
    stiffness, weight, height = np.longdouble(1e6), np.longdouble(9.81), np.longdouble(1e-4)
    t = np.arange(401).astype(np.longdouble) / SAMPLERATE
    fall, speed, omega = np.sqrt(2 * height / weight), np.sqrt(2 * height * weight), np.sqrt(stiffness)
    pressed = 2 * (np.pi - np.arctan(speed * omega / weight)) / omega
    depth = weight / stiffness * (1 - np.cos(omega * (t - fall))) + speed / omega * np.sin(omega * (t - fall))
    after = t - fall - pressed
    exact = np.where(t < fall, -height + weight * t * t / 2, np.where(after < 0, depth, 0))
    exact = np.where(after > 0, weight * after * after / 2 - speed * after, exact)
    motions = list(displacements(one_mode(weight=float(weight), q=-float(height), stiffness=float(stiffness))))
    assert motions
    for found in motions:
        assert np.abs(found - exact).max() < 3e-16 * float(height)


@pytest.mark.hard_for("2.5", "3.0", "1.3", "1.5", "2.0")
@needs_extended_precision
@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5, 2.0, 2.5, 3.0])
def test_contact_takes_as_long_as_the_beta_function_says(exponent):
    speed, stiffness = 2.0, 1e6
    deepest = (0.5 * (exponent + 1) * speed**2 / stiffness) ** (1 / (exponent + 1))
    duration = 2 * deepest / speed * scipy.special.beta(1 / (exponent + 1), 0.5) / (exponent + 1)
    frames = math.ceil((duration + 2e-3) * SAMPLERATE)
    problem = one_mode(q=-1e-3, p=speed, stiffness=stiffness, exponent=exponent, frames=frames)
    solution = reference.solve(problem)
    (begin, _, _), (end, _, _) = solution.events
    assert begin == pytest.approx(5e-4, rel=1e-14)
    assert end - begin == pytest.approx(duration, rel=1e-13)
    assert np.sum(solution.force) / SAMPLERATE == pytest.approx(2 * speed, rel=1e-15)
    end_of_run = -speed * (frames / SAMPLERATE - 5e-4 - duration)
    for found in (solution.displacement[-1], solve_by_series(problem)[0][-1]):
        assert float(found) == pytest.approx(end_of_run, rel=1e-11)


@pytest.mark.hard
@needs_extended_precision
def test_a_contact_that_leaves_fast_has_no_force():
    problem = one_mode(omega=3000.0, q=1e-3, p=-1.0, barrier=0.0, stiffness=1e7, exponent=1.5, loss=1.5)
    solution = reference.solve(problem)
    assert reference.SLACK in [status for _, _, status in solution.events]
    assert solution.force.min() >= 0.0
    found, _, events = solve_by_series(problem)
    assert events == len(solution.events)
    assert np.abs(found - solution.displacement).max() < 1e-14 * np.abs(found).max()


@pytest.mark.hard
@needs_extended_precision
def test_touching_without_pressing_is_seen():
    inside = one_mode(omega=1000.0, q=-1e-3 * (1 + 1e-9), barrier=1e-3, exponent=1.5, stiffness=1e9)
    outside = inside._replace(q=inside.q * (1 - 2e-9))
    assert len(reference.solve(inside).events) == solve_by_series(inside)[2] > 0
    assert len(reference.solve(outside).events) == solve_by_series(outside)[2] == 0


@pytest.mark.hard
@needs_extended_precision
def test_a_mode_that_stretches_moves_by_the_elliptic_cosine():
    """q'' = -ω²q - k²q³ from rest at A: A·cn(Ωt, m), Ω² = ω² + k²A², m = k²A²/(2Ω²)."""
    omega, far, k = 2000.0, 1.5e-3, 2e6
    problem = one_mode(omega=omega, q=far, barrier=1.0, stretch=[[k]])
    squared = omega**2 + (k * far) ** 2
    t = np.arange(401) / SAMPLERATE
    exact = far * scipy.special.ellipj(np.sqrt(squared) * t, (k * far) ** 2 / (2 * squared))[1]
    motions = list(displacements(problem))
    assert motions
    for motion in motions:
        assert np.abs(motion - exact).max() < 3e-14 * far  # of SciPy, which is in double precision


@pytest.mark.hard
@needs_extended_precision
def test_both_methods_agree_from_the_start_of_the_stroke_on():
    problem, known = read_problem(FOLDER / "stretching_string.npz")
    by_collocation, by_series = displacements(problem._replace(frames=60))
    peak = np.abs(known.displacement).max()
    assert known.force[:60].max() > 1.0  # N: the hammer presses
    assert np.abs(by_collocation - by_series).max() < 1e-15 * peak
    assert np.abs(by_collocation - known.displacement[:61]).max() < 1e-15 * peak


def test_the_force_of_a_stretch_is_the_slope_of_its_energy():
    problem, _ = read_problem(FOLDER / "stretching_string.npz")
    rng = np.random.default_rng(1)
    q, aside = 1e-5 * rng.standard_normal((2, problem.omega.size))
    linear = problem._replace(stretch=None, stiffness=0 * problem.stiffness)
    problem = problem._replace(stiffness=linear.stiffness)

    def stored(state):
        return energy_of(problem, state, 0 * state) - energy_of(linear, state, 0 * state)

    work = stored(q + 1e-3 * aside) - stored(q - 1e-3 * aside)
    assert stored(q) > 0.0
    assert -2e-3 * aside @ stretching_force(problem, q) == pytest.approx(work, rel=1e-5)
    assert not stretching_force(linear, q).any()


@pytest.mark.hard
@needs_extended_precision
def test_a_mass_sticks_slides_to_rest_and_sticks():
    """Without weakening: a sine of the bristle, a parabola, and the oscillation of the bristle from its bound on."""
    speed, press, bristle, coefficient = np.longdouble(0.5), 100.0, 1e5, 0.5
    numbers = [[0.0], [press], [coefficient], [coefficient], [0.1], [1e-4], [bristle]]
    nothing = {name: np.zeros(0) for name in ("barrier", "stiffness", "exponent", "loss")}
    problem = one_mode(p=0.5, shapes=np.zeros((0, 1)), rubbed=[[1.0]], friction=numbers, frames=500)
    omega, bend, slowing = np.sqrt(np.longdouble(bristle)), coefficient * press / bristle, coefficient * press
    begin = np.arcsin(bend * omega / speed) / omega
    slip = speed * np.cos(omega * begin)
    end, way = begin + slip / slowing, slip**2 / (2 * slowing)
    t = np.arange(501).astype(np.longdouble) / SAMPLERATE
    exact = np.where(t < begin, speed / omega * np.sin(omega * t), bend + way - slowing * (t - end) ** 2 / 2)
    exact = np.where(t > end, way + bend * np.cos(omega * (t - end)), exact)
    assert 40 < begin * SAMPLERATE < 50
    assert 400 < end * SAMPLERATE < 500
    for motion in displacements(problem._replace(**nothing)):
        assert np.abs(motion - exact).max() < 1e-16 * exact.max()


@pytest.mark.hard
@needs_extended_precision
def test_both_methods_agree_where_a_bow_slides_and_sticks():
    problem, known = read_problem(FOLDER / "bowed_string.npz")
    problem = problem._replace(frames=20)
    solution, (by_series, force, events) = reference.solve(problem), solve_by_series(problem)
    assert [status for _, _, status in solution.events] == [-1, 0, -1, 0] and events == 4
    peak = np.abs(known.displacement).max()
    assert np.abs(solution.displacement - by_series).max() < 1e-16 * peak
    assert np.abs(solution.displacement - known.displacement[:21]).max() < 1e-15 * peak
    assert np.abs(solution.force - force).max() < 1e-15 * np.abs(force).max()


def check_again(name):
    """Solve a problem again by both methods, and compare with its file."""
    problem, known = read_problem(FOLDER / f"{name}.npz")
    peak = np.abs(known.displacement).max()
    solution = reference.solve(problem)
    assert np.abs(solution.displacement - known.displacement).max() < 1e-14 * peak
    assert np.abs(solution.force - known.force).max() < 1e-12 * np.abs(known.force).max()
    displacement, force, _ = solve_by_series(problem)
    assert np.abs(displacement - known.displacement)[: known.horizon].max() < MAX_DIFFERENCE * peak
    assert np.abs(force - known.force)[: known.horizon].max() < 1e-11 * np.abs(known.force).max()


@pytest.mark.hard
@needs_extended_precision
@pytest.mark.parametrize("name", CHEAP)
def test_a_problem_solved_again_is_the_same(name):
    check_again(name)


@needs_extended_precision
@pytest.mark.slow
@pytest.mark.parametrize("name", LONGER)
def test_a_longer_problem_solved_again_is_the_same(name):
    check_again(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tanpura", "frets", "snare", "stretching_string"])
def test_what_scipy_makes_of_the_arrays_without_events_is_near(name):
    problem, known = read_problem(FOLDER / f"{name}.npz")
    count, frames = problem.omega.size, 220

    def derivative(t, x):
        q, p = x[:count], x[count:]
        s, speed = problem.shapes @ q - problem.barrier, problem.shapes @ p
        f = problem.stiffness * np.maximum(s, 0) ** problem.exponent * np.maximum(1 + problem.loss * speed, 0)
        slope = problem.weight - problem.omega**2 * q - 2 * problem.sigma * p - f @ problem.shapes
        if problem.stretch is not None:
            slope = slope - (problem.stretch @ q**2) @ problem.stretch * q
        return np.concatenate([p, slope])

    scale = np.sqrt(np.sum(problem.p**2 + problem.omega**2 * problem.q**2))
    times = np.arange(frames + 1) / problem.samplerate
    found = scipy.integrate.solve_ivp(
        derivative,
        (0, times[-1]),
        np.concatenate([problem.q, problem.p]),
        method="DOP853",
        rtol=1e-11,
        atol=1e-13 * scale * np.concatenate([1 / np.maximum(problem.omega, 1e3), np.ones(count)]),
        t_eval=times,
        max_step=2e-6,
    )
    apart = np.abs(problem.pickup @ found.y[:count] - known.displacement[: frames + 1])
    assert apart.max() < 1e-7 * np.abs(known.displacement[: frames + 1]).max()
