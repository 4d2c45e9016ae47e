"""The data file of a plug-in (.fdh): a patch at some sample rates, as `engine/export/plugin/fdh_file.c` reads it.

All numbers are little-endian words of eight bytes. A head says what the file is; a table of sections says where each
is, and its checksum. Sections are packed: all first bytes of their words, then all second ones, …, deflated (RFC 1951).
"""

import struct
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from engine.bodies.string import String
from engine.compiler import cache
from engine.compiler.kernel_name import KernelName
from engine.export.exchange_bytes import add_queued_exchanges
from engine.export.faults import CannotExport
from engine.export.key_tables import add_key_tables
from engine.export.page import by_place
from engine.export.player_bytes import MEMORY, arrays_of_player, lay_out_player
from engine.export.row_recorder import (
    LEVELS,
    PEDAL_DOWN,
    SHARES,
    Key,
    Law,
    RowRecorder,
    Rows,
    Slider,
    check_output,
    keys_of_pads,
    keys_of_player,
    player_of_keys,
    player_of_scene,
    rows_of_choke,
    sliders_of_player,
)
from engine.export.scene_bytes import SceneBytes
from engine.export.shared_bytes import SharedBytes
from engine.export.table_sliders import BEND, TableSlider, add_table_sliders, paths_of_sliders
from engine.patch.scene import Scene
from engine.provenance import ENGINE, version_of
from engine.runtime.jobs import Job

SAMPLERATES = 44_100, 48_000, 96_000  # Hz: those of most projects
MAGIC = b"FDHPLUG1"
HEAD_WORDS, SECTION_WORDS = 16, 8
LEVEL_COUNT, NO_GROUP, NO_TABLE = len(LEVELS), -1, -1
SLIDER, TABLE, WHEEL = range(3)  # kinds of controls
ROW = struct.Struct("<9q3d")  # kind, …, is_release; where the copies of an exchange are; values
CONTROL = struct.Struct("<7q8d")  # kind, rows, positions; range, value of the patch, law
RATE_NUMBERS = (  # of a sample rate: numbers, and then places in what each instance has for itself
    *("HAS_STAGES", "ISLANDS", "REST", "MEMORY", "RENDER_AT", "INSERT_AT"),
    *("COUNTERS", "GAUGES", "EVENTS", "VALUES", "BALANCE", "SLEEP"),
)
MAX_RATES, MAX_OVERLAPPING = 8, 63
LOWEST_RATE, HIGHEST_RATE = 8_000, 384_000  # Hz
MEGABYTE = 1e6


class Section:
    """Kinds of sections of a file."""

    NUMBERS, TEXTS, LEVELS, RATE, SHARED, PRIVATE, POINTERS, ROWS, KEYS, CONTROLS, POSITIONS = range(1, 12)


class PluginSettings(NamedTuple):
    """Settings of a plug-in's data.

    find_gain: returns the factor on SI units; called once it is known that the scene can become a plug-in
    slide:     live parameters that are to have positions with tables of their own; or the wheel
    """

    name: str
    find_gain: Callable[[], float]
    samplerates: Sequence[int] = SAMPLERATES  # Hz
    slide: Sequence[str] = ()


class PluginData(NamedTuple):
    """A data file, with names, outputs and parameters for descriptions of the plug-in."""

    content: bytes
    title: str
    author: str
    licence: str
    channels: int
    controls: list[Slider | TableSlider]  # without the wheel


