"""Connections: pitch and decay of what is joined against the eigenvalues of the same modes, motion against SciPy's
DOP853, and the ledger of energy."""

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy
from held_strings import MODES, PLUCK, held, lumped, spring
from poles import SAMPLERATE, cents, engine_poles, errors, exact_poles, nearest, step_map

import engine
from bench.scenes.choirs import choir, string
from engine.assembly.build import build
from engine.faults import BuildError

SPRINGS = [1e3, 1e4, 3e4, 1e5, 3e5, 1e6, 1e7, 1e9, "rigid"]  # N/m
DAMPERS = [0.01, 0.1, 1.0, 10.0, 100.0, 1e4]  # kg/s
PLACES = [0.5, 0.4, 0.3, 0.2, 0.12, 0.9, 0.93, 0.94]


# --- a spring, a damper, a rigid joint, anywhere on a string


@pytest.mark.hard_but("10000.0-0.5", "10000.0-0.94", "100000.0-0.2", "100000.0-0.5", "1000000.0-0.2", "10000000.0-0.3")
@pytest.mark.parametrize("at", PLACES)
@pytest.mark.parametrize("stiffness", SPRINGS)
def test_a_spring_on_a_string_has_the_right_pitch(at, stiffness):
    """Within 0.1 cent to partial 4 and 1.5 cents to partial 18; and with two substeps within a quarter of these."""
    scene = held([spring(stiffness, at=at)])
    for substeps, part in ((1, 1.0), (2, 0.25)):
        pitch, _ = errors(scene, substeps=substeps)
        assert pitch[:4].max() <= 0.1 * part
        assert pitch.max() <= 1.5 * part


@pytest.mark.parametrize("stiffness", SPRINGS)
def test_a_mass_on_a_spring_on_a_string_has_the_right_pitch(stiffness):
    """Within 0.3 cent to partial 4, and with two substeps within a quarter of that."""
    scene = held([spring(stiffness, at=0.31, on="bolt")], [lumped("bolt", mass=1.8e-3)])
    for substeps, part in ((1, 1.0), (2, 0.25)):
        pitch, _ = errors(scene, substeps=substeps)
        assert pitch[:4].max() <= 0.3 * part
        assert pitch.max() <= 1.5 * part


@pytest.mark.hard_for("192000-10000.0-0.2-0.6", "192000-1000000000.0-1.0-1.7")
@pytest.mark.parametrize(("samplerate", "stiffness", "least", "most"), [
    (44_100, 1e4, 1.0, 2.5), (44_100, 1e9, 4.0, 7.0), (192_000, 1e4, 0.2, 0.6), (192_000, 1e9, 1.0, 1.7),
])  # fmt: skip
def test_a_held_string_of_fewer_modes_is_sharper_than_an_ideal_one(samplerate, stiffness, least, most):
    """By as many cents to partial 4, beside the roots of T·k·sin(kL) + K·sin(kx)·sin(k(L - x)) = 0."""
    length, mass, pitch, place = 0.62, 3.93e-3, 261.6256, 0.31
    body = {"name": "s", "kind": "string", "length": length, "mass": mass, "frequency": pitch, "sigma0": 0.01}
    held_by = {"body": "s", "at": place, "stiffness": stiffness}
    scene = engine.load({"body": [body], "connection": [held_by], "pickup": [{"body": "s", "at": 0.9}]})
    tension = mass * length * (2.0 * pitch) ** 2

    def off(frequency):
        k = 2 * np.pi * frequency / (2 * length * pitch)
        within = np.sin(k * place * length) * np.sin(k * (1 - place) * length)
        return tension * k * np.sin(k * length) + stiffness * within

    grid = np.linspace(50.0, 5 * pitch, 4001)
    ideal = [scipy.optimize.brentq(off, a, b) for a, b in pairwise(grid) if off(a) * off(b) < 0.0][:4]
    found = exact_poles(scene, samplerate)[:4].imag / (2 * np.pi)
    sharper = 1200 * np.log2(found / ideal)
    assert (sharper >= -1e-3).all() and least <= sharper.max() <= most


