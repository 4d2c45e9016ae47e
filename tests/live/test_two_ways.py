"""The same events give the same samples: as a file or at a port, early or late, in blocks of any size, or replayed."""

import json
import random
from pathlib import Path
from typing import Any, NamedTuple

import mido
import numpy as np
import pytest
from conftest import mostly_hard

import engine
from engine.instrument.expansion import keys_of
from engine.live.midi import render_notes
from engine.live.midi_notes import Note
from engine.live.midi_parts import Excerpt
from engine.live.player import Player
from engine.live.replay import replay
from engine.live.voice_allocator import VoiceAllocator
from engine.patch.scene import Scene
from tests.live.two_ways import (
    BY_SAMPLE,
    GAIN,
    KINDS,
    RATE,
    WAYS,
    Message,
    Way,
    count_differences,
    draw_messages,
    largest_difference,
    make_player,
    play_port,
    play_told,
    render_file,
    save_messages,
)

INSTRUMENTS = (
    *("guitar", "guitar_slide", "kalimba_keys", "marimba_keys", "piano", "sitar", "snare", "tanpura_body", "toms"),
    *("vibraphone", "violin", "kit"),
)
AT_ITS_FRAME = Way("at its frame", 0)
FRAMES = RATE // 2


# --- keys: a MIDI file that is rendered, and the same messages at a port


def assert_same_two_ways(name: str, kind: str, seed: int, frames: int, ways: Any, folder: Path) -> None:
    """Assert that a rendered file and a port give the same samples, that nothing is dropped, and that logs replay."""
    scene = engine.load(name)
    messages = draw_messages(scene, kind, seed, frames)
    rendered, keys = render_file(scene, messages, frames, folder)
    assert rendered.any()
    for way in ways:
        session = play_port(scene, messages, frames, way, keys, cores=1 + seed % 2)
        assert session.player.meter().dropped == 0, way
        assert count_differences(session.audio, rendered) == 0, way
        replayed = replay(json.loads(json.dumps(session.player.log())))
        assert count_differences(replayed, session.audio) == 0, way


@pytest.mark.hard_for("guitar")
@pytest.mark.parametrize("name", mostly_hard(INSTRUMENTS, "guitar", "violin", "vibraphone"))
def test_a_port_gives_the_samples_of_the_file(name: str, tmp_path: Path) -> None:
    kind = KINDS[INSTRUMENTS.index(name) % len(KINDS)]
    ways = (AT_ITS_FRAME, random.Random(name).choice(WAYS))
    assert_same_two_ways(name, kind, 0, FRAMES, ways, tmp_path)


