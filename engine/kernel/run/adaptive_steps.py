"""Steps chosen by error: each sample has as many as it takes (docs/design.md, "Steps chosen by error").

A sample in stages is computed with some number of steps, and from the same state with twice as many, which count; where
the two differ too much, with twice as many again. The next sample begins where this one ended. So what twice the steps
change is known of each sample, and the energy balance is as exact as with any number of steps.
"""

import math

from engine.compiler.decorators import FALSE, TRUE, inline, noinline
from engine.compiler.lanes import lane_sum, number_at, splat, where_positive, zero_like
from engine.kernel.modes.mode_step import forget_drift, motion_of
from engine.kernel.modes.ordered_sums import copy_items, copy_or_back, fold_lanes
from engine.kernel.modes.potential import add_elastic

EASY = 2.0  # times the error that a sample may have, for the next to have fewer steps


@inline
def steps_of_sample(refinement, state):
    """Return the number of steps of the present sample."""
    return refinement.steps << state.refinement.level[0]


@inline
def first_kind_of_sample(refinement, state):
    """Return the first kind of stages of the present sample."""
    return refinement.kinds * state.refinement.level[0]


@inline
def may_try_again(adaptive):
    """True if a sample may be tried with other numbers of steps."""
    return adaptive.finest > 0


@inline
def begin_tries(adaptive, state):
    """Keep the state at the start of a sample, if its number of steps is to be found. The first try has half of the
    steps that are expected to do."""
    if may_try_again(adaptive):
        refinement = state.refinement
        refinement.tries[0], refinement.level[0] = 0, max(0, refinement.next_level[0] - 1)
        copy_motion(state, FALSE)


@inline
def accept_or_restore(adaptive, model, state):
    """Accept a sample that was computed with enough steps, or restore its start for a try with more. Returns True if it
    is accepted."""
    if may_try_again(adaptive):
        return compare_tries(adaptive, model, state)
    return TRUE


@noinline
def copy_motion(state, is_back):
    """Copy all that a sample changes to the saved motion, or back."""
    saved = state.refinement.saved
    copy_or_back(state.q, saved.q, is_back)
    copy_or_back(state.p, saved.p, is_back)
    copy_or_back(state.kick_compensation, saved.kick_compensation, is_back)
    copy_or_back(state.compression, saved.compression, is_back)
    copy_or_back(state.compression_compensation, saved.compression_compensation, is_back)
    copy_or_back(state.contact_force, saved.contact_force, is_back)
    for k in range(state.compression.shape[0]):
        copy_or_back(state.law_numbers[k], saved.law_numbers[k], is_back)
    copy_or_back(state.energy_totals, saved.energy_totals, is_back)
    copy_or_back(state.energy_debt, saved.energy_debt, is_back)
    copy_or_back(state.refinement.samples_of_strong_loss, saved.samples_of_strong_loss, is_back)
    copy_or_back(state.connection.extension, saved.extension, is_back)
    copy_or_back(state.connection.extension_compensation, saved.extension_compensation, is_back)


@inline
def add_change(of, m, sums):
    """Add to the sums, of mode m: p² + ω²q² if it has a spring, or else p² to the next one; how much p² + ω²q² has
    changed since the last try; and ω²."""
    omega_squared, motion, coarse_q, coarse_p = of
    q, p = number_at(motion.q, m), number_at(motion.p, m)
    dq, dp = q - number_at(coarse_q, m), p - number_at(coarse_p, m)
    change = sums[2] + add_elastic(omega_squared, m, dq, dp * dp)
    stiffness, zero = number_at(omega_squared, m), zero_like(p)
    vibration = where_positive(stiffness, add_elastic(omega_squared, m, q, p * p), zero)
    return sums[0] + vibration, sums[1] + where_positive(stiffness, zero, p * p), change, sums[3] + stiffness


@inline
def measure_tries(omega_squared, state):
    """Return √Σ(p² + ω²q²) of the modes with springs, or of free masses if there is none, and that of the change since
    the last try, √J. The motion of a heavy hammer says nothing of what its string does."""
    of = omega_squared, motion_of(state), state.refinement.coarse_q, state.refinement.coarse_p
    zeros = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    vibration, coasting, change, stiffness = fold_lanes(add_change, of, state.p.shape[0], zeros)
    size = lane_sum(vibration) if lane_sum(stiffness) > 0.0 else lane_sum(coasting)
    return math.sqrt(size), math.sqrt(lane_sum(change))


@noinline
def compare_tries(adaptive, model, state):
    """Compare the last two tries of a sample. Returns True if they agree, or if no more steps are allowed. Otherwise
    its start is restored."""
    refinement = state.refinement
    level, tries = refinement.level[0], refinement.tries[0]
    if tries > 0:
        size, change = measure_tries(model.omega_squared, state)
        refinement.largest_motion[0] = max(refinement.largest_motion[0], size)
        largest = refinement.largest_motion[0]
        error = change / largest if largest > 0.0 else 0.0
        if error <= adaptive.limit or level == adaptive.finest:
            refinement.largest_error[0] = max(refinement.largest_error[0], error)
            refinement.capped_samples[0] += int(error > adaptive.limit)
            refinement.next_level[0] = max(1, level - 1) if EASY * error < adaptive.limit else level
            return TRUE
    copy_items(state.q, refinement.coarse_q)
    copy_items(state.p, refinement.coarse_p)
    copy_motion(state, TRUE)
    forget_drift(state)
    refinement.tries[0], refinement.level[0] = tries + 1, level + 1
    return FALSE
