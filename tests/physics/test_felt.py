"""Felt with memory: a share of the stiffness of a contact relaxes while it is pressed (docs/design.md)."""

import numpy as np
import pytest

import engine
from engine.compiler.decorators import kernel
from engine.kernel.contact.law import Laws, respond
from engine.kernel.data.enums import LAW_NUMBERS
from engine.kernel.data.felt_numbers import FeltNumber
from engine.kernel.data.laws import Law
from engine.live.player import Player

MASS, EXPONENT, STIFFNESS = 0.01, 2.5, 1e9
FELT = {"share": 0.4, "time": 1e-3}
START = -1e-4  # m, from where the hammer sets out


def blow(velocity: float, relaxation: dict | None, stiffness: float = STIFFNESS, again: float = 0.0, **more):
    """A hammer that strikes a fixed barrier, and once more with the same velocity at time `again`."""
    hammer = {"name": "hammer", "kind": "mass", "mass": MASS, "displacement": START, "velocity": velocity}
    felt = {"name": "felt", "body": "hammer", "barrier": 0.0, "stiffness": stiffness, "exponent": EXPONENT}
    strike = {"kind": "strike", "time": again, "body": "hammer", "velocity": velocity, "displacement": START}
    parts = {"gravity": 0.0, "body": [hammer], "contact": [felt | ({"relaxation": relaxation} if relaxation else {})]}
    parts |= {"event": [strike] if again else [], "pickup": [{"body": "hammer"}]}
    return engine.Scene.model_validate(parts | more)


def contacts_of(rendering) -> list[slice]:
    """The samples of each contact."""
    closed = np.concatenate([[0], rendering.trace["force"][:, 0] > 0.0, [0]]).astype(int)
    return [
        slice(*ends)
        for ends in zip(np.flatnonzero(np.diff(closed) == 1), np.flatnonzero(np.diff(closed) == -1), strict=True)
    ]


# --- against the felt of Stulov


def stulov(velocity: float, share: float, time: float, blows: int = 2, step: float = 1e-6) -> list[tuple[float, float]]:
    """The loop area, J, and the stiffness, peak force over the largest compression to the power α, of blows that follow
    each other at once: F = F0·[u^p - ε·w], τ·w' = u^p - w (Stulov 1995), by the midpoint rule."""
    w, found = 0.0, []

    def force(u: float, w: float) -> float:
        return max(0.0, STIFFNESS * (max(u, 0.0) ** EXPONENT - share * w))

    for _ in range(blows):
        u, v, area, peak, deepest, f = 0.0, velocity, 0.0, 0.0, 0.0, 1.0
        while v > 0.0 or f > 0.0:
            a, rate = -force(u, w) / MASS, (max(u, 0.0) ** EXPONENT - w) / time
            u_mid, w_mid, v_mid = u + 0.5 * step * v, w + 0.5 * step * rate, v + 0.5 * step * a
            f = force(u_mid, w_mid)
            area, peak, deepest = area + f * step * v_mid, max(peak, f), max(deepest, u)
            w += step * (max(u_mid, 0.0) ** EXPONENT - w_mid) / time
            u, v = u + step * v_mid, v - step * f / MASS
        found.append((area, peak / deepest**EXPONENT))
    return found


@pytest.mark.parametrize("velocity", [0.5, 2.0, 5.0])
def test_loop_and_second_blow_are_those_of_stulovs_felt(velocity):
    """Within 10 %, with one set of constants. Those of Stulov's felt, ε = 0.2 and τ = 1 ms, are chosen by the authors:
    its loop holds a fifth of the work at 2 m/s. Ours has 1.284 of its stiffness, of which 0.431 relaxes in 1.043 ms."""
    (area, _), (_, second) = stulov(velocity, 0.2, 1e-3)
    relaxation, stiffness = {"share": 0.431, "time": 1.043e-3}, 1.284 * STIFFNESS
    accuracy = {"substeps": 8}
    alone = engine.render(blow(velocity, relaxation, stiffness, accuracy=accuracy), 0.02, trace=True)
    assert 0.5 * MASS * (velocity**2 - alone.trace["velocity"][-1, 0] ** 2) == pytest.approx(area, rel=0.1)
    end = contacts_of(alone)[0].stop / alone.samplerate
    twice = engine.render(blow(velocity, relaxation, stiffness, again=end, accuracy=accuracy), end + 0.02, trace=True)
    assert stiffness_found(twice, contacts_of(twice)[-1]) == pytest.approx(second, rel=0.1)


