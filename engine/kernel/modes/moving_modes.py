"""The pass that moves all modes of an island by a step, once the forces of the step are known.

It drifts and kicks each mode, and goes on to the momentum of the next drift, which tells how far the next step would
move points without its forces. So one pass is enough for a step. Every number between two passes is that at a sample.
"""

from typing import Any, NamedTuple

from engine.compiler.decorators import inline
from engine.compiler.lanes import multiply_add, number_at, place_after, put_number, splat, zero_like
from engine.kernel.data.model import ModalLoss
from engine.kernel.modes.mode_step import begin_step_mode, end_step_mode, kick_by_force, motion_of, put_motion
from engine.kernel.modes.ordered_sums import fold, fold_lanes


class PushedPoint(NamedTuple):
    """A point whose force acts within the pass: its numbers stay in registers. Half the time of `State.push` for a
    string on a bridge, 0.9 of it for one under a hammer."""

    kick_phi: Any  # t·Φ of its modes
    drift_phi: Any  # v·Φ; None if its moves are not wanted
    offset: Any  # of the first mode of the pass in both
    force: Any  # N


@inline
def push_of_points(a, b, m):
    """Return the momentum that the forces at two points, or one, give mode m of a pass in half a kick; None if there is
    no point."""
    if a is None:
        return None
    first = number_at(a.kick_phi, place_after(m, a.offset))
    if b is None:
        return first * a.force
    return multiply_add(first, a.force, number_at(b.kick_phi, place_after(m, b.offset)) * b.force)


@inline
def take_push(pushes, m):
    """Return what forces give mode m in half a kick, and set it to zero; None if there is none."""
    if pushes is None:
        return None
    push = number_at(pushes, m)
    put_number(pushes, m, zero_like(push))
    return push


@inline
def sum_of_pushes(push, more):
    """Return the sum of two momenta, of which either may be None."""
    if push is None:
        return more
    return kick_by_force(more, push)


@inline
def step_mode(h, motion, momentum, pushes, push, m):
    """Move mode m by a step. Returns the energy lost after the drift, and the energy lost before the next one; and the
    momenta of both drifts.

    momentum: that of the drift without `push`, of all modes; it becomes that of the next drift
    push:     what points of the pass give it in half a kick, beside `pushes`; or None
    """
    half = kick_by_force(push, number_at(momentum, m))
    push = sum_of_pushes(push, take_push(pushes, m))
    q, p, lost = end_step_mode(h, push, motion.compensation, m, number_at(motion.q, m), half)
    coming, lost_next = begin_step_mode(h, motion.compensation, m, q, p)
    put_motion(motion, m, q, p)
    put_number(momentum, m, coming)
    return lost, lost_next, half, coming


@inline
def add_step(of, m, sums):
    """Move mode m by a step. Add the energies lost after this drift and before the next to the sums."""
    h, motion, momentum, pushes, point = of
    lost, lost_next, _, _ = step_mode(h, motion, momentum, pushes, push_of_points(point, None, m), m)
    return sums[0] + lost, sums[1] + lost_next


@inline
def move_modes(h, pushes, point, state):
    """Move all modes by a step. Returns the energy lost, J.

    pushes: State.push, or None if it is all zeros
    point:  a PushedPoint of all modes, or None
    """
    of = h, motion_of(state), state.drift_momentum, pushes, point
    lost, lost_next = fold(add_step, of, state.p.shape[0], (splat(0.0), splat(0.0)))
    return count_loss(lost, lost_next, state)


@inline
def count_loss(lost, lost_next, state):
    """Return the energy lost in a step, J: before its drift, and after it. Keep what is lost before the next one."""
    total = state.drift_loss[0] + lost
    state.drift_loss[0] = lost_next
    return total


# --- a pass over some modes, which adds up how far points move


@inline
def add_moves(point, m, half, coming, moves):
    """Return how far a point moves in this drift and in the next, in lanes, with what mode m adds."""
    if point is None:
        return moves
    phi = number_at(point.drift_phi, place_after(m, point.offset))
    return multiply_add(phi, half, moves[0]), multiply_add(phi, coming, moves[1])


@inline
def add_step_towards(of, k, sums):
    """Move mode k of some modes by a step. Add to the sums the energies lost after this drift and before the next, and
    how far each of two points moves in either."""
    h, motion, state, (pushes, a, b), first = of
    losses, moves, others = sums
    push = push_of_points(a, b, k)
    lost, lost_next, half, coming = step_mode(h, motion, state.drift_momentum, pushes, push, place_after(k, first))
    moves, others = add_moves(a, k, half, coming, moves), add_moves(b, k, half, coming, others)
    return (losses[0] + lost, losses[1] + lost_next), moves, others


@inline
def move_some_modes(h, pushing, first, count, losses, state):
    """Move `count` modes from `first` on by a step. Returns the losses with theirs added, and how far two points move
    in this drift and in the next; all in lanes.

    pushing: State.push or None, and two PushedPoints with moves, or None
    losses:  energies lost after this drift and before the next
    """
    nothing = splat(0.0), splat(0.0)
    of = h, motion_of(state), state, pushing, first
    return fold_lanes(add_step_towards, of, count, (losses, nothing, nothing))


# --- a pass over the modes of a body, at many rows of which forces act


@inline
def push_of_rows(rows, k):
    """Return the momentum that the forces at rows give mode k of their body in half a kick."""
    kick_phi, begin, stride, force, first, count = rows
    push = number_at(kick_phi, place_after(k, begin)) * force[first]
    for r in range(1, count):
        push = multiply_add(number_at(kick_phi, place_after(k, begin + r * stride)), force[first + r], push)
    return push


@inline
def add_step_of_body(of, k, losses):
    """Move mode k of a body by a step, and keep the momentum of its drift in State.push. Add the energies lost after
    this drift and before the next to the losses."""
    h, motion, state, pushes, rows, first = of
    m = place_after(k, first)
    lost, lost_next, half, _ = step_mode(h, motion, state.drift_momentum, pushes, push_of_rows(rows, k), m)
    put_number(state.push, m, half)
    return losses[0] + lost, losses[1] + lost_next


@inline
def move_pushed_rows(h, pushes, rows, modes, losses, state):
    """Move the modes of a body by a step, and keep the momenta of the drift in State.push. Returns the losses with
    theirs added.

    pushes: State.push or None
    rows:   t·Φ of all rows, where that of the first begins, how far it is from row to row, the forces on all rows (N),
            and the first row and how many there are of this body
    modes:  the first, and their number
    """
    of = h, motion_of(state), state, pushes, rows, modes[0]
    return fold_lanes(add_step_of_body, of, modes[1], losses)


# --- modes that have neither weight nor loss in the drift


class PlainStep(NamedTuple):
    """Coefficients that such a pass reads of a StepCoefficients."""

    drift: Any
    spring_kick: Any
    weight_kick: None
    loss: Any
    drag: None
    connection: Any


@inline
def plain_step(h):
    """Return the coefficients of a step without weight and without loss in the drift. The losses of such a step are
    twice the energy, and are found from the momenta (engine.kernel.modes.mode_step.energy_of_loss)."""
    return PlainStep(h.drift, h.spring_kick, None, ModalLoss(h.loss.decay_factor, None), None, h.connection)
