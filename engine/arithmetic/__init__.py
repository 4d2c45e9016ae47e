"""Arithmetic with the same bits on every machine: of what NumPy and the C libraries offer, only what IEEE 754 fixes
(+, -, ·, /, √, rounding, scaling by powers of two), element by element, and sums in a fixed order."""
