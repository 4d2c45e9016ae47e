"""Contacts that may close in the next samples, while others of their island push; in scenes with connections.

A piano has hundreds of contacts, of which a few hammers are in reach. The others are left out of the step and of the
solve, for FLIGHT_FRAMES samples at a time, and their compressions are read from the modes after that. How far each can
close is bounded by all the energy that the island has (engine.assembly.contact_reach): by the motion of its bodies,
where no contact that is near pushes them, and what the forces of connections add; or by that energy alone.
"""

import math

import numpy as np

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.kernel.contact.law import Laws, follows_modes, laws_in_step, may_act, traced_compression
from engine.kernel.data.effects import CONNECTIONS, EFFECTS
from engine.kernel.data.enums import FLIGHT_FRAMES, StepKind
from engine.kernel.data.laws import Law
from engine.kernel.interactions.connected_modes import amplitude_of_connected
from engine.kernel.interactions.connections import has_connections, product_at
from engine.kernel.interactions.contacts import (
    ContactsInReach,
    compression_from_modes,
    find_free_displacements,
    free_displacement_at,
)
from engine.kernel.interactions.external_forces import has_external_forces
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.tension import stretches
from engine.kernel.modes.event_dampers import is_damping
from engine.kernel.modes.mode_energies import bound_modal_displacements
from engine.kernel.modes.point_rows import bound_at_row

FOUND = 2  # of NearContacts.is_far: near, but what it pushes is still taken for bounded
UNBOUNDED = 1e290  # √kg·m: of a mode that a contact pushes


@inline
def contacts_in_reach(model, settings, state):
    """Find how far the coming drift would close the contacts that may close, with the forces of connections and without
    those of contacts. Returns a ContactsInReach.

    settings: StepSettings; in the stages of a sample, all contacts are in reach
    """
    contact, h = model.contact, settings.h
    if EFFECTS & CONNECTIONS:
        if leave_out_far_contacts(model, settings, state):
            find_near_displacements(contact, h, state)
            reach = near_contacts(h, state)
        else:
            read_far_contacts(contact, state)
            find_free_displacements(contact, h.contact, state)
            reach = all_contacts(h, state)
        g, f = reach.free_displacement, state.connection.force
        for n in range(reach.size):
            g[n] -= product_at(reach.moves, n, f)
        return reach
    find_free_displacements(contact, h.contact, state)
    return all_contacts(h, state)


@inline
def leave_out_far_contacts(model, settings, state):
    """Leave contacts that are far out of this step, and find which are, if it is time. Returns False if all contacts
    take part."""
    is_only_contact = state.compression.shape[0] == 1 and not has_connections(state)
    if is_only_contact or settings.kind != StepKind.SAMPLE:
        return False
    if has_external_forces(model.force) or stretches(state):
        return False
    if model.contact.has_power_laws[0] == 0:
        return False
    if settings.frame >= state.connection.near.until[0]:
        find_near_contacts(model, settings, state)
    return True


@inline
def all_contacts(h, state):
    """Return the ContactsInReach of all contacts. h: StepCoefficients"""
    s, g, index = state.compression, state.free_displacement, state.connection.near.contact
    return ContactsInReach(
        s.shape[0], index, s, g, laws_in_step(h.contact, state), h.contact.coupling, h.connection.contact_moves
    )


@inline
def near_contacts(h, state):
    """Return the ContactsInReach of the contacts that are near. h: StepCoefficients"""
    near, n = state.connection.near, state.connection.near.size[0]
    law = Law(near.potential_coefficient[0:n], near.exponent[0:n])
    s, g, coupling = near.compression[0:n], near.free_displacement[0:n], near.coupling[0 : n * n]
    laws = Laws(law, near.loss_rate[0:n], state.law_numbers)
    return ContactsInReach(n, near.contact, s, g, laws, coupling, near.moves)


@inline
def find_near_displacements(contact, h, state):
    """Find how far the coming drift would change the compression of each near contact without its force."""
    near = state.connection.near
    for n in range(near.size[0]):
        k = near.contact[n]
        near.compression[n] = state.compression[k]
        near.free_displacement[n] = free_displacement_at(contact, h.contact, k, state.drift_momentum)


@noinline
def find_near_contacts(model, settings, state):
    """Find the contacts that may close in the next FLIGHT_FRAMES samples."""
    read_far_contacts(model.contact, state)
    if model.connection.is_plain[0] != 0:
        select_contacts(model, is_damping(state), state)
    gather_coefficients(settings.h, state)
    state.connection.near.until[0] = settings.frame + FLIGHT_FRAMES


@inline
def read_far_contacts(contact, state):
    """Read the compressions that were not kept from the modes; all are kept now, and in reach."""
    near = state.connection.near
    for k in range(near.is_far.shape[0]):
        near.contact[k] = k
        if near.is_far[k] != 0:
            state.compression[k] = min(compression_from_modes(contact, state, k), 0.0)
            state.compression_compensation[k] = state.contact_force[k] = 0.0
            near.is_far[k] = 0
    near.until[0] = 0


