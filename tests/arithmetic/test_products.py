"""Products of matrices that have the same bits in any order of the sums."""

from fractions import Fraction

import numpy as np
import pytest

from engine.arithmetic.products import cut_rows, multiply_slices, product

RNG = np.random.default_rng(65)
SHAPES = [(1, 1, 1), (2, 3, 4), (5, 1, 6), (30, 30, 30), (33, 50, 20), (7, 500, 3), (90, 2, 90), (1, 400, 80)]


def spread(*shape: int, decades: float = 3.0) -> np.ndarray:
    """Random numbers of many sizes."""
    return RNG.standard_normal(shape) * 10.0 ** RNG.uniform(-decades, decades, shape)


def exact(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product, rounded once."""
    rows, columns = [list(map(Fraction, row)) for row in a], [list(map(Fraction, column)) for column in b.T]
    return np.array([[float(sum(x * y for x, y in zip(r, c, strict=True))) for c in columns] for r in rows])


def size_of(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of the products that are summed, at most."""
    return np.max(np.abs(a), axis=1)[:, None] * np.max(np.abs(b), axis=0) * a.shape[1]


@pytest.mark.hard_for("shape4", "shape7")
@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_the_product(shape):
    n, k, m = shape
    a, b = spread(n, k), spread(k, m)
    assert np.all(np.abs(product(a, b) - exact(a, b)) <= 2.0**-52 * size_of(a, b))


@pytest.mark.hard_for("shape7")
@pytest.mark.parametrize("shape", SHAPES)
def test_slices_give_the_product_to_the_last_bits(shape):
    n, k, m = shape
    a, b = spread(n, k), spread(k, m)
    assert np.all(np.abs(multiply_slices(a, b) - exact(a, b)) <= 2.0**-52 * size_of(a, b))


@pytest.mark.hard
@pytest.mark.parametrize("bits", [20, 35, 45])
def test_fewer_bits_are_as_exact_as_they_say(bits):
    a, b = spread(33, 60), spread(60, 20)
    error = np.abs(multiply_slices(a, b, bits) - exact(a, b))
    assert np.all(error <= 2.0**-bits * 3 * size_of(a, b))


@pytest.mark.parametrize("k", [3, 64, 65, 300, 1000])
def test_no_order_of_the_sums_matters(k):
    a, b = spread(60, k), spread(k, 50)
    whole = product(a, b)
    for _ in range(5):
        order = RNG.permutation(k)
        assert np.array_equal(multiply_slices(a[:, order], b[order]), multiply_slices(a, b))
    rows, columns = RNG.permutation(60), RNG.permutation(50)
    assert np.array_equal(product(a[rows][:, :], b[:, columns]), whole[rows][:, columns])
    assert np.array_equal(product(np.asfortranarray(a), np.asfortranarray(b)), whole)


def test_products_of_slices_are_whole_numbers_that_are_exact():
    for k in (10, 64, 300):
        a = np.sign(spread(40, k)) * RNG.uniform(0.999, 1.0, (40, k))  # the sums are as large as can be
        width = (53 - (k - 1).bit_length()) // 2
        slices, exponent = cut_rows(a, width)
        assert len(slices) == 3
        for part in slices:
            assert np.array_equal(part, np.rint(part)) and np.max(np.abs(part)) <= 2.0**width
            assert np.sum(np.abs(part), axis=1).max() * 2.0**width <= 2.0**53
        back = sum(
            np.ldexp(part, (exponent - width - i * (width + 1))[:, None]) for i, part in reversed([*enumerate(slices)])
        )
        assert np.array_equal(back, a)


def test_rows_of_any_scale_are_as_exact():
    a, b = RNG.standard_normal((40, 50)), RNG.standard_normal((50, 60))
    plain = multiply_slices(a, b)
    up, across = RNG.integers(-500, 500, 40), RNG.integers(-400, 400, 60)
    scaled = multiply_slices(np.ldexp(a, up[:, None]), np.ldexp(b, across))
    assert np.array_equal(scaled, np.ldexp(plain, up[:, None] + across))


def test_numbers_without_leading_bits_count():
    a, b = np.full((40, 50), 5e-324), np.full((50, 60), 2.0**20)
    assert np.array_equal(product(a, b), np.full((40, 60), 5e-324 * 2.0**20 * 50))


def test_empty_rows_and_sizes_give_zeros():
    a, b = RNG.standard_normal((40, 50)), RNG.standard_normal((50, 60))
    a[3], b[:, 7] = 0.0, 0.0
    out = product(a, b)
    assert not out[3].any() and not out[:, 7].any() and np.count_nonzero(out) == 39 * 59
    assert np.array_equal(product(np.zeros((4, 0)), np.zeros((0, 5))), np.zeros((4, 5)))
    assert product(np.zeros((0, 4)), np.zeros((4, 5))).shape == (0, 5)


@pytest.mark.parametrize("size", [5, 50])
def test_what_is_not_finite_stays_so(size):
    a, b = np.abs(RNG.standard_normal((size, size))), np.abs(RNG.standard_normal((size, size)))
    a[1, 2], a[2, 1] = np.inf, np.nan
    out = product(a, b)
    assert np.all(np.isinf(out[1])) and np.all(np.isnan(out[2])) and np.all(np.isfinite(out[3:]))


def test_shapes_are_those_of_matmul():
    for a in [(6,), (4, 6), (3, 4, 6), (2, 1, 4, 6), (2, 3, 70, 6)]:
        for b in [(6,), (6, 5), (3, 6, 5), (3, 6, 80)]:
            x, y = RNG.standard_normal(a), RNG.standard_normal(b)
            assert product(x, y).shape == (x @ y).shape, (a, b)
            assert np.allclose(product(x, y), x @ y, rtol=0, atol=1e-13), (a, b)
    with pytest.raises(ValueError, match="do not fit"):
        product(np.zeros((2, 3)), np.zeros((4, 2)))
