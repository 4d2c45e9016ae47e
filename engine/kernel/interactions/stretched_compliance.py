"""Compliance of stretched bodies: that of contacts and connections in a step with given tensions, Σ Φ·Φᵀ·e/(1 + a·λ).

It is that of bodies which are not stretched, less what tensions take: Σ Φ·Φᵀ·w with w = e·aλ/(1 + aλ), e = t·v and
a = ½·e·κ. Here this w is called softness.
"""

from typing import Any

import numpy as np

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat
from engine.compiler.overloads import is_none, overload_by_source
from engine.kernel.data.enums import MovingEnd, Stretch, StretchFactor
from engine.kernel.data.model import ConnectionCoefficients, ContactCoefficients, StepCoefficients, StepSettings
from engine.kernel.data.state import SoftenedConnections
from engine.kernel.interactions.tension import (
    modes_of_body,
    stiffness_of,
)
from engine.kernel.modes.ordered_sums import copy_items, fold, fold_lanes


@inline
def softened_settings(settings, state):
    """Return the StepSettings with memory for the coefficients of contacts and connections of stretched bodies."""
    softened = softened_coefficients(settings.h, state.tension)
    return StepSettings(softened, settings.kind, settings.is_free, settings.frame)


def softened_coefficients(h: Any, tension_state: Any) -> Any:
    """StepCoefficients like `h` with the arrays of a TensionState. In compiled code only."""
    raise TypeError("softened_coefficients is for compiled code")


def _write_coefficients(h: Any, of: Any) -> tuple[str, dict[str, Any]]:
    softened = {"connection": softened_connections, "contact": softened_contacts}
    parts = [f"{softened[n].__name__}(h.{n}, tension_state)" if n in softened else f"h.{n}" for n in h.fields]
    names = {function.__name__: function for function in softened.values()}
    return f"StepCoefficients({', '.join(parts)})", names | {"StepCoefficients": StepCoefficients}


def softened_contacts(h: Any, tension_state: Any) -> Any:
    """ContactCoefficients like `h` with the arrays of a TensionState; None without. In compiled code only."""
    raise TypeError("softened_contacts is for compiled code")


def _write_contacts(h: Any, of: Any) -> tuple[str, dict[str, Any]]:
    if is_none(h):
        return "None", {}
    coupling = "None" if is_none(h.types[h.fields.index("coupling")]) else "tension_state.coupling"
    arrays = f"tension_state.compliance, tension_state.compliance_low, h.loss_rate, {coupling}"
    names = {"ContactCoefficients": ContactCoefficients}
    return f"ContactCoefficients(h.rows, h.other_rows, {arrays}, h.duration, h.only_kick_phi, h.basis)", names


def softened_connections(h: Any, tension_state: Any) -> Any:
    """ConnectionCoefficients like `h` with the arrays of a TensionState; None without. In compiled code only."""
    raise TypeError("softened_connections is for compiled code")


def _write_connections(h: Any, of: Any) -> tuple[str, dict[str, Any]]:
    if is_none(h):
        return "None", {}
    softened = SoftenedConnections._fields
    parts = [f"tension_state.connection.{name}" if name in softened else f"h.{name}" for name in h.fields]
    return f"ConnectionCoefficients({', '.join(parts)})", {"ConnectionCoefficients": ConnectionCoefficients}


overload_by_source(softened_coefficients, _write_coefficients)
overload_by_source(softened_contacts, _write_contacts)
overload_by_source(softened_connections, _write_connections)


@inline
def add_softness(of, k, sums):
    """Write what the tension takes from the compliance of mode k of a body, e·aλ/(1 + aλ), e = t·v, s²."""
    modes, softness, rise = of
    m = place_after(k, modes.first)
    compliance = number_at(modes.kick, m) * number_at(modes.drift, m)
    stiffened = 0.5 * compliance * number_at(modes.kappa, m) * rise
    put_number(softness, m, compliance * stiffened / (1.0 + stiffened))
    return sums


