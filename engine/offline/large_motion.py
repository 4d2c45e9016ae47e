"""Motion that is too large for the model of a body: the slopes of strings and membranes, and how many thicknesses
plates bend (docs/guarantees.md, "Large motion").

A bound follows from the energies of the modes; only while that is beyond what a model holds for is the motion itself
looked at.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from engine.assembly.connection_coordinates import find_stretching
from engine.assembly.layout import Layout
from engine.kernel.data.model import Model
from engine.kernel.data.state import State
from engine.offline.recorder import Recorder, Renderer
from engine.offline.shape_snapshots import body_shape

MAX_SLOPE = 0.1  # root of its mean square over the body: theories of small slopes leave out shares of slope²
MAX_THICKNESSES = 1.0  # that a plate bends: it is half as stiff again there as linear theory says
PEAK_SQUARE = 16.0  # of a mode shape over its mean square: at a free corner of a plate, the largest
FRAMES_OF_RENDER = 512  # of a block; to look between blocks takes as long as some samples
FRAMES_IF_LARGE = 64  # while a motion may be larger than what has been seen


class _Watched(NamedTuple):
    """A body whose motion is looked at."""

    number: int  # in the scene
    modes: np.ndarray  # positions of its modes in the arrays
    slopes: np.ndarray  # mean square of the slope of each mode, over MAX_SLOPE², 1/(kg·m²); 0 of a body that bends
    thickness: float | None  # m, of a body that bends
    bending: slice  # modes that bend it: not those that move it as a whole
    factor: float  # its motion is at most this times √(2·energy)
    stiffness: float  # K of Stretching
    kappa: np.ndarray  # κ of Stretching


class _Largest(NamedTuple):
    """The largest motion of a body up to now."""

    size: float  # 1 is the largest that its model holds for
    frame: int
    q: np.ndarray  # its modes then


class LargeMotion:
    """The largest motions of the bodies of a scene that may be too large for their models.

    model, state: in use; they may be rendered by another thread
    names:        of the bodies in warnings, if these are not those of the scene; several may have the same
    """

    def __init__(self, model: Model, state: State, layout: Layout, names: Sequence[str] | None = None) -> None:
        self._model, self._state, self._layout = model, state, layout
        self._names = [body.name for body in layout.scene.body] if names is None else names
        watched = (_watch(layout, number) for number in range(len(layout.scene.body)))
        self._watched = [body for body in watched if body is not None]
        self._largest: dict[int, _Largest] = {}
        self._rows: dict[int, np.ndarray] = {}  # mode shapes at all places of bodies that bend, made when needed
        if not self._watched:
            return
        modes = np.concatenate([body.modes for body in self._watched])
        is_row = bool((np.diff(modes) == 1).all())
        self._modes: Any = slice(int(modes[0]), int(modes[-1]) + 1) if is_row else modes  # a slice is read sooner
        self._begins = np.cumsum([0, *(body.modes.size for body in self._watched[:-1])])
        self._kappa = np.concatenate([body.kappa for body in self._watched])
        self._stiffness = np.array([body.stiffness for body in self._watched])
        self._factor = np.array([body.factor for body in self._watched])
        self._beyond = np.ones(len(self._watched))  # sizes that are not news, and the energies that they take at least
        self._enough = (self._beyond / self._factor) ** 2 / 2
        self._can_stretch = bool(self._stiffness.any())

    @property
    def has_limits(self) -> bool:
        """True if there is a body with a limit that is known."""
        return bool(self._watched)

    def may_be_large(self, energies: np.ndarray) -> bool:
        """True if a motion may be too large where each island has these energies at most, J [islands]."""
        islands = [self._layout.islands.of_body[body.number] for body in self._watched]
        return self.has_limits and bool((self._factor * np.sqrt(2 * energies[islands]) > 1.0).any())

    def look(self, frame: int) -> bool:
        """Read the state at a frame. Returns True if a motion may become too large, and larger than any before."""
        if not self._watched:
            return False
        q, p = self._state.q[self._modes], self._state.p[self._modes]
        squares, omega_squared = q * q, self._model.omega_squared
        energy = np.add.reduceat(p * p + omega_squared[self._modes] * squares, self._begins, dtype=float) / 2
        if self._can_stretch:
            energy += self._stiffness / 4 * np.add.reduceat(self._kappa * squares, self._begins) ** 2
        is_large = energy > self._enough
        if not is_large.any():
            return False
        for n in np.flatnonzero(is_large).tolist():
            begin = self._begins[n]
            modes = q[begin : begin + self._watched[n].modes.size].astype(float)
            size = self._size(n, modes)
            if size > self._beyond[n]:
                self._beyond[n], self._largest[n] = size, _Largest(size, frame, modes)
                self._enough[n] = (size / self._factor[n]) ** 2 / 2
        return True

    def _size(self, n: int, q: np.ndarray) -> float:
        """Return the motion of a body over the largest that its model holds for. q: its modes"""
        body = self._watched[n]
        if body.thickness is None:
            return math.sqrt(float(body.slopes @ (q * q)))
        return self._amplitude(n, q) / (MAX_THICKNESSES * body.thickness)

    def _amplitude(self, n: int, q: np.ndarray) -> float:
        """Return the largest displacement of a body, m, without what moves it as a whole."""
        if n not in self._rows:
            body = self._layout.scene.body[self._watched[n].number]
            shape = body_shape(body)
            assert shape is not None
            rows = self._layout.modal_bodies[self._watched[n].number].shape(shape.positions[shape.is_inside])
            self._rows[n] = np.ascontiguousarray(rows[:, self._watched[n].bending])
        return float(np.max(np.abs(self._rows[n] @ q[self._watched[n].bending])))

    def warnings(self, samplerate: float) -> list[str]:
        """Return a warning of each body whose motion was too large. samplerate: of the frames, Hz"""
        by_name: dict[str, int] = {}
        for n in sorted(self._largest, key=lambda n: -self._largest[n].size):
            by_name.setdefault(self._names[self._watched[n].number], n)
        return [self._warning(name, n, samplerate) for name, n in sorted(by_name.items(), key=lambda item: item[1])]

    def _warning(self, name: str, n: int, samplerate: float) -> str:
        body, largest = self._watched[n], self._largest[n]
        amplitude = self._amplitude(n, largest.q)
        moves = f'"{name}" moves by {1e3 * amplitude:.3g} mm at {largest.frame / samplerate:.3f} s'
        if body.thickness is None:
            return (
                f"{moves}, with a slope of {MAX_SLOPE * largest.size:.2g} (root mean square): theories of small slopes"
                f" hold up to about {MAX_SLOPE:g}"
            )
        thicknesses = f"{moves}, {amplitude / body.thickness:.3g} times its thickness of {1e3 * body.thickness:.3g} mm"
        if body.stiffness == 0.0:
            return f"{thicknesses}: linear bending holds up to about one; beyond, a plate is stiffer, and its modes mix"
        return (
            f"{thicknesses}: the model of its stretch (Berger) is coarse beyond one, and modes do not exchange their"
            " energies as in a plate of von Kármán"
        )


class MotionRecord(Recorder):
    """A renderer that keeps the largest motions of bodies."""

    def __init__(self, renderer: Renderer, motion: LargeMotion) -> None:
        super().__init__(renderer, FRAMES_OF_RENDER)
        self._motion = motion
        self.look()

    def look(self) -> None:
        """Look at the motion, the sooner again where it may be large; but not where a block ends for another reason:
        what is seen should not depend on that."""
        if self.frame % self.frames == 0:
            self.frames = FRAMES_IF_LARGE if self._motion.look(self.frame) else FRAMES_OF_RENDER


def _watch(layout: Layout, number: int) -> _Watched | None:
    """Return how the motion of a body is looked at; None if nothing limits it, or nothing is known of its limit."""
    table, modal = layout.scene.body[number], layout.modal_bodies[number]
    more = modal.residual + modal.silent
    of_slice = layout.modes.of_body[number]
    modes, omega = np.arange(of_slice.start, of_slice.stop), modal.omega[: modal.omega.size - more]
    slopes, thickness = table.slope_squares(omega), table.bending_thickness()
    if omega.size == 0 or (slopes is None and thickness is None):
        return None
    stretching = find_stretching(layout, table.name)
    kappa, stiffness = (np.zeros(modes.size), 0.0) if stretching is None else (stretching.kappa, stretching.stiffness)
    bending = slice(0, omega.size - table.count_whole_modes())
    with np.errstate(all="ignore"):
        if slopes is not None:
            slopes = np.concatenate([slopes, np.zeros(more)]) / MAX_SLOPE**2
            factor = math.sqrt(float(np.max(slopes[: omega.size] / omega**2)))
            return _Watched(number, modes, slopes, None, bending, factor, stiffness, kappa)
        assert thickness is not None
        compliance = PEAK_SQUARE / table.total_mass() * float(np.sum(1 / omega[bending] ** 2))  # of a place at most
    factor = math.sqrt(compliance) / (MAX_THICKNESSES * thickness)
    return _Watched(number, modes, np.zeros(modes.size), thickness, bending, factor, stiffness, kappa)
