"""All that touches the inner parts of Numba and llvmlite."""
