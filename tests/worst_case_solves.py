"""Solves of one contact over the whole range of its numbers, and their exact forces."""

import numpy as np
from later import import_later

from engine.compiler.decorators import kernel
from engine.kernel.contact.law import Laws, solve_alone, step_start
from engine.kernel.contact.scalar_contact_solver import ContactEquation
from engine.kernel.data.enums import LAW_NUMBERS
from engine.kernel.data.laws import Law

mpmath = import_later("mpmath")

EXPONENTS = [1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0, 12.0]


@kernel
def solve_all(law, s, g, compliance, out, count, how):
    for i in range(s.shape[0]):
        start = step_start(law, 0, s[i])
        equation = ContactEquation(law, 0, start, g[i], compliance[i], 1e-15)
        out[i, 0], out[i, 1], out[i, 2], _, count[i], how[i] = solve_alone(equation, 0.0)


def lossy_law(coefficient, exponent, rate=0.0) -> Laws:
    """The law of contacts: kc/(α+1), α, and the rate of their loss, 1/m; numbers, or one for each contact"""
    numbers = np.broadcast_arrays(*np.atleast_1d(coefficient, exponent, rate))
    of_contacts = [np.array(number, float) for number in numbers]
    return Laws(Law(*of_contacts[:2]), of_contacts[2], np.zeros((of_contacts[0].size, LAW_NUMBERS)))


def worst_case_solves(alpha: float, size: int) -> tuple:
    """Compressions and steps over 1e-9..1 m of either sign, B·kc over 1e-12..1e15; solved."""
    rng = np.random.default_rng(1)
    law = lossy_law(1.0 / (alpha + 1), alpha)
    s, g = (10 ** rng.uniform(-9, 0, size) * rng.choice([-1, 1], size) for _ in range(2))
    compliance = 10 ** rng.uniform(-12, 15, size)
    out, count, how = np.zeros((size, 3)), np.zeros(size, np.int64), np.zeros(size, np.int64)
    solve_all(law, s, g, compliance, out, count, how)
    return s, g, compliance, out, count, how


def exact_force(alpha: float, s: float, g: float, beta: float) -> "mpmath.mpf":
    """Mean force of a step at 50 digits, by bisection and Newton on the convex residual."""
    s, g, beta, alpha = mpmath.mpf(s), mpmath.mpf(g), mpmath.mpf(beta), mpmath.mpf(alpha)
    if s <= 0 and s + g <= 0:
        return mpmath.mpf(0)
    n = alpha + 1

    def mean(b):
        start, end = max(s, 0) ** n, max(b, 0) ** n
        return max(s, 0) ** alpha if b == s else (end - start) / (n * (b - s))

    high = max(s, s + g)
    low = min(s, s + g) - 1 - mpmath.sqrt(beta * max(s, 0) ** n)
    b = high
    for _ in range(400):
        miss = b - (s + g) + beta * mean(b)
        low, high = (low, b) if miss > 0 else (b, high)
        step = mpmath.mpf(10) ** -35 * (abs(b) + mpmath.mpf(10) ** -30)
        slope = (b + step - (s + g) + beta * mean(b + step) - miss) / step
        following = b - miss / slope
        if not low < following < high:
            following = (low + high) / 2
        if abs(following - b) <= mpmath.mpf(10) ** -40 * abs(following):
            break
        b = following
    return mean(b)
