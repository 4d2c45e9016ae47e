"""The tricks by which kernels compile and run faster. Each rests on inner parts of Numba, and none changes a sample.

A trick is in use if its self-test passes and the environment does not switch it off: FDH_PLAIN lists names of tricks,
or is "all". Without a trick, time is lost and nothing else. `python -m bench tricks` measures what each one buys.
"""

import os
from collections.abc import Callable
from enum import StrEnum
from functools import cache


class Trick(StrEnum):
    """The name of each trick, as in FDH_PLAIN."""

    ARRAY_VIEWS = "array_views"  # arrays of two values instead of seven
    LANES = "lanes"  # eight numbers at a time as vector code
    SKIP_INLINED = "skip_inlined"  # what is inlined is not optimised and translated by itself
    FORCED_INLINING = "forced_inlining"
    NO_WRAPPERS = "no_wrappers"  # for functions that only kernels call
    NO_REFERENCE_COUNTS = "no_reference_counts"
    KERNEL_FILES = "kernel_files"  # a file for each kernel, shared by processes


FOUND: dict[Trick, bool] = {}  # the results of self-tests up to now


@cache
def switched_off() -> frozenset[str]:
    """The tricks that FDH_PLAIN names. Raises ValueError if it names none of ours."""
    names = frozenset(os.environ.get("FDH_PLAIN", "").replace(",", " ").split())
    if unknown := names - {"all", *Trick}:
        raise ValueError(f"FDH_PLAIN: no trick is named {', '.join(sorted(unknown))}; all, {', '.join(Trick)}")
    return frozenset(Trick) if "all" in names else names


def in_use(trick: Trick, self_test: Callable[[], bool] = lambda: True) -> bool:
    """True if a trick is to be used. A self-test that raises has failed."""
    FOUND[trick] = trick not in switched_off() and _passes(self_test)
    return FOUND[trick]


def _passes(self_test: Callable[[], bool]) -> bool:
    try:
        return self_test()
    except Exception:  # an inner part of Numba that is no longer there
        return False
