"""Contacts that may close in the next samples, while others of their island push; in scenes with connections.

A piano has hundreds of contacts, of which a few hammers are in reach. The others are left out of the step and of the
solve, for FLIGHT_FRAMES samples at a time, and their compressions are read from the modes after that. How far each can
close is bounded by all the energy that the island has (engine.assembly.contact_reach): by the motion of its bodies,
where no contact that is near pushes them, and what the forces of connections add; or by that energy alone.
"""

import math
from typing import Any

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.overloads import is_none, overload_by_source, overload_by_type
from engine.kernel.contact.contact_law import LossyLaw, item_or_zero, law_in_step
from engine.kernel.contact.friction_law import acts, slides
from engine.kernel.data.enums import FLIGHT_FRAMES, StepKind
from engine.kernel.data.model import Connections
from engine.kernel.interactions.connections import has_connections, product_at
from engine.kernel.interactions.contacts import (
    Reach,
    compression_from_modes,
    find_free_displacements,
    free_displacement_at,
)
from engine.kernel.interactions.external_forces import has_external_forces
from engine.kernel.interactions.friction import has_friction, slip_at
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.event_dampers import is_damping
from engine.kernel.modes.mode_energies import bound_modal_displacements
from engine.kernel.modes.point_rows import bound_at_row

FOUND = 2  # of NearContacts.is_far: near, but what it pushes is still taken for bounded
UNBOUNDED = 1e290  # √kg·m: of a mode that a contact pushes


def contacts_in_reach(connection: Any, model: Any, settings: Any, state: Any) -> Reach:
    """Find how far the coming drift would close the contacts that may close, with the forces of connections and without
    those of contacts; in compiled code only.

    settings: StepSettings; in the stages of a sample, all contacts are in reach
    """
    raise TypeError("contacts_in_reach is for compiled code")


@inline
def contacts_without_connections(connection, model, settings, state):
    """Do this in a scene without connections."""
    find_free_displacements(model.contact, settings.h.contact, state)
    return all_contacts(model.contact, None, None, settings.h.contact, state)


@inline
def contacts_beside_connections(connection, model, settings, state):
    """Do this in a scene with connections."""
    contact, h = model.contact, settings.h
    if leaves_out_contacts(connection, model, settings, state):
        find_near_displacements(contact, h, state)
        reach = near_contacts(contact, h, state)
    else:
        read_far_contacts(contact, state)
        find_free_displacements(contact, h.contact, state)
        reach = all_contacts(contact, state.connection.near.contact, h.connection.contact_moves, h.contact, state)
    g, f = reach.free_displacement, state.connection.force
    for n in range(reach.size):
        g[n] -= product_at(reach.moves, n, f)
    return reach


@inline
def are_all_left_out(connection, model, settings, state):
    """True if no contact of an island may close in this step, which is beside connections."""
    if connection is None:
        return False
    return leaves_out_contacts(connection, model, settings, state) and state.connection.near.size[0] == 0


@inline
def leaves_out_contacts(connection, model, settings, state):
    """True if contacts that are far are left out of this step. Finds which are, if it is time."""
    is_only_contact = state.compression.shape[0] == 1 and not has_connections(connection, state)
    if is_only_contact or settings.kind != StepKind.SAMPLE:
        return False
    if has_external_forces(model.force) or stretches(model.tension, state):
        return False
    if has_friction(model.contact.friction):
        return False
    if settings.frame >= state.connection.near.until[0]:
        find_near_contacts(model, model.contact, connection, settings, state)
    return True


@inline
def all_contacts(contact, index, moves, h, state):
    """Return the Reach of all contacts. h: ContactCoefficients"""
    s, g = state.compression, state.free_displacement
    return Reach(s.shape[0], index, s, g, law_in_step(contact, h, state), h.coupling, moves)


def reach_of_all(connection: Any, contact: Any, h: Any, state: Any) -> Reach:
    """Return the Reach of all contacts; in compiled code only. h: StepCoefficients"""
    raise TypeError("reach_of_all is for compiled code")


@inline
def all_without_connections(connection, contact, h, state):
    """Do this in a scene without connections."""
    return all_contacts(contact, None, None, h.contact, state)


@inline
def all_beside_connections(connection, contact, h, state):
    """Do this in a scene with connections."""
    return all_contacts(contact, state.connection.near.contact, h.connection.contact_moves, h.contact, state)