@inline
def find_softness(tension, h, state):
    """Find what tensions take from the compliance of each mode of the bodies that stretch."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if stiffness_of(tension, b) != 0.0:
            soften_body(modes_of_body(tension, h, state, b), state.displacement_bound, body[Stretch.RISE])


@noinline
def soften_body(modes, softness, rise):
    """Do this for the modes of a body."""
    fold_lanes(add_softness, (modes, softness, rise), modes.size, (splat(0.0),))


@inline
def span_of(tension, b):
    """Return the first mode of body b, and its last + 1; -1 of one that does not stretch."""
    return tension.mode_begin[b], tension.mode_end[b]


@inline
def soften_contacts(contact, tension, h, coupling, state):
    """Find the compliance of contacts of stretched bodies if nothing is connected.

    h: their ContactCoefficients; coupling: of it, or None
    """
    of, count = state.tension, state.compression.shape[0]
    for k in range(count):
        of.compliance[k], of.compliance_low[k] = h.compliance[k], 0.0
    if count == 1:
        soften_pairs(contact, tension, of.compliance, state)
    else:
        soften_coupling(contact, tension, coupling, state)


@inline
def soften_coupling(contact, tension, coupling, state):
    """Do this for the several contacts of an island."""
    of, count = state.tension, state.compression.shape[0]
    if coupling is not None:
        copy_items(coupling, of.coupling)
        soften_pairs(contact, tension, of.coupling, state)
        for k in range(count):
            of.compliance[k] = of.coupling[k * count + k]


@noinline
def soften_pairs(contact, tension, compliance, state):
    """Take from the compliance of contacts, row by row, what tensions take."""
    count = state.compression.shape[0]
    for b in range(tension.mode_begin.shape[0]):
        span = span_of(tension, b)
        for k in range(count):
            if is_contact_of(contact, contact.other_rows, k, span):
                for i in range(k + 1):
                    if is_contact_of(contact, contact.other_rows, i, span):
                        softness = softness_between(contact, contact.other_rows, k, i, span, state)
                        compliance[k * count + i] -= softness
                        if i != k:
                            compliance[i * count + k] -= softness


@inline
def is_contact_of(contact, other_rows, k, span):
    """True if contact k is on the body of these modes."""
    if other_rows is not None:
        if overlaps(other_rows, k, span):
            return True
    return overlaps(contact.rows, k, span)


@inline
def softness_between(contact, other_rows, k, i, span, state):
    """Return how much less a force at contact k moves contact i because a body is stretched, m/N."""
    softness = softness_at_rows(contact.rows, k, contact.rows, i, span, state)
    if other_rows is not None:
        softness += softness_at_rows(contact.rows, k, other_rows, i, span, state)
        softness += softness_at_rows(other_rows, k, contact.rows, i, span, state)
        softness += softness_at_rows(other_rows, k, other_rows, i, span, state)
    return softness


@inline
def add_softness_of_rows(of, n, sums):
    """Add the product of two mode shapes and what tensions take from a compliance to the sums."""
    phi, begin, other_phi, other_begin, softness, first = of
    shapes = number_at(phi, place_after(n, begin)) * number_at(other_phi, place_after(n, other_begin))
    return (multiply_add(shapes, number_at(softness, place_after(n, first)), sums[0]),)


@inline
def softness_at_rows(rows, k, other_rows, i, span, state):
    """Return how much less a force at row k moves row i of others because the modes of a span are stretched, m/N."""
    # a row of connections may be of several bodies
    begin, other_begin = np.int64(rows.mode_begin[k]), np.int64(other_rows.mode_begin[i])
    first, end = max(span[0], begin, other_begin), np.int64(rows.mode_end[k])
    end = min(span[1], end, np.int64(other_rows.mode_end[i]))
    if first >= end:
        return 0.0
    place = np.int64(rows.offset[k]) + (first - begin)
    other_place = np.int64(other_rows.offset[i]) + (first - other_begin)
    at, other_at = (rows.phi, place), (other_rows.phi, other_place)
    return sum_softness(at, other_at, (state.displacement_bound, first), end - first)


@noinline
def sum_softness(at, other_at, softness, count):
    """Return the sum of the products of two mode shapes and softness over so many modes, m/N. Of each: an array, and
    where it begins"""
    return fold(add_softness_of_rows, (*at, *other_at, *softness), count, (splat(0.0),))[0]


# --- connections


@noinline
def soften_connections(connection, tension, h, softened, state):
    """Find the compliance of connections of stretched bodies. h, softened: ConnectionCoefficients"""
    rows, n = connection.rows, state.connection.extension.shape[0]
    copy_items(h.compliance, softened.compliance)
    for b in range(tension.mode_begin.shape[0]):
        span = span_of(tension, b)
        for r in range(connection.coordinate.shape[0]):
            if overlaps(rows, r, span):
                for s in range(r + 1):
                    if overlaps(rows, s, span):
                        i, j = connection.coordinate[r], connection.coordinate[s]
                        softness = softness_at_rows(rows, r, rows, s, span, state)
                        softened.compliance[i * n + j] -= softness
                        if r != s:
                            softened.compliance[j * n + i] -= softness


@inline
def overlaps(rows, r, span):
    """True if row r weighs a mode of a span."""
    return np.int64(rows.mode_begin[r]) < span[1] and span[0] < np.int64(rows.mode_end[r])


@inline
def soften_contact_moves(contact, tension, connection, h, softened, state):
    """Find how far contacts of stretched bodies move each other and connections. h, softened: ConnectionCoefficients"""
    if contact is not None:
        copy_items(h.contact_moves, softened.contact_moves)
        copy_items(h.contact_compliance, softened.contact_compliance)
        soften_pairs(contact, tension, softened.contact_compliance, state)
        for b in range(tension.mode_begin.shape[0]):
            span = span_of(tension, b)
            for k in range(state.compression.shape[0]):
                if is_contact_of(contact, contact.other_rows, k, span):
                    soften_moves_of_contact(contact, connection, softened.contact_moves, k, span, state)


@inline
def soften_moves_of_contact(contact, connection, moves, k, span, state):
    """Take from how far contact k moves connections what the tension of a body takes."""
    n = state.connection.extension.shape[0]
    for r in range(connection.coordinate.shape[0]):
        if overlaps(connection.rows, r, span):
            softness = softness_of_other(contact.other_rows, connection.rows, k, r, span, state)
            softness += softness_at_rows(contact.rows, k, connection.rows, r, span, state)
            moves[k * n + connection.coordinate[r]] -= softness


@inline
def softness_of_other(other_rows, rows, k, r, span, state):
    """Return how much less the other side of contact k moves row r because bodies are stretched, m/N."""
    if other_rows is None:
        return 0.0
    return softness_at_rows(other_rows, k, rows, r, span, state)


@inline
def stiffen_ends(connection, tension, state):
    """Find the stiffness that connections have in common, with what tensions add at the ends of strings."""
    n, coupling = state.connection.extension.shape[0], state.tension.connection.coupling
    copy_items(connection.coupling, coupling)
    for b in range(tension.mode_begin.shape[0]):
        ends, factor, rise = tension.ends[b], tension.factor[b], state.tension.body[b][Stretch.RISE]
        first, second = ends[MovingEnd.DISPLACEMENT], ends[MovingEnd.OTHER_DISPLACEMENT]
        if first >= 0:
            stiffen_end(coupling, n, ends[MovingEnd.SLOPE], first, rise * factor[StretchFactor.END])
        if second >= 0:
            stiffen_end(coupling, n, ends[MovingEnd.OTHER_SLOPE], second, rise * factor[StretchFactor.OTHER_END])
            stiffen_pair(coupling, n, first, second, rise * factor[StretchFactor.BOTH_ENDS])


@inline
def stiffen_end(coupling, n, slope, y, stiffness):
    """Add the stiffness that a tension gives the end of a string."""
    stiffen_pair(coupling, n, slope, y, stiffness)
    coupling[y * n + y] += stiffness


@inline
def stiffen_pair(coupling, n, i, j, stiffness):
    """Add a stiffness between two coordinates."""
    coupling[i * n + j] += stiffness
    coupling[j * n + i] += stiffness