@pytest.mark.hard
@pytest.mark.parametrize("name", ["guitar", "violin", "vibraphone"])
def test_repeated_keys_give_the_samples_of_the_file_in_any_block(name: str, tmp_path: Path) -> None:
    assert_same_two_ways(name, "repeated", 1, FRAMES // 2, (BY_SAMPLE, *WAYS), tmp_path)


@pytest.mark.slow_but_each(2)
@pytest.mark.hard
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_port_gives_the_samples_of_the_file_whatever_is_played(
    name: str, kind: str, seed: int, tmp_path: Path
) -> None:
    ways = AT_ITS_FRAME, *random.Random(f"{name}{kind}{seed}").sample(WAYS, 1 if name in ("toms", "piano") else 3)
    assert_same_two_ways(name, kind, seed, RATE, ways, tmp_path)


def test_a_key_that_is_repeated_at_once_sounds_each_time(tmp_path: Path) -> None:
    """The note-off of each note lies on the tick of the next note-on, as in quantised files."""
    violin, length = engine.load("violin"), RATE // 2
    messages = []
    for n in range(4):
        messages += [Message(n * length, "on", 69, 90), Message((n + 1) * length, "off", 69, 64)]
    audio, _ = render_file(violin, messages, 4 * length, tmp_path)
    late = [audio[int((n + 0.4) * length) : (n + 1) * length].astype(float) for n in range(4)]
    levels = [10.0 * np.log10(np.mean(part**2)) for part in late]
    assert max(levels) - min(levels) < 0.5


@pytest.mark.hard_for("kalimba_keys-64", "guitar-127", "guitar-20", "guitar-64", "kalimba_keys-20")
@pytest.mark.parametrize("velocity", [20, 64, 127])
@pytest.mark.parametrize("name", ["guitar", "sitar", "kalimba_keys"])
def test_a_pluck_at_a_port_has_the_shape_of_its_velocity(name: str, velocity: int, tmp_path: Path) -> None:
    scene = engine.load(name)
    assert scene.instrument is not None
    keys = keys_of(scene.instrument["keyboard"])
    messages = [Message(0, "on", keys[len(keys) // 2], velocity), Message(FRAMES // 2, "off", keys[len(keys) // 2], 64)]
    rendered, needed = render_file(scene, messages, FRAMES, tmp_path)
    session = play_port(scene, messages, FRAMES, AT_ITS_FRAME, needed)
    assert rendered.any() and count_differences(session.audio, rendered) == 0


@pytest.mark.hard
def test_vibrato_ends_with_its_note() -> None:
    """Notes far shorter than their vibrato leave nothing behind that fills the score."""
    violin, left = engine.load("violin"), []
    for count in (40, 80):
        messages = []
        for n in range(count):
            messages += [Message(n * 2400, "on", 69, 90), Message(n * 2400 + 2000, "off", 69, 64)]
        session = play_port(violin, messages, count * 2400, Way("in its block", 256), [69])
        assert session.player.meter().dropped == 0
        changes = session.player.model.events
        assert changes is not None
        there = changes.start[changes.start < 1 << 60]
        assert not np.any(there > session.player.frame) and there.size < changes.start.size / 2
        left.append(there.size)
    assert left[1] <= left[0]  # of the last notes alone


@pytest.mark.hard
@pytest.mark.parametrize("order", [(127, 0), (0, 127)])
def test_pedal_moves_of_one_tick_stay_in_the_order_of_the_file(order: tuple[int, int], tmp_path: Path) -> None:
    piano = engine.load("piano")
    messages = [Message(0, "on", 60, 90), *(Message(2400, "sustain", 0, value) for value in order)]
    messages.append(Message(4800, "off", 60, 64))
    audio, _ = render_file(piano, messages, RATE, tmp_path)
    levels = [float(np.sqrt(np.mean(audio[a : a + 4800].astype(float) ** 2))) for a in (2400, RATE - 4800)]
    assert (levels[1] < 0.05 * levels[0]) == (order[-1] == 0)


def test_a_file_may_be_shorter_than_an_instrument_s_own_events(tmp_path: Path) -> None:
    guitar = engine.load("guitar_slide")
    audio, _ = render_file(guitar, [Message(0, "on", 60, 90), Message(4800, "off", 60, 64)], RATE // 4, tmp_path)
    assert audio.any()


# --- plain patches: strikes, plucks, dampers, and parameters that glide or have tables of their own


class Told(NamedTuple):
    """An event of a player at a frame."""

    frame: int
    kind: str
    arguments: tuple[Any, ...]


def draw_events(player: Player, seed: str, frames: int, count: int = 12) -> list[Told]:
    """Draw events of a player, which may overlap."""
    rng, events = random.Random(seed), list[Told]()
    bodies = [body.name for body in player.scene.body if body.kind != "mass"]
    glided = [name for name, path in player.live_paths.items() if path.is_glided]
    tabled = [name for name, path in player.live_paths.items() if not path.is_glided]
    for _ in range(count):
        frame, kind = (
            rng.randrange(1, frames * 4 // 5),
            rng.choice(["strike", "pluck", "damp", "lift", "glide", "table"]),
        )
        if kind == "strike" and player.strikers:
            name = rng.choice(player.strikers)
            events.append(Told(frame, kind, (name, player.default_velocity(name) * rng.uniform(0.3, 1.5))))
        elif kind == "pluck" and player.plucked:
            events.append(Told(frame, kind, (rng.choice(player.plucked), rng.uniform(0.3, 1.5))))
        elif kind == "damp" and bodies:
            events.append(Told(frame, kind, (rng.choice(bodies), rng.uniform(5, 300), rng.uniform(0.0, 0.1))))
        elif kind == "lift" and bodies:
            events.append(Told(frame, kind, (rng.choice(bodies),)))
        elif kind in ("glide", "table"):
            names = glided if kind == "glide" else tabled
            if not names:
                continue
            name, seconds = rng.choice(names), rng.choice([0.0, rng.uniform(0.0, 0.03)])
            try:
                value = player.value(name) * rng.uniform(0.97, 1.03)
                player._parameters.tables.check([player._parameters.checked_value(name, value)])
            except ValueError:
                continue
            events.append(Told(frame, "set", (name, value, seconds)))
    return sorted(events, key=lambda event: event.frame)


def tell(player: Player, event: Told) -> None:
    """Tell a player an event for its frame."""
    if event.kind == "strike":
        player.strike(*event.arguments, frame=event.frame)
    elif event.kind == "pluck":
        player.pluck(*event.arguments, frame=event.frame)
    elif event.kind == "damp":
        player.damp(*event.arguments, frame=event.frame)
    elif event.kind == "lift":
        player.lift(*event.arguments, frame=event.frame)
    else:
        player.set(*event.arguments, frame=event.frame)


def assert_same_however_told(name: str, seed: int, frames: int, ways: Any) -> None:
    """Assert that events of a patch give the same samples told at their frames, early, in reverse, or replayed."""
    scene = engine.load(name)
    options = {"waiting": True}
    events = draw_events(make_player(scene, **options), f"{name}{seed}", frames)
    reference = make_player(scene, **options)
    expected = play_told(reference, events, frames, AT_ITS_FRAME, lambda event: tell(reference, event))
    for way in ways:
        player = make_player(scene, cores=1 + seed % 2, **options)
        heard = play_told(player, events, frames, way, lambda event: tell(player, event))  # noqa: B023
        assert count_differences(heard, expected) == 0, (way, largest_difference(heard, expected), events)
        replayed = replay(json.loads(json.dumps(player.log())))
        assert count_differences(replayed, heard) == 0, ("replay", way, events)
    backwards = make_player(scene, **options)
    for frame in sorted({event.frame for event in events}, reverse=True):
        for event in events:  # those of one frame stay in their order
            if event.frame == frame:
                tell(backwards, event)
    heard = play_told(backwards, [], frames, Way("in its block", 256), lambda event: None)
    assert count_differences(heard, expected) == 0, ("in reverse", events)


PLAIN = (
    "piano_c4",
    "marimba",
    "tanpura",
    "snare_wires",
    "bowed_violin",
    "guitar_body",
    "felt_arpeggio",
    "buzzing_reed",
)


@pytest.mark.hard_for("marimba", "snare_wires", "tanpura", "piano_c4", "bowed_violin")
@pytest.mark.parametrize("name", mostly_hard(PLAIN, *set(PLAIN) - {"guitar_body"}))
def test_events_of_a_patch_act_at_their_frames_however_they_are_told(name: str) -> None:
    assert_same_however_told(name, 0, FRAMES, random.Random(name).sample(WAYS, 2))


@pytest.mark.slow_but_each(3)
@pytest.mark.hard
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", sorted(path.stem for path in Path("patches").glob("*.toml")))
def test_events_of_any_patch_act_at_their_frames_however_they_are_told(name: str, seed: int) -> None:
    ways = (BY_SAMPLE, *WAYS) if seed else WAYS
    assert_same_however_told(name, seed, FRAMES, random.Random(f"{name}{seed}").sample(ways, 3))


# --- voices


def play_voices(scene: Scene, messages: list[Message], frames: int, way: Way, voices: int) -> tuple[np.ndarray, Player]:
    """Play messages on voices."""
    player = make_player(scene, voices=voices, lowest=0.25)
    keys = VoiceAllocator(player)
    audio = play_told(player, messages, frames, way, lambda m: keys.play(Note(0.0, m.kind, m.key, m.value), m.frame))
    return audio, player


def draw_voice_messages(name: str, seed: int, frames: int) -> list[Message]:
    """Draw fast notes around middle C, some of them repeated, some very short, with the pedal."""
    rng, messages = random.Random(f"{name}{seed}"), list[Message]()
    for begin in range(0, frames, frames // 24):
        key, length = 60 + rng.choice([0, 0, 4, 7, 9]), rng.choice([40, 200, 1500, 6000])
        messages += [Message(begin, "on", key, rng.randrange(20, 127)), Message(begin + length, "off", key, 64)]
    messages += [Message(frames // 3, "sustain", 0, 127), Message(frames // 2, "sustain", 0, 0)]
    return sorted(messages, key=lambda message: message.frame)


@pytest.mark.hard
@pytest.mark.parametrize("voices", [1, 4])
@pytest.mark.parametrize("name", ["marimba", "piano_c4", "tanpura"])
def test_voices_follow_from_the_messages(name: str, voices: int) -> None:
    scene, messages = engine.load(name), draw_voice_messages(name, 0, FRAMES)
    expected, _ = play_voices(scene, messages, FRAMES, AT_ITS_FRAME, voices)
    for way in (WAYS[0], WAYS[3], WAYS[5]):
        heard, player = play_voices(scene, messages, FRAMES, way, voices)
        assert count_differences(heard, expected) == 0, way
        assert count_differences(replay(player.log()), heard) == 0, way


@pytest.mark.hard_for("0.083-kalimba", "0.15-kalimba", "0.15-guitar_body", "0.083-guitar_body", "0.15-tanpura")
@pytest.mark.parametrize("name", ["tanpura", "guitar_body", "kalimba", "slack_bass"])
@pytest.mark.parametrize("gap", [0.083, 0.15])
def test_plucks_that_are_repeated_sound_each_time(name: str, gap: float, tmp_path: Path) -> None:
    scene, step = engine.load(name), int(gap * RATE)
    key = 60 if name == "kalimba" else 45
    messages = [Message(0, "on", key + 2, 90), Message(4800, "off", key + 2, 64)]
    for n in range(6):
        begin = RATE // 5 + n * step
        messages += [Message(begin, "on", key, 90), Message(begin + step * 7 // 8, "off", key, 64)]
    save_messages(messages, tmp_path / "repeated.mid")
    seconds = 0.2 + 6 * gap
    audio = render_notes(scene, str(tmp_path / "repeated.mid"), RATE, Excerpt(seconds=seconds), 8).audio
    begins = [RATE // 5 + n * step for n in range(6)]
    levels = [10.0 * np.log10(np.mean(audio[begin : begin + int(0.8 * step)] ** 2)) for begin in begins]
    assert max(levels[1:]) - min(levels[1:]) < 6.0, levels


@pytest.mark.parametrize("length", [48, 200, 480])
def test_a_note_that_takes_a_voice_ends_however_short_it_is(length: int) -> None:
    messages = [Message(0, "on", 60, 90), Message(RATE // 4, "on", 64, 90), Message(RATE // 4 + length, "off", 64, 64)]
    audio, _ = play_voices(engine.load("marimba"), messages, 2 * RATE, AT_ITS_FRAME, 1)
    loudest, left = (float(np.abs(part).max()) for part in (audio, audio[-RATE // 4 :]))
    assert left < 1e-4 * loudest


def test_a_port_plays_the_patch_s_own_key() -> None:
    for name in ("piano_c7", "grand_c7"):
        audio, _ = play_voices(engine.load(name), [Message(0, "on", 96, 100)], 4800, AT_ITS_FRAME, 2)
        assert audio.any(), name


# --- one rule for events that overlap


def spring(events: list[dict[str, Any]]) -> Scene:
    """An oscillator that a spring holds to the ground."""
    body = {"name": "a", "kind": "oscillator", "mass": 0.01, "frequency": 200.0, "displacement": 1e-3}
    held = {"name": "spring", "body": "a", "stiffness": 1000.0}
    return Scene.model_validate({"body": [body], "connection": [held], "pickup": [{"body": "a"}], "event": events})


def find_frequency(audio: np.ndarray) -> float:
    """Return the frequency of a sine by its rising zeros, Hz."""
    x = np.asarray(audio, float).reshape(-1)
    n = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    zeros = n + x[n] / (x[n] - x[n + 1])
    return float((zeros.size - 1) / (zeros[-1] - zeros[0]) * RATE)


def test_a_glide_ends_where_a_newer_one_of_its_target_begins() -> None:
    long = {"kind": "change", "connection": "spring", "time": 0.05, "stiffness": 9000.0, "duration": 0.2}
    short = {"kind": "change", "connection": "spring", "time": 0.1, "stiffness": 2000.0, "duration": 0.02}
    right = np.sqrt((2 * np.pi * 200.0) ** 2 + 2000.0 / 0.01) / (2 * np.pi)
    for events in ([long, short], [short, long]):
        audio = engine.render(spring(events), seconds=0.6, samplerate=RATE).audio
        assert find_frequency(audio[RATE * 3 // 10 :]) == pytest.approx(right, rel=1e-3)


def test_of_two_dampers_the_newer_counts_and_a_longer_one_goes_on_after_it() -> None:
    body = {"name": "a", "kind": "oscillator", "mass": 0.01, "frequency": 1000.0, "displacement": 1e-3}
    long = {"kind": "damp", "body": "a", "time": 0.1, "sigma": 10.0, "duration": 0.3}
    short = {"kind": "damp", "body": "a", "time": 0.2, "sigma": 40.0, "duration": 0.05}
    scene = Scene.model_validate({"body": [body], "pickup": [{"body": "a"}], "event": [long, short]})
    audio = np.asarray(engine.render(scene, seconds=0.5, samplerate=RATE).audio, float).reshape(-1)

    def decay(begin: float, end: float) -> float:
        levels = [np.sqrt(np.mean(audio[int(t * RATE) :][:480] ** 2)) for t in (begin, end - 0.01)]
        return float(np.log(levels[0] / levels[1]) / (end - 0.01 - begin))

    assert decay(0.1, 0.2) == pytest.approx(10.0, rel=1e-2)
    assert decay(0.2, 0.25) == pytest.approx(40.0, rel=1e-2)
    assert decay(0.25, 0.4) == pytest.approx(10.0, rel=1e-2)
    assert decay(0.4, 0.5) == pytest.approx(0.0, abs=0.1)


def test_an_event_that_finds_no_room_changes_nothing_and_a_release_always_finds_some() -> None:
    body = {"name": "a", "kind": "oscillator", "mass": 0.01, "frequency": 1000.0, "displacement": 1e-3}
    scene = Scene.model_validate({"body": [body], "pickup": [{"body": "a"}]})
    player = make_player(scene)
    audio = np.zeros((RATE, 1), np.float32)
    for n in range(300):  # dampers within each other, each of which goes on after the next
        player.damp("a", 30.0, 20.0 - 0.05 * n)
    player.render_into(audio[: RATE // 4])
    assert player.meter().dropped > 0
    slope = np.log(np.abs(audio[1000:1480]).max() / np.abs(audio[9000:9480]).max()) / (8000 / RATE)
    assert slope == pytest.approx(30.0, rel=2e-2)
    from engine.patch.tables import DampEvent

    player.play_event(DampEvent(kind="damp", time=0.0, body="a", sigma=200.0), is_release=True)
    player.render_into(audio[RATE // 4 : RATE // 2])
    part = audio[RATE // 4 :]
    slope = np.log(np.abs(part[480:960]).max() / np.abs(part[1440:1920]).max()) / (960 / RATE)
    assert slope == pytest.approx(200.0, rel=2e-2)


@pytest.mark.hard
def test_no_message_of_a_crowd_is_lost() -> None:
    """More events than the queue holds are told before the first block."""
    scene = Scene.model_validate({"body": [{"name": "a", "kind": "mass", "mass": 1.0}], "pickup": [{"body": "a"}]})
    player = make_player(scene)
    for n in range(20_000):
        player.strike("a", 1e-3 * n, frame=n)
    audio = np.zeros((24_000, 1), np.float32)
    player.render_into(audio)
    assert player.meter().dropped == 0
    for frame in (100, 10_000, 19_999):
        assert float(audio[frame + 1, 0]) / GAIN == pytest.approx(1e-3 * frame, rel=1e-6)  # m/s


# --- real files


def test_two_parts_of_a_file_hold_a_key_together(tmp_path: Path) -> None:
    file = mido.MidiFile(ticks_per_beat=480)
    for channel, (begin, end) in enumerate([(0, 960), (480, 1920)]):
        track = mido.MidiTrack()
        track.append(mido.Message("note_on", note=60, velocity=90, channel=channel, time=begin))
        track.append(mido.Message("note_off", note=60, velocity=64, channel=channel, time=end - begin))
        file.tracks.append(track)
    file.save(tmp_path / "parts.mid")
    from engine.live.instrument_notes import scene_of_file

    played = scene_of_file(engine.load("vibraphone"), tmp_path / "parts.mid")
    damped = [event.time for event in played.scene.event if event.kind == "damp"]
    assert 1.0 not in damped and 2.0 in damped


TURNED = """
[keyboard]
keys = "C4..D4"
[[key.body]]
name = "string"
kind = "string"
length = 0.6
mass = 3e-3
frequency = "= f"
modes = 1
sigma0 = 1.0
[[key.pickup]]
body = "string"
at = 0.3
[[key.on]]
kind = "pluck"
body = "string"
at = 0.2
amplitude = "= v"
duration = 2e-3
[[key.on]]
kind = "change"
parameter = "body.string.frequency"
value = "= 1.06*f"
time = 0.1
duration = 0.0
[[key.off]]
kind = "change"
parameter = "body.string.frequency"
value = "= f"
duration = 0.0
"""


def test_a_key_turns_its_string_at_its_frame_and_not_after_its_note(tmp_path: Path) -> None:
    (tmp_path / "turned.toml").write_text(TURNED, "utf-8")
    scene = engine.load(tmp_path / "turned.toml")
    messages = [Message(0, "on", 60, 90), Message(9600, "off", 60, 64)]  # turned at 0.1 s
    messages += [Message(12_000, "on", 62, 90), Message(14_400, "off", 62, 64)]  # not turned
    audio, keys = render_file(scene, messages, FRAMES, tmp_path)
    assert find_frequency(audio[6000:9500, :1]) == pytest.approx(1.06 * 261.63, rel=2e-3)
    for way in (AT_ITS_FRAME, WAYS[2], Way("ahead", 256)):
        session = play_port(scene, messages, FRAMES, way, keys)
        assert count_differences(session.audio, audio) == 0, way
        assert count_differences(replay(session.player.log()), session.audio) == 0, way