# --- what memory means


def test_fast_blows_find_all_of_the_stiffness_and_a_weight_the_rest():
    """A blow of a hundredth of the relaxation time has the force of felt without memory; a weight sinks to where
    the share that does not relax holds it."""
    slow = {"share": 0.4, "time": 0.1}
    forces = [engine.render(blow(2.0, felt), 0.01, trace=True).trace["force"].max() for felt in (slow, None)]
    assert forces[0] == pytest.approx(forces[1], rel=0.01)
    push = {"body": "hammer", "kind": "constant", "amplitude": MASS * 9.81}
    parts = blow(0.0, {"share": 0.4, "time": 1e-3}, stiffness=1e6, force=[push]).model_dump(exclude_none=True)
    parts["body"][0]["damping_rate"] = 200.0
    depth = engine.render(engine.Scene.model_validate(parts), 1.0, trace=True).trace["displacement"][-1, 0]
    assert depth == pytest.approx((MASS * 9.81 / (0.6 * 1e6)) ** (1 / EXPONENT), rel=1e-3)


def stiffness_found(rendering, contact: slice) -> float:
    """The largest force of a contact over its largest compression to the power α, N/m^α."""
    force, compression = (rendering.trace[name][contact, 0] for name in ("force", "compression"))
    return force.max() / compression.max() ** EXPONENT


def test_a_blow_that_follows_soon_finds_softer_felt_and_one_that_follows_late_the_same():
    alone = engine.render(blow(2.0, FELT), 0.01, trace=True)
    first, end = stiffness_found(alone, contacts_of(alone)[0]), contacts_of(alone)[0].stop / alone.samplerate

    def second(pause: float) -> float:
        rendering = engine.render(blow(2.0, FELT, again=end + pause), end + pause + 0.01, trace=True)
        return stiffness_found(rendering, contacts_of(rendering)[-1])

    soon, later = second(1e-4), second(2e-3)
    assert soon < 0.95 * first and soon < later < first
    assert second(0.1) == pytest.approx(first, rel=1e-3)


def test_a_share_of_nothing_is_felt_without_memory():
    with_memory = engine.render(blow(2.0, {"share": 1e-12, "time": 1e-3}), 0.01)
    without = engine.render(blow(2.0, None), 0.01)
    assert np.abs(with_memory.audio - without.audio).max() <= 1e-10 * np.abs(without.audio).max()


# --- the motion, the energy, one solution


@pytest.mark.parametrize("velocity", [0.5, 5.0])
def test_the_motion_is_that_of_the_equations(velocity):
    """Against an independent integrator; the error falls with the square of the step."""
    from scipy.integrate import solve_ivp

    share, time = FELT["share"], EXPONENT * FELT["time"]

    def rates(_, y):
        u, v, z = y
        force = STIFFNESS * ((1 - share) * max(u, 0.0) ** EXPONENT + share * max(u - z, 0.0) ** EXPONENT)
        return [v, -force / MASS, (max(u, 0.0) - z) / time]

    frames = np.arange(300) / 44_100
    exact = solve_ivp(rates, (0, 0.01), [START, velocity, 0.0], "DOP853", frames, rtol=1e-12, atol=1e-15, max_step=1e-5)
    errors = []
    for steps in (1, 4, 16):
        audio = engine.render(blow(velocity, FELT, accuracy={"substeps": steps}), 0.01).audio[:300, 0]
        errors.append(np.abs(audio - exact.y[1]).max() / velocity)
    assert errors[0] < 2e-3 and errors[2] < 2e-5
    assert errors[1] < errors[0] / 8 and errors[2] < errors[1] / 8


STRING = {
    "name": "string",
    "kind": "string",
    "length": 0.62,
    "mass": 4e-3,
    "tension": 670.0,
    "modes": 40,
    "sigma0": 3.0,
}


