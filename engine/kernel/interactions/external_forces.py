"""External forces: a table of the mean force over each sample (paper, eq. 34), and its shape in stages; and plucks of
the score, whose mean over each step is exact."""

from engine.compiler.decorators import inline, noinline
from engine.kernel.data.effects import DRIVE, EFFECTS, EVENTS, FORCES
from engine.kernel.data.enums import UNUSED_SLOT, EventCursor, EventKind
from engine.kernel.interactions.force_shapes import has_shape, mean_of_shape, pluck_impulse
from engine.kernel.interactions.one_way_drive import driven_force
from engine.kernel.modes.mode_step import forget_moves
from engine.kernel.modes.point_rows import project_drift, push_both_at_row


@inline
def has_external_forces(force):
    """True if external forces act on the island, now or at any time."""
    if EFFECTS & FORCES:
        return force.start.shape[0] > 0
    return False


@inline
def force_at(force, shapes, j, frame, span):
    """Return external force j, which is not that of strings, over a step, N. shapes: ForceShapes or None"""
    n = frame - force.start[j]
    if n < 0:
        return 0.0
    at = force.table_begin[j] + n
    if at >= force.table_end[j]:
        return force.tail[j]
    return table_or_shape(force, shapes, j, at, span)


@inline
def table_or_shape(force, shapes, j, at, span):
    """Return external force j over a step, where its table has the mean over the sample, N."""
    if shapes is not None:
        if has_shape(shapes, j, span):
            return mean_of_shape(shapes, j, at - force.table_begin[j], span)
    return force.table[at]


@inline
def is_driven(drive, j):
    """True if external force j is that of strings. drive: of the forces"""
    if EFFECTS & DRIVE:
        return drive[j] >= 0
    return False


@inline
def is_pushing(kind):
    """True if events of a kind push while they last."""
    return kind == EventKind.PLUCK or kind == EventKind.FORCE_AGAIN


@inline
def events_push(state):
    """True if plucks of the score, or forces that act again, push now."""
    if EFFECTS & EVENTS:
        return state.event_cursor[EventCursor.PUSHING] > 0
    return False


@noinline
def force_of_event(events, force, shapes, i, frame, span):
    """Return the force of event i, which pushes, over a step, N. shapes: ForceShapes or None"""
    n = frame - events.start[i]
    if events.kind[i] == EventKind.PLUCK:
        rises, falls = events.value2[i], events.value3[i]
        impulse = pluck_impulse(rises, falls, n + span[1]) - pluck_impulse(rises, falls, n + span[0])
        return events.value[i] * impulse / (span[1] - span[0])
    j = events.target_begin[i]
    at = force.table_begin[j] + n
    return events.value[i] * table_or_shape(force, shapes, j, at, span) if at < force.table_end[j] else 0.0


@inline
def next_external_force(force, frame):
    """Return the next frame, after the step of this frame, at which an external force acts; this frame if one goes
    on."""
    due = UNUSED_SLOT
    if EFFECTS & FORCES:
        for j in range(force.start.shape[0]):
            if is_driven(force.drive, j):
                return frame
            end = force.start[j] + force.table_end[j] - force.table_begin[j]
            if end > frame + 1 or force.tail[j] != 0.0:
                due = min(due, max(frame, force.start[j]))
    return due


@inline
def shapes_of(refinement):
    """Return the ForceShapes of a Refinement; None without one."""
    if refinement is None:
        return None
    return refinement.force


@inline
def find_external_forces(force, events, shapes, settings, state):
    """Find all external forces over a step; those of events on one point add up. shapes: ForceShapes or None"""
    frame, span = settings.frame, settings.span
    for j in range(force.start.shape[0]):
        if is_driven(force.drive, j):
            state.external_force[j] = driven_force(state.drive, force.drive[j], frame)
        else:
            state.external_force[j] = force_at(force, shapes, j, frame, span)
    if events_push(state):
        for i in range(state.event_cursor[EventCursor.FIRST_ACTIVE], state.event_cursor[EventCursor.NEXT]):
            if is_pushing(events.kind[i]):
                pushed = force_of_event(events, force, shapes, i, frame, span)
                state.external_force[events.target_begin[i]] += pushed


@inline
def push_by_external_forces(model, settings, state):
    """Do half a kick by every external force, and keep the forces for the second half. Returns True if any acts."""
    acts, force = False, model.force
    if EFFECTS & FORCES:
        find_external_forces(force, model.events, shapes_of(model.refinement), settings, state)
        for j in range(force.start.shape[0]):
            f = state.external_force[j]
            if f != 0.0:
                push_both_at_row(force.rows, settings.h.force, j, f, state)
                acts = True
        if acts:
            forget_moves(state)
    return acts


@inline
def finish_external_forces(force, coefficients, state):
    """Return the work that the external forces of the step do over the coming drift, J."""
    work = 0.0
    if EFFECTS & FORCES:
        for j in range(force.start.shape[0]):
            f = state.external_force[j]
            if f != 0.0:
                work += f * project_drift(force.rows, coefficients, j, state.drift_momentum)
    return work
