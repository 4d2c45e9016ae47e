"""Events: changes by the score at the start of a step.

All energy that an event adds to the stored energy counts as supplied, all that it takes as dissipated, so the ledger
stays closed: turning a knob cannot blow up the sound.
"""

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import rise
from engine.kernel.data.enums import NO_END, UNUSED_SLOT, DampedModes, EnergyTotal, EventCursor, EventKind
from engine.kernel.interactions.connections import (
    connection_parameter,
    forget_near_contacts,
    has_connections,
    set_connection_parameter,
    shift_connections,
)
from engine.kernel.interactions.contacts import (
    contact_parameter,
    invalidate_margins,
    set_contact_parameter,
    shift_contacts,
)
from engine.kernel.interactions.external_forces import next_external_force
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.near_contacts import keep_all_contacts
from engine.kernel.interactions.tension import let_stretch
from engine.kernel.modes.event_dampers import damp_modes, find_damped_loss, is_damping
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import accumulate
from engine.kernel.run.adaptive_steps import steps_of_sample


@inline
def next_due(force, events, state, frame):
    """Return the next frame, after the step of this frame, at which an event begins or an external force acts; this
    frame itself if one of these goes on, other than damping."""
    return min(next_event(events, state, frame), next_external_force(force, frame))


@inline
def next_event(events, state, frame):
    """Return the frame at which the next event begins; this frame if an event other than damping goes on after it."""
    if events is None:
        return UNUSED_SLOT
    following = state.event_cursor[EventCursor.NEXT]
    for j in range(state.event_cursor[EventCursor.FIRST_ACTIVE], following):
        if events.kind[j] != EventKind.DAMP and frame + 1 < events.end[j]:
            return frame
    return events.start[following] if following < events.kind.shape[0] else UNUSED_SLOT


@inline
def glide_value(events, state, j, frame, now):
    """Return the value that event j gives its target at the end of this step. now: its value at the start of the
    event"""
    if frame == events.start[j]:
        state.glide_start[j] = now
    if frame + 1 >= events.end[j]:
        return events.value[j]
    share = (frame + 1 - events.start[j]) / (events.end[j] - events.start[j])
    return state.glide_start[j] + (events.value[j] - state.glide_start[j]) * rise(share)


@noinline
def set_motion(model, state, m, q, p):
    """Put mode m at displacement q with momentum p, and move its contacts and connections with it."""
    shift_contacts(model.contact, state, m, q - state.q[m])
    shift_connections(model.connection, state, m, q - state.q[m])
    state.q[m] = q
    state.p[m] = p
    state.kick_compensation[m] = 0.0


@noinline
def lift_dampers(events, cursor, j, first, last, frame):
    """Let event j lift the dampers of modes first:last."""
    i = cursor[EventCursor.FIRST_ACTIVE]
    while i < events.kind.shape[0] and events.start[i] != UNUSED_SLOT:
        same = events.kind[i] == EventKind.DAMP and events.target_begin[i] < last and first < events.target_end[i]
        if same and (i < j or events.end[i] >= NO_END):
            events.end[i] = min(events.end[i], frame)
        i += 1


@inline
def lift_dampers_of_struck(events, contact, cursor, j, frame):
    """Let event j lift the dampers of the bodies that its mode has contacts with."""
    if contact is not None:
        lift_dampers_of_joined(events, contact.rows, contact.other_rows, cursor, j, frame)


@inline
def lift_dampers_of_joined(events, rows, other, cursor, j, frame):
    """Let event j lift the dampers of the bodies at the other end of its mode's contacts. rows, other: of either end of
    the contacts; `other` may be None"""
    if other is not None:
        m = events.target_begin[j]
        for k in range(rows.mode_begin.shape[0]):
            if rows.mode_begin[k] <= m and m < rows.mode_end[k]:
                lift_dampers(events, cursor, j, other.mode_begin[k], other.mode_end[k], frame)
            elif other.mode_begin[k] <= m and m < other.mode_end[k]:
                lift_dampers(events, cursor, j, rows.mode_begin[k], rows.mode_end[k], frame)


@noinline
def execute_event(model, state, j, frame):
    """Execute event j, which is not damping, at the start of this step."""
    events = model.events
    if events.kind[j] == EventKind.STRIKE or events.kind[j] == EventKind.LAUNCH_AND_LIFT:
        set_motion(model, state, events.target_begin[j], events.value[j], events.value2[j])
        if events.kind[j] == EventKind.LAUNCH_AND_LIFT:
            lift_dampers_of_struck(events, model.contact, state.event_cursor, j, frame)
    elif events.kind[j] == EventKind.LIFT:
        lift_dampers(events, state.event_cursor, j, events.target_begin[j], events.target_end[j], frame)
    else:
        set_parameter(model, state, j, frame)