@inline
def near_contacts(contact, h, state):
    """Return the Reach of the contacts that are near. h: StepCoefficients"""
    near, n = state.connection.near, state.connection.near.size[0]
    law = law_of_near(contact.law, near.potential_coefficient[0:n], near.exponent[0:n])
    rate = gathered(h.contact.loss_rate, near.loss_rate, n)
    coupling = gathered(h.contact.coupling, near.coupling, n * n)
    s, g = near.compression[0:n], near.free_displacement[0:n]
    return Reach(n, near.contact, s, g, LossyLaw(law, rate, state.friction), coupling, near.moves)


@inline
def find_near_displacements(contact, h, state):
    """Find how far the coming drift would change the compression of each near contact without its force."""
    near = state.connection.near
    for n in range(near.size[0]):
        k = near.contact[n]
        near.compression[n] = state.compression[k]
        near.free_displacement[n] = free_displacement_at(
            contact, contact.other_rows, h.contact, k, state.drift_momentum
        )


@noinline
def find_near_contacts(model, contact, connection, settings, state):
    """Find the contacts that may close in the next FLIGHT_FRAMES samples."""
    near = state.connection.near
    read_far_contacts(contact, state)
    if connection.is_plain[0] != 0:
        select_contacts(model, contact, connection, is_damping(model.events, state), state)
    gather_coefficients(contact, settings.h, state)
    near.until[0] = settings.frame + FLIGHT_FRAMES


@inline
def read_far_contacts(contact, state):
    """Read the compressions that were not kept from the modes; all are kept now, and in reach."""
    near = state.connection.near
    for k in range(near.is_far.shape[0]):
        near.contact[k] = k
        if near.is_far[k] != 0:
            state.compression[k] = min(compression_from_modes(contact, contact.other_rows, state, k), 0.0)
            state.compression_compensation[k] = state.contact_force[k] = 0.0
            near.is_far[k] = 0
    near.until[0] = 0


@inline
def keep_all_contacts(contact, connection, state):
    """Bring all compressions up to date for a step of all contacts."""
    if contact is not None:
        if connection is not None:
            read_far_contacts(contact, state)


@inline
def select_contacts(model, contact, connection, is_disturbed, state):
    """Say which contacts may close; and of what these push, no bound but that of energy holds."""
    near, bound = state.connection.near, state.displacement_bound
    bound_modal_displacements(model, state)
    amplitude = math.sqrt(max(0.0, 2.0 * island_energy(model, state)))
    for k in range(near.is_far.shape[0]):
        near.is_far[k] = 1
    more = True
    while more:
        more = False
        for k in range(near.is_far.shape[0]):
            if near.is_far[k] == 1 and may_close_by_energy(connection, amplitude, k, state):
                if may_close(contact, connection, amplitude, is_disturbed, k, state):
                    near.is_far[k] = FOUND
                    more = True
        for k in range(near.is_far.shape[0]):
            if near.is_far[k] == FOUND:
                near.is_far[k] = 0
                forget_bounds(contact.rows, k, bound)
                forget_bounds(contact.other_rows, k, bound)


@inline
def may_close(contact, connection, amplitude, is_disturbed, k, state):
    """True if contact k may close, or is closed. amplitude: √(2E) of the island, √J"""
    if slides(state.friction, k):
        return acts(state.friction, k, state.compression[k])
    bound = state.displacement_bound
    distance, connected = split_bound_at_contact(contact, contact.other_rows, connection, k, bound)
    distance += reach_of_connected(connection, amplitude, is_disturbed, k, connected)
    return not state.compression[k] + 1.01 * distance < 0.0  # NaN may


@inline
def may_close_by_energy(connection, amplitude, k, state):
    """False if all the energy of an island without connections cannot close contact k. amplitude: √(2E), √J"""
    return has_connections(connection, state) or not (
        state.compression[k] + 1.01 * connection.contact_reach[k] * amplitude < 0.0
    )


@inline
def forget_bounds(rows, k, bound):
    """Nothing bounds the modes of row k but their energy. rows: None of a fixed obstacle"""
    if rows is not None:
        for m in range(rows.mode_begin[k], rows.mode_end[k]):
            bound[m] = UNBOUNDED


# --- what a solve of the near ones needs


@inline
def gather_coefficients(contact, h, state):
    """Gather what does not change from step to step."""
    near, n, total = state.connection.near, INT64_0, state.compression.shape[0]
    for k in range(total):
        if near.is_far[k] == 0:
            near.contact[n] = k
            near.potential_coefficient[n], near.exponent[n] = state.potential_coefficient[k], state.exponent[k]
            near.loss_rate[n] = item_or_zero(h.contact.loss_rate, k)
            n += 1
    near.size[0] = n
    gather_coupling(h.contact.coupling, n, total, near)
    connections = state.connection.force.shape[0]
    for j in range(n):
        for i in range(connections):
            near.moves[j * connections + i] = h.connection.contact_moves[near.contact[j] * connections + i]


