"""The contact law and its solve, against mpmath."""

import numpy as np
import pytest
from conftest import mostly_hard
from later import import_later
from worst_case_solves import EXPONENTS, exact_force, lossy_law, worst_case_solves

from engine.compiler.decorators import kernel
from engine.kernel.contact import power_law
from engine.kernel.data.enums import SolveStatus

mpmath = import_later("mpmath")


@kernel
def gradient(law, s, b):
    start = power_law.StepStart(s, power_law.power(law, 0, s) if s > 0.0 else 0.0)
    return power_law.discrete_gradient(law, 0, start, b, b - s)


@pytest.mark.hard_for("2.0", "1.0", "3.0", "1.3", "1.5", "2.5")
@pytest.mark.parametrize("alpha", EXPONENTS)
def test_gradient_of_the_potential(alpha):
    """(V(b) - V(s))/(b - s) to 2e-15, however close or far s and b."""
    law = lossy_law(1.0, alpha).elastic
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


@pytest.mark.hard
@pytest.mark.parametrize("alpha", mostly_hard(EXPONENTS, 1.3, 2.5))
def test_worst_case_states(alpha):
    """Every one converges; at most 3 evaluations of the law for α ≤ 3, and 4 up to 12."""
    s, g, compliance, out, count, how = worst_case_solves(alpha, 100_000)
    assert np.all(how != SolveStatus.FAILED)
    assert np.all(np.isfinite(out))
    assert count.max() <= (3 if alpha <= 3 else 4)
    with mpmath.workdps(50):
        for i in np.random.default_rng(3).choice(s.size, 60, replace=False):
            exact = exact_force(alpha, s[i], g[i], compliance[i])
            assert abs(out[i, 2] - exact) <= mpmath.mpf(1e-13) * exact


@pytest.mark.hard
def test_linear_contact_agrees_with_a_bracketing_root_finder():
    """α = 1 in its four branches: free, entering, within, leaving."""
    from scipy.optimize import brentq

    s, g, compliance, out, _, how = worst_case_solves(1.0, 2000)
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
