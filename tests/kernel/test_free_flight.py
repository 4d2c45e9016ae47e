"""Free flight: 64 samples at once are what single steps would have been, and nobody can tell when they were taken."""

import json
import math

import numpy as np
import pytest
from conftest import mostly_hard

import engine
from bench.scenes.small import scene
from engine.assembly.build import build
from engine.live.player import Player
from engine.live.replay import replay
from engine.offline.simulation import Simulation

RATE = 44_100
QUANTITIES = ("displacement", "velocity", "acceleration")


def ringing(modes: int, sigma: float, seed: int = 1) -> engine.Scene:
    """A body of many modes that nothing touches, heard in three ways."""
    rng = np.random.default_rng(seed)
    body = {
        "name": "body",
        "kind": "modes",
        "frequency": np.sort(rng.uniform(20.0, 20_000.0, modes)).tolist(),
        "sigma": [sigma] * modes,
        "points": {"ear": rng.uniform(-1.0, 1.0, modes).tolist()},
    }
    pickup = [{"body": "body", "at": "ear", "quantity": q, "channel": n + 1} for n, q in enumerate(QUANTITIES)]
    return engine.Scene.model_validate({"body": [body], "pickup": pickup})


def set_in_motion(scene: engine.Scene, seed: int = 2, **accuracy: object):
    """Its model and its state, with motion in every mode."""
    rng = np.random.default_rng(seed)
    model, state, _ = build(scene, RATE, scene.accuracy.replace(silence=-math.inf, **accuracy))
    state.p[:] = rng.normal(size=state.p.size)
    stiffness = np.ones(state.q.size) if model.omega_squared is None else np.maximum(model.omega_squared, 1.0)
    state.q[:] = rng.normal(size=state.q.size) / np.sqrt(stiffness)
    return model, state


@pytest.mark.parametrize("sigma", [0.0, 0.7, 300.0, 40_000.0], ids=str)
def test_decay_and_pitch_are_exact_to_the_last_digits(sigma):
    """Of each mode, alone: y[n+1] + e^(-2σh)·y[n-1] = 2·e^(-σh)·cos(ω_d·h)·y[n], within a flight and from one to the
    next; heavy damping makes it a sum of two exponentials."""
    for frequency in (20.0, 440.0, 5_000.0, 19_000.0):
        body = {"kind": "modes", "name": "body", "frequency": [frequency], "sigma": [sigma], "points": {"ear": [1.0]}}
        pickup = [{"body": "body", "at": "ear", "quantity": "displacement"}]
        model, state = set_in_motion(engine.Scene.model_validate({"body": [body], "pickup": pickup}))
        y = np.zeros((2000, 1))
        Simulation(model, state).render_block(y)
        y = y[np.abs(y[:, 0]) > 1e-250, 0]
        slow = np.sqrt(complex(sigma**2 - (2 * math.pi * frequency) ** 2)) / RATE
        residual = y[2:] + math.exp(-2 * sigma / RATE) * y[:-2]
        residual -= 2 * math.exp(-sigma / RATE) * np.cosh(slow).real * y[1:-1]
        assert len(residual) > 100
        assert np.abs(residual / np.maximum(np.abs(y[1:-1]), np.abs(y[2:]))).max() <= 1e-10
        largest = np.maximum.reduce([np.abs(y[2:]), np.abs(y[1:-1]), np.abs(y[:-2])])
        assert np.median(np.abs(residual) / largest) <= 1e-14


@pytest.mark.parametrize(
    ("sigma", "gravity"), mostly_hard([(2.0, 9.81), (0.0, 0.0), (0.0, 9.81), (2.0, 0.0)], (2.0, 9.81)), ids=str
)
def test_what_is_heard_is_what_single_steps_give(sigma, gravity):
    """Every quantity and channel, of many modes and of a mass that falls; a trace is made of single steps."""
    told = ringing(300, sigma).model_dump(mode="json", exclude_unset=True)
    told["gravity"] = gravity
    told["body"].append({"name": "stone", "kind": "mass", "mass": 2.0, "damping_rate": 3.0 * sigma})
    told["body"].append({"name": "reed", "kind": "oscillator", "mass": 1e-3, "frequency": 3.0, "displacement": 1e-2})
    told["pickup"] += [{"body": "stone", "quantity": q, "channel": 4 + n} for n, q in enumerate(QUANTITIES)]
    told["pickup"] += [{"body": "reed", "quantity": q, "channel": 7 + n} for n, q in enumerate(QUANTITIES)]
    found = engine.Scene.model_validate(told)
    flown, stepped = (set_in_motion(found) for _ in range(2))
    audio = np.zeros((2, 3000, 9))
    simulation = Simulation(*flown)
    simulation.render_block(audio[0])
    damper = {"kind": "damp", "body": "body", "sigma": 1e-300, "time": 0.0}  # goes on for good, and takes nothing
    told["event"] = [damper, damper | {"body": "stone"}, damper | {"body": "reed"}]
    stepped = set_in_motion(engine.Scene.model_validate(told))
    Simulation(*stepped).render_block(audio[1])
    assert flown[1].flight.frame[:, 0].all() and not stepped[1].flight.frame[:, 0].any()
    scale = np.abs(audio[1]).max(axis=0)
    np.testing.assert_array_less(np.abs(audio[0] - audio[1]).max(axis=0), 1e-12 * scale)
    assert simulation.energies().error_max <= 1e-13