@inline
def gather_coupling(coupling, n, total, near):
    """Gather how far a force at each moves the others, if an island has several contacts."""
    if coupling is not None:
        for i in range(n):
            for j in range(n):
                near.coupling[i * n + j] = coupling[np.int64(near.contact[i]) * total + near.contact[j]]


# --- bounds


@inline
def split_bound_at_row(connection, rows, r, bound):
    """Return how far the modes of row r can move its point, m, if each moves no further than `bound`. Of the two
    numbers, the first is for a body to which nothing is connected, and the second for any other; one of them is 0."""
    distance = bound_at_row(rows, r, bound)
    if connection is not None:
        if distance > 0.0 and connection.is_unconnected[rows.mode_begin[r]] == 0.0:
            return 0.0, distance
    return distance, 0.0


@inline
def split_bound_at_contact(contact, other_rows, connection, k, bound):
    """Return how far contact k can close, m, if each mode moves no further than `bound`: by the bodies to which nothing
    is connected, and by the others."""
    alone, connected = split_bound_at_row(connection, contact.rows, k, bound)
    if other_rows is not None:
        more, further = split_bound_at_row(connection, other_rows, k, bound)
        return alone + more, connected + further
    return alone, connected


@inline
def reach_of_connected(connection, amplitude, is_disturbed, k, distance):
    """Return how far what is connected can close contact k, m. All of its energy bounds that; or, if less, what the
    bodies move by themselves and what the forces of connections add, which that energy bounds.

    amplitude:    √(2E) of what is connected, √J
    is_disturbed: True if the bodies do not move by themselves alone, but are damped by an event
    distance:     how far the bodies can close it by themselves, m
    """
    if connection is None:
        return 0.0
    by_energy = connection.contact_reach[k] * amplitude
    if is_disturbed:
        return by_energy
    return min(by_energy, distance + connection.contact_reach_by_forces[k] * amplitude)


@inline
def cannot_close(contact, connection, amplitude, is_disturbed, state):
    """True if no contact can close while each mode moves by itself no further than `state.displacement_bound`.

    amplitude:    √(2E) of what is connected at most, √J
    is_disturbed: True if the bodies do not move by themselves alone, but are damped by an event
    """
    if contact is not None:
        for k in range(state.compression.shape[0]):
            if may_close(contact, connection, amplitude, is_disturbed, k, state):
                return False
    return True


@inline
def is_left_out(connection_state, k):
    """True if contact k is left out of steps, because it cannot close."""
    if connection_state is None:
        return False
    return connection_state.near.is_far[k] != 0


@inline
def compression_now(contact, connection_state, state, k, frame):
    """Return compression k, m; of friction, the slip, m/s. Where a contact is known to stay open, its compression is
    not kept, and is read from the modes. connection_state: ConnectionState or None"""
    if contact is not None:
        if slides(state.friction, k):
            return slip_at(state.friction, k)
        if frame < state.contact_free_until[0] or is_left_out(connection_state, k):
            return compression_from_modes(contact, contact.other_rows, state, k)
    return state.compression[k]


# --- by type


def law_of_near(law: Any, coefficient: Any, exponent: Any) -> Any:
    """A law of the kind of `law`, with these coefficients and exponents. In compiled code only."""
    raise TypeError("law_of_near is for compiled code")


def _write_law(law: Any, coefficient: Any, exponent: Any) -> tuple[str, dict[str, Any]]:
    kind = law.instance_class
    return f"{kind.__name__}(coefficient, exponent)", {kind.__name__: kind}


overload_by_source(law_of_near, _write_law)


def gathered(original: Any, copy: Any, count: int) -> Any:
    """The first items of a copy; None where there is no original. In compiled code only."""
    raise TypeError("gathered is for compiled code")


overload_by_source(gathered, lambda original, copy, count: ("None" if is_none(original) else "copy[0:count]", {}))
overload_by_type(
    reach_of_all, {type(None): all_without_connections.py_func, Connections: all_beside_connections.py_func}
)
overload_by_type(
    contacts_in_reach,
    {type(None): contacts_without_connections.py_func, Connections: contacts_beside_connections.py_func},
)
