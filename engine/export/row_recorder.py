"""Rows of events that a page or a library in C sends to a scene, made once for each key, hammer, pluck and slider.

It scales their values, by velocity or by a slider, and computes nothing else.
"""

import math
from collections.abc import Container, Sequence
from typing import Any, NamedTuple

from engine.assembly.coordinates import MAX_SHARE_LATER
from engine.assembly.event_table import EventRow
from engine.assembly.table_changes import NewValue, TableChanges, count_steps
from engine.export.faults import CannotExport
from engine.instrument.held_keys import PEDAL_STEPS, SOSTENUTO_HALF, damper_share
from engine.instrument.key_names import HIGHEST_KEY, note_name, plain_note_name
from engine.instrument.key_sequencer import FULL_VELOCITY
from engine.instrument.key_writer import KeyWriter
from engine.instrument.score import Score
from engine.kernel.data.enums import EventKind
from engine.live.audio_memory import MAX_FRAMES
from engine.live.controls import targets_of_all
from engine.live.event_queue import RowSet
from engine.live.key_allocator import KeyAllocator, live_scene
from engine.live.midi_notes import UNKNOWN_RELEASE, Note
from engine.live.player import Player
from engine.live.retuning import VoiceTuning
from engine.live.shared_memory import Slot
from engine.live.voice_allocator import NOMINAL_VELOCITY, VELOCITY_EXPONENT
from engine.patch.frames import nearest_frame
from engine.patch.labels import labels_of
from engine.patch.live_parameters import live_paths, value_at
from engine.patch.live_ranges import live_range
from engine.patch.scene import Scene

LEVELS = (1, 2, 4, 8, 16, 32, 48, 64, 80, 96, 112, 127)  # MIDI velocities; rows between two of them are interpolated
RELEASE = UNKNOWN_RELEASE  # MIDI velocity with which a page lets keys go
# of how many PEDAL_STEPS the sustain pedal leaves to the dampers, by how far MIDI says that it is down
SHARES = [round(PEDAL_STEPS * damper_share(value / FULL_VELOCITY)) for value in range(128)]
PEDAL_DOWN = math.ceil(FULL_VELOCITY * SOSTENUTO_HALF)  # as MIDI says it: soft and sostenuto pedals are down from there
TIMES = 1e3  # a slider of a stiffness goes so many times beyond the value of the patch, and below
LEAST_GAP = 1e-3  # m, that a slider of a gap goes either way
# numbers that may be 0 or less, whose sliders are linear, and how far these go at least
LEAST_REACH = dict.fromkeys(("barrier", "gap", "rest"), LEAST_GAP) | {"velocity": 0.5, "force": 1.0}
MAX_SLIDERS = 24  # an instrument of many keys has hundreds of such numbers: then none is shown
TRIED_SHARES = 0.0, 0.117, 0.25, 0.5003, 0.731, 1.0  # of a slider, at which its law is tried
SLIDER_SECONDS = 0.02  # that its parameter takes to glide
LOWEST_PAD = 36  # key of the first pad, as drums have it
CHOKE_DAMPER = 1500.0, 0.01  # of a note that ends at once: decay rate, 1/s, and how long, s

Rows = list[list[float]]


