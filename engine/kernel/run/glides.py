"""Glides: parameters of contacts, connections and friction that events move to new values.

Over each step, of a sample or of a stage, a parameter has the value that its glide reaches in the middle: so the motion
is of second order in the length of the step. From the end of the glide on it has exactly the value that this leads to.
"""

from engine.compiler.decorators import inline, noinline
from engine.compiler.elementary import rise
from engine.kernel.contact.law import contact_parameter, set_contact_parameter
from engine.kernel.data.effects import EFFECTS, EVENTS
from engine.kernel.data.enums import EventCursor, EventKind
from engine.kernel.interactions.connections import connection_parameter, set_connection_parameter
from engine.kernel.run.step import begin_change, end_change


@inline
def is_glide(kind):
    """True if events of a kind move a parameter to a value."""
    is_of_contact = kind >= EventKind.STIFFNESS and kind <= EventKind.EXPONENT
    return is_of_contact or (kind >= EventKind.CONNECTION_STIFFNESS and kind <= EventKind.FRICTION_BRISTLE)


@inline
def lasts(events, j):
    """True if event j is a glide that takes more than one step."""
    return is_glide(events.kind[j]) and events.end[j] - events.start[j] > 1


@inline
def glides_now(state):
    """True if parameters glide in this sample."""
    if EFFECTS & EVENTS:
        return state.event_cursor[EventCursor.GLIDING] > 0
    return False


@inline
def glide_value(events, state, j, time):
    """Return the value that glide j has reached at a time, frames. One that takes a single step is at its end at
    once."""
    duration = events.end[j] - events.start[j]
    if duration <= 1 or time >= events.end[j]:
        return events.value[j]
    share = (time - events.start[j]) / duration
    return state.glide_start[j] + (events.value[j] - state.glide_start[j]) * rise(share)


@inline
def is_of_connection(kind):
    """True if events of a kind change a parameter of connections."""
    return kind >= EventKind.CONNECTION_STIFFNESS and kind <= EventKind.CONNECTION_REST


@inline
def parameter_of(model, state, j):
    """Return the present value of what event j changes."""
    events, kind = model.events, model.events.kind[j]
    if is_of_connection(kind):
        return connection_parameter(kind, events.target_begin[j], state)
    return contact_parameter(model.contact, kind, events.target_begin[j], state)


@inline
def set_parameter(model, state, j, value):
    """Set what event j changes."""
    events, kind = model.events, model.events.kind[j]
    span = events.target_begin[j], events.target_end[j]
    if is_of_connection(kind):
        set_connection_parameter(kind, span, value, state)
    else:
        set_contact_parameter(model.contact, kind, span, value, state)


@inline
def advance_glide(model, state, j, frame):
    """Begin glide j, go on with it, or end it, at the start of the step of this frame."""
    events = model.events
    if frame == events.start[j]:
        state.glide_start[j] = parameter_of(model, state, j)
    set_parameter(model, state, j, glide_value(events, state, j, frame + 0.5))


@inline
def ends_late(model, state, j, frame):
    """True if event j is a glide that ends at this frame, and its parameter is not yet what it leads to."""
    events = model.events
    if not is_glide(events.kind[j]) or events.end[j] != frame or events.start[j] >= frame:
        return False
    return parameter_of(model, state, j) != events.value[j]


@inline
def stop_glide(events, state, j, frame):
    """Let event j, a glide whose place another takes at this frame, end at the value that it has reached."""
    if frame > events.start[j] and frame < events.end[j]:
        events.value[j] = glide_value(events, state, j, frame + 0.0)


@noinline
def glide_to(model, state, now, time):
    """Move all parameters that glide to where they are at a time within the present sample, frames. What this adds to
    the energy counts as supplied. now: to which the state has come, frames"""
    events, cursor = model.events, state.event_cursor
    before = begin_change(model, state, now)
    for j in range(cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT]):
        if lasts(events, j):
            set_parameter(model, state, j, glide_value(events, state, j, time))
    end_change(model, state, before)
