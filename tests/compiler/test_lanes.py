"""Eight numbers at a time are rounded as each by itself."""

import math

import numba
import numpy as np
from later import import_later

from engine.compiler.lanes import lane_sum, load_lanes, multiply_add, splat, store_lanes, where_positive

mpmath = import_later("mpmath")


@numba.njit(error_model="numpy")
def operate(a, b, out):
    x, y = load_lanes(a, 0), load_lanes(b, 0)
    store_lanes(out, 0, x + y)
    store_lanes(out, 8, x - 2.0 * y)
    store_lanes(out, 16, x / y)
    store_lanes(out, 24, math.sqrt(x))
    store_lanes(out, 32, multiply_add(x, y, splat(1.0)))
    store_lanes(out, 40, where_positive(x - 0.5, y, 7.0))
    return lane_sum(x)


def test_lanes_are_rounded_as_numbers_are():
    rng = np.random.default_rng(1)
    a, b, out = rng.random(8), rng.random(8), np.zeros(48)
    total = operate(a, b, out)
    assert total == ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    np.testing.assert_array_equal(out[:8], a + b)
    np.testing.assert_array_equal(out[8:16], a - 2.0 * b)
    np.testing.assert_array_equal(out[16:24], a / b)
    np.testing.assert_array_equal(out[24:32], np.sqrt(a))
    with mpmath.workdps(60):
        fused = [float(mpmath.mpf(x) * mpmath.mpf(y) + 1) for x, y in zip(a, b, strict=True)]
    np.testing.assert_array_equal(out[32:40], fused)
    np.testing.assert_array_equal(out[40:], np.where(a > 0.5, b, 7.0))
