"""Quadratised contact potentials: ψ = √(2V) is a state of its own, and the forces of a step are a linear solve.

Over two steps of h the compression changes by d (C: what unit forces take away from it; d*: the change without force):

    f = g·(ψ⁺ + ψ⁻)/2 + damping·d          ψ⁺ - ψ⁻ = g·d/2          d = s⁺ - s⁻ = d* - C·f

so that f·d = ψ⁺² - ψ⁻² without loss, whatever g is: each rule below is a choice of g, and conserves the same
pseudo-energy.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

PLAIN = 0  # g = dψ/ds of the potential at the middle step; none without compression
RELEASED = 1  # the same, with the sign of ψ; without compression, g hands what is left in ψ back to the motion
NON_ADHESIVE = 2  # g is bounded such that ψ stays positive, and what is left is handed back
REGULATED = 3  # g of PLAIN, less gain·(ψ - √(2V))/(s - s⁻), which leads ψ to the potential
REGULATED_NON_ADHESIVE = 4  # the same, within the bounds of NON_ADHESIVE
SINGLE = 6  # one ψ for the potential of all contacts together; regulated, if there is a gain
STEEPEST = 1e8  # g²·C above which nothing is corrected, as the compression hardly changes: rounding would be seen
LARGEST_CHANGE = 0.25  # of g by the regulation, share of it, with REGULATED_NON_ADHESIVE


class Contacts(NamedTuple):
    """Contacts of a problem, and what unit forces do to them in a step."""

    barrier: np.ndarray  # [contacts], m
    stiffness: np.ndarray  # [contacts], N/m^α
    exponent: np.ndarray  # [contacts]
    loss: np.ndarray  # [contacts], s/m
    coupling: np.ndarray  # C [contacts, contacts], m/N


@numba.njit(cache=True, error_model="numpy")
def root_of_potential(contacts, k, s):
    """√(2V) of a contact at a compression in m, √J."""
    if s <= 0.0:
        return 0.0
    alpha = contacts.exponent[k]
    return math.sqrt(2.0 * contacts.stiffness[k] / (alpha + 1.0) * s ** (alpha + 1.0))


@numba.njit(cache=True, error_model="numpy")
def slope_of_root(contacts, k, s):
    """d√(2V)/ds of a contact at a compression in m, √J/m."""
    if s <= 0.0:
        return 0.0
    alpha = contacts.exponent[k]
    return math.sqrt(0.5 * contacts.stiffness[k] * (alpha + 1.0) * s ** (alpha - 1.0))


@numba.njit(cache=True, error_model="numpy")
def largest_slope(psi, moved, coupling):
    """Largest g for which ψ stays positive: ψ⁺ ≥ 0 in the step of one contact that would move by `moved`, m."""
    root = math.sqrt(moved * moved + 4.0 * coupling * psi * psi)
    if moved > 0.0:
        return (moved + root) / (coupling * max(psi, 0.0))
    return 4.0 * max(psi, 0.0) / (root - moved) if root > moved else 0.0


@numba.njit(cache=True, error_model="numpy")
def choose_slope(rule, gain, contacts, k, psi, s, before, moved):
    """g of one contact, √J/m.

    s, before: compression now and a step ago, m
    moved: change of compression over two steps that it would have without its force, m
    """
    slope = slope_of_root(contacts, k, s)
    if rule == RELEASED:
        if s < 0.0:
            return -2.0 * psi / moved if moved != 0.0 else 0.0
        return slope if psi >= 0.0 else -slope
    if rule in (REGULATED, REGULATED_NON_ADHESIVE):
        error = psi - root_of_potential(contacts, k, 0.5 * (s + before))
        if STEEPEST * (s - before) ** 2 > (gain * error) ** 2 * contacts.coupling[k, k]:
            change = gain * error / (s - before)
            if rule == REGULATED_NON_ADHESIVE:  # where the contact turns, the change would be without bound
                change = min(max(change, -LARGEST_CHANGE * slope), LARGEST_CHANGE * slope)
            slope -= change
    if rule in (NON_ADHESIVE, REGULATED_NON_ADHESIVE):
        bound = largest_slope(psi, moved, contacts.coupling[k, k])
        if s <= 0.0:  # ψ goes to 0 at once, if the contact opens
            return bound if moved < 0.0 else 0.0
        return max(min(slope, bound), 0.0)
    return slope


@numba.njit(cache=True, error_model="numpy")
def eliminate(matrix, right, count):
    """Solve a linear system of `count` unknowns in place: `right` becomes the solution. No pivots are needed."""
    for i in range(count):
        for j in range(i + 1, count):
            share = matrix[j, i] / matrix[i, i]
            if share != 0.0:
                for l in range(i + 1, count):  # noqa: E741
                    matrix[j, l] -= share * matrix[i, l]
                right[j] -= share * right[i]
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@numba.njit(cache=True, error_model="numpy")
def solve_each(contacts, g, damping, psi, free, forces, active, matrix, right):
    """Forces of contacts with a ψ each, N; none where damping is negative.

    free: change of compression over two steps without forces, m; damping: N/m
    """
    count = 0
    for k in range(g.size):
        forces[k] = 0.0
        if damping[k] >= 0.0 and (g[k] != 0.0 or damping[k] != 0.0):
            active[count] = k
            count += 1
    for i in range(count):
        k = active[i]
        share = 0.25 * g[k] * g[k] + damping[k]
        right[i] = g[k] * psi[k] + share * free[k]
        for j in range(count):
            matrix[i, j] = share * contacts.coupling[k, active[j]]
        matrix[i, i] += 1.0
    eliminate(matrix, right, count)
    for i in range(count):
        forces[active[i]] = right[i]
    return count


@numba.njit(cache=True, error_model="numpy")
def solve_together(contacts, g, damping, psi, free, forces, active, matrix, right):
    """Forces of contacts with one ψ for all, N."""
    count = 0
    stretched = psi[0]
    for k in range(g.size):
        forces[k] = 0.0
        if g[k] != 0.0 or damping[k] != 0.0:
            active[count] = k
            count += 1
            stretched += 0.25 * g[k] * free[k]
    for i in range(count):
        k = active[i]
        right[i] = g[k] * stretched + damping[k] * free[k]
        for j in range(count):
            reaction = 0.0
            for m in range(count):
                reaction += g[active[m]] * contacts.coupling[active[m], active[j]]
            matrix[i, j] = 0.25 * g[k] * reaction + damping[k] * contacts.coupling[k, active[j]]
        matrix[i, i] += 1.0
    eliminate(matrix, right, count)
    for i in range(count):
        forces[active[i]] = right[i]
    return count


@numba.njit(cache=True, error_model="numpy")
def choose_slopes(rule, gain, contacts, s, before, unforced, psi, forces, g):
    """g of all contacts; each is met as if the others had the forces given."""
    for k in range(g.size):
        g[k] = 0.0
        if s[k] > 0.0 or psi[k] != 0.0:
            moved = unforced[k] - before[k]
            for j in range(g.size):
                if j != k and forces[j] != 0.0:
                    moved -= contacts.coupling[k, j] * forces[j]
            g[k] = choose_slope(rule, gain, contacts, k, psi[k], s[k], before[k], moved)


@numba.njit(cache=True, error_model="numpy")
def weaken_adhesive(contacts, g, psi, free, forces):
    """Halve the g of the contacts whose ψ would become negative, as others push them apart; whether there are any."""
    found = False
    for k in range(g.size):
        if g[k] > 0.0:
            moved = free[k]
            for j in range(g.size):
                moved -= contacts.coupling[k, j] * forces[j]
            if psi[k] + 0.5 * g[k] * moved < -1e-9 * psi[k]:
                g[k] *= 0.5
                found = True
    return found


@numba.njit(cache=True, error_model="numpy")
def release_fast(strictly, contacts, h, damping, free, forces):
    """Mark contacts, by a negative damping, that open and whose loss takes away all force; whether there are any.

    strictly: also where the force of the scheme is negative though the law would have some left
    """
    found = False
    for k in range(damping.size):
        if damping[k] > 0.0:
            moved = free[k]
            for j in range(damping.size):
                moved -= contacts.coupling[k, j] * forces[j]
            if contacts.loss[k] * moved < -2.0 * h or (strictly and forces[k] < 0.0 and moved < 0.0):
                damping[k] = -1.0
                found = True
    return found


@numba.njit(cache=True, error_model="numpy")
def choose_slopes_together(gain, contacts, s, before, psi, g):
    """g of all contacts for one ψ: their forces over √(2V) of all; with a gain, ψ is led to √(2V)."""
    total, middle, speed = 0.0, 0.0, 0.0
    for k in range(g.size):
        root = root_of_potential(contacts, k, s[k])
        total += root * root
        g[k] = root * slope_of_root(contacts, k, s[k]) if root > 0.0 else 0.0
        middle += root_of_potential(contacts, k, 0.5 * (s[k] + before[k])) ** 2
        speed += abs(s[k] - before[k])
    for k in range(g.size):
        if total > 0.0:
            g[k] /= math.sqrt(total)
        if gain > 0.0 and speed > 0.0:
            g[k] -= gain * (psi[0] - math.sqrt(middle)) * np.sign(s[k] - before[k]) / speed


@numba.njit(cache=True, error_model="numpy")
def solve_step(rule, gain, contacts, h, s, before, unforced, work):
    """Find the forces of a step, and what they leave of the compressions and of ψ; returns how many act.

    s, before: compressions now and a step ago, m; unforced: a step ahead without forces, which the forces change
    """
    number = s.size
    psi, g, damping, free, forces, active, matrix, right = work
    forces[:] = 0.0
    touching = rule == SINGLE and psi[0] != 0.0
    for k in range(number):
        free[k] = unforced[k] - before[k]
        damping[k] = 0.0
        touching = touching or s[k] > 0.0 or psi[k] != 0.0
    if not touching:
        return 0
    for k in range(number):
        if contacts.loss[k] != 0.0 and s[k] > 0.0:
            damping[k] = 0.5 / h * contacts.loss[k] * contacts.stiffness[k] * s[k] ** contacts.exponent[k]
    if rule == SINGLE:
        choose_slopes_together(gain, contacts, s, before, psi, g)
        count = solve_together(contacts, g, damping, psi, free, forces, active, matrix, right)
    else:
        strictly = rule in (NON_ADHESIVE, REGULATED_NON_ADHESIVE)
        passes = 3 if number > 1 and (strictly or rule == RELEASED) else 1
        count = 0
        for _ in range(passes):  # g depends on the forces of the others, which depend on their g
            choose_slopes(rule, gain, contacts, s, before, unforced, psi, forces, g)
            count = solve_each(contacts, g, damping, psi, free, forces, active, matrix, right)
            if count < 2:
                break
        if strictly:
            for _ in range(60):
                if not weaken_adhesive(contacts, g, psi, free, forces):
                    break
                count = solve_each(contacts, g, damping, psi, free, forces, active, matrix, right)
        if release_fast(strictly, contacts, h, damping, free, forces):
            count = solve_each(contacts, g, damping, psi, free, forces, active, matrix, right)
    for k in range(number):
        for i in range(count):
            unforced[k] -= contacts.coupling[k, active[i]] * forces[active[i]]
        change = 0.5 * g[k] * (unforced[k] - before[k])
        if rule == SINGLE:
            psi[0] += change
        elif damping[k] < 0.0:  # released: what it stored is lost, and never grows
            psi[k] = min(max(psi[k] + change, 0.0), abs(psi[k]))
        else:
            psi[k] += change
    return count


@numba.njit(cache=True, error_model="numpy")
def make_work(number):
    """What the solve of a step needs: ψ (√J), which is a state, and scratch."""
    return (
        np.zeros(number),
        np.zeros(number),
        np.zeros(number),
        np.zeros(number),
        np.zeros(number),
        np.zeros(number, np.int64),
        np.zeros((number, number)),
        np.zeros(number),
    )


@numba.njit(cache=True, error_model="numpy")
def begin_psi(rule, contacts, k, s, psi):
    """Set ψ of a contact, or add to the one of all, from a compression in m."""
    root = root_of_potential(contacts, k, s)
    if rule == SINGLE:
        psi[0] = math.sqrt(psi[0] * psi[0] + root * root)
    else:
        psi[k] = root