@pytest.mark.hard
def test_the_balance_is_closed_over_a_minute():
    """Of 1000 modes with and without loss."""
    for sigma in (0.0, 0.05):
        simulation = Simulation(*set_in_motion(ringing(1000, sigma)))
        block = np.zeros((4096, 3))
        for _ in range(60 * RATE // len(block)):
            simulation.render_block(block)
        energies = simulation.energies()
        assert energies.error_max <= 1e-13
        assert energies.final / energies.initial == pytest.approx(math.exp(-2 * sigma * 60), rel=0.2)


def test_a_falling_body_does_not_drift(patch):
    """Over a minute of bounces without loss: the energy is off by rounding that goes both ways."""
    for samplerate in (44_100, 48_000):
        energy = engine.render(patch("bouncing_ball"), seconds=60.0, samplerate=samplerate).stats["energy"]
        assert energy["error_max"] <= 2e-13


# --- live = replay = offline


def busy() -> engine.Scene:
    """A hammer and a string, a reed with a stop, a plate that is plucked: much to happen, and much free flight."""
    body = [
        {
            "name": "string",
            "kind": "string",
            "length": 0.62,
            "mass": 4e-3,
            "tension": 670.0,
            "modes": 40,
            "sigma0": 3.0,
        },
        {"name": "hammer", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 2.0},
        {
            "name": "reed",
            "kind": "oscillator",
            "mass": 1e-3,
            "frequency": 90.0,
            "displacement": 1e-4,
            "damping_rate": 30.0,
        },
        {"name": "bell", "kind": "oscillator", "mass": 1e-3, "frequency": 700.0, "velocity": 1e-2, "damping_rate": 9.0},
    ]
    contact = [
        {"name": "felt", "body": "hammer", "on": "string", "on_at": 0.12, "stiffness": 4e9, "exponent": 2.5},
        {"name": "stop", "body": "reed", "barrier": 1e-3, "stiffness": 1e7, "exponent": 1.5},
    ]
    pickup = [
        {"body": "string", "at": 0.4},
        {"body": "reed", "quantity": "acceleration", "gain": 1e-4, "channel": 2},
        {"body": "bell", "quantity": "displacement", "channel": 2},
    ]
    return scene(body, contact=contact, pickup=pickup, gravity=1e-3)


def score(seed: int, frames: int) -> list[dict]:
    """Events at random frames; those that last are over before the next."""
    rng, events = np.random.default_rng(seed), list[dict]()
    for frame in np.sort(rng.choice(np.arange(50, frames), 25, replace=False)).tolist():
        when = {"time": frame / RATE}
        events.append(
            [
                {"kind": "strike", "body": "hammer", "velocity": float(rng.uniform(0.5, 4)), "displacement": -1e-3},
                {"kind": "strike", "body": "reed", "velocity": float(rng.uniform(0.1, 1)), "displacement": 0.0},
                {"kind": "strike", "body": "bell", "velocity": float(rng.uniform(0.1, 1)), "displacement": 0.0},
                {"kind": "damp", "body": "bell", "sigma": float(rng.uniform(1, 500)), "duration": 0.001},
                {"kind": "change", "contact": "stop", "stiffness": float(10 ** rng.uniform(5, 9)), "duration": 0.001},
            ][int(rng.integers(5))]
            | when
        )
    return events


def play(player: Player, events: list[dict], frames: int, seed: int) -> np.ndarray:
    """What a player gives in random blocks, told each event at random some time before it is due."""
    rng = np.random.default_rng(seed)
    due = [(round(event["time"] * RATE), event) for event in events]
    told = [max(0, frame - int(rng.choice([0, 1, 30, 200]))) for frame, _ in due]
    out, at = np.zeros((frames, player.channels), np.float32), 0
    while at < frames:
        for when, (frame, event) in list(zip(told, due, strict=True)):
            if when == at:
                _tell(player, event, frame)
        later = [when for when in told if when > at]
        size = min(int(rng.integers(1, 700)), min([*later, frames]) - at)
        player.render_into(out[at : at + size])
        at += size
    return out


def _tell(player: Player, event: dict, frame: int) -> None:
    if event["kind"] == "strike":
        player.strike(event["body"], event["velocity"], event["displacement"], frame)
    elif event["kind"] == "damp":
        player.damp(event["body"], event["sigma"], event["duration"], frame)
    else:
        player.set(f"contact.{event['contact']}.stiffness", event["stiffness"], event["duration"], frame)


@pytest.mark.parametrize(
    "seed", [1, 2, pytest.param(3, marks=pytest.mark.hard), pytest.param(4, marks=pytest.mark.hard)]
)
def test_live_is_replay_is_offline(seed):
    """Bit for bit: an event that was known from the start and one that came in the middle of a flight give the same,
    in blocks of any size, on one core and on two."""
    frames, gain = 30_000, 2.0**-8
    events = score(seed, frames)
    told = busy().model_copy(
        update={"event": engine.Scene.model_validate(busy().model_dump() | {"event": events}).event}
    )
    one, two = (engine.render(told, seconds=frames / RATE, cores=cores) for cores in (1, 2))
    np.testing.assert_array_equal(one.audio, two.audio)
    player = Player(busy(), gain=gain, seconds=math.inf)
    heard = play(player, events, frames, seed)
    fade = 2000
    np.testing.assert_array_equal(heard[fade:], (one.audio * gain).astype(np.float32)[fade:])
    np.testing.assert_array_equal(replay(json.loads(json.dumps(player.log())))[: len(heard)], heard)
    assert player.meter()["energy_error"] <= 1e-12 and one.stats["energy"]["error_max"] <= 1e-12
    assert player.state.flight.frame[:, 0].any()  # it did fly
