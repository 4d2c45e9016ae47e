"""Keys that change a body, such as the length of a string: the tables of each value are made at export."""

from typing import Any

from engine.assembly.event_table import EventRow
from engine.assembly.table_changes import Exchange, NewValue
from engine.export.exchange_bytes import row_of_exchange, writes_alike
from engine.export.faults import CannotExport
from engine.export.row_recorder import RowRecorder
from engine.export.scene_bytes import SceneBytes
from engine.kernel.data.enums import EventKind

ROW_NUMBERS = len(EventRow._fields)
VALUE = EventRow._fields.index("value")
OWN = [EventRow._fields.index(name) for name in ("start", "note", "is_release")]  # places in a row that the key knows


def add_key_tables(laid_out: SceneBytes, player: RowRecorder, rows: Any) -> Any:
    """Add the tables of what keys exchange to the bytes of a player. Return the rows of these keys, lists within lists
    and records, with their addresses. Raises CannotExport if an exchange is impossible, or tables of one number are
    those of another, too."""
    made = [row_of_exchange(laid_out, exchange) for exchange in _exchanges_of(player)]

    def complete(node: Any) -> Any:
        if isinstance(node, dict):
            return {name: complete(inner) for name, inner in node.items()}
        if not isinstance(node, list):
            return node
        if len(node) != ROW_NUMBERS or node[0] != EventKind.EXCHANGE_TABLES:
            return [complete(inner) for inner in node]
        return [node[place] if place in OWN else number for place, number in enumerate(made[int(node[VALUE])])]

    return complete(rows) if made else rows


def _exchanges_of(player: RowRecorder) -> list[Exchange]:
    """Return an exchange for each of the values that keys give to live parameters."""
    by_parameter, by_value = dict[str, list[NewValue]](), dict[NewValue, Exchange]()
    for new in player.exchanged:
        by_parameter.setdefault(new.parameter, []).append(new)
    for parameter, values in by_parameter.items():
        exchanges = player.tables.alternatives([[new] for new in values])
        if len(exchanges) < len(values):
            raise CannotExport(f"a key gives {parameter} a value at which it has other modes or contacts")
        if any(writes_alike(exchanges[0].copies, other.copies) for other in by_value.values()):
            raise CannotExport(f"keys change {parameter} and another number of the same tables")
        by_value |= dict(zip(values, exchanges, strict=True))
    return [by_value[new] for new in player.exchanged]
