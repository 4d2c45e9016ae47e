"""Live sound: the compiled callback gives the offline samples at any block size; what was played can be replayed."""

import ctypes
import json
import math

import numpy as np
import pytest
from conftest import ROOT, mostly_hard
from numba import typeof

import engine
from engine.assembly.build import build
from engine.kernel.data.enums import Sleep
from engine.live import audio_thread, kernels
from engine.live.audio_memory import coarser_models
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.shared_memory import Gauge, Slot

PIANO, TANPURA, RATTLE = (ROOT / "patches" / f"{name}.toml" for name in ("piano_c4", "tanpura", "rattle"))
ANSWER = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p
)


def called(player: Player, frames: int, sizes: np.ndarray, flags: int = 0) -> np.ndarray:
    """What the callback gives a driver that asks for blocks of these sizes, over and over."""
    answer = ANSWER(kernels.portaudio_callback())
    out, at, n = np.full((frames, player.channels), np.nan, np.float32), 0, 0
    while at < frames:
        size = min(int(sizes[n % len(sizes)]), frames - at)
        answer(None, out[at:].ctypes.data, size, None, flags, player.memory.address)
        at, n = at + size, n + 1
    return out


@pytest.mark.parametrize("path", mostly_hard([PIANO, TANPURA], PIANO), ids=lambda p: p.stem)
def test_the_callback_gives_the_offline_samples(path):
    """Bit for bit, in random blocks of 1 to 1023 frames; but for the fades."""
    scene, gain = engine.load(path), 1 / 64
    frames = 30_000
    player = Player(scene, gain=gain)
    heard = called(player, frames, np.random.default_rng(1).integers(1, 1024, 200))
    wanted = (engine.render(scene, seconds=frames / 44_100).audio * gain).astype(np.float32)
    fade = int(player.counters[Slot.FADE_IN_FRAMES])
    np.testing.assert_array_equal(heard[fade:], wanted[fade:])
    assert np.abs(heard[:fade]).max() <= np.abs(wanted[:fade]).max()
    assert player.counters[Slot.CALLS] > 50 and player.meter()["limited"] == 0


TREMOLO = {"rate": 5.0, "depth": 0.8, "spread": 0.5}
HEARD = {"body": "string", "at": 0.3}


def test_a_tremolo_is_the_same_live_and_rendered():
    """The left is loud where the right is soft: the factor is 1 - depth·sin²(π(rate·t + spread)); no body feels it."""
    document = engine.load(PIANO).model_dump(exclude_none=True) | {"pickup": [HEARD, HEARD | {"channel": 2}]}
    steady, scene = engine.load(document), engine.load(document | {"tremolo": TREMOLO})
    frames, gain = 30_000, 1 / 64
    player = Player(scene, gain=gain)
    heard = called(player, frames, np.random.default_rng(1).integers(1, 1024, 200))
    rendered, plain = (engine.render(one, seconds=frames / 44_100) for one in (scene, steady))
    fade = int(player.counters[Slot.FADE_IN_FRAMES])
    np.testing.assert_allclose(heard[fade:], (rendered.audio * gain)[fade:], rtol=1e-6, atol=1e-12)
    time = np.arange(frames)[:, None] / 44_100
    factor = 1.0 - 0.8 * np.sin(np.pi * (5.0 * time + [0.0, 0.5])) ** 2
    assert np.abs(rendered.audio - plain.audio * factor).max() < 0.003 * np.abs(plain.audio).max()
    assert rendered.stats["energy"] == plain.stats["energy"]


def disturbed(player: Player, frames: int, seed: int) -> np.ndarray:
    """Play with strikes, dampers and knobs at random moments."""
    rng = np.random.default_rng(seed)
    knobs = [path for path, live in player.live_paths.items() if live.is_glided]
    out, at = np.zeros((frames, player.channels), np.float32), 0
    while at < frames:
        size = int(rng.integers(1, 800))
        if rng.random() < 0.15:
            player.strike(velocity=float(rng.uniform(0.5, 6.0)) if rng.random() < 0.5 else None, frame=at + 100)
        if rng.random() < 0.05:
            player.damp(sigma=float(10 ** rng.uniform(0, 3)), seconds=0.1)
        if rng.random() < 0.3:
            name = knobs[int(rng.integers(len(knobs)))]
            place = float(rng.uniform(-1e-4, 1e-4))
            values = {"stiffness": float(10 ** rng.uniform(6, 11)), "exponent": float(rng.uniform(1, 4))}
            player.set(name, values.get(name.rpartition(".")[2], place), 0.01)
        player.render_into(out[at : at + size])
        at += size
    return out


