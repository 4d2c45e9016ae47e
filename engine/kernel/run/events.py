"""Events: changes by the score at the start of a step.

Where events overlap, one rule decides, at the frame at which the newer begins (docs/patches.md): a glide ends where a
newer one of the same target begins, which starts from the value reached; of two dampers the newer counts, and one that
lasts longer goes on after it; plucks and strikes leave each other alone. Of events that begin at one frame, the newer
is that which comes later in the score, or was told later.

All energy that an event adds to the stored energy counts as supplied, all that it takes as dissipated, so the ledger
stays closed: turning a knob cannot blow up the sound.
"""

from engine.compiler.decorators import TRUE, inline, noinline
from engine.kernel.data.effects import EFFECTS, EVENTS
from engine.kernel.data.enums import NO_END, UNUSED_SLOT, DampedModes, EventCursor, EventKind
from engine.kernel.interactions.connections import forget_near_contacts, shift_connections
from engine.kernel.interactions.contacts import shift_contacts
from engine.kernel.interactions.external_forces import is_pushing, next_external_force
from engine.kernel.interactions.stretching_choice import let_stretch
from engine.kernel.modes.event_dampers import find_damped_loss
from engine.kernel.run.glides import advance_glide, ends_late, is_glide, lasts, stop_glide
from engine.kernel.run.step import begin_change, end_change


@inline
def next_due(force, events, state, frame):
    """Return the next frame, after the step of this frame, at which an event begins or an external force acts; this
    frame itself if one of these goes on, other than damping."""
    due = next_external_force(force, frame)
    if EFFECTS & EVENTS:
        due = min(due, next_event(events, state, frame))
    return due


@inline
def next_event(events, state, frame):
    """Return the frame at which the next event begins, or a glide ends; this frame if an event other than damping goes
    on after it."""
    following = state.event_cursor[EventCursor.NEXT]
    due = events.start[following] if following < events.kind.shape[0] else UNUSED_SLOT
    for j in range(state.event_cursor[EventCursor.FIRST_ACTIVE], following):
        if events.kind[j] != EventKind.DAMP and frame + 1 < events.end[j]:
            return frame
        if is_glide(events.kind[j]) and frame + 1 == events.end[j]:
            due = min(due, frame + 1)
    return due


@noinline
def set_motion(model, state, m, q, p):
    """Put mode m at displacement q with momentum p, and move its contacts and connections with it."""
    shift_contacts(model.contact, state, m, q - state.q[m])
    shift_connections(model.connection, state, m, q - state.q[m])
    state.q[m] = q
    state.p[m] = p
    if state.kick_compensation.shape[0] > 0:
        state.kick_compensation[m] = 0.0


@noinline
def lift_dampers(events, cursor, j, modes, frame, is_for_good):
    """Let event j lift the dampers of some modes. modes: the first, and the one after the last; is_for_good: also those
    dampers that are to come down for good later"""
    first, last = modes
    i = cursor[EventCursor.FIRST_ACTIVE]
    while i < events.kind.shape[0] and events.start[i] != UNUSED_SLOT:
        same = events.kind[i] == EventKind.DAMP and events.target_begin[i] < last and first < events.target_end[i]
        if same and (i < j or (is_for_good and events.end[i] >= NO_END)):
            events.end[i] = min(events.end[i], frame)
        i += 1


@inline
def lift_dampers_of_struck(events, contact, cursor, j, frame):
    """Let event j lift the dampers of the bodies at the other end of its mode's contacts."""
    m, rows, other = events.target_begin[j], contact.rows, contact.other_rows
    for k in range(rows.mode_begin.shape[0]):
        if rows.mode_begin[k] <= m and m < rows.mode_end[k]:
            lift_dampers(events, cursor, j, (other.mode_begin[k], other.mode_end[k]), frame, TRUE)
        elif other.mode_begin[k] <= m and m < other.mode_end[k]:
            lift_dampers(events, cursor, j, (rows.mode_begin[k], rows.mode_end[k]), frame, TRUE)


@noinline
def execute_event(model, state, j, frame):
    """Execute event j, which changes motion or a parameter, at the start of this step."""
    events = model.events
    if events.kind[j] == EventKind.STRIKE or events.kind[j] == EventKind.LAUNCH_AND_LIFT:
        set_motion(model, state, events.target_begin[j], events.value[j], events.value2[j])
        if events.kind[j] == EventKind.LAUNCH_AND_LIFT:
            lift_dampers_of_struck(events, model.contact, state.event_cursor, j, frame)
    else:
        advance_glide(model, state, j, frame)


@inline
def changes_at_start(kind):
    """True if events of a kind change motion or a parameter at the start of a step. Dampers and what pushes act within
    steps, and a lift only ends dampers."""
    return not (kind == EventKind.DAMP or kind == EventKind.LIFT or is_pushing(kind))


