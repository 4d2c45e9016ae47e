"""Record of the bodies that stretch in a rendering: when they did, how far their tensions rose, and warnings.

The tensions of the last three steps are read from the state, between blocks. How far a tension can rise follows from
the energy of its body; only while that is more than has been seen are the blocks short.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from engine.assembly.layout import Layout
from engine.assembly.tension import stretching_bodies
from engine.bodies import Body, Plate, String
from engine.bodies.stretching import Stretching
from engine.kernel.data.enums import Stretch
from engine.kernel.data.state import State, Trace
from engine.offline.shape_snapshots import body_shape
from engine.offline.statistics_base import Statistics
from engine.offline.trace import trace_rows

MAX_RELATIVE_RISE = 0.5  # of a tension: beyond, slopes are not small
LAST_RISES = [Stretch.LAST, Stretch.SECOND_LAST, Stretch.THIRD_LAST]
FRAMES_IF_LOUD = len(LAST_RISES)  # of a block, while a tension may rise to more than has been seen
FRAMES_OF_RENDER = 256  # of a block otherwise; to look between blocks takes as long as some samples
FRAMES_BETWEEN_BOUNDS = 64  # which follow from energies


class Renderer(Protocol):
    """Advances a scene by blocks of samples: a Simulation, or what stands before one."""

    def render_block(self, audio: np.ndarray, trace: Trace | None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""


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


class StretchingRecord:
    """A renderer that keeps a record of the bodies that stretch.

    frames:       of a block at most
    only_beyond:  record rises of tension only where they may lead to a warning
    """

    def __init__(
        self, renderer: Renderer, state: State, layout: Layout, frames: int, only_beyond: bool = False
    ) -> None:
        assert state.tension is not None
        stretching, islands = stretching_bodies(layout), layout.islands
        self._renderer, self._state, self._tension, self._layout = renderer, state, state.tension, layout
        self._frames, self._frame, self._last_look, self._next_bound, self._is_loud = frames, 0, 0, 0, True
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
        limits = [rise_to_warn_of(layout.scene.body[b], of_body) for b, of_body in stretching.items()]
        self._least = np.array(limits) if only_beyond else np.zeros(len(limits))
        self._rise, self._rise_frame = np.zeros(len(limits)), np.zeros(len(limits), np.int64)
        self._q = [np.zeros(modes.stop - modes.start) for modes in inside]
        self._intervals: list[list[list[int]]] = [[] for _ in limits]
        self._was_active = np.zeros(len(limits), bool)
        self._look()

    def render_block(self, audio: np.ndarray, trace: Trace | None = None) -> None:
        """Render len(audio) samples into audio [frames, channels], and fill the trace; of none, compile."""
        if not len(audio):
            self._renderer.render_block(audio, trace)
        done = 0
        while done < len(audio):
            count = min(len(audio) - done, FRAMES_IF_LOUD if self._is_loud else self._frames)
            rows = None if trace is None else trace_rows(trace, done, done + count)
            self._renderer.render_block(audio[done : done + count], rows)
            self._frame, done = self._frame + count, done + count
            self._look()

    def _look(self) -> None:
        """Read which bodies stretch, and their tensions; and find if these can rise further than they have."""
        is_active = self._tension.body[self._rows, Stretch.STRETCHES] != 0.0
        for n, intervals in enumerate(self._intervals):
            if is_active[n] and not self._was_active[n]:
                intervals.append([self._last_look, self._frame])
            elif is_active[n]:
                intervals[-1][1] = self._frame
        self._last_look, self._was_active = self._frame, is_active
        if not is_active.any():
            self._is_loud = False
            return
        rises = self._tension.body[self._rows][:, LAST_RISES].max(axis=1) * is_active
        for i in np.flatnonzero(rises > self._rise):
            self._rise[i], self._rise_frame[i] = rises[i], self._frame
            self._q[i] = self._state.q[self._modes[self._begins[i] :][: self._q[i].size]]
        if self._frame >= self._next_bound:
            possible = self._possible_rises() * is_active
            self._is_loud = bool((possible > np.maximum(self._rise, self._least)).any())
            self._next_bound = self._frame + FRAMES_BETWEEN_BOUNDS

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

    def warnings(self, samplerate: float) -> list[str]:
        """Return warnings of bodies that move further than their model holds. samplerate: of the frames, Hz"""
        bodies = [self._layout.scene.body[b] for b in self._numbers]
        of_bodies = zip(bodies, self.statistics(samplerate), self._stiffness, strict=True)
        return [
            line for body, of_body, stiffness in of_bodies for line in warn_of_large_motion(body, of_body, stiffness)
        ]


def rise_to_warn_of(body: Body, stretching: Stretching) -> float:
    """Return the rise of the tension of a body below which no warning is due, N of a string, N/m of a sheet."""
    if isinstance(body, Plate):  # its lowest mode by half its thickness; higher modes have larger slopes
        half = plate_thickness(body, stretching.stiffness) / 2
        return float(stretching.stiffness * stretching.kappa.min() * half**2 * body.total_mass() / 4)
    return MAX_RELATIVE_RISE * (body.tension_at_rest() or 0.0)


def warn_of_large_motion(body: Body, of_body: StretchingStatistics, stiffness: float) -> list[str]:
    """Warn of a body that has moved further than its model holds. stiffness: K of its Stretching"""
    motion = f"{1e3 * of_body.amplitude:.3g} mm at {of_body.time:.3f} s"
    if isinstance(body, Plate):
        thickness = plate_thickness(body, stiffness)
        if of_body.amplitude <= thickness:
            return []
        return [
            f'"{body.name}" moves by {motion}, more than its thickness of {1e3 * thickness:.3g} mm: the model of its'
            " stretch (Berger) is coarse there, and modes do not exchange their energies as in a plate of von Kármán"
        ]
    if of_body.relative_rise is None or of_body.relative_rise <= MAX_RELATIVE_RISE:
        return []
    return [
        f'the tension of "{body.name}" rises by {of_body.relative_rise:.0%} as it moves by {motion}: outside the theory'
        " of small slopes"
    ]


def plate_thickness(plate: Plate, stiffness: float) -> float:
    """Return the thickness of a plate, m; if it is not given, √(12·D/(E·h/(1 - ν²))). stiffness: K of its Stretching"""
    return plate.thickness or math.sqrt(12 * plate.stiffness().x / (2 * stiffness * plate.area()))