def named(path) -> engine.Scene:
    """A patch whose contacts all have names."""
    scene = engine.load(path)
    contacts = [c.model_copy(update={"name": c.name or f"contact{n}"}) for n, c in enumerate(scene.contact)]
    return scene.model_copy(update={"contact": contacts})


@pytest.mark.parametrize("path", mostly_hard([PIANO, TANPURA, RATTLE], PIANO), ids=lambda p: p.stem)
def test_a_replay_of_the_log_is_what_was_played(path):
    """Bit for bit; the log goes through JSON. And nothing that was done could blow up the sound."""
    player = Player(named(path), gain=0.01, seconds=math.inf)
    played = disturbed(player, 60_000, seed=3)
    player.stop()
    end = np.zeros((1000, player.channels), np.float32)
    player.render_into(end)
    assert player.finished
    log = json.loads(json.dumps(player.log()))
    assert len(log["events"]) > 20 and all(e["frame"] is not None for e in log["events"])
    again = replay(log)
    np.testing.assert_array_equal(again, np.concatenate([played, end])[: len(again)])
    now = player.meter()
    assert np.isfinite(played).all() and played.any()
    assert now["newton"]["unconverged"] == 0
    assert now["energy_error"] <= 1e-10


def test_an_event_comes_at_its_frame():
    scene = engine.load(PIANO).model_copy(update={"event": []})
    player, plain = Player(scene, gain=0.1), Player(scene, gain=0.1)
    with_strike, without = (np.zeros((12_000, player.channels), np.float32) for _ in range(2))
    player.strike(velocity=5.0, displacement=-1e-3, frame=10_000)
    player.render_into(with_strike)
    plain.render_into(without)
    np.testing.assert_array_equal(with_strike[:10_000], without[:10_000])
    assert not np.array_equal(with_strike[10_000:], without[10_000:])


@pytest.mark.hard
def test_a_pluck_comes_again():
    player = Player(engine.load(TANPURA), gain=0.01, seconds=math.inf)
    first, later = np.zeros((44_100, player.channels), np.float32), np.zeros((4 * 44_100, player.channels), np.float32)
    player.render_into(first)
    player.render_into(later)
    player.strike()
    again = np.zeros_like(first)
    player.render_into(again)
    assert np.abs(again).max() > 5 * np.abs(later[-4410:]).max()
    assert player.meter()["energy_error"] <= 1e-12


def test_fades_and_the_end():
    """5 ms in and out, without a step; then silence, and the driver is told."""
    bodies = [{"name": "b", "kind": "oscillator", "mass": 1.0, "frequency": 1.0, "displacement": 1.0}]
    told = {"body": bodies, "pickup": [{"body": "b", "quantity": "displacement"}]}
    player = Player(engine.Scene.model_validate(told), seconds=0.1, gain=0.5)
    heard = called(player, 6000, np.array([256]))[:, 0]
    assert heard[0] < 0.01 and 0.45 < heard[441] < 0.51
    assert np.abs(np.diff(heard)).max() < 0.01
    assert not heard[4410:].any() and heard[4408] != 0.0
    assert player.counters[Slot.FINISHED] == 1
    stopped = Player(engine.Scene.model_validate(told), seconds=math.inf, gain=0.5)
    stopped.render_into(np.zeros((1000, 1), np.float32))
    stopped.stop()
    out = np.zeros((1000, 1), np.float32)
    stopped.render_into(out)
    assert out[0] > 0.4 and not out[221:].any() and stopped.finished


def test_the_limiter_keeps_within_full_scale_and_counts():
    player = Player(engine.load(PIANO), gain=30.0)
    heard = called(player, 20_000, np.array([256]))
    assert np.abs(heard).max() <= 1.0
    assert player.meter()["limited"] > 100


def test_the_driver_running_dry_is_counted():
    player = Player(engine.load(PIANO))
    called(player, 1024, np.array([256]), flags=audio_thread.OUTPUT_UNDERFLOW)
    assert player.meter()["dropouts"] == 4


def test_too_many_events_are_dropped_and_said():
    player = Player(engine.load(PIANO))
    for _ in range(1100):
        player.strike("hammer")
    player.render_into(np.zeros((256, player.channels), np.float32))
    events = player.log()["events"]
    done = [e for e in events if e["frame"] is not None]
    assert len(events) == 1100 and len(done) == 64  # of 1024 that the ring held, so many fit an island's score
    assert player.meter()["dropped"] == 1100 - 64
    assert player.meter()["energy_error"] <= 1e-12