@pytest.mark.hard_but("0.01-0.2", "0.01-0.4", "0.01-0.5", "0.01-0.93", "0.1-0.12", "0.1-0.3")
@pytest.mark.parametrize("at", PLACES)
@pytest.mark.parametrize("damping", DAMPERS)
def test_a_damper_on_a_string_has_the_right_decay(at, damping):
    scene = held([{"body": "s", "at": at, "damping_coefficient": damping}])
    for substeps, part in ((1, 1.0), (2, 0.25)):
        _, decay = errors(scene, substeps=substeps)
        assert decay[:4].max() <= 0.005 * part
        assert decay.max() <= 0.10 * part


@pytest.mark.parametrize("damping", DAMPERS)
def test_a_support_is_right_at_any_damping(damping):
    """As -16.1 1/s at 100 kg/s, where the diagonal of the damping matrix would give -16 655."""
    body = string("s", modes=MODES, support=[{"at": 0.37, "stiffness": 1e3, "damping_coefficient": damping}])
    scene = engine.Scene.model_validate({"body": [body], "pickup": [{"body": "s", "at": 0.3}]})
    _, decay = errors(scene)
    assert decay[:4].max() <= 0.005
    assert decay.max() <= 0.10


def test_a_support_with_several_places_shares_its_spring_among_them():
    places = [0.1, 0.3, 0.35]
    body = string("s", modes=MODES, support=[{"at": places, "stiffness": 3e4, "damping_coefficient": 3.0}])
    one = engine.Scene.model_validate({"body": [body], "pickup": [{"body": "s", "at": 0.3}]})
    several = held([{"body": "s", "at": at, "stiffness": 1e4, "damping_coefficient": 1.0} for at in places])
    assert np.allclose(engine_poles(one), engine_poles(several), rtol=1e-9)


@pytest.mark.hard
@pytest.mark.parametrize("stiffness", [1e4, 1e5, 1e6, 1e7, 1e8])
def test_near_the_end_a_spring_to_a_board_gives_pitch_and_decay(stiffness):
    scene = held([spring(stiffness, at=0.985, on="board", on_at="bridge")], [choir(1)["body"][1]])
    exact = exact_poles(scene)
    partials = 261.6256 * np.arange(1, 19) * np.sqrt(1 + 3.7702e-4 * np.arange(1, 19) ** 2)
    slow = [exact[np.abs(exact.imag / (2 * math.pi) - f) < 0.06 * f] for f in partials]
    wanted = np.array([poles[np.argmax(poles.real)] for poles in slow])  # of the string: those that die last
    found = nearest(engine_poles(scene), wanted)
    pitch, decay = np.abs(cents(found, wanted)), np.abs(found.real / wanted.real - 1)
    assert pitch[:4].max() <= 0.05
    assert pitch.max() <= 0.9
    assert decay.max() <= 0.01 or stiffness > 1e5


# --- few bodies


def test_two_masses_on_a_spring_swing_as_they_should():
    """ω² = k·(1/a + 1/b), in the midpoint's own time: ω → (2/h)·atan(ωh/2)."""
    stiffness, a, b = 1e4, 0.01, 0.03
    scene = engine.Scene.model_validate(
        {
            "body": [lumped("a", mass=a), lumped("b", mass=b)],
            "connection": [{"body": "a", "on": "b", "stiffness": stiffness}],
            "pickup": [{"body": "a"}],
        }
    )
    omega = math.sqrt(stiffness * (1 / a + 1 / b))
    pole = engine_poles(scene)
    assert pole.imag == pytest.approx([2 * SAMPLERATE * math.atan(omega / (2 * SAMPLERATE))], rel=1e-9)


def ring(**keys):
    """Three bodies of which each is joined to both others."""
    bodies = [
        lumped("a", velocity=keys.pop("velocity", 0.0)),
        lumped("b", mass=0.02),
        {"name": "c", "kind": "oscillator", "mass": 0.03, "frequency": 200.0},
    ]
    joints = [{"body": x, "on": y, **keys} for x, y in (("a", "b"), ("b", "c"), ("c", "a"))]
    return engine.Scene.model_validate({"body": bodies, "connection": joints, "pickup": [{"body": "a"}]})


