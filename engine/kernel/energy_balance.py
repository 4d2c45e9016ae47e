"""Follows the balance of energy, stored + dissipated - supplied, over the samples of a scene: it ought to be constant.

Sums and maxima are taken of eight samples at a time, for to do so one by one costs as much as a small scene.
"""

import math

from engine.compiler.decorators import inline
from engine.compiler.lanes import lane_sum, load_lanes, multiply_add, splat, store_lanes, where_positive
from engine.kernel.codes import BALANCE_MEMORY, LANES, Balance


@inline
def magnitude(lanes):
    """Their absolute values."""
    return where_positive(lanes, lanes, 0.0 - lanes)


@inline
def larger(lanes, others):
    """The larger of each two."""
    return where_positive(lanes - others, lanes, others)


@inline
def raise_to(balance, column, lanes):
    """Raise a maximum to the largest of eight numbers."""
    store_lanes(balance, BALANCE_MEMORY, lanes)
    for i in range(LANES):
        balance[column] = max(balance[column], balance[BALANCE_MEMORY + i])


@inline
def follow_sample(balance, stored, spent, absolute, i):
    """Take one sample."""
    now = stored[i] + spent[i]
    if balance[Balance.SAMPLES] == 0.0:
        balance[Balance.INITIAL] = stored[i]
        balance[Balance.INITIAL_BALANCE] = balance[Balance.LAST_BALANCE] = now
    jump, error = abs(now - balance[Balance.LAST_BALANCE]), abs(now - balance[Balance.INITIAL_BALANCE])
    is_number = 0.0 * now == 0.0
    balance[Balance.MAX_ERROR_PER_STEP] = max(balance[Balance.MAX_ERROR_PER_STEP], jump) if is_number else math.inf
    balance[Balance.MAX_ERROR] = max(balance[Balance.MAX_ERROR], error) if is_number else math.inf
    balance[Balance.LARGEST] = max(balance[Balance.LARGEST], absolute[i])
    balance[Balance.LAST_BALANCE] = now
    balance[Balance.SAMPLES] += 1.0


@inline
def follow_energies(balance, stored, spent, absolute, frames):
    """Take the samples of a block. stored, spent, absolute: rows of its ledger"""
    singles = min(frames, 1 + (frames - 1) % LANES)  # at least one, so that the rest has one before it
    for i in range(singles):
        follow_sample(balance, stored, spent, absolute, i)
    error, jump, largest, sound = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    initial = splat(balance[Balance.INITIAL_BALANCE])
    for i in range(singles, frames, LANES):
        now = load_lanes(stored, i) + load_lanes(spent, i)
        before = load_lanes(stored, i - 1) + load_lanes(spent, i - 1)
        error, jump = larger(magnitude(now - initial), error), larger(magnitude(now - before), jump)
        largest, sound = larger(load_lanes(absolute, i), largest), multiply_add(now, 0.0, sound)
    if frames > singles:
        raise_to(balance, Balance.MAX_ERROR, error)
        raise_to(balance, Balance.MAX_ERROR_PER_STEP, jump)
        raise_to(balance, Balance.LARGEST, largest)
        if lane_sum(sound) != 0.0:  # zero times what is no number, or infinite
            balance[Balance.MAX_ERROR] = balance[Balance.MAX_ERROR_PER_STEP] = math.inf
        balance[Balance.SAMPLES] += frames - singles
    if frames > 0:
        balance[Balance.FINAL] = stored[frames - 1]
        balance[Balance.LAST_BALANCE] = stored[frames - 1] + spent[frames - 1]
