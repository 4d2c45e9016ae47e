"""Where machine code finds the functions of C, on systems that are not here: their libraries are faked."""

import ctypes
import sys
from types import SimpleNamespace

import pytest

from engine.compiler import code_objects


@pytest.fixture
def forgotten():
    """Forgets which libraries there are, before and after."""
    caches = code_objects._libraries, code_objects._address_of
    for cached in caches:
        cached.cache_clear()
    yield
    for cached in caches:
        cached.cache_clear()


def at(**addresses):
    """A library with functions at these addresses."""
    return SimpleNamespace(**{name: ctypes.CFUNCTYPE(None)(address) for name, address in addresses.items()})


def test_on_windows_the_library_of_python_and_numba_comes_first(forgotten, monkeypatch):
    """The old one, msvcrt, has another pow, exp and sin: other bits than a kernel that Numba compiled there."""
    monkeypatch.setattr(sys, "platform", "win32")
    libraries = {"ucrtbase": at(pow=0x1000, abort=0x1010), "msvcrt": at(pow=0x2000, memcpy=0x2020)}
    monkeypatch.setattr(ctypes, "cdll", SimpleNamespace(**libraries))
    wanted = {"pow": 0x1000, "memcpy": 0x2020, "numba_gil_ensure": 0x1010, "of_no_library": None}
    assert {name: code_objects._address_of(name) for name in wanted} == wanted


def test_without_a_library_of_mathematics_that_of_c_has_its_functions(forgotten, monkeypatch):
    """As with musl, on macOS and on BSD, where no libm.so.6 can be loaded."""

    def load(name):
        if name is not None:
            raise OSError(f"{name}: cannot open shared object file")
        return at(pow=0x3000)

    monkeypatch.setattr(ctypes, "CDLL", load)
    assert code_objects._address_of("pow") == 0x3000
