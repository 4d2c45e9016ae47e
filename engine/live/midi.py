"""Notes of a MIDI file or port, played by the voices of a scene: live, or rendered."""

import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engine.faults import RenderInterrupted
from engine.instrument.tables import drum_keys
from engine.live.controls import Controls, takes_move
from engine.live.key_allocator import KeyAllocator
from engine.live.midi_drivers import MidiError
from engine.live.midi_files import MidiNotes, TimedMove, is_midi_file, read_notes
from engine.live.midi_notes import Note
from engine.live.midi_parts import ALL_NOTES, Excerpt
from engine.live.motion_watch import MotionWatch
from engine.live.player import Player
from engine.live.rig_keys import RigKeys
from engine.live.shared_memory import Gauge, Slot
from engine.live.voice_allocator import VoiceAllocator, nearest_body, pitched_bodies
from engine.offline.infrasound import warn_of_infrasound
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene
from engine.patch.tables import MAX_SECONDS

LEAD_IN = 0.05  # s before the first note of a file that is played live: what comes first fades in
TAIL_SECONDS = 3.0  # s after the last
LOOKAHEAD = 0.2  # s, by which notes of a file are sent before they sound
PORT_LOWEST = 2.0 ** (-24.5 / 12.0)  # ratio of the lowest pitch of notes of a port
RENDER_GAIN = 1e-6  # gain of a render: single precision is as exact at any, and no limiter is to act

Allocator = VoiceAllocator | KeyAllocator | RigKeys


class MidiFilePlayer:
    """The notes of a file, and the moves that its controls take, told in their order as their time comes near. At one
    time, moves come first: a note begins with them."""

    def __init__(self, keys: Allocator, file: MidiNotes, lead: float = 0.0, controls: Controls | None = None) -> None:
        self.keys, self.file, self._next, self._controls = keys, file, 0, controls
        self._begin = 0  # frames that other players have played before
        self.notes = [note._replace(seconds=note.seconds + lead) for note in file.notes]
        moves = [] if controls is None else [timed._replace(seconds=timed.seconds + lead) for timed in file.moves]
        self._has_moves = bool(moves)
        events: list[Note | TimedMove] = [*moves, *self.notes]
        self._events = sorted(events, key=lambda event: event.seconds)

    @property
    def end(self) -> float:
        """When all has died away, s."""
        return self.notes[-1].seconds + TAIL_SECONDS

    def use(self, keys: Allocator) -> None:
        """Go on with another player, which takes over now: it gets the notes and moves that have not begun."""
        self._begin, self.keys = self._begin + self.keys.player.frame, keys
        now = self._begin / keys.player.samplerate
        self._next = next((n for n, one in enumerate(self._events) if one.seconds >= now), len(self._events))

    def poll(self) -> bool:
        """Tell the notes and moves of the next moments; returns whether all is over."""
        rate, now = self.keys.player.samplerate, self._begin + self.keys.player.frame
        until = now + nearest_frame(LOOKAHEAD, rate)
        self.keys.controls = self._controls if self._has_moves else None
        while self._next < len(self._events):
            event = self._events[self._next]
            frame = nearest_frame(event.seconds, rate)
            if frame >= until:
                break
            self._advance(frame - 1)
            if isinstance(event, Note):
                self.keys.play(event, max(0, frame - self._begin))
            else:
                self._move(event)
            self._next += 1
        self._advance(until - 1)
        return now > self.end * rate

    def _move(self, timed: TimedMove) -> None:
        """Move the controls that follow a controller."""
        if self._controls is not None:
            self._controls.move(timed.move, self.keys.targets(timed.move, timed.is_of_one_note))

    def _advance(self, frame: int) -> None:
        """Let the controls go on up to a frame of the session."""
        if self._controls is not None and self._has_moves:
            self._controls.advance(frame - self._begin)


def make_allocator(player: Player) -> Allocator | None:
    """Make the allocator that gives notes to a player; None if it plays the score of its scene alone. Raises
    MidiError."""
    if player.voices:
        return VoiceAllocator(player)
    if player.waiting and player.patch.rig is not None:
        return RigKeys(player, player.patch.rig)
    return KeyAllocator(player) if player.waiting and player.patch.instrument is not None else None


def has_notes(scene: Scene, text: str) -> bool:
    """True if a patch without a keyboard can play notes. It need not, if a port moves its controls. Raises
    MidiError."""
    try:
        pitched_bodies(scene)
    except MidiError:
        if is_midi_file(text) or all(control.kind == "osc" for control in scene.control):
            raise
        return False
    return True


