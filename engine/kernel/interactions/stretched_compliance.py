"""Compliance of stretched bodies: that of contacts and connections in a step with given tensions, Σ Φ·Φᵀ·e/(1 + a·λ).

It is that of bodies which are not stretched, less what tensions take: Σ Φ·Φᵀ·w with w = e·aλ/(1 + aλ), e = t·v and
a = ½·e·κ. Here this w is called softness.
"""

from typing import Any

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat
from engine.compiler.overloads import is_none, overload_by_source
from engine.kernel.data.enums import MovingEnd, PairOnBody, SoftMatrix, Stretch, StretchFactor
from engine.kernel.data.model import ConnectionCoefficients, ContactCoefficients, StepCoefficients, StepSettings
from engine.kernel.data.state import SoftenedConnections
from engine.kernel.interactions.tension import (
    modes_of_body,
    present_stiffness,
)
from engine.kernel.modes.ordered_sums import copy_items, fold, fold_lanes


@inline
def softened_settings(settings, state):
    """Return the StepSettings with memory for the coefficients of contacts and connections of stretched bodies."""
    softened = softened_coefficients(settings.h, state.tension)
    return StepSettings(softened, settings.kind, settings.is_free, settings.frame, settings.span)


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
    return f"ContactCoefficients(h.rows, h.other_rows, {arrays}, h.duration, h.only_kick_phi)", names


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
        if present_stiffness(tension, state, b) != 0.0:
            soften_body(modes_of_body(tension, h, state, b), state.displacement_bound, body[Stretch.RISE])


@noinline
def soften_body(modes, softness, rise):
    """Do this for the modes of a body."""
    fold_lanes(add_softness, (modes, softness, rise), modes.size, (splat(0.0),))


@inline
def soften_matrix(softening, kind, matrix, state):
    """Take from how far forces at points move others what tensions take. kind: SoftMatrix of the matrix"""
    for n in range(softening.begin[kind], softening.begin[kind + 1]):
        pair = softening.pairs[n]
        if state.tension.body[pair[PairOnBody.BODY]][Stretch.RISE] != 0.0:
            softness = softness_between(softening.shapes, pair, state.displacement_bound)
            matrix[pair[PairOnBody.TARGET]] -= softness
            if pair[PairOnBody.MIRROR] >= 0:
                matrix[pair[PairOnBody.MIRROR]] -= softness


@noinline
def softness_between(shapes, pair, softness):
    """Return how much less a force at one point of a body moves another because the body is stretched, m/N."""
    of = shapes, pair[PairOnBody.SHAPE], pair[PairOnBody.OTHER_SHAPE], softness, pair[PairOnBody.MODE_BEGIN]
    return fold(add_softness_of_pair, of, pair[PairOnBody.MODES], (splat(0.0),))[0]


@inline
def add_softness_of_pair(of, n, sums):
    """Add the product of two mode shapes and what tensions take from a compliance to the sums."""
    shapes, begin, other_begin, softness, first = of
    product = number_at(shapes, place_after(n, begin)) * number_at(shapes, place_after(n, other_begin))
    return (multiply_add(product, number_at(softness, place_after(n, first)), sums[0]),)


@inline
def soften_contacts(tension, h, coupling, state):
    """Find the compliance of contacts of stretched bodies if nothing is connected.

    h: their ContactCoefficients; coupling: of it, or None
    """
    of, count = state.tension, state.compression.shape[0]
    for k in range(count):
        of.compliance[k], of.compliance_low[k] = h.compliance[k], 0.0
    if count == 1:
        soften_matrix(tension.softening, SoftMatrix.CONTACTS, of.compliance, state)
    else:
        soften_coupling(tension, coupling, state)


@inline
def soften_coupling(tension, coupling, state):
    """Do this for the several contacts of an island."""
    of, count = state.tension, state.compression.shape[0]
    if coupling is not None:
        copy_items(coupling, of.coupling)
        soften_matrix(tension.softening, SoftMatrix.CONTACTS, of.coupling, state)
        for k in range(count):
            of.compliance[k] = of.coupling[k * count + k]


# --- connections


@inline
def soften_connections(contact, tension, h, softened, state):
    """Find how far connections, and contacts beside them, move each other on stretched bodies. contact: Contact or
    None; h, softened: ConnectionCoefficients"""
    copy_items(h.compliance, softened.compliance)
    soften_matrix(tension.softening, SoftMatrix.CONNECTIONS, softened.compliance, state)
    if contact is not None:
        copy_items(h.contact_moves, softened.contact_moves)
        copy_items(h.contact_compliance, softened.contact_compliance)
        soften_matrix(tension.softening, SoftMatrix.CONTACT_MOVES, softened.contact_moves, state)
        soften_matrix(tension.softening, SoftMatrix.CONTACTS, softened.contact_compliance, state)


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
