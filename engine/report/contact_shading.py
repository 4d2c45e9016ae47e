"""The shading of the time in which bodies touch: of whatever size a picture is, every contact can be seen in it."""

from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection

MIN_PIXELS = 2.01  # of a contact's width: rounded to whole pixels it is never less than two
MIN_POINTS = 1.2  # likewise, in print
STYLE: dict[str, Any] = {"facecolor": "C1", "alpha": 0.25, "linewidth": 0}


class ContactShading(PolyCollection):
    """Intervals of a time axis [(begin, end), …], s, over the whole height of axes. Those shorter than two pixels of
    the picture are widened when it is drawn, for only then is its resolution known."""

    def __init__(self, axes: Any, intervals: list[tuple[float, float]]) -> None:
        super().__init__([], transform=axes.get_xaxis_transform(), **STYLE)
        self.intervals = intervals
        self.set_in_layout(False)

    def draw(self, renderer: Any) -> None:
        """Draw the intervals, at least two pixels wide each."""
        assert self.axes is not None
        figure = self.axes.figure
        assert figure is not None
        pixel = 1.0 / renderer.get_image_magnification()  # in units of the renderer: points, if it draws no pixels
        width = max(MIN_PIXELS * pixel, MIN_POINTS * figure.dpi / 72)
        low, high = sorted(self.axes.get_xlim())
        shown = widen(self.intervals, width * (high - low) / self.axes.bbox.width)
        self.set_verts([np.array([(begin, 0.0), (begin, 1.0), (end, 1.0), (end, 0.0)]) for begin, end in shown])
        super().draw(renderer)


def widen(intervals: list[tuple[float, float]], width: float) -> list[tuple[float, float]]:
    """The intervals, in order, each at least so wide; those that then overlap are one, not shaded twice."""
    widened: list[tuple[float, float]] = []
    for begin, end in sorted(intervals):
        end = max(end, begin + width)
        if widened and begin <= widened[-1][1]:
            begin, end = widened[-1][0], max(end, widened.pop()[1])
        widened.append((begin, end))
    return widened
