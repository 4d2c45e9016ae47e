"""Bodies whose tension hardly rises are linear: at every check each body stretches if its partials may rise by more
than the scene lets pass (Accuracy.least_detuning) before the next one.

How far they may follows from energy: that of the body if nothing else acts, that of its whole island where contacts or
connections join it to others, and what external forces and moving surfaces can add meanwhile. An event that has begun
is known to all ways of playing; one that is still to come counts from the step that it begins in.
"""

import math

from engine.compiler.decorators import inline, noinline
from engine.kernel.contact.law import largest_drive
from engine.kernel.data.effects import EFFECTS, EVENTS, FORCES, STRETCHING
from engine.kernel.data.enums import FLIGHT_FRAMES, EnergyTotal, EventCursor, EventKind, Stretch, StretchFactor
from engine.kernel.interactions.connections import connection_energy, has_connections
from engine.kernel.interactions.contacts import contact_energy
from engine.kernel.interactions.external_forces import force_at, is_driven, is_pushing
from engine.kernel.interactions.tension import (
    stiffness_of,
    stretch_and_vibration,
    stretching_energy,
)
from engine.kernel.modes.mode_energies import motion_energy
from engine.kernel.modes.ordered_sums import accumulate

SHARE_IN_CONTACT = 1 / 16  # of the rise that the scene lets pass, from which a body stretches that may gain energy
WHOLE = 0.0, 1.0  # span of a sample


@inline
def can_stretch(model):
    """True if a body of the island may stretch."""
    if EFFECTS & STRETCHING:
        return model.tension.can_stretch[0] != 0
    return False


@inline
def update_stretching(model, state):
    """Choose which bodies of an island stretch, where nothing but connections acts before the next check."""
    if can_stretch(model):
        amplitude = 0.0
        if has_connections(state):
            amplitude = amplitude_of_island(model, state)
        choose_stretching(model.tension, model.omega_squared, amplitude, 1.0, state)


@inline
def update_touched(model, state, frame):
    """Choose which bodies of an island stretch, where contacts or forces may act from this frame on."""
    if can_stretch(model):
        amplitude = amplitude_of_island(model, state) + gain_by_forces(model, state, frame)
        amplitude += gain_by_surfaces(model, state)
        choose_stretching(model.tension, model.omega_squared, amplitude, SHARE_IN_CONTACT, state)


@inline
def let_stretch(model, state):
    """Let the bodies of an island stretch, as something may act on them before the next check."""
    if can_stretch(model):
        choose_stretching(model.tension, model.omega_squared, math.inf, 1.0, state)


@noinline
def choose_stretching(tension, omega_squared, amplitude, share, state):
    """Let each body of an island stretch, or be linear.

    amplitude: √(2E) of what may reach the body, √J; share: of the rise that the scene lets pass
    """
    is_any = False
    for b in range(tension.mode_begin.shape[0]):
        if stiffness_of(tension, b) != 0.0:
            is_loud = amplitude == math.inf or is_heard(tension, omega_squared, amplitude, share, state, b)
            set_stretching(tension, omega_squared, is_loud, state, b)
            is_any = is_any or is_loud
    state.tension.is_active[0] = 1 if is_any else 0


@inline
def is_heard(tension, omega_squared, amplitude, share, state, b):
    """True if the energy that body b has, or may get, may raise its pitch by more than a share of what the scene lets
    pass. NaN does, too."""
    stretch, vibration = stretch_and_vibration(tension, omega_squared, state, b)
    energy = 0.25 * stiffness_of(tension, b) * stretch * stretch + max(vibration, 0.5 * amplitude * amplitude)
    unheard = share * tension.factor[b][StretchFactor.UNHEARD]
    return unheard <= 0.0 or not stiffness_of(tension, b) * energy <= unheard