@inline
def keep_all_contacts(contact, state):
    """Bring all compressions up to date for a step of all contacts."""
    if EFFECTS & CONNECTIONS:
        read_far_contacts(contact, state)


@inline
def select_contacts(model, is_disturbed, state):
    """Say which contacts may close; and of what these push, no bound but that of energy holds."""
    contact, connection = model.contact, model.connection
    near, bound = state.connection.near, state.displacement_bound
    bound_modal_displacements(model, state)
    amplitude = math.sqrt(max(0.0, 2.0 * island_energy(model, state)))
    for k in range(near.is_far.shape[0]):
        near.is_far[k] = 1
    more = True
    while more:
        more = False
        for k in range(near.is_far.shape[0]):
            is_beyond = state.compression[k] + 1.01 * connection.contact_reach[k] * amplitude < 0.0  # of all the energy
            if near.is_far[k] == 1 and (has_connections(state) or not is_beyond):
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
    if not follows_modes(state, k):
        return may_act(state, k, state.compression[k], 0.0)
    bound = state.displacement_bound
    distance, connected = split_bound_at_contact(contact, connection, k, bound)
    distance += reach_of_connected(connection, amplitude, is_disturbed, k, connected)
    return not state.compression[k] + 1.01 * distance < 0.0  # NaN may


@inline
def forget_bounds(rows, k, bound):
    """Nothing bounds the modes of row k but their energy."""
    for m in range(rows.mode_begin[k], rows.mode_end[k]):
        bound[m] = UNBOUNDED


# --- what a solve of the near ones needs


@inline
def gather_coefficients(h, state):
    """Gather what does not change from step to step. h: StepCoefficients"""
    near, n, total = state.connection.near, INT64_0, state.compression.shape[0]
    for k in range(total):
        if near.is_far[k] == 0:
            near.contact[n] = k
            near.potential_coefficient[n], near.exponent[n] = state.potential_coefficient[k], state.exponent[k]
            near.loss_rate[n] = h.contact.loss_rate[k]
            n += 1
    near.size[0] = n
    connections = state.connection.force.shape[0]
    for i in range(n):
        for j in range(n):
            near.coupling[i * n + j] = h.contact.coupling[np.int64(near.contact[i]) * total + near.contact[j]]
        for j in range(connections):
            near.moves[i * connections + j] = h.connection.contact_moves[near.contact[i] * connections + j]


# --- bounds


@inline
def split_bound_at_row(connection, rows, r, bound):
    """Return how far the modes of row r can move its point, m, if each moves no further than `bound`. Of the two
    numbers, the first is for a body to which nothing is connected, and the second for any other; one of them is 0."""
    distance = bound_at_row(rows, r, bound)
    if distance > 0.0 and connection.is_unconnected[rows.mode_begin[r]] == 0.0:
        return 0.0, distance
    return distance, 0.0


@inline
def split_bound_at_contact(contact, connection, k, bound):
    """Return how far contact k can close, m, if each mode moves no further than `bound`: by the bodies to which nothing
    is connected, and by the others."""
    alone, connected = split_bound_at_row(connection, contact.rows, k, bound)
    more, further = split_bound_at_row(connection, contact.other_rows, k, bound)
    return alone + more, connected + further


@inline
def reach_of_connected(connection, amplitude, is_disturbed, k, distance):
    """Return how far what is connected can close contact k, m. All of its energy bounds that; or, if less, what the
    bodies move by themselves and what the forces of connections add, which that energy bounds.

    amplitude:    √(2E) of what is connected, √J
    is_disturbed: True if the bodies do not move by themselves alone, but are damped by an event
    distance:     how far the bodies can close it by themselves, m
    """
    by_energy = connection.contact_reach[k] * amplitude
    if is_disturbed:
        return by_energy
    return min(by_energy, distance + connection.contact_reach_by_forces[k] * amplitude)


@inline
def find_if_all_open(model, is_disturbed, state):
    """Return True if no contact can close before the next check, while each mode moves by itself as far as its energy
    lets it. is_disturbed: True if the bodies do not move by themselves alone, but are damped by an event"""
    bound_modal_displacements(model, state)
    amplitude = amplitude_of_connected(model, FLIGHT_FRAMES / model.samplerate, state)
    for k in range(state.compression.shape[0]):
        if may_close(model.contact, model.connection, amplitude, is_disturbed, k, state):
            return False
    return True


@inline
def compression_now(contact, state, k, frame):
    """Return compression k, m; of friction, the slip, m/s. Where a contact is known to stay open, its compression is
    not kept, and is read from the modes."""
    if not follows_modes(state, k):
        return traced_compression(state, k)
    if frame < state.contact_free_until[0] or state.connection.near.is_far[k] != 0:
        return compression_from_modes(contact, state, k)
    return state.compression[k]
