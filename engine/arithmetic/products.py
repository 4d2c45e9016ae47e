"""Products of matrices with the same bits on every machine.

A library sums in an order, and with or without fused multiply-add, as suits the processor. Here, small products are
summed element by element in a fixed order. Large ones are sums of products of slices that the library computes without
rounding, so that no order matters: Ozaki, Ogita, Oishi & Rump, Numer. Algorithms 59, 2012, 95.
"""

import math

import numpy as np

MANTISSA = 53  # bits of a number
MOST_MULTIPLICATIONS = 30_000  # beyond, slices are quicker
FEW_COLUMNS = 2  # for which slices are not worth their making


def product(a: np.ndarray, b: np.ndarray, bits: int = MANTISSA) -> np.ndarray:
    """a @ b, of floats: [..., n, k] × [..., k, m], and one index less for a vector, as for `@`.

    bits: to which the sums are exact at least, relative to inner size × largest of the row × largest of the column;
        less than 53 are quicker where matrices are large
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    rows, columns = (a[None] if a.ndim == 1 else a), (b[:, None] if b.ndim == 1 else b)
    if rows.shape[-1] != columns.shape[-2]:
        raise ValueError(f"shapes {a.shape} and {b.shape} do not fit")
    if columns.ndim == 2:  # a stack of rows is more rows
        out = _multiply(rows.reshape(math.prod(rows.shape[:-1]), rows.shape[-1]), columns, bits)
        out = out.reshape(*rows.shape[:-1], columns.shape[-1])
    else:
        out = _multiply_stacks(rows, columns, bits)
    if b.ndim == 1:
        out = out[..., 0]
    return np.asarray(out[..., 0, :] if a.ndim == 1 and b.ndim > 1 else out[0] if a.ndim == 1 else out)


def _multiply_stacks(a: np.ndarray, b: np.ndarray, bits: int) -> np.ndarray:
    """[..., n, k] × [..., k, m]: all at once if small, else one after the other."""
    n, k, m = a.shape[-2], *b.shape[-2:]
    stack = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    a, b = np.broadcast_to(a, (*stack, n, k)), np.broadcast_to(b, (*stack, k, m))
    if n * k * m <= MOST_MULTIPLICATIONS:
        return _sum_over_first(np.moveaxis(a, -1, 0)[..., None], np.moveaxis(b, -2, 0)[..., None, :])
    out = np.empty((*stack, n, m))
    for place in np.ndindex(stack):
        out[place] = _multiply(a[place], b[place], bits)
    return out


def _multiply(a: np.ndarray, b: np.ndarray, bits: int) -> np.ndarray:
    """[n, k] × [k, m]."""
    n, k, m = a.shape[0], *b.shape
    if n * k * m == 0:
        return np.zeros((n, m))
    if m <= FEW_COLUMNS:
        return np.stack([np.add.reduce(np.multiply(a, column, order="C"), axis=1) for column in b.T], axis=1)
    if n <= FEW_COLUMNS:
        return np.stack([np.add.reduce(np.multiply(b.T, row, order="C"), axis=1) for row in a])
    if n * k * m <= MOST_MULTIPLICATIONS:
        return _sum_over_first(a.T[:, :, None], b[:, None, :])
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return _sum_one_by_one(a, b)
    return multiply_slices(a, b, bits)


def _sum_over_first(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of the elements, summed over the first axis in order."""
    return np.asarray(np.add.reduce(np.multiply(a, b, order="C"), axis=0))


def _sum_one_by_one(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[n, k] × [k, m], with as much memory as the result."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for column, row in zip(a.T, b, strict=True):
        out += column[:, None] * row
    return out


def multiply_slices(a: np.ndarray, b: np.ndarray, bits: int = MANTISSA) -> np.ndarray:
    """[n, k] × [k, m] of finite numbers, by products of slices that are whole numbers.

    Each slice is rounded to so few bits that a product of two, summed over k in any order, stays below 2⁵³: it is
    exact, and only the sum of these products is rounded. Pairs of slices whose products lie below the last bit of the
    largest are left out.
    """
    inner = (a.shape[1] - 1).bit_length()
    width = (MANTISSA - inner) // 2
    of_rows, up = cut_rows(a, width, bits)
    of_columns, across = cut_rows(b.T, width, bits)
    total = np.zeros((a.shape[0], b.shape[1]))
    last = min(len(of_rows) + len(of_columns) - 2, depth_of(width, bits) - 1)
    for depth in range(last, -1, -1):  # the smallest first
        for i in range(min(depth, len(of_rows) - 1), -1, -1):
            if depth - i < len(of_columns):
                total += of_rows[i] @ of_columns[depth - i].T
        if depth:
            total *= math.ldexp(1.0, -width - 1)
    return np.asarray(np.ldexp(total, up[:, None] + across - 2 * width))


def depth_of(width: int, bits: int) -> int:
    """The slices that hold so many bits: the first has `width` of them, each further one a bit more, by its sign."""
    return max(1, -(-(bits + 1) // (width + 1)))


def cut_rows(rows: np.ndarray, width: int, bits: int = MANTISSA) -> tuple[list[np.ndarray], np.ndarray]:
    """Slices of rows, whole numbers of at most 2^width, and the exponents e of the rows.

    The rows are the sum of slice[i]·2^(e - width - i·(width + 1)), but for bits that lie below the last of the largest
    number of the row.
    """
    largest = np.max(np.abs(rows), axis=1)
    exponent = np.frexp(largest)[1]
    rest = np.ldexp(rows, (width - exponent)[:, None])
    slices = []
    for _ in range(depth_of(width, bits)):
        whole = np.rint(rest)
        slices.append(whole)
        rest -= whole
        if not rest.any():
            break
        rest *= math.ldexp(1.0, width + 1)
    return slices, exponent