def test_three_bodies_in_a_ring():
    found, exact = engine_poles(ring(stiffness=2e3)), exact_poles(ring(stiffness=2e3))
    assert np.abs(cents(found, exact)).max() <= 0.1


def test_rigid_joints_that_repeat_each_other_hold_as_fewer_do():
    """A ring of rigid joints is one body of 60 g on the spring of the oscillator."""
    omega = 2 * math.pi * 200.0 * math.sqrt(0.03 / 0.06)
    pole = engine_poles(ring(rigid=True))
    assert pole[0].imag == pytest.approx(omega, rel=1e-4)


def test_a_body_joined_to_itself():
    scene = held([{"body": "s", "at": 0.3, "on": "s", "on_at": 0.8, "stiffness": 2e4}])
    pitch, _ = errors(scene)
    assert pitch[:4].max() <= 0.1
    assert pitch.max() <= 1.5


def test_the_same_spring_twice_is_one_of_twice_the_stiffness():
    one, two = held([spring(1e4, at=0.3)]), held([spring(5e3, at=0.3), spring(5e3, at=0.3)])
    assert np.abs(cents(engine_poles(two)[:18], engine_poles(one)[:18])).max() <= 1e-2


def test_what_is_rigid_stays_together():
    """A mass that is rigidly joined to a string moves as the string does there."""
    scene = held(
        [{"body": "bolt", "on": "s", "on_at": 0.4, "rigid": True}],
        [lumped("bolt", mass=1e-3)],
        force=[{"kind": "pluck", "body": "s", "at": 0.2, "amplitude": 5.0, "duration": 2e-3}],
        pickup=[
            {"body": "s", "at": 0.4, "quantity": "displacement"},
            {"body": "bolt", "quantity": "displacement", "channel": 2},
        ],
    )
    rendering = engine.render(scene, 1.0)
    string_moves, bolt_moves = rendering.audio.T
    assert np.abs(bolt_moves).max() > 1e-5
    assert np.abs(string_moves - bolt_moves).max() <= 1e-12 * np.abs(bolt_moves).max()


@pytest.mark.parametrize(
    "contacts", [[], [{"body": "s", "at": 0.4, "barrier": 1e5, "stiffness": 1.0, "exponent": 1.5}]]
)
def test_the_pass_where_nothing_touches_does_what_any_step_does(contacts):
    """One pass over the modes, with and without contacts in reach of the scene: the same map."""
    connections = [spring(1e4, at=0.3), {"body": "s", "at": 0.5, "damping_coefficient": 2.0}, spring(3e3, at=0.8)]
    plain = step_map(held(connections[:2]))
    assert np.allclose(
        step_map(held(connections[:2], contact=contacts)), plain, rtol=0, atol=1e-12 * np.abs(plain).max()
    )
    many = step_map(held(connections, contact=contacts))
    assert np.allclose(many, step_map(held(connections)), rtol=0, atol=1e-12 * np.abs(many).max())


# --- the motion, with contacts


def test_a_hammer_on_a_held_string_moves_as_integrated():
    """A hammer strikes an oscillator that a spring and a damper join to another: against DOP853."""
    k, r, kc, alpha, m, mass = 2e4, 3.0, 1e7, 2.5, 0.02, 0.01
    omega = 2 * math.pi * np.array([150.0, 410.0])
    scene = engine.Scene.model_validate(
        {
            "body": [
                {"name": "a", "kind": "oscillator", "mass": m, "frequency": 150.0},
                {"name": "b", "kind": "oscillator", "mass": m, "frequency": 410.0},
                lumped("hammer", mass=mass, displacement=-1e-4, velocity=1.0),
            ],
            "connection": [{"body": "a", "on": "b", "stiffness": k, "damping_coefficient": r, "rest": 1e-4}],
            "contact": [{"body": "hammer", "on": "a", "stiffness": kc, "exponent": alpha}],
            "pickup": [
                {"body": name, "quantity": "displacement", "channel": n + 1}
                for n, name in enumerate(("a", "b", "hammer"))
            ],
        }
    )
    rendering = engine.render(scene, 0.02, substeps=16)

    def motion(_, y):
        a, b, x, va, vb, vx = y
        force = k * (a - b - 1e-4) + r * (va - vb)
        push = kc * max(0.0, x - a) ** alpha
        return [va, vb, vx, -(omega[0] ** 2) * a + (push - force) / m, -(omega[1] ** 2) * b + force / m, -push / mass]

    times = np.arange(len(rendering.audio)) / SAMPLERATE
    tight = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-15}
    start = [0, 0, -1e-4, 0, 0, 1.0]
    exact = scipy.integrate.solve_ivp(motion, (0, 0.02), start, t_eval=times, **tight).y[:3].T
    assert np.abs(exact).max() > 1e-4
    assert np.abs(rendering.audio - exact).max() <= 1e-4 * np.abs(exact).max()