class RowRecorder(Player):
    """A player that does not play: it keeps the rows of its events.

    queue_size: events that a page or a library can have waiting
    exchanged: values whose tables keys exchange; the row of such an exchange has its number here in place of a value,
               until the tables are made (engine.export.key_tables)
    """

    queue_size = 1024

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._rows_kept: list[EventRow] = []
        self.exchanged: list[NewValue] = []
        super().__init__(*arguments, **options)

    def take_rows(self) -> Rows:
        """Return the rows since the last call: the numbers of EventRow."""
        rows, self._rows_kept = self._rows_kept, []
        return [list(map(float, row)) for row in rows]

    @property
    def tables(self) -> TableChanges:
        """Builder of the tables of its live parameters."""
        return self._parameters.tables

    @property
    def tuning(self) -> VoiceTuning:
        """The pitches of its voices."""
        return self._tuning

    def _plan(self, values: list[NewValue], seconds: float, frame: int, note: int = 0) -> None:
        """Keep the row of an exchange, whose tables are made later. Raises CannotExport if they would glide."""
        for new in values:
            if count_steps([new], seconds) > 1:
                raise CannotExport(f"a key glides {new.parameter}, which cannot be exported; give it duration = 0")
            if new not in self.exchanged:
                self.exchanged.append(new)
            value = self.exchanged.index(new)
            self._rows_kept.append(EventRow(EventKind.EXCHANGE_TABLES, 0, 0, 0, frame, 0, value, note=note))

    def make_tables(self) -> None:
        """Leave the tables until all values are known."""

    def cancel(self, note: int, frame: int = 0) -> None:
        """Forget the events of a note that have not begun before a frame: those that are kept, and those of a key that
        is pressed in a page."""
        self._rows_kept = [row for row in self._rows_kept if row.note != note or row.start < frame]
        super().cancel(note, frame)

    def play_sets(self, description: list[Any], sets: Sequence[RowSet], frame: int = 0) -> None:
        """Keep the rows of sets of events."""
        self._rows_kept += [row._replace(start=frame) for one in sets for row in one.rows]

    def _put(
        self, description: list[Any], rows: list[EventRow], frame: int, note: int = 0, is_release: bool = False
    ) -> None:
        self._rows_kept += [row._replace(start=frame + row.start, note=note, is_release=is_release) for row in rows]


def player_of_scene(scene: Scene, samplerate: int, kernel: str, seconds: float | None = None) -> RowRecorder:
    """Return the player of a scene with its score. Raises BuildError if that changes tables too often."""
    return _without_fades(RowRecorder(scene, samplerate, seconds, kernel=kernel))


def player_of_keys(scene: Scene, samplerate: int, kernel: str) -> RowRecorder:
    """Return the player of an instrument that waits for its keys."""
    return _without_fades(RowRecorder(live_scene(scene), samplerate, math.inf, kernel=kernel, waiting=True))


def player_of_voices(scene: Scene, samplerate: int, kernel: str, voices: int, lowest: float) -> RowRecorder:
    """Return the player of so many copies of a scene. lowest: ratio of the lowest pitch that they have"""
    return _without_fades(RowRecorder(scene, samplerate, math.inf, kernel=kernel, voices=voices, lowest=lowest))


def check_output(scene: Scene, place: str) -> None:
    """Raise CannotExport if a scene is oversampled or has a tremolo. place: where there is neither"""
    if scene.tremolo is not None and scene.tremolo.depth > 0.0:
        raise CannotExport(f"a patch with a tremolo cannot be exported: in {place} there is none; set its depth to 0")
    if scene.accuracy.oversample > 1:
        raise CannotExport(f"a patch with oversample cannot be exported: in {place} there is no filter to decimate it")


def _without_fades(player: RowRecorder) -> RowRecorder:
    player.counters[[Slot.FADE_IN_FRAMES, Slot.END]] = 0, MAX_FRAMES
    return player


class Key(NamedTuple):
    """A key of an instrument. Of its dampers there are rows for each share of their force that a pedal may leave them,
    from 1 / PEDAL_STEPS to 1."""

    number: int  # of MIDI
    name: str
    on: list[Rows]  # at each of LEVELS
    soft_on: list[Rows]  # … with the soft pedal down; empty if that changes nothing
    off: list[Rows]  # when it is let go, at each of LEVELS at which it was pressed, or one for all …
    soft_off: list[Rows]  # … with the soft pedal down
    damp: list[Rows]  # its dampers come down
    lift: Rows  # its dampers
    steal: Rows  # another key needs its place: it is damped, whatever the pedals say
    group: float | None  # keys of which one sounds at a time


