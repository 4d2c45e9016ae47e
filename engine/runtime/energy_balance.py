"""Statistics of the energy balance over the samples of a scene: stored + dissipated - supplied ought to be constant.

Sums and maxima are taken of eight samples at a time: one by one, they would cost as much as a small scene.
"""

import math

from engine.compiler.decorators import inline
from engine.compiler.lanes import greater, lane_sum, load_lanes, magnitude, multiply_add, splat, store_lanes
from engine.kernel.data.enums import BALANCE_MEMORY, LANES, Balance


@inline
def raise_to(balance, column, lanes):
    """Raise a maximum to the largest of eight numbers."""
    store_lanes(balance, BALANCE_MEMORY, lanes)
    for i in range(LANES):
        balance[column] = max(balance[column], balance[BALANCE_MEMORY + i])


@inline
def follow_sample(balance, now, absolute):
    """Update the statistics of the balance with one sample."""
    if balance[Balance.SAMPLES] == 0.0:
        balance[Balance.INITIAL] = balance[Balance.LAST] = now
    jump, error = abs(now - balance[Balance.LAST]), abs(now - balance[Balance.INITIAL])
    is_number = 0.0 * now == 0.0
    balance[Balance.MAX_ERROR_PER_STEP] = max(balance[Balance.MAX_ERROR_PER_STEP], jump) if is_number else math.inf
    balance[Balance.MAX_ERROR] = max(balance[Balance.MAX_ERROR], error) if is_number else math.inf
    balance[Balance.LARGEST] = max(balance[Balance.LARGEST], absolute)
    balance[Balance.LAST] = now
    balance[Balance.SAMPLES] += 1.0


@inline
def follow_energies(balance, balances, absolutes, frames):
    """Update the statistics of the balance with the samples of a block. balances, absolutes: rows of its ledger"""
    singles = min(frames, 1 + (frames - 1) % LANES)  # at least one, so that the rest has one before it
    for i in range(singles):
        follow_sample(balance, balances[i], absolutes[i])
    if frames > singles:
        initial = splat(balance[Balance.INITIAL])
        error, jump, largest, sound = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for i in range(singles, frames, LANES):
            now = load_lanes(balances, i)
            error = greater(magnitude(now - initial), error)
            jump = greater(magnitude(now - load_lanes(balances, i - 1)), jump)
            largest = greater(load_lanes(absolutes, i), largest)
            sound = multiply_add(now, 0.0, sound)
        raise_to(balance, Balance.MAX_ERROR, error)
        raise_to(balance, Balance.MAX_ERROR_PER_STEP, jump)
        raise_to(balance, Balance.LARGEST, largest)
        if lane_sum(sound) != 0.0:  # zero times what is no number, or infinite
            balance[Balance.MAX_ERROR] = balance[Balance.MAX_ERROR_PER_STEP] = math.inf
        balance[Balance.SAMPLES] += frames - singles
        balance[Balance.LAST] = balances[frames - 1]