def make_plugin_data(
    scene: Scene, settings: PluginSettings, report: Callable[[int], object] = lambda rate: None
) -> PluginData:
    """Return the data file of a scene. report: called with each sample rate that is begun

    Raises CannotExport (a ValueError) with the reason if the scene cannot become a plug-in, BuildError (a ValueError)
    if it cannot be built.
    """
    check_output(scene, "a plug-in")
    rates = list(dict.fromkeys(settings.samplerates))
    if not 1 <= len(rates) <= MAX_RATES:
        raise CannotExport(f"a plug-in has 1 to {MAX_RATES} sample rates, not {len(rates)}")
    if wrong := [rate for rate in rates if not LOWEST_RATE <= rate <= HIGHEST_RATE]:
        raise CannotExport(f"{wrong[0]} Hz is no sample rate of a plug-in; {LOWEST_RATE} to {HIGHEST_RATE} Hz are")
    sections, made = list[tuple[int, int, bytes]](), list[_AtRate]()
    for rate in rates:
        report(rate)
        made.append(_AtRate(scene, rate, settings))
        sections += made[-1].sections
    first = made[0]
    if any(one.names != first.names for one in made):
        raise CannotExport("its keys or live parameters are others at another sample rate; give one of --rates")
    keyboard = scene.instrument["keyboard"] if scene.instrument is not None else {}
    numbers = [scene.channels, keyboard.get("polyphony") or 0, len(first.keys), len(first.controls), len(rates)]
    gain = struct.unpack("<q", struct.pack("<d", settings.find_gain()))[0]
    name = settings.name
    title = scene.title or name
    texts = [name, title, scene.author, scene.licence, version_of(ENGINE)]
    texts += [key.name for key in first.keys]
    texts += [word for control in first.controls for word in (control.path, control.unit)]
    joined = b"".join(text.encode() + b"\0" for text in texts)
    head = [
        (Section.NUMBERS, 0, _words([*numbers, gain])),
        (Section.TEXTS, 0, joined + bytes(-len(joined) % 8)),
        (Section.LEVELS, 0, _words([*LEVELS, PEDAL_DOWN, *SHARES])),
    ]
    controls = [control for control in first.controls if control.path != BEND]
    return PluginData(_compose([*head, *sections]), title, scene.author, scene.licence, scene.channels, controls)


class _AtRate:
    """Contents of a file for a sample rate."""

    def __init__(self, scene: Scene, rate: int, settings: PluginSettings) -> None:
        has_keys = scene.instrument is not None
        player = (player_of_keys if has_keys else player_of_scene)(scene, rate, KernelName.GENERAL)
        self.rate = rate
        laid_out = lay_out_player(player.memory, pointer_bytes=8, base=0)
        add_queued_exchanges(laid_out, player.memory.shared, player.tables.exchanges)
        keys = (keys_of_player if has_keys else keys_of_pads)(player)
        tables_of_keys = add_key_tables(laid_out, player, {"keys": [key._asdict() for key in keys]})
        self.keys = [Key(**key) for key in tables_of_keys["keys"]]
        self._chokes = [rows_of_choke(player, key) for key in self.keys]
        paths = paths_of_sliders(player, settings.slide)
        tables = _tables_of(laid_out, player, paths)
        sliders = sliders_of_player(player, paths)
        self.controls: list[Slider | TableSlider] = [*sliders, *tables]
        parts = SharedBytes(laid_out)
        self._place, self._rows = parts.place, bytearray()
        spans = self._pack_keys()
        controls, positions = self._pack_controls(len(sliders))
        sections = {
            Section.RATE: _words(_numbers_of(player, laid_out, parts)),
            Section.SHARED: bytes(parts.shared),
            Section.PRIVATE: bytes(parts.private),
            Section.POINTERS: _words(parts.pointers),
            Section.ROWS: bytes(self._rows),
            Section.KEYS: spans,
            Section.CONTROLS: controls,
            Section.POSITIONS: positions,
        }
        self.sections = [(kind, rate, content + bytes(-len(content) % 8)) for kind, content in sections.items()]

    @property
    def names(self) -> list[Any]:
        """Keys and parameters, which must be the same at all rates."""
        return [[key.number for key in self.keys], [(one.path, one.unit) for one in self.controls]]

    def _add(self, rows: Rows) -> tuple[int, int]:
        """Add rows; return where they begin, and how many they are."""
        begin = len(self._rows) // ROW.size
        for row in rows:
            table = self._place(int(row[11])) if len(row) > 11 else NO_TABLE
            self._rows += ROW.pack(*map(int, [*row[:6], *row[9:11]]), table, *row[6:9])
        return begin, len(rows)

    def _pack_keys(self) -> bytes:
        groups, words = list(dict.fromkeys(key.group for key in self.keys if key.group is not None)), list[int]()
        for key, choke in zip(self.keys, self._chokes, strict=True):
            group = NO_GROUP if key.group is None else groups.index(key.group)
            on, off = map(self._spans, (key.on, key.off))
            soft_on, soft_off = map(self._spans, (key.soft_on or key.on, key.soft_off or key.off))
            spans = [*on, *soft_on, *off, *soft_off, *map(self._add, [*key.damp, key.lift, key.steal, choke])]
            words += [key.number, group, *(number for span in spans for number in span)]
        return _words(words)

    def _spans(self, levels: list[Rows]) -> list[tuple[int, int]]:
        """Add rows at each of LEVELS, or at one for all."""
        spans = [self._add(rows) for rows in levels]
        return spans if len(spans) > 1 else spans * LEVEL_COUNT

    def _pack_controls(self, sliders: int) -> tuple[bytes, bytes]:
        controls, positions = bytearray(), list[float]()
        for n, one in enumerate(self.controls):
            begin, count = self._add(one.rows)
            if isinstance(one, TableSlider):
                kind = WHEEL if one.path == BEND else TABLE
                mask = sum(1 << sliders + other for other in one.overlapping)
                ends, law, first = (one.values[0], one.values[-1], one.values[one.home]), Law(), len(positions)
                positions += one.values
            else:
                kind, mask, ends, law, first = SLIDER, 0, (one.low, one.high, one.value), one.law, 0
            is_logarithmic = one.is_logarithmic if isinstance(one, Slider) else kind == TABLE
            controls += CONTROL.pack(kind, int(is_logarithmic), begin, count, first, mask, n, *ends, *law)
        return bytes(controls), np.array(positions, float).tobytes()