@inline
def set_parameter(model, state, j, frame):
    """Set the parameter of contacts or connections that event j changes, or advance its glide."""
    events, kind = model.events, model.events.kind[j]
    span = events.target_begin[j], events.target_end[j]
    if kind >= EventKind.CONNECTION_STIFFNESS and kind <= EventKind.CONNECTION_REST:
        now = connection_parameter(model.connection, kind, span[0], state)
        set_connection_parameter(model.connection, kind, span, glide_value(events, state, j, frame, now), state)
    else:
        now = contact_parameter(model.contact, kind, span[0], state)
        set_contact_parameter(model.contact, kind, span, glide_value(events, state, j, frame, now), state)


@noinline
def run_due_events(model, state, frame):
    """Execute all events that are due at the start of this step, and count the energy that they add or take; dampers
    act at its end."""
    events, cursor = model.events, state.event_cursor
    following = cursor[EventCursor.NEXT]
    while following < events.kind.shape[0] and events.start[following] <= frame:
        following += 1
        cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN
    cursor[EventCursor.NEXT] = following
    if acts_on_more_than_loss(events, cursor, frame):
        keep_all_contacts(model.contact, model.connection, state)
        before = island_energy(model, state)
        for j in range(cursor[EventCursor.FIRST_ACTIVE], following):
            if frame < events.end[j] and events.kind[j] != EventKind.DAMP:
                execute_event(model, state, j, frame)
        accumulate(state.energy_totals, EnergyTotal.SUPPLIED, island_energy(model, state) - before)
        let_stretch(model.tension, model, state)  # a contact may close within this step
        state.contact_free_until[0] = 0
        invalidate_margins(state.refinement)
        forget_drift(state)
    forget_finished(events, state, frame)
    if cursor[EventCursor.DAMPED] == DampedModes.UNKNOWN:
        find_damped_loss(events, model.step.loss, model.refinement, state)
        forget_near_contacts(state.connection)


@inline
def acts_on_more_than_loss(events, cursor, frame):
    """True if an event that has begun acts at this step and is not damping."""
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if frame < events.end[j] and events.kind[j] != EventKind.DAMP:
            return True
    return False


@inline
def forget_finished(events, state, frame):
    """Move events that go on to the end of those that have begun, so that no step looks at those that are over: a
    damper may stay down while thousands of other events come and go."""
    cursor = state.event_cursor
    first, running = cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]
    for j in range(running - 1, first - 1, -1):
        if events.end[j] > frame:
            running -= 1
            if running != j:
                move_event(events, j, running)
                state.glide_start[running] = state.glide_start[j]
    if cursor[EventCursor.FIRST_ACTIVE] != running:
        cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.DAMPED] = running, DampedModes.UNKNOWN


@inline
def move_event(events, source, target):
    """Copy an event to another slot."""
    events.kind[target], events.start[target] = events.kind[source], events.start[source]
    events.end[target] = events.end[source]
    events.target_begin[target], events.target_end[target] = events.target_begin[source], events.target_end[source]
    events.value[target], events.value2[target] = events.value[source], events.value2[source]


@inline
def damps_in_halves(connection, refinement, state):
    """True if dampers act after the first stage of a sample and after its last, for half a sample each.

    In each stage a rigid joint reverses the velocity at which loss lets its sides part. Between two losses there must
    be an odd number of stages, or that velocity grows with each sample.
    """
    return (
        has_connections(connection, state)
        and (refinement.sequence.shape[0] * steps_of_sample(refinement, state)) % 2 == 0
    )


@inline
def finish_first_stage(model, refinement, state):
    """Let the dampers of events act after the first stage of a sample, if they act in halves."""
    if is_damping(model.events, state):
        if damps_in_halves(model.connection, refinement, state):
            damp_modes(state)


@inline
def finish_score(model, events, refinement, state):
    """Let the dampers of events act at the end of a sample in stages: the half of it that belongs to the next sample
    would come at the same place."""
    if refinement is not None:
        if is_damping(events, state):
            if not damps_in_halves(model.connection, refinement, state):
                damp_modes(state)
            damp_modes(state)


@inline
def run_score(model, events, state, frame):
    """Execute the events of the score that act at the start of this step."""
    if events is not None:
        cursor = state.event_cursor
        following, is_unknown = cursor[EventCursor.NEXT], cursor[EventCursor.DAMPED] == DampedModes.UNKNOWN
        is_due = following < events.kind.shape[0] and events.start[following] <= frame
        if is_due or is_unknown or has_more_than_damping(events, cursor, frame):
            run_due_events(model, state, frame)


@inline
def has_more_than_damping(events, cursor, frame):
    """True if an event that has begun is over, or is not damping: damping that goes on needs no call."""
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if events.kind[j] != EventKind.DAMP or events.end[j] <= frame:
            return True
    return False