def open_file(
    text: str, keys: Allocator | None, controls: Controls, excerpt: Excerpt = ALL_NOTES
) -> "MidiFilePlayer | None":
    """Open the notes of a file, to be played live; None if nothing plays them. Raises MidiError."""
    if keys is None:
        return None
    return MidiFilePlayer(keys, read_for(controls.scene, text, excerpt), LEAD_IN, controls)


def read_for(scene: Scene, text: str, excerpt: Excerpt = ALL_NOTES) -> MidiNotes:
    """The notes of a file, and the moves that a scene has controls for. Raises MidiError."""
    takes, drums = scene.control, drum_keys(scene.instrument)
    return read_notes(Path(text), scene.midi, lambda move: any(takes_move(one, move) for one in takes), excerpt, drums)


def lowest_ratio(text: str, scene: Scene, excerpt: Excerpt = ALL_NOTES) -> float:
    """Ratio of the lowest pitch that will be played: that of a file's lowest note; for a port, two octaves down."""
    if is_midi_file(text):
        bodies = pitched_bodies(scene)
        notes = read_for(scene, text, excerpt).notes
        bends: dict[int, float] = {}
        for note in notes:
            if note.kind == "bend":
                bends[note.channels.channel] = min(note.value, bends.get(note.channels.channel, 0.0))
        followed = {note.channels.followed() for note in notes if note.kind == "on"}
        bend = min(sum(bends.get(channel, 0.0) for channel in channels) for channels in followed)
        keys = {note.number for note in notes if note.kind == "on"}
        bend += min([0.0, *(note.value for note in notes if note.kind == "tune" and note.number in keys)])
        lowest = min(1.0, *(nearest_body(bodies, key).ratio(key) for key in keys))
        return float(lowest * 2.0 ** (bend / 1200.0))
    return PORT_LOWEST


class RenderedNotes(NamedTuple):
    """The notes of a file as sound, or as much of it as Ctrl-C left."""

    audio: np.ndarray  # SI units, [frames, channels]
    player: Player
    keys: VoiceAllocator
    file: MidiNotes
    warnings: list[str]
    seconds: float  # that were to be rendered


def render_notes(
    scene: Scene,
    text: str,
    samplerate: int,
    excerpt: Excerpt,
    voices: int,
    progress: Any = None,
) -> RenderedNotes:
    """Render the notes of an excerpt of a file, from the first of them on. Raises MidiError; and
    RenderInterrupted (a KeyboardInterrupt) at Ctrl-C, if something is rendered by then."""
    seconds = excerpt.seconds
    file = read_for(scene, text, excerpt)
    lowest = lowest_ratio(text, scene, excerpt)
    player = Player(scene, samplerate, math.inf, RENDER_GAIN, voices=voices, lowest=lowest)
    player.counters[Slot.FADE_IN_FRAMES] = 0  # it begins with a note
    keys = VoiceAllocator(player)
    keys.ignored |= file.ignored
    controls, motion = Controls(scene, player), MotionWatch(player)
    sequencer = MidiFilePlayer(keys, file, controls=controls)
    if seconds is None and sequencer.end > MAX_SECONDS:
        raise MidiError(
            f"{text} lasts {sequencer.end:.0f} s; the limit is {MAX_SECONDS:g} s: give --seconds {MAX_SECONDS:g}"
        )
    frames = nearest_frame(seconds or sequencer.end, samplerate)
    out, block = np.zeros((frames, player.channels), np.float32), nearest_frame(LOOKAHEAD / 2, samplerate)
    done, interruption = 0, None
    try:
        while done < frames:
            started = time.perf_counter()
            sequencer.poll()
            player.render_into(out[done : done + block])
            player.gauges[Gauge.SECONDS_USED] += time.perf_counter() - started
            done = min(done + block, frames)
            motion.poll()
            if progress is not None:
                progress(done / frames)
    except KeyboardInterrupt as stop:  # what there is can be kept
        if done == 0:
            raise
        interruption = stop
    audio = out[:done] / RENDER_GAIN
    warnings = motion.warnings() + warn_of_infrasound(player.scene, audio, samplerate)
    rendered = RenderedNotes(audio, player, keys, file, warnings, frames / samplerate)
    if interruption is not None:
        raise RenderInterrupted(rendered) from interruption
    return rendered