def test_what_cannot_be_done_is_said():
    player = Player(engine.load(PIANO))
    with pytest.raises(
        KeyError,
        match=r"no live parameter contact\.velvet\.stiffness; the live parameters are contact\.felt\.stiffness",
    ):
        player.set("contact.velvet.stiffness", 1.0)
    with pytest.raises(KeyError, match="there is no body anvil; the bodies are string, hammer"):
        player.strike("anvil")
    with pytest.raises(KeyError, match="string is not a hammer"):
        player.strike("string")
    with pytest.raises(ValueError, match=r"contact\.felt\.stiffness = 1e\+99 is out of range"):
        player.set("contact.felt.stiffness", 1e99)
    with pytest.raises(ValueError, match="float32"):
        player.render_into(np.zeros((10, 2)))


def test_what_was_played_can_be_fetched():
    player = Player(engine.load(PIANO), gain=0.1)
    out = np.zeros((9000, player.channels), np.float32)
    fetched = []
    for begin in range(0, 9000, 900):
        player.render_into(out[begin : begin + 900])
        fetched.append(player.fetch_recording())
    np.testing.assert_array_equal(np.concatenate(fetched), out)


@pytest.fixture
def voices():
    """Three strings with hammers, refined."""
    body, contact, pickup = [], [], []
    for i, pitch in enumerate((220.0, 330.0, 440.0)):
        string = {"name": f"s{i}", "kind": "string", "length": 0.6, "mass": 4e-3, "frequency": pitch, "sigma0": 0.5}
        hammer = {"name": f"h{i}", "kind": "mass", "mass": 3e-3, "displacement": -1e-3, "velocity": 1.0 + i}
        body += [string, hammer]
        contact.append({"body": f"h{i}", "on": f"s{i}", "on_at": 0.12, "stiffness": 4.5e9, "exponent": 2.5})
        pickup.append({"body": f"s{i}", "at": 0.9})
    accuracy = {"order": 4, "substeps": 4}
    return engine.Scene.model_validate({"body": body, "contact": contact, "pickup": pickup, "accuracy": accuracy})


def test_quality_steps_down_before_the_sound_breaks_and_up_again(voices):
    """From order 4 to one plain step, then the quietest voices sleep; energy is exact at every level, each step is
    counted, and a replay takes the same ones."""
    player = Player(voices, gain=0.05, seconds=math.inf)
    sizes = np.array([256])
    player.gauges[Gauge.LOAD_HIGH] = math.inf  # however slow this machine is
    calm = called(player, 8192, sizes)
    assert player.meter()["quality_steps"] == 0
    player.gauges[Gauge.LOAD_HIGH], player.gauges[Gauge.LOAD_LOW] = -1.0, -2.0  # every block is near its deadline
    rough = called(player, 8192, sizes)
    now = player.meter()
    assert now["quality"] == -5  # 4 × 4, order 2: 4 ×, 2 ×, 1 ×; then one voice of three, then two asleep
    assert now["awake"] == 1 and np.isfinite(rough).all() and rough.any()
    player.strike()
    player.gauges[Gauge.LOAD_HIGH], player.gauges[Gauge.LOAD_LOW] = math.inf, math.inf  # every block is at ease
    better = called(player, 8 * 44_100, sizes)
    now = player.meter()
    assert now["quality"] == 0
    assert now["quality_steps"] == 9 and now["energy_error"] <= 1e-12
    again = replay(json.loads(json.dumps(player.log())))
    np.testing.assert_array_equal(again, np.concatenate([calm, rough, better]))


def test_other_channels_cannot_take_over():
    scene = engine.load(PIANO)
    mono = scene.model_copy(update={"pickup": [p.model_copy(update={"channel": 1}) for p in scene.pickup]})
    player = Player(scene)
    with pytest.raises(ValueError, match="stop and start again"):
        player.cross_fade_to(Player(mono))