# --- energy


@pytest.mark.parametrize("lossless", [True, False], ids=["lossless", "lossy"])
@pytest.mark.parametrize(
    "connection",
    [spring(1e3, at=0.63), spring(1e6, at=0.63), spring(1e9, at=0.63), spring("rigid", at=0.63)]
    + [{"body": "s", "at": 0.63, "damping_coefficient": d} for d in (0.1, 100.0)],
    ids=str,
)
def test_the_ledger_of_a_held_string_closes(connection, lossless):
    scene = held([connection], force=PLUCK)
    if lossless:
        body = scene.body[0].model_copy(update={"sigma0": 0.0, "b3": 0.0})
        scene = scene.model_copy(update={"body": [body]})
    stats = engine.render(scene, 10.0).stats
    assert stats.energy.supplied > 1e-4
    assert stats.energy.error_max <= 1e-12
    assert ("damping_coefficient" in connection) or not lossless or stats.energy.dissipated == 0.0


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
def test_the_ledger_of_a_ring_closes(stiffness):
    stats = engine.render(ring(stiffness=stiffness, velocity=1.0), 10.0).stats
    assert stats.energy.error_max <= 1e-12


@pytest.mark.parametrize("accuracy", [{"substeps": 2}, {"order": 4}, {"order": 6}], ids=str)
def test_the_ledger_closes_at_every_order(accuracy):
    connections = [spring(1e5, at=0.63), {"kind": "end", "body": "s", "at": 1.0, "on": "o"}]
    body = {"name": "o", "kind": "oscillator", "mass": 0.5, "frequency": 90.0}
    stats = engine.render(held(connections, [body], force=PLUCK), 1.0, **accuracy).stats
    assert stats.energy.error_max <= 1e-13


@pytest.mark.parametrize("order, least", [(2, 3.9), (4, 12.0), (6, 55.0)])
def test_errors_fall_as_the_order_says(order, least):
    """Half the step leaves 2^-order of the error of the pitch of partials 10 to 18; springs that make up for the step
    begin better at order 2."""
    scene = held(
        [spring(1e5, at=0.5), {"kind": "end", "body": "s", "at": 1.0, "on": "o"}],
        [{"name": "o", "kind": "oscillator", "mass": 0.5, "frequency": 90.0}],
    )
    coarse, fine = (errors(scene, order=order, substeps=n)[0][9:18].max() for n in (1, 2))
    assert coarse / fine >= least


def test_a_damper_outside_steps_back_in_time():
    """At order 4 a weak damper acts in half-steps outside; a strong one is refused, with what would be right."""
    weak = held([{"body": "s", "at": 0.5, "damping_coefficient": 0.02}])
    _, decay = errors(weak, order=4)
    assert decay[:4].max() <= 0.005
    assert (
        engine.render(
            held([{"body": "s", "at": 0.5, "damping_coefficient": 0.02}], force=PLUCK), 1.0, order=4
        ).stats.energy.error_max
        <= 1e-13
    )
    with pytest.raises(
        BuildError, match=r"connection\[0\].damping_coefficient: order 4 has steps back in time.*order = 2"
    ):
        build(held([{"body": "s", "at": 0.5, "damping_coefficient": 1.0}]), SAMPLERATE, weak.accuracy.replace(order=4))