def struck_string(**more) -> engine.Scene:
    """Two hammers of felt with memory on a string, which meets a hard stop, too."""
    hammers = [
        {"name": f"hammer{n}", "kind": "mass", "mass": 3e-3, "displacement": -1e-3 * n, "velocity": 2.0 + n}
        for n in (1, 2)
    ]
    felts = [
        {
            "body": f"hammer{n}",
            "on": "string",
            "on_at": 0.12 * n,
            "stiffness": 4e9,
            "exponent": 2.5,
            "relaxation": FELT,
        }
        for n in (1, 2)
    ]
    stop = {"body": "string", "at": 0.5, "barrier": 1e-3, "stiffness": 1e7, "exponent": 1.5}
    parts = {
        "body": [STRING, *hammers],
        "contact": [*felts, stop],
        "pickup": [{"body": "string", "at": 0.4, "gain": 0.05}],
    }
    return engine.Scene.model_validate({"gravity": 0.0, **parts, **more})


SETTINGS = [{}, {"substeps": 4}, {"max_error": 1e-4}, {"scheme": "fdh"}]


@pytest.mark.parametrize(
    "accuracy", [SETTINGS[0], *(pytest.param(a, marks=pytest.mark.hard) for a in SETTINGS[1:])], ids=str
)
def test_the_ledger_closes_and_felt_only_takes_energy(accuracy):
    """Several contacts, solved together, some of them with memory."""
    rendering = engine.render(struck_string(accuracy=accuracy), 0.05, trace=True)
    assert rendering.stats.trusted and rendering.stats.energy["error_max"] <= 1e-12
    assert rendering.stats.effects["compiled"].count("felt with memory") == 1
    assert np.diff(rendering.trace["dissipated"]).min() >= -1e-15 and rendering.trace["dissipated"][-1] > 1e-4


def test_several_contacts_converge_to_one_motion():
    exact = engine.render(struck_string(accuracy={"substeps": 64}), 0.005).audio
    errors = [
        np.abs(engine.render(struck_string(accuracy={"substeps": steps}), 0.005).audio - exact).max()
        / np.abs(exact).max()
        for steps in (1, 4, 16)
    ]
    assert errors[0] < 0.05 and errors[1] < errors[0] / 4 and errors[2] < errors[1] / 4


def test_samples_depend_neither_on_blocks_nor_on_when_a_note_is_told():
    scene = struck_string()
    whole = engine.render(scene, 0.05).audio
    player = Player(scene, 44_100, 0.05)
    parts = [np.zeros((frames, 1), np.float32) for frames in (1, 17, 64, 300, 700)]
    for part in parts:
        player.render_into(part)
    played = np.concatenate(parts)[:, 0]
    np.testing.assert_array_equal(played[300:], whole[300 : len(played), 0].astype(np.float32)[: len(played) - 300])


@pytest.mark.parametrize(
    "accuracy", [SETTINGS[0], *(pytest.param(a, marks=pytest.mark.hard) for a in SETTINGS[1:])], ids=str
)
@pytest.mark.parametrize(
    "change", [{"barrier": -1e-3, "duration": 0.0}, {"barrier": -6e-3, "duration": 1e-3}], ids=["jump", "glide"]
)
def test_a_barrier_that_moves_into_felt_supplies_what_the_felt_then_holds(change, accuracy):
    """The hammer has left, and the felt has not come back yet, when the barrier follows: the felt is brought up to that
    time before the energy is counted."""
    alone = engine.render(blow(2.0, FELT), 0.01, trace=True)
    time = contacts_of(alone)[0].stop / alone.samplerate + 1e-4
    move = {"kind": "change", "time": time, "contact": "felt", **change}
    rendering = engine.render(blow(2.0, FELT, event=[move], accuracy=accuracy), time + 0.01, trace=True)
    assert len(contacts_of(rendering)) == 2 and rendering.stats.energy["supplied"] > 1e-3
    assert rendering.stats.energy["error_max"] <= 1e-12


@kernel
def respond_to_all(laws, s, eta, force, slope):
    for i in range(eta.shape[0]):
        force[i], slope[i] = respond(laws, 0, s, eta[i])


