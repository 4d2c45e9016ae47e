"""Keys of a patch that is no instrument: copies of it, its voices, which are tuned to notes as in live sound.

The tables of each pitch are made at export, once for all voices.
"""

import math
from typing import Any, NamedTuple

from engine.assembly.table_exchange import Copies, collect_copies
from engine.export.exchange_bytes import add_copies, add_values, row_of_copies
from engine.export.faults import CannotExport
from engine.export.row_recorder import LEVELS, RowRecorder, Rows
from engine.export.scene_bytes import SceneBytes
from engine.instrument.key_names import note_name
from engine.live.midi_drivers import MidiError
from engine.live.voice_allocator import (
    NOMINAL_VELOCITY,
    RELEASE_DAMPER,
    STEAL_DAMPER,
    VELOCITY_EXPONENT,
    PitchedBody,
    nearest_body,
    pitched_bodies,
)
from engine.live.voices import sounding_bodies, striker_velocities
from engine.patch.frames import nearest_frame
from engine.patch.scene import Scene

OCTAVE = 12  # keys, which the keyboard goes beyond the bodies of the patch on either side …
MAX_KEYS = 49  # … if it has no more keys then
A4, A4_HERTZ = 69, 440.0


class VoiceKey(NamedTuple):
    """A key that any voice can play."""

    number: int  # of MIDI
    name: str
    body: int  # that it sounds, of those that notes can sound
    tune: Rows  # of each voice: it gets the pitch


class Voice(NamedTuple):
    """Rows of what a voice does."""

    on: list[list[Rows]]  # for each body, at each of LEVELS
    release: Rows  # it is damped
    steal: Rows  # it is damped for another note, which begins when that is over


def bodies_of_notes(scene: Scene) -> list[PitchedBody]:
    """Return the bodies of a patch that notes can sound. Raises CannotExport if there are none."""
    if scene.instrument is not None:
        raise CannotExport("the patch is an instrument, whose keys need no voices")
    try:
        return pitched_bodies(scene)
    except MidiError as error:
        raise CannotExport(str(error)) from None


def numbers_of_keys(bodies: list[PitchedBody]) -> list[int]:
    """Return the keys around the pitches of bodies."""
    pitches = [round(A4 + 12 * math.log2(body.frequency / A4_HERTZ)) for body in bodies]
    low, high = min(pitches) - OCTAVE, max(pitches) + OCTAVE
    low = max(low, (low + high - MAX_KEYS) // 2)
    return [number for number in range(low, min(high, low + MAX_KEYS - 1) + 1) if 0 <= number < 128]


def lowest_ratio(bodies: list[PitchedBody]) -> float:
    """Return the ratio of the lowest pitch of the keys."""
    return min(1.0, *(nearest_body(bodies, number).ratio(number) for number in numbers_of_keys(bodies)))


def controls_of_voices(laid_out: SceneBytes, player: RowRecorder) -> dict[str, Any]:
    """Add the tables of the keys of voices to the bytes of their player. Return the controls of a page: keys, voices,
    and a note that Play plays. Keys that the voices cannot be tuned to are left out."""
    bodies = bodies_of_notes(player.patch)
    keys = [key for number in numbers_of_keys(bodies) if (key := _key(laid_out, player, bodies, number)) is not None]
    voices = [_voice(player, bodies, voice) for voice in range(player.voices)]
    middle = min(keys, key=lambda key: abs(math.log(bodies[key.body].ratio(key.number))))
    song = [middle.tune[0], *voices[0].on[middle.body][LEVELS.index(NOMINAL_VELOCITY)]]
    return {
        "keys": [key._asdict() for key in keys],
        "voices": [voice._asdict() for voice in voices],
        "levels": LEVELS,
        "steal_frames": nearest_frame(STEAL_DAMPER[1], player.samplerate),
        "release_frames": nearest_frame(RELEASE_DAMPER[1], player.samplerate),
        "song": song,
    }


def _key(laid_out: SceneBytes, player: RowRecorder, bodies: list[PitchedBody], number: int) -> VoiceKey | None:
    """Return a key, whose tables are added to the bytes; None if no voice can have its pitch."""
    body = nearest_body(bodies, number)
    try:
        single = player.tuning.single_model(body.ratio(number), body.body)
        pairs = [player.tuning.pairs(voice, single) for voice in range(player.voices)]
    except ValueError:
        return None
    first = collect_copies([(ours, theirs.reshape(-1)) for ours, theirs in pairs[0]])
    islands = single.islands.mode.size - 1
    values, tune = add_values(laid_out, first), Rows()
    for voice, arrays in enumerate(pairs):
        table = first.table.copy()
        table[:, 0] = [ours.ctypes.data for ours, _ in arrays]
        added = add_copies(laid_out, Copies(table, first.values), values)
        tune.append(row_of_copies(laid_out, (voice * islands, (voice + 1) * islands), added))
    return VoiceKey(number, note_name(number), bodies.index(body), tune)


def _voice(player: RowRecorder, bodies: list[PitchedBody], voice: int) -> Voice:
    """Return what a voice does."""

    def strike(body: PitchedBody, level: int) -> Rows:
        share = (level / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT
        for hammer in body.hammers:
            player.strike(f"{hammer}_{voice}", striker_velocities(player.patch)[hammer] * share)
        if body.plucked:
            player.pluck(f"{body.body}_{voice}", share)
        return player.take_rows()

    def damp(damper: tuple[float, float]) -> Rows:
        for name in sounding_bodies(player.patch):
            player.damp(f"{name}_{voice}", *damper)
        return player.take_rows()

    on = [[strike(body, level) for level in LEVELS] for body in bodies]
    return Voice(on, damp(RELEASE_DAMPER), damp(STEAL_DAMPER))
