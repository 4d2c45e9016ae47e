"""External forces: a table of the mean force over each step (paper, eq. 34)."""

from engine.jit import jit
from engine.modes import kick, project_drift


@jit
def strength(force, j, frame):
    """Force j over the step that begins at sample `frame`, N."""
    n = frame - force.start[j]
    if n < 0:
        return 0.0
    at = force.begin[j] + n
    return force.scale[j] * (force.table[at] if at < force.begin[j + 1] else force.after[j])


@jit
def idle(force, frame, ahead):
    """Whether no external force acts from this frame on for `ahead` samples."""
    if force is not None:
        for j in range(force.start.shape[0]):
            over = force.start[j] + force.begin[j + 1] - force.begin[j] <= frame and force.after[j] == 0.0
            if not over and force.start[j] <= frame + ahead:
                return False
    return True


@jit
def push(force, frame, p):
    """Half a kick by every external force."""
    if force is not None:
        for j in range(force.start.shape[0]):
            f = strength(force, j, frame)
            if f != 0.0:
                kick(force.rows, j, f, p)


@jit
def supply(force, frame, p):
    """Work the external forces do over the coming drift, J."""
    work = 0.0
    if force is not None:
        for j in range(force.start.shape[0]):
            f = strength(force, j, frame)
            if f != 0.0:
                work += f * project_drift(force.rows, j, p)
    return work