def test_a_damper_ends_as_in_the_score_if_an_event_comes_at_its_last_sample():
    """The event is put in as the damper is over: the next step is one without a damper."""
    frame = 3_000
    damper = {"kind": "damp", "time": 0.0, "body": "string", "sigma": 50.0, "duration": frame / 44_100}
    strike = {"kind": "strike", "time": (frame + 500) / 44_100, "body": "hammer", "velocity": 3.0}
    damped, scored = (
        engine.Scene.model_validate(engine.load(PIANO).model_dump(exclude_none=True) | {"event": events})
        for events in ([damper], [damper, strike])
    )
    wanted = engine.render(scored, seconds=0.3).audio
    player = Player(damped, gain=0.01, seconds=math.inf)
    out = np.zeros((len(wanted), player.channels), np.float32)
    player.render_into(out[:frame])
    player.strike("hammer", velocity=3.0, frame=frame + 500)
    player.render_into(out[frame:])
    assert np.abs(out[300:] / np.float32(0.01) - wanted[300:]).max() <= 1e-6 * np.abs(wanted).max()


@pytest.mark.parametrize("frame", [10_001, 10_020, 10_048, 10_049, 10_063])
def test_an_event_at_once_is_as_one_of_the_score(frame):
    """Wherever it falls among the samples at which the engine looks at what is near: here the string is in free
    flight, and its compressions are not kept up to date."""
    scene = engine.load(PIANO).model_copy(update={"event": []})
    strike = {"kind": "strike", "time": frame / 44_100, "body": "hammer", "velocity": 3.0, "displacement": -1e-4}
    scored = engine.Scene.model_validate(scene.model_dump(exclude_none=True) | {"event": [strike]})
    wanted = engine.render(scored, seconds=0.3).audio
    player = Player(scene, gain=0.01, seconds=math.inf)
    out = np.zeros((len(wanted), player.channels), np.float32)
    player.render_into(out[:frame])
    player.strike("hammer", velocity=3.0, displacement=-1e-4)
    player.render_into(out[frame:])
    assert np.abs(out[300:] / np.float32(0.01) - wanted[300:]).max() <= 1e-6 * np.abs(wanted).max()


def test_the_knob_turned_last_wins():
    player = Player(engine.load(PIANO), gain=0.01, seconds=math.inf)
    player.set("contact.felt.stiffness", 1e9, seconds=0.5)
    player.render_into(np.zeros((441, player.channels), np.float32))
    player.set("contact.felt.stiffness", 9e9, seconds=0.02)
    player.render_into(np.zeros((44_100, player.channels), np.float32))
    assert player.state.potential_coefficient[0] == pytest.approx(9e9 / 3.5)


@pytest.mark.parametrize("start", [0, 64, 640])
def test_quality_may_change_while_hammers_touch(voices, start):
    """The next step has another length then, and what was known of it no longer holds."""
    player = Player(voices, gain=0.01, seconds=math.inf)
    player.gauges[Gauge.LOAD_HIGH], player.gauges[Gauge.LOAD_LOW] = math.inf, -2.0
    if start:
        called(player, start, np.array([64]))
    player.gauges[Gauge.LOAD_HIGH] = -1.0
    called(player, 256, np.array([64]))
    player.gauges[Gauge.LOAD_HIGH] = math.inf
    called(player, 4096, np.array([64]))
    assert player.meter()["quality_steps"] >= 3 and player.state.contact_samples[0] > 0
    assert player.meter()["energy_error"] <= 1e-12


def test_what_reduced_quality_drops_is_at_rest_and_misses_nothing(voices):
    """Its vibration is gone, a hammer in flight flies on, what the score says comes in its time, and the last voice is
    never silenced."""
    strike = {"kind": "strike", "time": 0.5, "body": "h0", "velocity": 3.0, "displacement": -1e-3}
    told = voices.model_dump(exclude_none=True) | {"event": [strike]}
    player = Player(engine.Scene.model_validate(told), gain=0.01, seconds=math.inf)
    called(player, 2048, np.array([64]))
    player.gauges[Gauge.LOAD_HIGH], player.gauges[Gauge.LOAD_LOW] = -1.0, -2.0
    called(player, 8192, np.array([64]))
    player.gauges[Gauge.LOAD_HIGH] = math.inf
    dropped = [n for n in range(3) if player.state.sleep[n, Sleep.WAKE_FRAME] > player.frame]
    assert len(dropped) == 2 and 0 in dropped
    for n in dropped:
        modes = slice(*player.model.islands.mode[[n, n + 1]])
        vibrates = player.model.omega_squared[modes] > 0.0
        assert not player.state.q[modes][vibrates].any() and not player.state.p[modes][vibrates].any()
        assert player.state.p[modes][~vibrates].all()  # its hammer
    solves = player.state.contact_samples[0]
    called(player, 22_050, np.array([64]))
    assert player.state.contact_samples[0] > solves  # the hammer of the first voice has struck
    assert player.meter()["energy_error"] <= 1e-12