def test_the_force_never_falls_as_the_body_moves_on():
    """So that the equation of a step has one solution: any compression, creep, length of the step and exponent; and the
    slope is that of the force."""
    rng, found = np.random.default_rng(3), 0
    for _ in range(2000):
        numbers = np.zeros((1, LAW_NUMBERS))
        numbers[0, FeltNumber.SHARE], numbers[0, FeltNumber.LENGTH] = rng.uniform(0.01, 0.99), 1.0
        numbers[0, FeltNumber.RATE], numbers[0, FeltNumber.CREPT] = 10 ** rng.uniform(-4, 1.5), rng.uniform(0.0, 1.0)
        law = Law(np.ones(1), np.array([rng.choice([1.0, 1.3, 1.5, 2.5, 4.0])]))
        eta, s = np.sort(rng.uniform(-2.0, 2.0, 400)), rng.uniform(-1.0, 1.0)
        force, slope = np.zeros((2, 400))
        respond_to_all(Laws(law, np.zeros(1), numbers), s, eta, force, slope)
        assert force.min() >= 0.0 and np.diff(force).min() >= -1e-13 * force.max()
        measured = np.diff(force) / np.diff(eta)
        between = np.minimum(slope[:-1], slope[1:]) - 1e-6 <= measured
        found += np.mean(between & (measured <= np.maximum(slope[:-1], slope[1:]) + 1e-6)) > 0.9
    assert found > 1900


def test_what_felt_cannot_be_combined_with_is_refused():
    with pytest.raises(ValueError, match="loss and relaxation are both given; give one of them"):
        parts = blow(2.0, FELT).model_dump(exclude_none=True)
        parts["contact"][0]["loss"] = 1.0
        engine.Scene.model_validate(parts)
    with pytest.raises(ValueError, match="contact has order 2, not 4: some steps of that order go back in time"):
        engine.render(blow(2.0, FELT), 0.01, order=4)


BRIDGE = {"name": "bridge", "kind": "oscillator", "mass": 0.05, "stiffness": 2e4, "damping_rate": 20.0}
BOW = {"body": "string", "at": 0.13, "velocity": 0.2, "force": 0.5}
COMPANY = {
    "a string that stretches": ({"axial_stiffness": 1e5}, {}),
    "an end that moves": ({}, {"connection": [{"kind": "end", "body": "string", "at": 1.0, "on": "bridge"}]}),
    "a bow": ({}, {"friction": [BOW]}),
    "a force": (
        {},
        {"force": [{"body": "string", "at": 0.3, "kind": "half_sine", "amplitude": 5.0, "duration": 2e-3}]},
    ),
    "a stiffness that glides": (
        {},
        {"event": [{"kind": "change", "time": 1e-3, "contact": "felt", "stiffness": 8e9, "duration": 3e-3}]},
    ),
    "a second blow": ({}, {"event": [{"kind": "strike", "time": 6e-3, "body": "hammer", "velocity": 3.0}]}),
}


def in_company(name: str, **more) -> engine.Scene:
    """A hammer of felt with memory on a string, and something else."""
    string, parts = COMPANY[name]
    hammer = {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 3.0}
    felt = {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4e9, "exponent": 2.5}
    bodies = [STRING | string, hammer, BRIDGE]
    pickup = [{"body": "string", "at": 0.4, "quantity": "displacement"}]
    scene = {"gravity": 0.0, "body": bodies, "contact": [felt | {"relaxation": FELT}], "pickup": pickup}
    return engine.Scene.model_validate(scene | parts | more)


@pytest.mark.hard
@pytest.mark.parametrize("name", COMPANY)
def test_felt_beside_everything_else(name):
    """The ledger closes with each kind of steps, and these converge to one motion."""
    settings = ({"substeps": 2}, {"substeps": 8}, {"max_error": 1e-5}, {"substeps": 64})
    renderings = [engine.render(in_company(name, accuracy=accuracy), 0.012, trace=True) for accuracy in settings]
    for rendering in renderings:
        assert rendering.stats.energy["error_max"] <= 1e-11 and rendering.stats.newton["reversed_steps"] == 0
        assert rendering.trace["force"][:, 0].max() > 1.0
    exact = renderings[-1].audio
    coarse, fine, chosen = (np.abs(r.audio - exact).max() / np.abs(exact).max() for r in renderings[:-1])
    assert fine < 0.25 * coarse or fine < 1e-4
    assert fine < 5e-3 and chosen < 1e-3


@pytest.mark.hard
@pytest.mark.parametrize("name", ["a bow", "an end that moves"])
def test_the_general_kernel_and_the_special_one_give_the_same(name):
    scene = in_company(name)
    one, other = (engine.render(scene, 0.02, trace=True, kernel=kernel) for kernel in ("general", "special"))
    assert one.audio.tobytes() == other.audio.tobytes() and one.stats.energy == other.stats.energy