# --- changes


CHANGES = [
    {"time": 0.1, "kind": "change", "connection": "c", "stiffness": 3e5, "duration": 0.05},
    {"time": 0.2, "kind": "change", "connection": "c", "damping_coefficient": 5.0, "duration": 0.05},
    {"time": 0.3, "kind": "change", "connection": "c", "rest": 2e-3, "duration": 0.1},
    {"time": 0.5, "kind": "change", "connection": "c", "stiffness": 0.0, "damping_coefficient": 0.0},
]


def test_what_changes_is_accounted_for():
    scene = held([spring(1e3, at=0.63, name="c")], force=PLUCK, event=CHANGES)
    energy = engine.render(scene, 1.0).stats.energy
    assert energy.error_max <= 1e-12
    assert energy.supplied > 1e-4


@pytest.mark.parametrize(
    "before, after",
    [({"stiffness": 2e4}, {"stiffness": 5e4}), ({"damping_coefficient": 0.5}, {"damping_coefficient": 2.0})],
    ids=str,
)
def test_after_a_change_the_string_is_as_one_that_was_always_so(before, after):
    """Factors that the kernel makes again are those of a scene that is built with the new values."""
    change = {"time": 0.001, "kind": "change", "connection": "c", "duration": 0.0, **after}
    later = [{**PLUCK[0], "start": 0.01}]
    changed, always = (
        held([{"name": "c", "body": "s", "at": 0.63, **values}, spring(1e3, at=0.2)], force=later, event=event)
        for values, event in ((before, [change]), (after, []))
    )
    a, b = engine.render(changed, 0.2).audio, engine.render(always, 0.2).audio
    assert np.abs(b).max() > 0.1
    assert np.abs(a - b).max() <= 1e-9 * np.abs(b).max()


def test_a_contact_meets_what_a_changed_spring_leaves(tmp_path):
    """The compliance of a contact follows the spring beside it: the ledger closes, and a rendered blow is that of a
    scene that was built so."""
    hammer = lumped("h", mass=3e-3, displacement=-5e-3, velocity=2.0)
    contact = [{"body": "h", "on": "o", "stiffness": 1e8, "exponent": 2.0}]
    bodies = [{"name": "o", "kind": "oscillator", "mass": 0.02, "frequency": 200.0}, hammer]
    pickup = [{"body": "o", "quantity": "force"}]
    blows = []
    for stiffness, event in (
        (1e3, [{"time": 0.0, "kind": "change", "connection": "c", "stiffness": 8e5, "duration": 0.0}]),
        (8e5, []),
    ):
        joint = [{"name": "c", "body": "o", "stiffness": stiffness}]
        table = {"body": bodies, "connection": joint, "contact": contact, "event": event, "pickup": pickup}
        rendering = engine.render(engine.Scene.model_validate(table), 0.02)
        assert rendering.stats.energy.error_max <= 1e-13
        blows.append(rendering.audio)
    assert np.abs(blows[0]).max() > 10.0
    assert np.allclose(blows[0], blows[1], rtol=0, atol=1e-9 * np.abs(blows[1]).max())


# --- sleep, and the kernels


def test_what_is_connected_sleeps_and_wakes():
    events = [{"time": 2.0, "kind": "pluck", "body": "s", "at": 0.2, "amplitude": 5.0, "duration": 2e-3}]
    rendering = engine.render(held([spring(1e4, at=0.37)], force=PLUCK, event=events, seconds=3.0, loss=20.0))
    assert rendering.stats.activity.asleep > 0.2
    early, late = np.abs(rendering.audio[:4410]).max(), np.abs(rendering.audio[88_200:92_610]).max()
    assert late == pytest.approx(early, rel=1e-3)
    assert np.abs(rendering.audio[80_000:88_000]).max() == 0.0


