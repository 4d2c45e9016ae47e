"""External forces: a table of the mean force over each step (paper, eq. 34)."""

from engine.compiler.decorators import inline
from engine.kernel.data.enums import UNUSED_SLOT
from engine.kernel.interactions.one_way_drive import driven_force
from engine.kernel.modes.mode_step import forget_moves
from engine.kernel.modes.point_rows import project_drift, push_both_at_row


@inline
def has_external_forces(force):
    """True if external forces act on the island, now or at any time."""
    if force is None:
        return False
    return force.start.shape[0] > 0


@inline
def force_at(force, drive, ring, j, frame):
    """Return external force j over the step that begins at sample `frame`, N. drive, ring: of the forces, and of the
    state"""
    if drive is not None:
        if drive[j] >= 0:
            return driven_force(ring, drive[j], frame)
    n = frame - force.start[j]
    if n < 0:
        return 0.0
    at = force.table_begin[j] + n
    return force.scale[j] * (force.table[at] if at < force.table_end[j] else force.tail[j])


@inline
def is_driven(drive, j):
    """True if external force j is that of strings. drive: of the forces"""
    if drive is None:
        return False
    return drive[j] >= 0


@inline
def next_external_force(force, frame):
    """Return the next frame, after the step of this frame, at which an external force acts; this frame if one goes
    on."""
    due = UNUSED_SLOT
    if force is not None:
        for j in range(force.start.shape[0]):
            if is_driven(force.drive, j):
                return frame
            end = force.start[j] + force.table_end[j] - force.table_begin[j]
            if end > frame + 1 or force.tail[j] != 0.0:
                due = min(due, max(frame, force.start[j]))
    return due


@inline
def push_by_external_forces(force, coefficients, frame, state):
    """Do half a kick by every external force, and keep it for the second half. Returns True if any acts."""
    acts = False
    if force is not None:
        for j in range(force.start.shape[0]):
            f = force_at(force, force.drive, state.drive, j, frame)
            if f != 0.0:
                push_both_at_row(force.rows, coefficients, j, f, state)
                acts = True
        if acts:
            forget_moves(state.connection)
    return acts


@inline
def finish_external_forces(force, coefficients, frame, state):
    """Return the work that the external forces do over the coming drift, J."""
    work = 0.0
    if force is not None:
        for j in range(force.start.shape[0]):
            f = force_at(force, force.drive, state.drive, j, frame)
            if f != 0.0:
                work += f * project_drift(force.rows, coefficients, j, state.drift_momentum)
    return work
