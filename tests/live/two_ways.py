"""The same messages, told in two ways: as a MIDI file that is rendered, and at a port, early, late or in blocks."""

import math
import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mido
import numpy as np

import engine
from engine.instrument.expansion import keys_needed, keys_of
from engine.live.audio_memory import MAX_FRAMES
from engine.live.instrument_notes import scene_of_file
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import Note
from engine.live.player import Player
from engine.live.shared_memory import Slot
from engine.patch.control_tables import Midi
from engine.patch.scene import Scene

RATE = 48_000  # Hz
GAIN = 2.0**-24  # of a player: far from its limiter, and no rounding
TICKS = 24_000  # a beat, of half a second: one tick is one frame
CONTROLLERS = {"sustain": 64, "sostenuto": 66, "soft": 67}
AHEAD = 9600  # frames by which messages are told early
KINDS = ("notes", "repeated", "overlapping", "pressed again", "pedals", "short")


class Message(NamedTuple):
    """A message at a frame: a key is pressed or let go, or a pedal is moved."""

    frame: int
    kind: str  # on | off | the name of a pedal
    key: int
    value: int


class Way(NamedTuple):
    """How messages are told to a player that renders in blocks."""

    told: str  # at its frame | in its block | ahead | at the start
    block: int


WAYS = (
    *(Way("in its block", block) for block in (17, 64, 256, 1024, 4096)),
    Way("ahead", 256),
    Way("at the start", 1024),
)
BY_SAMPLE = Way("in its block", 1)


def draw_messages(scene: Scene, kind: str, seed: int, frames: int) -> list[Message]:
    """Draw messages of a kind, the first at frame 0."""
    rng, messages = random.Random(f"{scene.title}{kind}{seed}"), list[Message]()
    assert scene.instrument is not None
    keys = keys_of(scene.instrument["keyboard"])
    chosen = rng.sample(keys, min(4, len(keys)))

    def note(key: int, begin: int, length: int) -> None:
        messages.append(Message(begin, "on", key, rng.randrange(1, 128)))
        messages.append(Message(begin + length, "off", key, rng.randrange(1, 128)))

    step = frames // 8
    if kind == "repeated":  # the note-off on the tick of the next note-on, or just before it
        for n in range(6):
            note(chosen[0], n * step, step - rng.choice([0, 0, 1, 48, step // 2]))
    elif kind == "overlapping":
        for n in range(6):
            note(chosen[n % len(chosen)], n * step, rng.randrange(step, 2 * step))
    elif kind == "pressed again":
        messages += [Message(n * 2 * step, "on", chosen[0], 60 + 20 * n) for n in range(3)]
        messages.append(Message(6 * step, "off", chosen[0], 64))
    else:
        for n in range(6):
            length = rng.choice([0, 1, 10, 48]) if kind == "short" else rng.randrange(step // 8, step)
            note(rng.choice(chosen), n * step, length)
    if kind == "pedals":  # also on the tick of a note
        times = [*(m.frame for m in messages[:4]), *(rng.randrange(1, 7 * step) for _ in range(6))]
        messages += [Message(t, rng.choice(list(CONTROLLERS)), 0, rng.choice([0, 30, 64, 90, 127])) for t in times]
    return sorted(messages, key=lambda message: message.frame)


def save_messages(messages: Sequence[Message], path: Path) -> None:
    """Save messages as a MIDI file whose ticks are frames."""
    file, track, now = mido.MidiFile(ticks_per_beat=TICKS), mido.MidiTrack(), 0
    file.tracks.append(track)
    for frame, kind, key, value in messages:
        if kind in CONTROLLERS:
            message = mido.Message("control_change", control=CONTROLLERS[kind], value=value, time=frame - now)
        else:
            message = mido.Message(f"note_{kind}", note=key, velocity=value, time=frame - now)
        track.append(message)
        now = frame
    file.save(path)


class Session(NamedTuple):
    """A session at a port."""

    audio: np.ndarray  # float32 [frames, channels]
    player: Player
    keys: Any


def render_file(scene: Scene, messages: Sequence[Message], frames: int, folder: Path) -> tuple[np.ndarray, list[int]]:
    """Render messages as a MIDI file. Return the sound as a player of gain GAIN gives it, and the keys that it has."""
    path = folder / "two_ways.mid"
    save_messages(messages, path)
    played = scene_of_file(scene.model_copy(update={"midi": Midi(shortest_lift=0.0)}), path)
    rendering = engine.render(played.scene, seconds=frames / RATE, samplerate=RATE, kernel="general", cores=1)
    audio = (np.asarray(rendering.audio).reshape(frames, -1) * GAIN).astype(np.float32)
    return audio, keys_needed(scene.instrument or {}, played.score)


def make_player(scene: Scene, **options: Any) -> Player:
    """Make a player without fades, far below full scale."""
    player = Player(scene, RATE, math.inf, GAIN, kernel="general", **options)
    player.counters[[Slot.FADE_IN_FRAMES, Slot.END]] = 0, MAX_FRAMES
    return player


def play_port(
    scene: Scene, messages: Sequence[Message], frames: int, way: Way, keys: list[int], cores: int = 1
) -> Session:
    """Play messages as they come from a port."""
    player = make_player(live_scene(scene, keys), waiting=True, cores=cores)
    allocator = KeyAllocator(player)
    audio = play_told(
        player, messages, frames, way, lambda m: allocator.play(Note(0.0, m.kind, m.key, m.value), m.frame)
    )
    return Session(audio, player, allocator)


def play_told(player: Player, told: Sequence[Any], frames: int, way: Way, tell: Callable[[Any], None]) -> np.ndarray:
    """Render frames, and tell a player what is told in the order of frames. told: records with a `frame`"""
    audio, following = np.zeros((frames, player.channels), np.float32), 0
    lead = {"in its block": 0, "ahead": AHEAD, "at the start": frames}.get(way.told)
    if lead is None:  # at its frame: blocks are cut there
        at = 0
        for one in told:
            if one.frame > at:
                player.render_into(audio[at : one.frame])
                at = one.frame
            tell(one)
        player.render_into(audio[at:])
        return audio
    for begin in range(0, frames, way.block):
        while following < len(told) and told[following].frame < begin + way.block + lead:
            tell(told[following])
            following += 1
        player.render_into(audio[begin : begin + way.block])
    return audio


def count_differences(one: np.ndarray, other: np.ndarray) -> int:
    """Count the samples that differ."""
    return int(np.count_nonzero(one != other))


def largest_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference, as a share of the peak."""
    return float(np.abs(one.astype(float) - other).max() / max(1e-30, np.abs(other).max()))