@inline
def end_former(events, state, first, j, frame):
    """End what event j, which begins, takes the place of: of events `first` to j, those of its kind and target, but not
    damping that lasts longer. A lift ends dampers, and is over."""
    kind = events.kind[j]
    if is_pushing(kind):
        return
    if kind == EventKind.LIFT:
        modes = events.target_begin[j], events.target_end[j]
        lift_dampers(events, state.event_cursor, j, modes, frame, events.value[j] != 0.0)
        events.end[j] = frame
    for i in range(first, j):
        if events.kind[i] == kind and events.target_begin[i] == events.target_begin[j]:
            is_same = events.target_end[i] == events.target_end[j]
            if is_same and (kind != EventKind.DAMP or events.end[i] <= events.end[j]):
                if is_glide(kind):
                    stop_glide(events, state, i, frame)
                events.end[i] = min(events.end[i], frame)


@inline
def begin_due_events(events, state, frame):
    """Let all events begin that are due at the start of this step. Returns True if any does."""
    cursor = state.event_cursor
    following = first = cursor[EventCursor.NEXT]
    while following < events.kind.shape[0] and events.start[following] <= frame:
        end_former(events, state, cursor[EventCursor.FIRST_ACTIVE], following, frame)
        if events.kind[following] == EventKind.DAMP:
            cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN
        following += 1
    cursor[EventCursor.NEXT] = following
    return following > first


@noinline
def run_due_events(model, state, frame):
    """Execute all events that are due at the start of this step, and count the energy that they add or take; dampers
    act at its end."""
    events, cursor = model.events, state.event_cursor
    is_new = begin_due_events(events, state, frame)
    if is_any_executed(model, state, frame):
        before = begin_change(model, state, frame + 0.0)
        for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
            if is_executed(model, state, j, frame):
                execute_event(model, state, j, frame)
        end_change(model, state, before)
        state.contact_free_until[0] = 0
    forget_finished(events, state, frame)
    if is_new or cursor[EventCursor.GLIDING] > 0:
        let_stretch(model, state)  # a contact may close within this step, or a force push
    if cursor[EventCursor.DAMPED] == DampedModes.UNKNOWN:
        find_damped_loss(events, model.step.loss, model.refinement, state)
        forget_near_contacts(state)


@inline
def is_executed(model, state, j, frame):
    """True if event j, which has begun, acts at the start of this step."""
    events = model.events
    acts = frame < events.end[j] and changes_at_start(events.kind[j])
    return acts or ends_late(model, state, j, frame)


@inline
def is_any_executed(model, state, frame):
    """True if an event that has begun acts at the start of this step."""
    for j in range(state.event_cursor[EventCursor.FIRST_ACTIVE], state.event_cursor[EventCursor.NEXT]):
        if is_executed(model, state, j, frame):
            return True
    return False


@inline
def forget_finished(events, state, frame):
    """Move events that go on to the end of those that have begun, so that no step looks at those that are over: a
    damper may stay down while thousands of other events come and go."""
    cursor, pushing, gliding = state.event_cursor, 0, 0
    first, running = cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]
    for j in range(running - 1, first - 1, -1):
        if events.kind[j] == EventKind.DAMP and events.end[j] <= frame:
            cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN
        if events.end[j] > frame:
            running -= 1
            pushing += is_pushing(events.kind[j])
            gliding += lasts(events, j)
            if running != j:
                move_event(events, j, running)
                state.glide_start[running] = state.glide_start[j]
    cursor[EventCursor.PUSHING], cursor[EventCursor.GLIDING] = pushing, gliding
    cursor[EventCursor.FIRST_ACTIVE] = running


@inline
def move_event(events, source, target):
    """Copy an event to another slot."""
    events.kind[target], events.start[target] = events.kind[source], events.start[source]
    events.end[target] = events.end[source]
    events.target_begin[target], events.target_end[target] = events.target_begin[source], events.target_end[source]
    events.value[target], events.value2[target] = events.value[source], events.value2[source]
    events.value3[target] = events.value3[source]


@inline
def run_score(model, events, state, frame):
    """Execute the events of the score that act at the start of this step."""
    if EFFECTS & EVENTS:
        cursor = state.event_cursor
        following, is_unknown = cursor[EventCursor.NEXT], cursor[EventCursor.DAMPED] == DampedModes.UNKNOWN
        is_due = following < events.kind.shape[0] and events.start[following] <= frame
        if is_due or is_unknown or has_starts_or_ends(events, cursor, frame):
            run_due_events(model, state, frame)


@inline
def has_starts_or_ends(events, cursor, frame):
    """True if an event that has begun is over, or acts at the start of this step: what acts within steps needs no
    call."""
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if events.end[j] <= frame or changes_at_start(events.kind[j]):
            return True
    return False
