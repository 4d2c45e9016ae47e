"""Sliders of numbers that tables are made of, such as a pitch: the tables of each position are made at export."""

from collections.abc import Sequence
from typing import NamedTuple

from engine.assembly.table_changes import Exchange, NewValue
from engine.export.exchange_bytes import row_of_exchange, writes_alike
from engine.export.faults import CannotExport
from engine.export.row_recorder import RowRecorder, Rows
from engine.export.scene_bytes import SceneBytes
from engine.instrument.bent_parameters import bent_parameters
from engine.live.key_allocator import KeyAllocator
from engine.live.key_bends import KeyBends
from engine.live.midi_notes import Note
from engine.patch.labels import labels_of
from engine.patch.live_parameters import LivePath, explain_unknown, value_at
from engine.patch.live_ranges import live_range

POSITIONS = 12  # of a slider on either side of the patch's value …
RATIO = 2.0 ** (1.0 / POSITIONS)  # … and of each to the one before: it reaches from half to twice the value
BEND = "bend"  # names the pitch wheel of an instrument among the parameters …
BEND_POSITIONS = 8  # … which has so many on either side
CENTS = 100.0  # of a semitone


class TableSlider(NamedTuple):
    """A number of a patch with a few positions, each of which exchanges tables."""

    path: str
    unit: str
    values: list[float]  # at each position
    home: int  # position of the patch's value
    rows: Rows  # one for each position
    overlapping: list[int]  # sliders that change tables of this one: one of them at a time is away from home
    label: str = ""  # its name for people


class Wanted(NamedTuple):
    """A slider that is to be made."""

    path: str
    unit: str
    home: float
    positions: dict[float, list[NewValue]]  # what each value gives to live parameters


def paths_of_sliders(player: RowRecorder, parameters: Sequence[str]) -> dict[str, LivePath | None]:
    """Return the live parameters that are to have sliders, by their names; the pitch wheel has no path. Raises
    CannotExport for an unknown one."""
    known, paths = player.live_paths, dict[str, LivePath | None]()
    for parameter in parameters:
        if parameter not in known and parameter != BEND:
            raise CannotExport(explain_unknown(parameter, list(known)))
        paths[parameter] = known.get(parameter)
    return paths


def add_table_sliders(
    laid_out: SceneBytes, player: RowRecorder, paths: dict[str, LivePath | None]
) -> list[TableSlider]:
    """Add the tables of sliders to the bytes of a player. Raises CannotExport if a parameter can have no slider."""
    wanted = [_wheel_of(player) if path is None else _slider_of(player, name, path) for name, path in paths.items()]
    scored, made = player.tables.exchanges, [_exchanges_of(player, one) for one in wanted]
    for one, exchanges in zip(wanted, made, strict=True):
        if any(writes_alike(exchanges[0].copies, other.copies) for other in scored):
            raise CannotExport(f"{one.path} can have no slider, as the score or a key changes the same tables")
    sliders, labels = [], labels_of(player.scene, player.live_paths)
    for n, (one, exchanges) in enumerate(zip(wanted, made, strict=True)):
        by_values = {tuple(values): value for value, values in one.positions.items()}
        values = [by_values[exchange.values] for exchange in exchanges]
        alike = [m for m, other in enumerate(made) if m != n and writes_alike(other[0].copies, exchanges[0].copies)]
        rows = [row_of_exchange(laid_out, exchange) for exchange in exchanges]
        label = labels.get(one.path, "")
        sliders.append(TableSlider(one.path, one.unit, values, values.index(one.home), rows, alike, label))
    return sliders


def _slider_of(player: RowRecorder, name: str, path: LivePath) -> Wanted:
    """Return the slider of a live parameter."""
    value, limits = value_at(player.scene, path), live_range(player.scene, *path[:3])
    if value <= 0.0:
        raise CannotExport(f"{name} can have no slider, as it is {value:g}: a slider goes from half to twice the value")
    values = [value * RATIO**n for n in range(-POSITIONS, POSITIONS + 1)]
    return Wanted(name, limits.unit, value, {one: [NewValue(path, name, one)] for one in values if one in limits})


def _wheel_of(player: RowRecorder) -> Wanted:
    """Return the pitch wheel of an instrument, which bends all its keys."""
    if player.patch.instrument is None:
        raise CannotExport("the patch has no keys to bend; give the pitch of a body a slider")
    bodies = [body.model_dump(exclude_unset=True) for body in player.scene.body]
    bent = [one for one in bent_parameters(bodies, KeyAllocator(player).keys) if one.path in player.live_paths]
    if not bent:
        raise CannotExport("no key has a frequency or a tension to bend")
    bends, positions = KeyBends(bent, {}), dict[float, list[NewValue]]()
    for n in range(-BEND_POSITIONS, BEND_POSITIONS + 1):
        cents = CENTS * player.patch.midi.bend_range * n / BEND_POSITIONS
        bends.follow(Note(0.0, "bend", 0, cents))
        positions[cents] = [NewValue(player.live_paths[path], path, value) for path, value in bends.values().items()]
    return Wanted(BEND, "cents", 0.0, positions)


def _exchanges_of(player: RowRecorder, wanted: Wanted) -> list[Exchange]:
    """Return the exchanges of the positions of a slider that are possible."""
    exchanges = player.tables.alternatives(list(wanted.positions.values()))
    home = tuple(wanted.positions[wanted.home])
    if home not in [exchange.values for exchange in exchanges] or len(exchanges) == 1:
        raise CannotExport(f"{wanted.path} can have no slider: no other value has as many modes and contacts")
    return exchanges
