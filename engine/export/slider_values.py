"""Places of the present values of sliders in the memory of a page, whose sliders follow the score."""

from collections.abc import Sequence
from typing import NamedTuple

from engine.assembly.event_table import find_changed_number
from engine.export.row_recorder import RowRecorder, Slider
from engine.export.scene_bytes import SceneBytes


class ValuePlace(NamedTuple):
    """A number of the kernel that the row of a slider changes: the value of the row is (number - shift)/unit."""

    address: int
    shift: float
    unit: float


def find_value_places(laid_out: SceneBytes, player: RowRecorder, sliders: Sequence[Slider]) -> list[ValuePlace]:
    """Return the place of each slider: of several contact points or voices, that of the first."""
    places = []
    for slider in sliders:
        kind, island, target = map(int, slider.rows[0][:3])
        changed = find_changed_number(player.layout, player.model, player.state, (kind, island, target))
        address = laid_out.address(changed.array) + changed.array.itemsize * changed.place
        places.append(ValuePlace(address, changed.shift, changed.unit))
    return places
