"""Record of the bodies that stretch in a rendering: when they did, and how far their tensions rose.

The tensions of the last three steps are read from the state, between blocks. How far a tension can rise follows from
the energy of its body; only while that is more than has been seen are the blocks short.
"""

from dataclasses import dataclass

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.tension import stretching_bodies
from engine.bodies import String
from engine.kernel.data.enums import Stretch
from engine.kernel.data.state import State
from engine.offline.recorder import Recorder, Renderer
from engine.offline.shape_snapshots import body_shape
from engine.offline.statistics_base import Statistics

LAST_RISES = [Stretch.LAST, Stretch.SECOND_LAST, Stretch.THIRD_LAST]
FRAMES_IF_LOUD = len(LAST_RISES)  # of a block, while a tension may rise to more than has been seen
FRAMES_BETWEEN_BOUNDS = 64  # which follow from energies


@dataclass(frozen=True)
class StretchingStatistics(Statistics):
    """Stretching of a body in a rendering."""

    body: str
    unit: str  # of a rise: N of a string, N/m of a sheet
    intervals: list[list[float]]  # s: begin and end of each in which it stretched; else it was linear
    rise: float  # of its tension, at most
    relative_rise: float | None  # of its tension at rest; None of a plate without one
    time: float  # s, of that rise
    amplitude: float  # m, at that time: of a string from the line between its ends


class StretchingRecord(Recorder):
    """A renderer that keeps a record of the bodies that stretch. frames: of a block at most"""

    def __init__(self, renderer: Renderer, state: State, layout: Layout, frames: int) -> None:
        super().__init__(renderer, frames)
        stretching, islands = stretching_bodies(layout), layout.islands
        self._state, self._tension, self._layout = state, state.tension, layout
        self._frames_if_quiet, self._last_look, self._next_bound = frames, 0, 0
        self._numbers = list(stretching)
        self._rows = [islands.body_order.index(b) for b in stretching]
        inside = [layout.modes.of_body[b] for b in stretching]
        self._modes = np.concatenate([np.arange(modes.start, modes.stop) for modes in inside])
        self._begins = np.cumsum([0, *(modes.stop - modes.start for modes in inside[:-1])])
        self._omega_squared = layout.modes.omega[self._modes] ** 2
        self._kappa = np.concatenate([of_body.kappa for of_body in stretching.values()])
        self._stiffness = np.array([of_body.stiffness for of_body in stretching.values()])
        with np.errstate(divide="ignore"):  # the second polarisation has modes that do not stretch
            self._hardness = np.minimum.reduceat(self._omega_squared / self._kappa, self._begins)
        count = len(stretching)
        self._rise, self._rise_frame = np.zeros(count), np.zeros(count, np.int64)
        self._q = [np.zeros(modes.stop - modes.start) for modes in inside]
        self._intervals: list[list[list[int]]] = [[] for _ in stretching]
        self._was_active = np.zeros(count, bool)
        self._set_loud(True)
        self.look()

    def _set_loud(self, is_loud: bool) -> None:
        self.frames = FRAMES_IF_LOUD if is_loud else self._frames_if_quiet

    def look(self) -> None:
        """Read which bodies stretch, and their tensions; and find if these can rise further than they have."""
        is_active = self._tension.body[self._rows, Stretch.STRETCHES] != 0.0
        for n, intervals in enumerate(self._intervals):
            if is_active[n] and not self._was_active[n]:
                intervals.append([self._last_look, self.frame])
            elif is_active[n]:
                intervals[-1][1] = self.frame
        self._last_look, self._was_active = self.frame, is_active
        if not is_active.any():
            self._set_loud(False)
            return
        rises = self._tension.body[self._rows][:, LAST_RISES].max(axis=1) * is_active
        for i in np.flatnonzero(rises > self._rise):
            self._rise[i], self._rise_frame[i] = rises[i], self.frame
            self._q[i] = self._state.q[self._modes[self._begins[i] :][: self._q[i].size]]
        if self.frame >= self._next_bound:
            possible = self._possible_rises() * is_active
            self._set_loud(bool((possible > self._rise).any()))
            self._next_bound = self.frame + FRAMES_BETWEEN_BOUNDS

    def _possible_rises(self) -> np.ndarray:
        """Return how far the energy of each body can raise its tension: λ with λ·c²/(2K) + λ²/(4K) = E, where c² is
        the least ω²/κ."""
        q, p = (modes[self._modes].astype(float) for modes in (self._state.q, self._state.p))
        vibration = np.add.reduceat(p * p + self._omega_squared * q * q, self._begins) / 2
        energy = vibration + self._stiffness / 4 * np.add.reduceat(self._kappa * q * q, self._begins) ** 2
        hardness = self._hardness
        return np.asarray(hardness * (np.sqrt(1 + 4 * self._stiffness * energy / hardness**2) - 1))

    def statistics(self, samplerate: float) -> list[StretchingStatistics]:
        """Return what was recorded, by body. samplerate: of the frames, Hz"""
        return [self._statistics_of(n, samplerate) for n in range(len(self._numbers))]

    def _statistics_of(self, n: int, samplerate: float) -> StretchingStatistics:
        b = self._numbers[n]
        body, shape, rise = self._layout.scene.body[b], body_shape(self._layout.scene.body[b]), float(self._rise[n])
        tension, amplitude = body.tension_at_rest(), 0.0
        if shape is not None:
            rows = self._layout.modal_bodies[b].shape(shape.positions[shape.is_inside])
            amplitude = float(np.max(np.abs(rows @ self._q[n])))
        return StretchingStatistics(
            body=body.name,
            unit="N" if isinstance(body, String) else "N/m",
            intervals=[[begin / samplerate, end / samplerate] for begin, end in self._intervals[n]],
            rise=rise,
            relative_rise=None if tension is None else rise / tension,
            time=float(self._rise_frame[n] / samplerate),
            amplitude=amplitude,
        )
