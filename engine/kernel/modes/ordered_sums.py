"""Sums of products whose bits are the same on any processor and in any kernel. Eight numbers are taken at a time, and
then summed over the lanes; fewer than eight are taken one after the other."""

import numpy as np

from engine.compiler.decorators import INT64_0, inline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    load_first_lanes,
    load_lanes,
    magnitude,
    multiply_add,
    number_at,
    place_after,
    put_number,
    splat,
)
from engine.kernel.data.enums import LANES


@inline
def lanes_of(count):
    """Return the largest multiple of LANES that is no more than `count`: so many numbers are taken eight by eight."""
    return count // LANES * LANES


@inline
def fold(add, of, count, sums):
    """Call add(of, m, sums) for items 0 to `count`, such as modes, and return the sums over all. Eight items are taken
    at a time, and then summed over the lanes; a single item that is left comes last.

    add:  a compiled function that returns the sums with those of item m added; m is an index, EightFrom or FewFrom
    of:   what `add` reads and writes
    sums: a tuple of Lanes to begin with
    """
    whole = lanes_of(count)
    for m in range(INT64_0, whole, LANES):
        sums = add(of, EightFrom(m), sums)
    remaining = count - whole
    if remaining > 1:
        sums = add(of, FewFrom(whole, remaining), sums)
    totals = lane_sum(sums)
    if remaining == 1:
        totals = add(of, whole, totals)
    return totals


@inline
def fold_lanes(add, of, count, sums):
    """Do what `fold` does, and return the sums in lanes, to which more can be added."""
    whole = lanes_of(count)
    for m in range(INT64_0, whole, LANES):
        sums = add(of, EightFrom(m), sums)
    if whole < count:
        sums = add(of, FewFrom(whole, count - whole), sums)
    return sums


@inline
def copy_items(source, target):
    """Copy an array to another of the same size."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@inline
def copy_or_back(source, target, is_back):
    """Copy an array to another of the same size, or the other one to this."""
    if is_back:
        copy_items(target, source)
    else:
        copy_items(source, target)


@inline
def sum_products(a, i, b, j, count):
    """Return Σ a·b over `count` numbers of a from number i on, and of b from number j on."""
    total = 0.0
    if count < LANES:
        for k in range(count):
            total = multiply_add(number_at(a, i + k), number_at(b, j + k), total)
        return total
    even, odd, k, whole = splat(0.0), splat(0.0), INT64_0, lanes_of(count)
    while k + LANES < whole:  # two sums: the next addition need not wait for the last
        even = multiply_add(load_lanes(a, i + k), load_lanes(b, j + k), even)
        odd = multiply_add(load_lanes(a, i + k + LANES), load_lanes(b, j + k + LANES), odd)
        k += 2 * LANES
    if k < whole:
        even = multiply_add(load_lanes(a, i + k), load_lanes(b, j + k), even)
    if whole < count:
        last = load_first_lanes(a, i + whole, count - whole)
        odd = multiply_add(last, load_first_lanes(b, j + whole, count - whole), odd)
    return lane_sum(even + odd)


@inline
def sum_sizes_of_products(a, i, b, j, count):
    """Return Σ |a|·b over `count` numbers of a from number i on, and of b from number j on."""
    total = 0.0
    if count < LANES:
        for k in range(count):
            total = multiply_add(magnitude(number_at(a, i + k)), number_at(b, j + k), total)
        return total
    lanes, whole = splat(0.0), lanes_of(count)
    for k in range(INT64_0, whole, LANES):
        lanes = multiply_add(magnitude(load_lanes(a, i + k)), load_lanes(b, j + k), lanes)
    if whole < count:
        last = magnitude(load_first_lanes(a, i + whole, count - whole))
        lanes = multiply_add(last, load_first_lanes(b, j + whole, count - whole), lanes)
    return lane_sum(lanes)


@inline
def add_products(matrix, x, total):
    """Add the product of a matrix, column by column, and a vector to a total; each column at once."""
    fold_lanes(add_product, (matrix, x, total), total.shape[0], (splat(0.0),))


@inline
def add_product(of, i, sums):
    """Add row i of the product, or as many as i stands for, to the total."""
    matrix, x, total = of
    value = number_at(total, i)
    for j in range(x.shape[0]):
        value = multiply_add(number_at(matrix, place_after(i, np.int64(j) * x.shape[0])), x[j], value)
    put_number(total, i, value)
    return sums


@inline
def accumulate(totals, column, amount):
    """Add an energy to a total of an island. Small amounts on a large sum: rounding is carried (Kahan)."""
    amount += totals[column + 1]
    before = totals[column]
    totals[column] = before + amount
    totals[column + 1] = amount - (totals[column] - before)
