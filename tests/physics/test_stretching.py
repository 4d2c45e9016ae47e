"""Bodies whose tension rises as they stretch: against formulas, and against independent integrators."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy

import engine
from engine.assembly.build import build
from engine.kernel.data.effects import STRETCHING

RATE, MODES = 44_100, 24
LENGTH, DENSITY, F0, AXIAL = 0.648, 4e-4, 329.6, 5e4
TENSION = DENSITY * (2 * LENGTH * F0) ** 2
NUMBER = np.arange(1.0, MODES + 1)
BETA = NUMBER * math.pi / LENGTH
OMEGA, KAPPA, STRETCH = BETA * math.sqrt(TENSION / DENSITY), BETA**2 / DENSITY, AXIAL / (2 * LENGTH)
HEARD, STRUCK = 0.11, 0.31


def shape(at):
    """Mode shapes of the string at a position, 1/√kg."""
    return math.sqrt(2 / (DENSITY * LENGTH)) * np.sin(math.pi * NUMBER * at)


def string(**more):
    """A string of 24 modes whose axial stiffness is large."""
    return {
        "name": "string",
        "kind": "string",
        "length": LENGTH,
        "linear_density": DENSITY,
        "tension": TENSION,
        "modes": MODES,
        "residual": False,
        "axial_stiffness": AXIAL,
        **more,
    }


def bent(amplitude):
    """A smooth shape at time 0: the first mode."""
    return {"displacement": {"kind": "mode", "number": 1, "amplitude": amplitude}}


def heard(parts, seconds=0.01, **accuracy):
    """Displacement of the string, m, and the error of the energy."""
    pickup = [{"body": "string", "at": HEARD, "quantity": "displacement"}]
    scene = engine.Scene.model_validate({"pickup": pickup, **parts})
    rendering = engine.render(scene, seconds=seconds, samplerate=RATE, **accuracy)
    assert rendering.stats.newton.solve_outcomes.failed == 0
    return rendering.audio[:, 0], rendering.stats.energy.error_max


def string_force(q):
    """Force of the string on its modes: linear, and by its tension."""
    return -(OMEGA**2) * q - STRETCH * (KAPPA @ q**2) * KAPPA * q


def first_mode(amplitude):
    q = np.zeros(MODES)
    q[0] = amplitude / math.sqrt(2 / (DENSITY * LENGTH))
    return q


def integrate(rate_of_change, start, samples):
    """Solution of an independent integrator at the samples."""
    times = np.arange(samples) / RATE
    solution = scipy.integrate.solve_ivp(
        rate_of_change, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-15, max_step=4e-6
    )
    return solution.y.T


def slopes(parts, reference, levels, **accuracy):
    """Order of convergence, between numbers of substeps that double."""
    errors = []
    for substeps in levels:
        y, energy_error = heard(parts, len(reference) / RATE, substeps=substeps, **accuracy)
        assert energy_error < 2e-13
        errors.append(np.max(np.abs(y - reference)) / np.max(np.abs(reference)))
    return [math.log2(a / b) for a, b in pairwise(errors)]


AMPLITUDE, SPEED = 4e-3, 3.0  # m, m/s
SAMPLES = 441


def moving_string(**more):
    """A string bent to its first mode that moves in its second one: its tension rises by 6 %."""
    second = {"kind": "mode", "number": 2, "amplitude": SPEED}
    return string(displacement={"kind": "mode", "number": 1, "amplitude": AMPLITUDE}, velocity=second, **more)


def start():
    """q and p of the string at time 0."""
    p = np.zeros(MODES)
    p[1] = SPEED / math.sqrt(2 / (DENSITY * LENGTH))
    return np.concatenate([first_mode(AMPLITUDE), p])


def mean_slope(parts, reference, levels=(4, 8, 16), **accuracy):
    return np.mean(slopes(parts, reference, levels, **accuracy)[-2:])


def has_tension(parts):
    pickup = [{"body": "string", "at": HEARD}]
    return build(engine.Scene.model_validate({"pickup": pickup, **parts}), RATE).model.effects & STRETCHING != 0


def test_a_string_without_axial_stiffness_is_linear():
    assert has_tension({"body": [string()]})
    assert not has_tension({"body": [string(axial_stiffness=0.0)]})
    assert not has_tension({"body": [string(axial_stiffness=None)]})


@pytest.mark.parametrize("frequency", [110.0, 329.6])
@pytest.mark.parametrize("rise", [0.01, 0.1, 1.0])
def test_one_mode_sounds_higher_by_the_elliptic_integral(rise, frequency):
    """q'' + ω²q + Kκ²q³ = 0 from amplitude A has the angular frequency Ω·π/(2K(m)), Ω² = ω² + Kκ²A². The force of the
    tension acts in a step as (sin θ/θ)² of it, θ = ωh: of the shift 1 - θ²/3 is left, and less if it is large."""
    tension = DENSITY * (2 * LENGTH * frequency) ** 2
    q = math.sqrt(rise * tension / (STRETCH * KAPPA[0]))
    amplitude = q * math.sqrt(2 / (DENSITY * LENGTH))
    y, _ = heard({"body": [string(**bent(amplitude), modes=1) | {"tension": tension}]}, 1.0, least_detuning=0.0)
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    times = up - y[up] / (y[up + 1] - y[up])
    measured = (len(up) - 1) / (times[-1] - times[0]) * RATE
    omega = 2 * math.pi * frequency
    cubic = rise * omega**2
    top = omega**2 + cubic
    exact = math.sqrt(top) / (4 * scipy.special.ellipk(cubic / (2 * top)))
    shift = math.log2(measured / frequency) / math.log2(exact / frequency) - 1
    assert abs(shift) < 1e-3
    assert shift == pytest.approx(-((omega / RATE) ** 2) / 3, rel=0.02 + 0.3 * rise)


@pytest.mark.hard
def test_free_motion_is_of_second_and_fourth_order():
    def change(_, y):
        return np.concatenate([y[MODES:], string_force(y[:MODES])])

    reference = integrate(change, start(), SAMPLES)[:, :MODES] @ shape(HEARD)
    parts = {"body": [moving_string()]}
    assert mean_slope(parts, reference, (1, 2, 4)) == pytest.approx(2, abs=0.3)
    assert mean_slope(parts, reference, (1, 2, 4), order=4) == pytest.approx(4, abs=0.3)


@pytest.mark.hard
def test_a_hammer_on_a_stretching_string_is_of_second_order():
    mass, stiffness, exponent, speed, phi = 5e-3, 1e8, 2.5, 8.0, shape(STRUCK)
    below = float(phi @ first_mode(AMPLITUDE)) - 1e-3

    def change(_, y):
        q, p, x, v = y[:MODES], y[MODES : 2 * MODES], y[-2], y[-1]
        force = stiffness * max(x - phi @ q, 0.0) ** exponent
        return np.concatenate([p, string_force(q) + phi * force, [v, -force / mass]])

    reference = integrate(change, [*start(), below, speed], SAMPLES)[:, :MODES] @ shape(HEARD)
    hammer = {"name": "hammer", "kind": "mass", "mass": mass, "displacement": below, "velocity": speed}
    law = {"stiffness": stiffness, "exponent": exponent}
    parts = {
        "body": [moving_string(), hammer],
        "contact": [{"body": "hammer", "on": "string", "on_at": STRUCK, **law}],
    }
    assert mean_slope(parts, reference) == pytest.approx(2, abs=0.2)


@pytest.mark.hard
def test_a_mass_on_a_spring_from_a_stretching_string_is_of_second_order():
    mass, stiffness, phi = 2e-3, 1e3, shape(STRUCK)

    def change(_, y):
        q, p, x, v = y[:MODES], y[MODES : 2 * MODES], y[-2], y[-1]
        force = stiffness * (phi @ q - x)
        return np.concatenate([p, string_force(q) - phi * force, [v, force / mass]])

    reference = integrate(change, [*start(), 0.0, 0.0], SAMPLES)[:, :MODES] @ shape(HEARD)
    parts = {
        "body": [moving_string(), {"name": "mass", "kind": "mass", "mass": mass}],
        "connection": [{"kind": "spring", "body": "string", "at": STRUCK, "on": "mass", "stiffness": stiffness}],
    }
    assert mean_slope(parts, reference) == pytest.approx(2, abs=0.2)


BRIDGE_MASS, BRIDGE_STIFFNESS = 5e-3, 2e4  # kg, N/m
END_SLOPE = math.sqrt(2 / (DENSITY * LENGTH)) * BETA * np.where(NUMBER % 2 == 0, 1, -1)
LINE = DENSITY * END_SLOPE / BETA**2  # c̃
LIGHT_BRIDGE = {"name": "bridge", "kind": "oscillator", "mass": BRIDGE_MASS, "stiffness": BRIDGE_STIFFNESS}


def strings_on_a_bridge(scales, shares, has_one_tension=False):
    """Displacement of the first of strings at one point of an oscillator, by an independent integrator:
    V = Σ ½(ωa + cz)² + T/(2L)·z² + ¼K·s², s = Σκ(a + c̃z)² + z²/L, z = x·y.

    scales: of what each string begins with
    has_one_tension: whether the strings are two directions of one, s the sum of both
    """

    def change(_, y):
        x, v, rates, pull = y[-2], y[-1], [], 0.0
        ends = [share * x for share in shares]
        moves = [y[2 * n * MODES : (2 * n + 1) * MODES] for n in range(len(shares))]
        momenta = [y[(2 * n + 1) * MODES : (2 * n + 2) * MODES] for n in range(len(shares))]
        from_line = [a + LINE * z for a, z in zip(moves, ends, strict=True)]
        rises = [STRETCH * (KAPPA @ u**2 + z * z / LENGTH) for u, z in zip(from_line, ends, strict=True)]
        rises = [sum(rises)] * len(shares) if has_one_tension else rises
        for u, z, p, rise, share in zip(from_line, ends, momenta, rises, shares, strict=True):
            rates += [p, -(OMEGA**2) * u - rise * KAPPA * u]
            pull += share * (OMEGA**2 * LINE @ u + TENSION / LENGTH * z + rise * (KAPPA * LINE @ u + z / LENGTH))
        return np.concatenate([*rates, [v, -(pull + BRIDGE_STIFFNESS * x) / BRIDGE_MASS]])

    begin = np.concatenate([scale * start() for scale in scales] + [[0.0, 0.0]])
    return integrate(change, begin, SAMPLES)[:, :MODES] @ shape(HEARD)


@pytest.mark.hard
@pytest.mark.parametrize(
    "shares", [[1.0], [0.8, -0.5], *(pytest.param(x, marks=pytest.mark.hard) for x in ([0.6], [1.0, 1.0]))]
)
def test_strings_whose_ends_move_are_stretched_between_them(shares):
    """At one point of an oscillator, of whose motion each end follows a share."""
    reference = strings_on_a_bridge([1.0, -0.5][: len(shares)], shares)
    bodies = [moving_string()]
    if len(shares) == 2:
        second = {"kind": "mode", "number": 2, "amplitude": -0.5 * SPEED}
        first = {"kind": "mode", "number": 1, "amplitude": -0.5 * AMPLITUDE}
        bodies.append({**string(displacement=first, velocity=second), "name": "other"})
    ends = [{"kind": "end", "body": b["name"], "at": 1.0, "share": x} for b, x in zip(bodies, shares, strict=True)]
    parts = {"body": [*bodies, LIGHT_BRIDGE], "connection": [c | {"on": "bridge"} for c in ends]}
    assert mean_slope(parts, reference, (2, 4, 8)) == pytest.approx(2, abs=0.2)


@pytest.mark.hard
def test_the_polarisations_of_a_string_stretch_it_together():
    """One of them moves at first, the bridge moves both."""
    angle = 0.7
    reference = strings_on_a_bridge([1.0, 0.0], [math.cos(angle), math.sin(angle)], has_one_tension=True)
    bodies = [moving_string(polarisations=2, polarisation_angle=angle, modes=MODES), LIGHT_BRIDGE]
    parts = {"body": bodies, "connection": [{"kind": "end", "body": "string", "at": 1.0, "on": "bridge"}]}
    assert mean_slope(parts, reference, (2, 4, 8)) == pytest.approx(2, abs=0.2)


@pytest.mark.hard
def test_two_stretching_strings_that_collide_are_of_second_order():
    stiffness, exponent, gap, phi = 1e7, 2.0, 1e-3, shape(STRUCK)

    def change(_, y):
        q, p, r, v = np.split(y, 4)
        force = stiffness * max(phi @ (r - q) - gap, 0.0) ** exponent
        return np.concatenate([p, string_force(q) + phi * force, v, string_force(r) - phi * force])

    begin = np.concatenate([start(), -0.5 * start()])
    begin[: 2 * MODES] *= -1
    begin[2 * MODES :] *= -1
    reference = integrate(change, begin, SAMPLES)[:, :MODES] @ shape(HEARD)

    def part(scale, name):
        first = {"kind": "mode", "number": 1, "amplitude": scale * AMPLITUDE}
        return string(displacement=first, velocity={"kind": "mode", "number": 2, "amplitude": scale * SPEED}, name=name)

    law = {"stiffness": stiffness, "exponent": exponent, "gap": gap}
    contact = {"body": "other", "at": STRUCK, "on": "string", "on_at": STRUCK, **law}
    parts = {"body": [part(-1.0, "string"), part(0.5, "other")], "contact": [contact]}
    assert mean_slope(parts, reference) == pytest.approx(2, abs=0.3)


LOSSES = {"sigma0": 0.6, "b3": 6e-9}
BARRIER = {"body": "string", "at": [0.3, 0.6], "barrier": -1e-3, "side": "below", "stiffness": 1e8, "exponent": 1.5}
BRIDGE = {"name": "bridge", "kind": "oscillator", "mass": 0.02, "stiffness": 2e4, "damping_rate": 1.0}
END = {"kind": "end", "body": "string", "at": 1.0, "on": "bridge"}
SPRING = {"kind": "spring", "body": "string", "at": 0.4, "on": "bridge", "stiffness": 1e3, "damping_coefficient": 0.05}


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"contact": [BARRIER | {"at": 0.3}]},
        {"contact": [BARRIER | {"loss": 0.5}]},
        {"connection": [END]},
        {"connection": [SPRING]},
        {"connection": [END, SPRING], "contact": [BARRIER]},
        {"connection": [END | {"share": -0.6}, SPRING], "contact": [BARRIER]},
        {
            "contact": [
                {
                    "body": "string",
                    "at": 0.3,
                    "on": "bridge",
                    "side": "below",
                    "gap": 1e-3,
                    "stiffness": 1e7,
                    "exponent": 1.0,
                }
            ]
        },
        {"event": [{"kind": "damp", "time": 0.05, "duration": 0.05, "body": "string", "sigma": 30.0}]},
    ],
)
@pytest.mark.parametrize("accuracy", [{}, {"order": 4}, {"substeps": 2}])
def test_energy_is_exact_with_everything_else(parts, accuracy):
    bodies = [moving_string(**LOSSES)] + ([BRIDGE] if "bridge" in str(parts) else [])
    _, error = heard({"body": bodies, **parts}, 0.2, **accuracy)
    assert error < 1e-13


@pytest.mark.parametrize(
    ("axial", "amplitude", "mass", "stiffness", "losses"),
    [
        (1.05e4, 3e-3, 1e-4, 156.0, {}),
        (2.97e4, 5.1e-3, 3.6e-3, 7.38, {"sigma0": 2000.0}),
        (2.7e6, 4e-3, 2.4e-5, 1e3, {}),
        (5e4, 4e-3, 0.02, 2e4, {}),
    ],
)
def test_a_light_bridge_keeps_the_energy(axial, amplitude, mass, stiffness, losses):
    pluck = {"kind": "triangle", "at": 0.3, "amplitude": amplitude}
    bodies = [string(displacement=pluck, **losses) | {"axial_stiffness": axial}]
    bodies.append({"name": "bridge", "kind": "oscillator", "mass": mass, "stiffness": stiffness})
    scene = {"body": bodies, "connection": [END], "pickup": [{"body": "string", "at": HEARD}]}
    stats = engine.render(engine.Scene.model_validate(scene), seconds=0.2, samplerate=RATE, least_detuning=0.0).stats
    assert stats.energy.error_max < 1e-13 and stats.newton.solve_outcomes.failed == 0


def test_the_axial_stiffness_can_change_while_it_sounds():
    change = {"kind": "change", "parameter": "body.string.axial_stiffness", "value": 2e5, "duration": 0.05}
    body = {"body": [string(**bent(4e-3))]}
    before, _ = heard(body, 0.2)
    after, error = heard(body | {"event": [change | {"time": 0.05}]}, 0.2)
    same = round(0.05 * RATE)
    assert np.array_equal(before[:same], after[:same]) and error < 1e-13
    assert np.max(np.abs(before - after)) > 0.1 * np.max(np.abs(before))


@pytest.mark.hard
@pytest.mark.parametrize(
    ("axial", "amplitude", "limit"), [(1e4, 3e-3, 2e-13), (1e6, 6e-3, 2e-13), (1e9, 6e-3, 1e-11), (1e13, 0.03, 1e-9)]
)
def test_energy_is_exact_over_ten_seconds_at_any_stiffness(axial, amplitude, limit):
    y, error = heard(
        {"body": [string(**bent(amplitude), **LOSSES) | {"axial_stiffness": axial}]}, 10.0, least_detuning=0.0
    )
    assert np.isfinite(y).all() and error < limit


@pytest.mark.hard
def test_hostile_hammers_keep_the_energy():
    random = np.random.default_rng(42)
    for _ in range(1500):
        axial, stiffness = 10 ** random.uniform(2, 12), 10 ** random.uniform(3, 13)
        exponent, speed = random.choice([1.0, 1.5, 2.0, 2.5, 3.3]), 10 ** random.uniform(-1, 2)
        hammer = {"name": "hammer", "kind": "mass", "mass": 5e-3, "velocity": speed}
        contact = {"body": "hammer", "on": "string", "on_at": STRUCK, "stiffness": stiffness, "exponent": exponent}
        bodies = [string(**bent(1e-3)) | {"axial_stiffness": axial}, hammer]
        y, error = heard({"body": bodies, "contact": [contact]}, 0.05)
        assert np.isfinite(y).all() and error < 1e-10, (axial, stiffness, exponent, speed)


def joined_strings(seed):
    """A few strings that stretch, with springs between them and to the ground, and contacts."""
    rng = np.random.default_rng(seed)
    draw = lambda low, high: float(10 ** rng.uniform(low, high))
    count = int(rng.integers(2, 5))
    decay = {"kind": "chaigne_askenfelt", "b1": draw(-1, 2), "b3": 1e-9}
    bodies = [
        {"name": f"b{i}", "kind": "string", "length": 0.5, "linear_density": draw(-4, -2), "decay": decay}
        | {"frequency": draw(1.7, 3), "modes": int(rng.integers(1, 40)), "axial_stiffness": draw(2, 7)}
        | ({"displacement": {"kind": "triangle", "at": 0.3, "amplitude": draw(-4, -1.5)}} if rng.random() < 0.7 else {})
        for i in range(count)
    ]

    def between(grounded, joined):
        i, j = rng.integers(count, size=2)
        at, on_at = rng.uniform(0.05, 0.95, 2).tolist()
        return {"body": f"b{i}", "at": at} | (grounded if i == j else {"on": f"b{j}", "on_at": on_at} | joined)

    place = {"side": "above", "stiffness": draw(4, 9), "exponent": float(rng.choice([1, 1.3, 1.5, 2.5]))}
    contacts = [between({"barrier": 1e-4}, {"gap": 3e-4}) | place for _ in range(rng.integers(0, 3))]
    springs = [
        between({}, {}) | {"stiffness": draw(1, 5), "damping_coefficient": float(rng.choice([0, draw(-3, 1)]))}
        for _ in range(rng.integers(1, 5))
    ]
    scene = {"seconds": 0.03, "body": bodies, "contact": contacts, "connection": springs}
    return scene | {"pickup": [{"body": "b0", "at": 0.2}], "accuracy": {"least_detuning": 0.0}}


def check_joined_strings(seeds, limit):
    """No step of any of them errs by more of its energy than the limit."""
    for seed in seeds:
        trace = engine.render(engine.load(joined_strings(seed)), trace=True).trace
        balance = trace["total"] + trace["dissipated"] - trace["supplied"]
        assert np.abs(np.diff(balance)).max() <= limit * np.abs(balance).max(), seed


@pytest.mark.hard
def test_strings_that_stretch_each_other_keep_the_energy():
    """Each tension depends on all others, which move while it is sought."""
    check_joined_strings(range(20), 1e-12)


@pytest.mark.hard
def test_five_hundred_groups_of_strings_keep_the_energy():
    """As above, at extremes."""
    check_joined_strings(range(20, 60), 1e-12)
    check_joined_strings(range(60, 560), 1e-11)


def glide(body, at, seconds, frequency):
    """Pitch of the first 93 ms above that at the end, cents."""
    pickup = [{"body": body["name"], "at": at, "quantity": "displacement"}]
    scene = engine.Scene.model_validate({"body": [body], "pickup": pickup})
    y = engine.render(scene, seconds=seconds, samplerate=RATE, least_detuning=0.0).audio[:, 0]

    def pitch(part):
        spectrum = np.abs(np.fft.rfft(part * np.hanning(part.size), 1 << 19))
        frequencies = np.fft.rfftfreq(1 << 19, 1 / RATE)
        near = (frequencies > 0.9 * frequency) & (frequencies < 1.25 * frequency)
        return frequencies[near][np.argmax(spectrum[near])]

    return 1200 * math.log2(pitch(y[:4096]) / pitch(y[-5000:-904]))


def test_a_plucked_guitar_string_falls_in_pitch():
    """An E4 of 0.010 in, plucked by 3 mm and by 6 mm: what another program computes, in steps of 0.4 cents."""
    plain = {"name": "s", "kind": "string", "length": 0.648, "linear_density": 4e-4, "frequency": 329.6}
    losses = {"inharmonicity": 2e-5, "sigma0": 0.6, "b3": 6e-9, "axial_stiffness": 10_134.0}
    for millimetres, cents in ((3, 4.85), (6, 17.14)):
        pluck = {"kind": "triangle", "at": 0.2, "amplitude": millimetres * 1e-3}
        assert glide(plain | losses | {"displacement": pluck}, 0.11, 6.0, 329.6) == pytest.approx(cents, abs=0.1)


def test_a_tom_glides_by_its_stretch():
    """A 12 in tom of film of 0.254 mm, released in its first mode by 2 mm: 94 cents by Duffing with decay."""
    density = 0.26 * 1.39
    tension = density * (2 * math.pi * 100 * 0.152 / 2.405) ** 2
    head = {"name": "h", "kind": "membrane", "radius": 0.152, "area_density": density, "tension": tension}
    film = {"young": 3.5e9, "thickness": 0.254e-3, "poisson": 0.3, "sigma0": 4.0, "b3": 2e-6, "modes": 40}
    bend = {"displacement": {"kind": "mode", "number": 1, "amplitude": 2e-3}}
    assert glide(head | film | bend, [0.5, 0.5], 2.0, 100) == pytest.approx(93.5, abs=1.0)


@pytest.mark.hard
def test_the_slack_bass_falls_by_a_semitone():
    """And the same string, taut and plucked as far, by a quarter of that at most."""
    scene = engine.load("slack_bass")
    audio = engine.render(scene, seconds=5.7).audio.mean(axis=1)

    def pitch(time: float, near: float) -> float:
        x = audio[round(time * RATE) :][:8192]
        frequencies = np.fft.rfftfreq(2**20, 1 / RATE)
        spectrum = np.abs(np.fft.rfft(x * np.hanning(x.size), 2**20)) * (np.abs(frequencies / near - 1) < 0.2)
        return float(frequencies[np.argmax(spectrum)])

    taut, slack = (1200 * math.log2(pitch(a, f) / pitch(b, f)) for a, b, f in ((1.23, 2.2, 98), (3.85, 5.5, 49)))
    assert 80.0 < slack < 150.0
    assert 2.0 < taut < slack / 4


def test_a_body_that_is_hardly_detuned_flies_as_a_linear_one():
    """It is linear below 0.1 cents, so that the sound is that of a string that always stretches, to a little phase."""
    parts = {"body": [string(**bent(3e-4), **LOSSES)]}
    quiet, error = heard(parts, 1.0)
    exact, _ = heard(parts, 1.0, least_detuning=0.0)
    linear, _ = heard({"body": [string(**bent(3e-4), **LOSSES) | {"axial_stiffness": 0.0}]}, 1.0)
    assert error < 1e-13
    away = np.max(np.abs(quiet - exact))
    assert 0 < away < 0.15 * np.max(np.abs(exact))
    assert np.max(np.abs(linear - exact)) > 2 * away


PLATE = {"name": "p", "kind": "plate", "area_density": 1.0, "flexural_rigidity": 1.0}


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (PLATE | {"radius": 0.1, "stretching_stiffness": 1e5}, "only a rectangle of size with supported edges"),
        (PLATE | {"size": [0.1, 0.2], "edges": "free", "stretching_stiffness": 1e5}, "supported edges"),
        (PLATE | {"size": [0.1, 0.2], "stretching": True}, "without young and thickness"),
        (string(axial_stiffness=None, young=2e11), "no diameter is given"),
    ],
)
def test_a_body_that_cannot_stretch_so_is_refused_with_a_reason(body, message):
    with pytest.raises(ValueError, match=message):
        engine.Scene.model_validate({"body": [body], "pickup": [{"body": body["name"], "at": [0.3, 0.3]}]})
