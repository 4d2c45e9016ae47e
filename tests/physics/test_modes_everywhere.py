"""Modes of plates, soundboards and shells have the same bits on every machine: NumPy's and OpenBLAS' code for other
processors gives them too."""

import functools
import os
import platform
import subprocess
import sys

import pytest
from conftest import ROOT
from mode_digests import BODIES

PLAIN = {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Haswell"}
NO_AVX512 = "X86_V4 AVX512_ICL AVX512_SPR"
SETTINGS = {
    "oldest": {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": f"{NO_AVX512} X86_V3",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
    },
    "as it is": {"OPENBLAS_CORETYPE": ""},
    "two threads": {"OPENBLAS_NUM_THREADS": "2"},
    **{kind: {"OPENBLAS_CORETYPE": kind} for kind in ("SkylakeX", "Zen", "Sandybridge", "Nehalem", "Prescott")},
    "NumPy without AVX-512": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512},
    "NumPy without AVX2": {"NPY_DISABLE_CPU_FEATURES": f"{NO_AVX512} X86_V3"},
    "libm without AVX2": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"},
}
pytestmark = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="settings of x86-64")


@functools.cache
def digests_with(*bodies: str, **settings: str) -> dict[str, str]:
    """Digests by name of a process with such settings, of some bodies or of all."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **settings}
    command = [sys.executable, str(ROOT / "tests" / "physics" / "mode_digests.py"), *bodies]
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    if run.returncode in (-4, 132):  # an illegal instruction
        pytest.skip("this processor cannot run that code")
    assert run.returncode == 0, run.stderr
    return dict(line.split() for line in run.stdout.splitlines())


def check_bits(setting: str, *bodies: str) -> None:
    here, there = digests_with(*bodies, **PLAIN), digests_with(*bodies, **{**PLAIN, **SETTINGS[setting]})
    assert len(here) == len(bodies or BODIES) + 2
    if setting == "oldest":  # or the settings do nothing, and this proves nothing
        assert here["LAPACK"] != there["LAPACK"]
    assert {name for name in here if here[name] != there[name]} <= {"LAPACK", "libm"}


@pytest.mark.hard
def test_a_few_have_the_same_bits_on_an_old_processor():
    check_bits("oldest", "hinged plate", "free shell")


@pytest.mark.hard
@pytest.mark.parametrize("setting", SETTINGS)
def test_all_have_the_same_bits_on_every_processor(setting):
    check_bits(setting)