def test_a_weight_on_a_spring_comes_to_rest():
    """At m·g/k below where it began; and then it sleeps."""
    scene = engine.Scene.model_validate(
        {
            "gravity": 9.81,
            "body": [lumped("a")],
            "connection": [{"body": "a", "stiffness": 1e3, "damping_coefficient": 1.0}],
            "pickup": [{"body": "a", "quantity": "displacement"}],
        }
    )
    rendering = engine.render(scene, 3.0)
    assert rendering.audio[-1, 0] == pytest.approx(-0.01 * 9.81 / 1e3, rel=1e-6)
    assert rendering.stats.energy.error_max <= 1e-12


def test_connected_bodies_still_touch_when_they_should():
    """A ball that falls on a sprung plate: contact begins in the sample in which the distance is gone."""
    scene = engine.Scene.model_validate(
        {
            "body": [lumped("ball", displacement=5e-3, velocity=-0.5), lumped("plate", mass=0.1)],
            "connection": [{"body": "plate", "stiffness": 1e4, "damping_coefficient": 1.0}],
            "contact": [{"body": "ball", "on": "plate", "side": "below", "stiffness": 1e7, "exponent": 1.5}],
            "pickup": [{"body": "plate", "quantity": "force"}],
        }
    )
    force = engine.render(scene, 0.05).audio[:, 0]
    assert np.flatnonzero(force)[0] == pytest.approx(5e-3 / 0.5 * SAMPLERATE, abs=1.5)


def test_masses_land_on_a_bed_whatever_is_connected_elsewhere():
    """In a scene with connections, contacts of a bed that are far are left out of its steps. Those that land later do
    so as in a scene without connections, in which no contact is left out."""
    places = [[0.1 + 0.07 * i, 0.2 + 0.05 * i] for i in range(12)]
    bed = {"kind": "plate", "size": [1.5, 1.1], "area_density": 34.0, "flexural_rigidity": 8000.0, "modes": 40}
    masses = [lumped(f"m{i}", mass=0.02, displacement=-4e-3 * (1 + i % 4), velocity=0.6) for i in range(12)]
    contacts = [
        {"body": f"m{i}", "on": "bed", "on_at": at, "stiffness": 1e7, "exponent": 1.5, "loss": 0.3}
        for i, at in enumerate(places)
    ]
    hit_again = [
        {"kind": "strike", "body": f"m{i}", "time": 0.03, "displacement": -2e-3, "velocity": 1.0} for i in (2, 7)
    ]
    alone = {
        "body": [{"name": "bed", **bed}, *masses],
        "contact": contacts,
        "event": hit_again,
        "pickup": [{"body": "bed", "at": [0.3, 0.4]}],
    }
    elsewhere = [lumped("a", mass=0.1, displacement=1e-3), lumped("b", mass=0.2)]
    beside = alone | {
        "body": [*alone["body"], *elsewhere],
        "connection": [{"body": "a", "on": "b", "stiffness": 1e4}],
    }
    without, with_it = (engine.render(engine.Scene.model_validate(scene), 0.1) for scene in (alone, beside))
    assert np.abs(with_it.audio - without.audio).max() < 1e-11 * np.abs(without.audio).max()
    assert with_it.stats.energy.error_max < 1e-13


def test_a_connection_that_amounts_to_nothing_is_left_out():
    nothing = held([{"body": "s", "at": 0.3, "stiffness": 0.0}], force=PLUCK)
    without, with_it = (engine.render(scene, 0.1) for scene in (held([], force=PLUCK), nothing))
    assert "connections" in with_it.stats.effects.left_out
    assert without.audio.tobytes() == with_it.audio.tobytes()


@pytest.mark.parametrize("size", [1, 7, 64, 1000])
def test_blocks_of_any_size_give_the_same(size):
    from engine.offline.simulation import Simulation

    scene = engine.Scene.model_validate(choir(2, force=[{**PLUCK[0], "body": "string_0"}]))
    whole, parts = np.zeros((2000, 1)), np.zeros((2000, 1))
    for out, step in ((whole, 2000), (parts, size)):
        model, state, _ = build(scene, SAMPLERATE)
        simulation = Simulation(model, state)
        for begin in range(0, 2000, step):
            simulation.render_block(out[begin : begin + step])
    assert whole.tobytes() == parts.tobytes()
