"""Compliance of stretched bodies: that of contacts and connections in a step with given tensions, Σ Φ·Φᵀ·e/(1 + a·λ).

It is that of bodies which are not stretched, less what tensions take: Σ Φ·Φᵀ·w with w = e·aλ/(1 + aλ), e = t·v and
a = ½·e·κ. Here this w is called the compliance lost.
"""

from collections.abc import Mapping
from typing import Any

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat
from engine.compiler.overloads import overload_by_source
from engine.kernel.data.effects import CONTACTS, EFFECTS
from engine.kernel.data.enums import MovingEnd, PairOnBody, StiffenedMatrix, Stretch, StretchFactor
from engine.kernel.data.model import ConnectionCoefficients, ContactCoefficients, StepCoefficients, StepSettings
from engine.kernel.data.state import StiffenedConnections
from engine.kernel.interactions.tension import (
    modes_of_body,
    present_stiffness,
)
from engine.kernel.modes.ordered_sums import copy_items, fold, fold_lanes


@inline
def stretched_settings(settings, state):
    """Return the StepSettings with memory for the coefficients of contacts and connections of stretched bodies."""
    stretched = stretched_coefficients(settings.h, state.tension)
    return StepSettings(stretched, settings.kind, settings.is_free, settings.frame, settings.span)


def stretched_coefficients(h: Any, of: Any) -> Any:
    """StepCoefficients like `h` with the arrays of a TensionState. In compiled code only."""
    raise TypeError("stretched_coefficients is for compiled code")


def _write_like(record: Any, value: str, replaced: Mapping[str, str]) -> str:
    """Return the source of a record like a value, with some fields replaced by expressions."""
    parts = [replaced.get(name, f"{value}.{name}") for name in record._fields]
    return f"{record.__name__}({', '.join(parts)})"


def _write_coefficients(h: Any, of: Any) -> tuple[str, dict[str, Any]]:
    contact = {name: f"of.{name}" for name in ("compliance", "compliance_low", "coupling")}
    connection = {name: f"of.connection.{name}" for name in StiffenedConnections._fields}
    inner = {
        "contact": _write_like(ContactCoefficients, "h.contact", contact),
        "connection": _write_like(ConnectionCoefficients, "h.connection", connection),
    }
    records = StepCoefficients, ContactCoefficients, ConnectionCoefficients
    return _write_like(StepCoefficients, "h", inner), {record.__name__: record for record in records}


overload_by_source(stretched_coefficients, _write_coefficients)


@inline
def add_compliance_lost(of, k, sums):
    """Write what the tension takes from the compliance of mode k of a body, e·aλ/(1 + aλ), e = t·v, s²."""
    modes, compliance_lost, rise = of
    m = place_after(k, modes.first)
    compliance = number_at(modes.kick, m) * number_at(modes.drift, m)
    stiffened = 0.5 * compliance * number_at(modes.kappa, m) * rise
    put_number(compliance_lost, m, compliance * stiffened / (1.0 + stiffened))
    return sums


@inline
def find_compliance_lost(tension, h, state):
    """Find what tensions take from the compliance of each mode of the bodies that stretch."""
    for b in range(tension.mode_begin.shape[0]):
        body = state.tension.body[b]
        if present_stiffness(tension, state, b) != 0.0:
            stiffen_body(modes_of_body(tension, h, state, b), state.displacement_bound, body[Stretch.RISE])


@noinline
def stiffen_body(modes, compliance_lost, rise):
    """Do this for the modes of a body."""
    fold_lanes(add_compliance_lost, (modes, compliance_lost, rise), modes.size, (splat(0.0),))


@inline
def stiffen_matrix(stiffening, kind, matrix, state):
    """Take from how far forces at points move others what tensions take. kind: StiffenedMatrix of the matrix"""
    for n in range(stiffening.begin[kind], stiffening.begin[kind + 1]):
        pair = stiffening.pairs[n]
        if state.tension.body[pair[PairOnBody.BODY]][Stretch.RISE] != 0.0:
            compliance_lost = compliance_lost_between(stiffening.shapes, pair, state.displacement_bound)
            matrix[pair[PairOnBody.TARGET]] -= compliance_lost
            if pair[PairOnBody.MIRROR] >= 0:
                matrix[pair[PairOnBody.MIRROR]] -= compliance_lost


@noinline
def compliance_lost_between(shapes, pair, compliance_lost):
    """Return how much less a force at one point of a body moves another because the body is stretched, m/N."""
    of = shapes, pair[PairOnBody.SHAPE], pair[PairOnBody.OTHER_SHAPE], compliance_lost, pair[PairOnBody.MODE_BEGIN]
    return fold(add_compliance_lost_by_pair, of, pair[PairOnBody.MODES], (splat(0.0),))[0]


@inline
def add_compliance_lost_by_pair(of, n, sums):
    """Add the product of two mode shapes and what tensions take from a compliance to the sums."""
    shapes, begin, other_begin, compliance_lost, first = of
    product = number_at(shapes, place_after(n, begin)) * number_at(shapes, place_after(n, other_begin))
    return (multiply_add(product, number_at(compliance_lost, place_after(n, first)), sums[0]),)


@inline
def stiffen_contacts(tension, h, state):
    """Find the compliance of contacts of stretched bodies if nothing is connected. h: their ContactCoefficients"""
    of, count = state.tension, state.compression.shape[0]
    for k in range(count):
        of.compliance[k], of.compliance_low[k] = h.compliance[k], 0.0
    if count == 1:
        stiffen_matrix(tension.stiffening, StiffenedMatrix.CONTACTS, of.compliance, state)
    else:
        copy_items(h.coupling, of.coupling)
        stiffen_matrix(tension.stiffening, StiffenedMatrix.CONTACTS, of.coupling, state)
        for k in range(count):
            of.compliance[k] = of.coupling[k * count + k]


# --- connections


@inline
def stiffen_connections(tension, h, stretched, state):
    """Find how far connections, and contacts beside them, move each other on stretched bodies. h, stretched:
    ConnectionCoefficients"""
    copy_items(h.compliance, stretched.compliance)
    stiffen_matrix(tension.stiffening, StiffenedMatrix.CONNECTIONS, stretched.compliance, state)
    if EFFECTS & CONTACTS:
        copy_items(h.contact_moves, stretched.contact_moves)
        copy_items(h.contact_compliance, stretched.contact_compliance)
        stiffen_matrix(tension.stiffening, StiffenedMatrix.CONTACT_MOVES, stretched.contact_moves, state)
        stiffen_matrix(tension.stiffening, StiffenedMatrix.CONTACTS, stretched.contact_compliance, state)


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
