"""Sliders of numbers that tables are made of, such as a pitch: the tables of each position are made at export."""

from collections.abc import Sequence
from typing import NamedTuple

from engine.assembly.table_changes import Exchange, NewValue
from engine.export.exchange_bytes import row_of_exchange, writes_alike
from engine.export.faults import CannotExport
from engine.export.row_recorder import RowRecorder, Rows
from engine.export.scene_bytes import SceneBytes
from engine.patch.live_parameters import LivePath, current_path, explain_unknown, value_at
from engine.patch.live_ranges import live_range

POSITIONS = 12  # of a slider on either side of the patch's value …
RATIO = 2.0 ** (1.0 / POSITIONS)  # … and of each to the one before: it reaches from half to twice the value


class TableSlider(NamedTuple):
    """A number of a patch with a few positions, each of which exchanges tables."""

    path: str
    unit: str
    values: list[float]  # at each position
    home: int  # position of the patch's value
    rows: Rows  # one for each position
    overlapping: list[int]  # sliders that change tables of this one: one of them at a time is away from home


def paths_of_sliders(player: RowRecorder, parameters: Sequence[str]) -> dict[str, LivePath]:
    """Return the live parameters that are to have sliders, by their names. Raises CannotExport for an unknown one."""
    known = player.live_paths
    names = [current_path(known, parameter) for parameter in parameters]
    for name, parameter in zip(names, parameters, strict=True):
        if name not in known:
            raise CannotExport(explain_unknown(parameter, list(known)))
    return {name: known[name] for name in names}


def add_table_sliders(laid_out: SceneBytes, player: RowRecorder, paths: dict[str, LivePath]) -> list[TableSlider]:
    """Add the tables of sliders to the bytes of a player. Raises CannotExport if a parameter can have no slider."""
    scored, made = player.tables.exchanges, list[list[Exchange]]()
    for name, path in paths.items():
        exchanges = _positions(player, name, path)
        if any(writes_alike(exchanges[0].copies, one.copies) for one in scored):
            raise CannotExport(f"{name} can have no slider, as the score changes the same tables")
        made.append(exchanges)
    sliders = []
    for n, ((name, path), exchanges) in enumerate(zip(paths.items(), made, strict=True)):
        values = [exchange.values[0].value for exchange in exchanges]
        alike = [m for m, one in enumerate(made) if m != n and writes_alike(one[0].copies, exchanges[0].copies)]
        rows = [row_of_exchange(laid_out, exchange) for exchange in exchanges]
        unit = live_range(player.scene, *path[:3]).unit
        sliders.append(TableSlider(name, unit, values, values.index(value_at(player.scene, path)), rows, alike))
    return sliders


def _positions(player: RowRecorder, name: str, path: LivePath) -> list[Exchange]:
    """Return the exchanges of the positions of a slider that are possible."""
    value, limits = value_at(player.scene, path), live_range(player.scene, *path[:3])
    if value <= 0.0:
        raise CannotExport(f"{name} can have no slider, as it is {value:g}: a slider goes from half to twice the value")
    values = [value * RATIO**n for n in range(-POSITIONS, POSITIONS + 1)]
    exchanges = player.tables.alternatives([[NewValue(path, name, one)] for one in values if one in limits])
    possible = [exchange.values[0].value for exchange in exchanges]
    if value not in possible or len(possible) == 1:
        raise CannotExport(f"{name} can have no slider: no other value has as many modes or as many contacts")
    return exchanges