@inline
def set_stretching(tension, omega_squared, is_active, state, b):
    """Let body b stretch or be linear. The energy of its stretch is supplied or dissipated."""
    body = state.tension.body[b]
    if is_active != (body[Stretch.STRETCHES] != 0.0):
        stretch, _ = stretch_and_vibration(tension, omega_squared, state, b)
        energy = 0.25 * stiffness_of(tension, b) * stretch * stretch
        accumulate(state.energy_totals, EnergyTotal.SUPPLIED if is_active else EnergyTotal.DISSIPATED, energy)
        body[Stretch.STRETCHES] = 1.0 if is_active else 0.0
        body[Stretch.RISE] = body[Stretch.LAST] = body[Stretch.SECOND_LAST] = body[Stretch.THIRD_LAST] = 0.0


# --- what may reach a body, as √(2E), √J


@noinline
def amplitude_of_island(model, state):
    """Return √(2E) of an island: of all that moves, about its rest, and of what contacts, connections and stretched
    bodies hold, √J."""
    energy = motion_energy(model, state) + contact_energy(state)
    energy += max(0.0, connection_energy(model.connection, state))
    return math.sqrt(2.0 * (energy + stretching_energy(model, state)))


@inline
def gain_by_forces(model, state, frame):
    """Return by how much external forces may raise √(2E) of an island up to the next check, √J: those that act, and
    those of the patch that begin by then."""
    gain, force = 0.0, model.force
    if EFFECTS & FORCES:
        for j in range(force.start.shape[0]):
            most, change = force_until_check(force, model.events, j, frame, state)
            if most > 0.0:
                gain += gain_by_force(force.rows, model.omega_squared, j, most, change, 1.0 / model.samplerate)
    return gain


@noinline
def force_until_check(force, events, j, frame, state):
    """Return the largest size of external force j up to the next check, and the sum of its changes, N."""
    if is_driven(force.drive, j):
        return math.inf, math.inf
    most, change, last = 0.0, 0.0, 0.0
    for n in range(frame, frame + FLIGHT_FRAMES):
        f = force_at(force, None, j, n, WHOLE)
        most, change, last = max(most, abs(f)), change + abs(f - last), f
    if EFFECTS & EVENTS:
        for i in range(state.event_cursor[EventCursor.FIRST_ACTIVE], state.event_cursor[EventCursor.NEXT]):
            if is_pushing(events.kind[i]) and events.target_begin[i] == j and events.end[i] > frame:
                size = size_of_push(force, events, i, j)
                most, change = most + size, change + 2.0 * size
    return most, change


@inline
def size_of_push(force, events, i, j):
    """Return the largest size of event i, which pushes where external force j does, N."""
    if events.kind[i] == EventKind.PLUCK:
        return abs(events.value[i])
    largest = abs(force.tail[j])
    for at in range(force.table_begin[j], force.table_end[j]):
        largest = max(largest, abs(force.table[at]))
    return abs(events.value[i]) * largest


@noinline
def gain_by_force(rows, omega_squared, r, most, change, step):
    """Return by how much a force at row r may raise √(2E) up to the next check, √J. A mode gains no more momentum than
    Φ·F·T, and no more than Φ·(2·F + ΣΔF)/ω, as partial integration shows.

    most: its largest size, F; change: the sum of its changes, ΣΔF, N; step: of a sample, s
    """
    total, begin = 0.0, rows.mode_begin[r]
    for m in range(begin, rows.mode_end[r]):
        impulse = most * FLIGHT_FRAMES * step
        if omega_squared[m] > 0.0:
            impulse = min(impulse, (2.0 * most + change) / math.sqrt(omega_squared[m]))
        share = rows.phi[rows.offset[r] + (m - begin)] * impulse
        total += share * share
    return math.sqrt(total)


@inline
def gain_by_surfaces(model, state):
    """Return by how much surfaces that move by themselves, such as bows, may raise √(2E) of an island up to the next
    check, √J; infinite where a contact presses them."""
    gain, contact, step = 0.0, model.contact, 1.0 / model.samplerate
    if contact.has_power_laws[0] == 0:
        for k in range(state.compression.shape[0]):
            most = largest_drive(contact, k, state)
            if most == math.inf:
                return most
            if most > 0.0:
                gain += gain_by_force(contact.rows, model.omega_squared, k, most, math.inf, step)
                gain += gain_by_force(contact.other_rows, model.omega_squared, k, most, math.inf, step)
    return gain