def test_what_is_not_a_number_is_silent_and_said():
    player = Player(engine.load(PIANO), gain=0.1)
    player.state.q[3] = np.nan
    heard = called(player, 2000, np.array([256]))
    assert np.isfinite(heard).all()
    assert player.meter()["not_finite"] > 0 and player.meter()["energy_error"] == math.inf
    with pytest.raises(ValueError, match="gain"):
        Player(engine.load(PIANO), gain=math.nan)


@pytest.mark.parametrize(
    "change",
    [
        {"scene": {}},
        {"samplerate": "abc"},
        {"samplerate": 10**9},
        {"end": -5},
        {"frames": 10**15},
        {"events": 5},
        {"gain": "x"},
        {"voices": -1},
        {"events": [{"frame": 10, "why": []}]},
        {"events": [{"frame": 10, "why": [], "row": [0, 10**7, 0, 1, 0, 1, 0, 0]}]},
        {"events": [{"frame": 10, "why": [], "row": [0, 0, 10**7, 10**7 + 1, 0, 1, 0, 0]}]},
        {"events": [{"frame": 10, "why": [], "row": [10, 0, -(10**6), 0, 0, 1, 0, 0]}]},
        {"events": [{"frame": 10, "why": [], "row": [11, 0, 1, 1, 4096, 1, 0, 0]}]},
        {"events": [{"frame": 10, "why": ["tune", 9, 1.0], "row": [11, 0, 1, 1, 4096, 1, 0, 0]}]},
    ],
    ids=str,
)
def test_a_bad_log_is_refused(change):
    player = Player(engine.load(PIANO), gain=0.1)
    player.render_into(np.zeros((100, player.channels), np.float32))
    with pytest.raises((ValueError, IndexError)):
        replay(json.loads(json.dumps(player.log() | change)))


@pytest.mark.hard
def test_a_voice_is_as_if_built_at_its_pitch():
    """Bit for bit; and retuning voices that sound keeps the balance of energy."""
    scene = engine.load(PIANO)
    for ratio in (0.5, 1.0, 1.7):
        player = Player(scene, gain=0.1, seconds=math.inf, voices=3, lowest=0.5)
        player.tune(1, ratio)
        player.strike("hammer_1")
        tuned = np.zeros((8820, player.channels), np.float32)
        player.render_into(tuned)
        alone = Player(scene, gain=0.1, seconds=math.inf, voices=1, lowest=ratio)
        alone.strike("hammer_0")
        built = np.zeros_like(tuned)
        alone.render_into(built)
        np.testing.assert_array_equal(tuned, built)
    with pytest.raises(ValueError, match=r"ratio = 0\.4 is out of range; give at least 0\.5"):
        player.tune(1, 0.4)
    rng = np.random.default_rng(5)
    out = np.zeros((20 * 1000, player.channels), np.float32)
    for begin in range(0, len(out), 1000):
        voice = int(rng.integers(3))
        player.tune(voice, float(2 ** rng.uniform(-1, 1)))
        player.strike(f"hammer_{voice}", float(rng.uniform(1, 5)))
        player.render_into(out[begin : begin + 1000])
    assert player.meter()["energy_error"] <= 1e-12 and player.meter()["newton"]["unconverged"] == 0


@pytest.mark.parametrize("order", [2, 4, 6])
def test_coarser_models_run_in_the_kernel_of_the_finest(order):
    """Also where loss of contacts, dampers and heavily damped modes act elsewhere at order 2."""
    string = {"name": "s", "kind": "string", "length": 0.6, "mass": 4e-3, "tension": 670.0, "modes": 10, "sigma0": 1.0}
    parts = {
        "body": [string | {"residual": True}, {"name": "h", "kind": "mass", "mass": 3e-3, "velocity": 2.0}],
        "contact": [{"body": "h", "on": "s", "on_at": 0.12, "stiffness": 4e9, "exponent": 2.5, "loss": 0.02}],
        "connection": [{"body": "s", "at": 0.3, "damping_coefficient": 0.01}],
        "pickup": [{"body": "s", "at": 0.4}],
    }
    scene = engine.Scene.model_validate(parts)
    accuracy = scene.accuracy.replace(order=order, substeps=4)
    built = build(scene, 44_100, accuracy)
    coarser = coarser_models(built, accuracy)
    assert len(coarser) == (2 if order == 2 else 3)
    assert {typeof(model) for model in coarser} == {typeof(built.model)}