def keys_of_player(player: RowRecorder) -> list[Key]:
    """Return the keys of an instrument. player: of a `live_scene`, with `waiting = True`"""
    allocator = KeyAllocator(player)
    document = player.patch.instrument or {}
    mono, writer = document["keyboard"].get("mono"), KeyWriter(document)

    def play(kind: str, number: int, value: int) -> Rows:
        allocator.play(Note(0.0, kind, number, value))
        return player.take_rows()

    def damp(number: int) -> Rows:
        allocator.do(allocator.sequencer.damp(number, RELEASE / FULL_VELOCITY), 0)
        return player.take_rows()

    def lift(number: int) -> Rows:
        allocator.do(allocator.sequencer.lift(number), 0)
        return player.take_rows()

    def steal(number: int) -> Rows:
        allocator.do(allocator.sequencer.end(number), 0)
        return player.take_rows()

    def press(number: int) -> tuple[list[Rows], list[Rows]]:
        on, off = list[Rows](), list[Rows]()
        for level in LEVELS:
            on.append(play("on", number, level))
            rows = play("off", number, RELEASE)
            off.append(rows[: len(rows) - len(dampers[-1][number])])
        return on, off if any(rows != off[0] for rows in off) else off[:1]

    dampers = []
    for share in range(1, PEDAL_STEPS + 1):
        play("sustain", 0, SHARES.index(share))
        dampers.append({number: damp(number) for number in allocator.keys})
    pressed = {number: press(number) for number in allocator.keys}
    play("soft", 0, round(FULL_VELOCITY))
    softly = {number: press(number) for number in allocator.keys}
    play("sustain", 0, SHARES.index(0))  # no damper comes down beside those of `steal`
    keys = []
    for number in allocator.keys:
        on, off = pressed[number]
        soft_on, soft_off = softly[number] if softly[number] != pressed[number] else ([], [])
        damp_rows = [rows[number] for rows in dampers]
        group = None if mono is None else writer.names(number).get(mono)
        key = Key(number, note_name(number), on, soft_on, off, soft_off, damp_rows, lift(number), steal(number), group)
        keys.append(key)
    return keys


def rows_of_score(player: RowRecorder, score: Score) -> Rows:
    """Return the notes and pedals of a score as rows with their frames, in order. Keys that a player does not have, as
    they have no bodies of their own, are left out, as in live sound."""
    allocator = KeyAllocator(player)
    for message in score.messages():
        if message.kind in ("on", "off") and message.key not in allocator.keys:
            continue
        allocator.do(allocator.sequencer.take(message), nearest_frame(message.time, player.samplerate))
    return [row for row in sorted(player.take_rows(), key=lambda row: row[4]) if row[0] != EventKind.CANCEL]


class Pad(NamedTuple):
    """A hammer that can be thrown or a body that can be plucked."""

    name: str
    unit: str  # of its size; "" for times the patch's own
    size: float  # as the patch has it
    rows: Rows  # their second value, of a hammer, or their first, of a pluck, goes with the size
    is_hammer: bool


def pads_of_player(player: RowRecorder, velocity: float | None = None) -> list[Pad]:
    """Return what can be struck and plucked in a patch without keys. velocity: of hammers, m/s; the patch's if None"""
    pads = []
    for name in player.strikers:
        player.strike(name, velocity)
        pads.append(Pad(name, "m/s", player.default_velocity(name), player.take_rows(), True))
    for name in player.plucked:
        player.pluck(name)
        pads.append(Pad(name, "", 1.0, player.take_rows(), False))
    return pads


def keys_of_pads(player: RowRecorder) -> list[Key]:
    """Return the hammers and plucked bodies of a patch without keys as keys, from LOWEST_PAD: the harder, the faster or
    stronger, as with notes on voices."""
    shares = [(level / NOMINAL_VELOCITY) ** VELOCITY_EXPONENT for level in LEVELS]

    def strike(name: str, share: float) -> Rows:
        player.strike(name, share * player.default_velocity(name))
        return player.take_rows()

    def pluck(name: str, share: float) -> Rows:
        player.pluck(name, share)
        return player.take_rows()

    pads = [(name, strike) for name in player.strikers] + [(name, pluck) for name in player.plucked]
    last = HIGHEST_KEY + 1 - LOWEST_PAD
    return [
        Key(
            LOWEST_PAD + n,
            name,
            [play(name, share) for share in shares],
            [],
            [[]],
            [],
            [[]] * PEDAL_STEPS,
            [],
            [],
            None,
        )
        for n, (name, play) in enumerate(pads[:last])
    ]


