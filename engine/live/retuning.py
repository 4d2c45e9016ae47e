"""Retunes a voice of a polyphonic model: lists the numbers to copy from a model of one voice at the new pitch."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from engine.assembly.build import build
from engine.assembly.contact_points import entry_counts
from engine.assembly.layout import Layout
from engine.kernel.data.axes import Axis, Items, pair_arrays
from engine.kernel.data.model import (
    BasisCoefficients,
    Connections,
    ContactBasis,
    FreeFlight,
    Model,
    ModeShapeRows,
    RowCoefficients,
    StepCoefficients,
)
from engine.live.voices import replicate, retune, sounding_bodies, tuned_bodies
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene

GLIDE_STEP_SECONDS, GLIDE_STEP_CENTS = 0.002, 2.0  # the smallest steps in which a pitch glides …
MAX_GLIDE_STEPS = 128  # … and how many they are at most
MAX_MODES_COPIED = 20_000
NEUTRAL = {0.0: np.zeros(MAX_MODES_COPIED), 1.0: np.ones(MAX_MODES_COPIED)}

Arrays = tuple[np.ndarray, np.ndarray]  # to write, to read


class VoiceTuning:
    """The pitches of the voices of a player, and tables of what the audio thread copies to change them.

    patch:    the scene of one voice; voices, lowest: how many there are, and the ratio of the lowest pitch
    accuracy: of the polyphonic model
    """

    def __init__(self, patch: Scene, voices: int, lowest: float, accuracy: Accuracy, variable_exponents: bool) -> None:
        self._patch, self._lowest, self._accuracy = patch, lowest, accuracy
        self._variable_exponents = variable_exponents
        self._pitch: list[tuple[float, str | None]] = [(lowest, None)] * voices
        self._tables: dict[tuple[int, float, str | None], tuple[np.ndarray, Model]] = {}

    def glide(self, voice: int, ratio: float, seconds: float, body: str | None) -> list[float]:
        """Ratios of the steps in which a voice glides from its pitch to another, that one last."""
        before, of = self._pitch[voice]
        before = before if of == body else ratio  # from another body, nothing can glide
        cents = 1200.0 * abs(math.log2(ratio / before))
        steps = max(1, math.ceil(min(MAX_GLIDE_STEPS, seconds / GLIDE_STEP_SECONDS, cents / GLIDE_STEP_CENTS)))
        return [before * (ratio / before) ** (n / steps) for n in range(1, steps)] + [ratio]

    def keep(self, voice: int, ratio: float, body: str | None) -> None:
        """Remember the pitch that a voice has been given."""
        self._pitch[voice] = ratio, body

    def forget_tables(self) -> None:
        """Forget tables if they are many; the audio thread must not wait for any."""
        if len(self._tables) > MAX_GLIDE_STEPS:
            self._tables.clear()

    def table(self, target: tuple[Model, Layout], voice: int, ratio: float, body: str | None) -> np.ndarray:
        """Return the copies that give a voice a pitch [n, 3]. They are kept, for the audio thread reads them."""
        key = voice, ratio, body
        if key not in self._tables:
            scene = retune(self._patch, ratio)
            if body is not None:
                heard = set(sounding_bodies(self._patch))
                names = tuned_bodies(self._patch, body)
                scene = retune(retune(self._patch, self._lowest, heard - names), ratio, names)
            single = replicate(scene, 1).model_copy(update={"accuracy": self._accuracy})
            rate, exponents = target[0].samplerate, self._variable_exponents
            model, _, layout = build(single, rate, event_capacity=1, variable_exponents=exponents)
            self._tables[key] = tuning_copies(target, (model, layout), voice), model
        return self._tables[key][0]


def tuning_copies(target: tuple[Model, Layout], source: tuple[Model, Layout], voice: int) -> np.ndarray:
    """List the copies that make a voice of a polyphonic model equal to the only voice of another: addresses to copy to
    and from, and counts of numbers [n, 3]. Modes above the limit of the sample rate, which the other does not have, are
    made such that nothing moves them and no pickup senses them. Raises ValueError if the voice is too small."""
    pairs = [(a, b) for a, b in _pairs(target, source, voice) if b.size]
    if any(a.size < b.size for a, b in pairs):
        raise ValueError("this pitch needs more modes or contacts than a voice has room for")
    rows = [(a.ctypes.data, b.ctypes.data, b.size) for a, b in pairs]
    return np.array(rows, np.int64).reshape(-1, 3)


def _pairs(target: tuple[Model, Layout], source: tuple[Model, Layout], voice: int) -> Iterator[Arrays]:
    """Arrays to write and arrays to read."""
    (poly, poly_layout), (single, layout) = target, source
    bodies, islands = len(layout.scene.body), len(layout.islands.bodies)
    for b in range(bodies):
        yield from _mode_pairs(poly, single, poly_layout.modes.of_body[voice * bodies + b], layout.modes.of_body[b])
        yield from _connection_pairs(target, source, voice * bodies + b, b)
    for i in range(islands):
        n = voice * islands + i
        for axis in ("contact", "force", "pickup", "body", "basis"):
            to, of = (getattr(model.islands, axis) for model in (poly, single))
            for a, x in zip(_rows_of(poly, axis), _rows_of(single, axis), strict=axis != "basis"):
                for r in range(to[n + 1] - to[n]):
                    yield from _row_pairs(a, x, int(to[n]) + r, int(of[i]) + r if r < of[i + 1] - of[i] else None)
        yield from _contact_pairs(poly, single, n, i)
        yield from _basis_pairs(poly, single, n, i)


def _tuned_arrays(poly: Model, single: Model, *axes: Axis) -> Iterator[tuple[Items, np.ndarray, np.ndarray | None]]:
    """Yield the arrays on some axes that a pitch changes: the coefficients of a step, and the restoring force."""
    records = (StepCoefficients, poly.step, single.step), (FreeFlight, poly.flight, single.flight)
    for record in records:
        for items, ours, theirs in pair_arrays(*record):
            if items.axis in axes:
                yield items, ours, theirs
    if Axis.MODE in axes and poly.omega_squared is not None:
        yield Items(Axis.MODE), poly.omega_squared, single.omega_squared
    if poly.connection is not None and single.connection is not None:
        for items, ours, theirs in pair_arrays(Connections, poly.connection, single.connection):
            if items.axis in axes and items.axis is not Axis.MODE:
                yield items, ours, theirs


def _mode_pairs(poly: Model, single: Model, to: slice, of: slice) -> Iterator[Arrays]:
    """Yield the arrays of each mode of a body."""
    count = min(to.stop - to.start, of.stop - of.start)
    for items, ours, theirs in _tuned_arrays(poly, single, Axis.MODE):
        read = theirs[of.start : of.start + count] if theirs is not None else NEUTRAL[items.neutral][:count]
        yield ours[to.start : to.start + count], read
        if items.is_shape:
            missing = to.stop - to.start - count
            yield ours[to.stop - missing : to.stop], NEUTRAL[0.0][:missing]


def _contact_pairs(poly: Model, single: Model, n: int, i: int) -> Iterator[Arrays]:
    """Yield the compliances of an island at its contacts and connections."""
    axes = Axis.CONTACT, Axis.COMPLIANCE, Axis.CONNECTION, Axis.CONNECTION_PAIR, Axis.CONNECTION_CONTACT
    for items, ours, theirs in _tuned_arrays(poly, single, *axes):
        if theirs is not None:
            begin, start = getattr(poly.islands, items.axis), getattr(single.islands, items.axis)
            yield ours[begin[n] : begin[n + 1]], theirs[start[i] : start[i + 1]]


def _basis_pairs(poly: Model, single: Model, n: int, i: int) -> Iterator[Arrays]:
    """Yield the motion at an island's contacts for each row of the basis of these contacts.

    Raises ValueError if that of the other cannot be one of as few rows.
    """
    first, begin = int(poly.islands.basis[n]), int(single.islands.basis[i])
    if first == poly.islands.basis[n + 1]:
        return
    if begin == single.islands.basis[i + 1]:
        raise ValueError("at this pitch, the contacts of a body no longer move alike, so this voice cannot have it")
    for (to_contact, to), (of_contact, of) in zip(_bases(poly), _bases(single), strict=True):
        entries, products = entry_counts(int(np.diff(poly.islands.contact)[n]))
        a, x = to_contact.at_contacts_begin[first], of_contact.at_contacts_begin[begin]
        yield to.at_contacts[a : a + entries], of.at_contacts[x : x + entries]
        a, x = to_contact.products_begin[first], of_contact.products_begin[begin]
        yield to.products[a : a + products], of.products[x : x + products]


def _bases(model: Model) -> list[tuple[ContactBasis, BasisCoefficients]]:
    """The bases of the contacts of a model, with their coefficients; nothing without any."""
    contact, step = model.contact, model.step.contact
    if contact is None or contact.basis is None or step is None or step.basis is None:
        return []
    return [(contact.basis, step.basis)]


class PickupTables(NamedTuple):
    """The tables that belong to the rows of pickups."""

    table: np.ndarray  # [entries, 2 * FLIGHT_PART], of FreeFlight.pickup_tables


RowsAt = tuple[ModeShapeRows, RowCoefficients | PickupTables | None]


def _rows_of(model: Model, axis: str) -> list[RowsAt]:
    """The mode shape rows of a model that go with its contacts, forces, pickups or bodies, with their
    coefficients."""
    if axis == "contact":
        contact, step = model.contact, model.step.contact
        if contact is None or step is None:
            return []
        other = [] if contact.other_rows is None else [(contact.other_rows, step.other_rows)]
        return [(contact.rows, step.rows), *other]
    if axis == "force":
        return [(model.force.rows, model.step.force)] if model.force is not None else []
    if axis == "pickup":
        return [(model.pickups.rows, PickupTables(model.flight.pickup_tables))]
    if axis == "basis":
        return [(basis.rows, coefficients.rows) for basis, coefficients in _bases(model)]
    return [(model.bodies, None)]


def _row_pairs(to: RowsAt, of: RowsAt, r: int, s: int | None) -> Iterator[Arrays]:
    """A row of shapes, kicks and drifts; zeros where the other has no such row."""
    ours, theirs = to[0], of[0]
    write = int(ours.offset[r]), int(ours.mode_end[r]) - int(ours.mode_begin[r])
    read = (0, 0) if s is None else (int(theirs.offset[s]), int(theirs.mode_end[s]) - int(theirs.mode_begin[s]))
    yield from _entry_pairs(to, of, write, read)


def _entry_pairs(to: RowsAt, of: RowsAt, write: tuple[int, int], read: tuple[int, int]) -> Iterator[Arrays]:
    """Entries of rows, given by the first and their number; zeros where the other has fewer."""
    (ours, our_step), (theirs, their_step) = to, of
    (begin, size), start, count = write, read[0], min(write[1], read[1])
    pairs = [(ours.phi, theirs.phi)]
    if our_step is not None and their_step is not None:
        pairs += zip(our_step, their_step, strict=True)
    for a, x in pairs:
        yield a[begin : begin + count], x[start : start + count]
        missing = a[begin + count : begin + size]
        yield missing, NEUTRAL[0.0][: missing.size]


def _connection_pairs(target: tuple[Model, Layout], source: tuple[Model, Layout], b: int, c: int) -> Iterator[Arrays]:
    """Yield the entries of a body in each coordinate of its connections. b, c: its number in the one scene, and in the
    other"""
    (poly, poly_layout), (single, layout) = target, source
    if poly.connection is None or single.connection is None:
        return
    assert poly.step.connection is not None and single.step.connection is not None
    to, of = (poly.connection.rows, poly.step.connection.rows), (single.connection.rows, single.step.connection.rows)
    theirs = _entries_of(single, layout, c)
    for number, entries in _entries_of(poly, poly_layout, b).items():
        yield from _entry_pairs(to, of, entries, theirs.get(number, (0, 0)))


def _entries_of(model: Model, layout: Layout, b: int) -> dict[int, tuple[int, int]]:
    """The first entry of a body in the rows of connections, and for how many there is room, by coordinate."""
    found: dict[int, tuple[int, int]] = {}
    if model.connection is not None:
        for r, part in enumerate(layout.points.connection_parts):
            if b in part.pieces:
                first, room = part.pieces[b]
                found[part.coordinate] = int(model.connection.rows.offset[r]) + first, room
    return found