def _tables_of(laid_out: SceneBytes, player: RowRecorder, paths: dict[str, Any]) -> list[TableSlider]:
    """Add the tables of sliders, and of the wheel of an instrument with strings, which their tension bends. Raises
    CannotExport if one that is wanted is impossible."""
    tabled = {name: path for name, path in paths.items() if path is None or not path.is_glided}
    has_strings = any(isinstance(body, String) for body in player.scene.body)
    if has_strings and player.patch.instrument is not None and BEND not in tabled:
        with suppress(CannotExport):  # keys that change the same tables, such as the length of a string
            return add_table_sliders(laid_out, player, {**tabled, BEND: None})
    tables = add_table_sliders(laid_out, player, tabled)
    if len(tables) > MAX_OVERLAPPING:
        raise CannotExport(f"a plug-in has at most {MAX_OVERLAPPING} parameters with tables; give fewer --slide")
    return tables


def _numbers_of(player: RowRecorder, laid_out: SceneBytes, parts: SharedBytes) -> list[int]:
    """Return the RATE_NUMBERS."""
    arrays = arrays_of_player(player.memory) | {"sleep": player.state.sleep}
    places = {
        "memory": laid_out.values[MEMORY],
        "render_at": laid_out.place_of(player.memory.job_memory.job) + 8 * Job.RENDER_BLOCK,
        "insert_at": laid_out.place_in(MEMORY, "insert_event"),
        **{name: laid_out.place_of(array) for name, array in arrays.items()},
    }
    numbers = {"HAS_STAGES": int(player.model.refinement is not None)}
    numbers |= {"ISLANDS": len(player.state.sleep), "REST": player.state.sleep.shape[1]}
    numbers |= {name.upper(): parts.private_place(place) for name, place in places.items()}
    return [numbers[name] for name in RATE_NUMBERS]


def _words(numbers: Iterable[int]) -> bytes:
    return np.array(list(numbers), np.int64).tobytes()


def _pack(content: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(by_place(bytearray(content))) + packer.flush()
    return packed + bytes(-len(packed) % 8)


def _compose(sections: list[tuple[int, int, bytes]]) -> bytes:
    """Return the file. sections: kind, sample rate (0: for all) and content"""
    place, table, body = 8 * (HEAD_WORDS + SECTION_WORDS * len(sections)), list[int](), bytearray()
    for kind, rate, content in sections:
        packed = _pack(content)
        table += [kind, rate, place + len(body), len(packed), len(content), zlib.crc32(packed), zlib.crc32(content), 0]
        body += packed
    listed = _words(table)
    head = [int.from_bytes(MAGIC, "little"), 1, place + len(body), source_word(), len(sections), zlib.crc32(listed)]
    return _words([*head, *[0] * (HEAD_WORDS - len(head))]) + listed + bytes(body)


def source_word() -> int:
    """Return a digest of the sources of the kernels: a file is for these alone."""
    return int(cache.source_digest()[:15], 16)
