"""The contact law and its solve, against mpmath."""

import mpmath
import numpy as np
import pytest

from engine.compiler.decorators import kernel
from engine.kernel import contact_law, laws
from engine.kernel.codes import SolveStatus
from engine.kernel.scalar_contact_solver import solve_scalar_contact

EXPONENTS = [1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0, 12.0]


@kernel
def solve_all(law, s, g, compliance, out, count, how):
    for i in range(s.shape[0]):
        out[i, 0], out[i, 1], out[i, 2], _, count[i], how[i] = solve_scalar_contact(
            law, None, 0, s[i], g[i], compliance[i], 1e-15
        )


@kernel
def gradient(law, s, b):
    return contact_law.discrete_gradient(law, 0, s, b, b - s)


def hostile(alpha: float, size: int) -> tuple:
    """Compressions and steps over 1e-9..1 m of either sign, B·kc over 1e-12..1e15; solved."""
    rng = np.random.default_rng(1)
    law = laws.select_law(np.array([1.0]), np.array([alpha]))
    s, g = (10 ** rng.uniform(-9, 0, size) * rng.choice([-1, 1], size) for _ in range(2))
    compliance = 10 ** rng.uniform(-12, 15, size)
    out, count, how = np.zeros((size, 3)), np.zeros(size, np.int64), np.zeros(size, np.int64)
    solve_all(law, s, g, compliance, out, count, how)
    return s, g, compliance, out, count, how


def exact_force(alpha: float, s: float, g: float, beta: float) -> mpmath.mpf:
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


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_gradient_of_the_potential(alpha):
    """(V(b) - V(s))/(b - s) to 2e-15, however close or far s and b."""
    law = laws.select_law(np.array([alpha + 1.0]), np.array([alpha]))
    rng = np.random.default_rng(2)
    with mpmath.workdps(60):
        for _ in range(200):
            b = 10 ** rng.uniform(-9, 0)
            s = b * (1 + 10 ** rng.uniform(-15, 1) * rng.choice([-1, 1]))
            if b == s:
                continue
            exact = (mpmath.mpf(b) ** (alpha + 1) - max(mpmath.mpf(s), 0) ** (alpha + 1)) / (
                mpmath.mpf(b) - mpmath.mpf(s)
            )
            assert gradient(law, s, b)[0] == pytest.approx(float(exact), rel=2e-15)


@pytest.mark.parametrize("alpha", EXPONENTS)
def test_hostile_states(alpha):
    """Every one converges; at most 3 evaluations of the law for α ≤ 3, and 4 up to 12."""
    s, g, compliance, out, count, how = hostile(alpha, 100_000)
    assert np.all(how != SolveStatus.FAILED)
    assert np.all(np.isfinite(out))
    assert count.max() <= (3 if alpha <= 3 else 4)
    with mpmath.workdps(50):
        for i in np.random.default_rng(3).choice(s.size, 60, replace=False):
            exact = exact_force(alpha, s[i], g[i], compliance[i])
            assert abs(out[i, 2] - exact) <= mpmath.mpf(1e-13) * exact


def test_linear_contact_agrees_with_a_bracketing_root_finder():
    """α = 1 in its four branches: free, entering, within, leaving."""
    from scipy.optimize import brentq

    s, g, compliance, out, _, how = hostile(1.0, 2000)
    assert set(how.tolist()) == {
        SolveStatus.FREE,
        SolveStatus.SEPARATION,
        SolveStatus.CLOSED_FORM,
    }
    for i in range(300):

        def miss(b, i=i):
            step = b - s[i]
            mean = max(s[i], 0) if step == 0 else (max(b, 0) ** 2 - max(s[i], 0) ** 2) / 2 / step
            return step - g[i] + compliance[i] * mean

        low = min(s[i], s[i] + g[i]) - (compliance[i] ** 0.5 + 1) * max(s[i], 0) - 1e-12
        b = brentq(miss, low, max(s[i], s[i] + g[i]) + 1e-12, xtol=1e-16, rtol=1e-14, maxiter=500)
        assert out[i, 1] == pytest.approx(b, rel=1e-6, abs=1e-12)
