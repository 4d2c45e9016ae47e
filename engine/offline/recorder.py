"""Recorders: what stands before a Simulation, and looks at its state between blocks. They may stand before each other,
and leave the samples as they are."""

from typing import Protocol

import numpy as np

from engine.kernel.data.state import Trace
from engine.offline.trace import trace_rows


class Renderer(Protocol):
    """Advances a scene by blocks of samples: a Simulation, or a recorder before one."""

    def render_block(self, audio: np.ndarray, trace: Trace | None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""


class Recorder:
    """A renderer that looks at the state between blocks, and first of all before any.

    frames: a block ends at each multiple of so many; a look may change it
    frame:  the next one
    """

    def __init__(self, renderer: Renderer, frames: int) -> None:
        self._renderer, self.frames, self.frame = renderer, frames, 0

    def look(self) -> None:
        """Read the state after the samples up to `frame`."""

    def render_block(self, audio: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""
        if not len(audio):
            self._renderer.render_block(audio, trace)
        done = 0
        with np.errstate(all="ignore"):  # a state that is not finite is reported elsewhere
            while done < len(audio):
                count = min(len(audio) - done, self.frames - self.frame % self.frames)
                rows = None if trace is None else trace_rows(trace, done, done + count)
                self._renderer.render_block(audio[done : done + count], rows)
                self.frame, done = self.frame + count, done + count
                self.look()