def rows_of_choke(player: RowRecorder, key: Key) -> Rows:
    """Return the rows that end the sound of a key at once: its bodies are damped; those of its dampers, if it has no
    bodies of its own; all bodies, if it is a pad."""
    beginning = f"{plain_note_name(key.number)}_"
    bodies: list[str | None] = [body for body in player.layout.body_index if body.startswith(beginning)]
    if player.patch.instrument is None:
        bodies = [None]
    for body in bodies:
        player.damp(body, *CHOKE_DAMPER)
    return player.take_rows() or key.steal


class Law(NamedTuple):
    """The value of a row of an event by the value x of a live parameter, as live sound has it, to the last bit:
    ((x - shift)/part)/unit; or x/(1 - min(x*compliance, most)) of a spring beside a compliance."""

    shift: float = 0.0
    part: float = 1.0
    unit: float = 1.0
    compliance: float = 0.0  # m/N; 0: the first one
    most: float = 0.0

    def row_value(self, value: float) -> float:
        """Return the value of a row."""
        if self.compliance:
            return value / (1.0 - min(value * self.compliance, self.most))
        return (value - self.shift) / self.part / self.unit


class Slider(NamedTuple):
    """A number of a patch that glides while it sounds."""

    path: str
    unit: str
    value: float  # of the patch
    low: float
    high: float
    is_logarithmic: bool
    rows: Rows  # whose values follow a law
    law: Law
    label: str = ""  # its name for people


def sliders_of_player(player: RowRecorder, chosen: Container[str] = ()) -> list[Slider]:
    """Return the numbers of a patch that glide; if there are too many, those that were chosen."""
    scene = player.patch if player.voices else player.scene
    paths = live_paths(scene) if player.voices else player.live_paths  # a number of the patch is that of all voices
    labels = labels_of(scene, paths)
    sliders, glided = list[Slider](), {name: path for name, path in paths.items() if path.is_glided}
    if len(glided) > MAX_SLIDERS:
        glided = {name: path for name, path in glided.items() if name in chosen}
    for parameter, path in glided.items():
        value, key = value_at(scene, path), str(path.keys[0])
        is_linear = key in LEAST_REACH
        if not is_linear and value <= 0.0:
            continue
        reach = max(LEAST_REACH.get(key, 0.0), 2.0 * abs(value))
        low, high = (value - reach, value + reach) if is_linear else (value / TIMES, value * TIMES)
        limits = live_range(scene, *path[:3])
        ends = max(low, limits.low), min(high, limits.high)
        law = _find_law(player, parameter, value, ends)
        rows = _rows_at(player, parameter, value)
        sliders.append(
            Slider(parameter, limits.unit, value, *ends, not is_linear, rows, law, labels.get(parameter, ""))
        )
    return sliders


def _rows_at(player: RowRecorder, parameter: str, value: float) -> Rows:
    for target in targets_of_all(player, parameter) if player.voices else [parameter]:
        player.set(target, value, SLIDER_SECONDS)
    return player.take_rows()


def _find_law(player: RowRecorder, parameter: str, value: float, ends: tuple[float, float]) -> Law:
    """Return the law of the rows of a live parameter. value: of the patch. Raises CannotExport if none is known."""
    places = [value, *(ends[0] + share * (ends[1] - ends[0]) for share in TRIED_SHARES)]
    tried = [(one, [row[6] for row in _rows_at(player, parameter, one)]) for one in places]
    counts = {1, *(contact.bridge.points for contact in player.scene.contact if contact.bridge is not None)}
    known = [Law(), *(Law(part=count, unit=value / count) for count in counts if value)]
    heights = {point.offset for _, point in player.layout.islands.contact_points if hasattr(point, "offset")}
    heights |= {contact.bridge.height for contact in player.scene.contact if contact.bridge is not None}
    known += [Law(shift=height, part=sign) for height in (value, *sorted(heights)) for sign in (1.0, -1.0)]
    for coordinates in player.layout.islands.coordinates:
        known += [Law(compliance=item.excess, most=MAX_SHARE_LATER) for item in coordinates.items if item.excess]
    for law in known:
        if all(law.row_value(one) == found for one, row in tried for found in row):
            return law
    raise CannotExport(f"{parameter} can have no slider: its events follow from it in a way that no page knows")
