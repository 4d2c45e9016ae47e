"""What `bench machines` says where tables differ, and where a setting cannot be had."""

import subprocess

import pytest

from bench.accuracy import machines
from bench.accuracy.machines import Setting

FEATURES = {"optional": ["X86_V3", "X86_V4", "AVX512_ICL"], "used": ["X86_V3"]}
HERE = {"numpy": FEATURES, "blas": "Haswell", "libm": "00"}


def test_what_this_processor_lacks_is_left_out():
    without = {one.name: one for one in machines.settings(FEATURES)}
    assert without["NumPy without x86-64-v4"].problem == "this processor has none of it"
    assert without["NumPy without x86-64-v3"].variables == {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL"}
    older = {"optional": ["AVX512F", "AVX512_SKX", "AVX2", "FMA3"], "used": ["AVX512F", "AVX512_SKX", "AVX2", "FMA3"]}
    named = [one.variables for one in machines.settings(older)[:2]]
    assert [one["NPY_DISABLE_CPU_FEATURES"] for one in named] == ["AVX512F AVX512_SKX", "AVX512F AVX512_SKX AVX2 FMA3"]
    arm = {"optional": ["ASIMDHP", "SVE"], "used": ["SVE"]}
    assert all(one.problem for one in machines.settings(arm)[:2])


@pytest.mark.parametrize(
    ("variables", "came_to", "problem"),
    [
        ({"NPY_DISABLE_CPU_FEATURES": "X86_V3"}, {"numpy": {"used": []}}, ""),
        ({"NPY_DISABLE_CPU_FEATURES": "X86_V3"}, {}, "NumPy still uses X86_V3"),
        ({"OPENBLAS_CORETYPE": "Sandybridge"}, {"blas": "SANDYBRIDGE"}, ""),
        ({"OPENBLAS_CORETYPE": "Prescott"}, {"blas": "Katmai"}, ""),
        ({"OPENBLAS_CORETYPE": "Haswell"}, {}, ""),
        ({"OPENBLAS_CORETYPE": "Zen"}, {}, "OpenBLAS takes Haswell instead, as it does by itself"),
        (machines.NO_FMA, {"libm": "01"}, ""),
        (machines.NO_FMA, {}, "its functions gave the same bits as before"),
        ({"OPENBLAS_NUM_THREADS": "2"}, {}, ""),
    ],
)
def test_a_setting_without_effect_proves_nothing(variables, came_to, problem):
    assert machines.explain_no_effect(Setting("it", variables), HERE, HERE | came_to) == problem


def finished(code: int, error: str = "") -> subprocess.CompletedProcess:
    return subprocess.CompletedProcess([], code, "", error)


def test_a_process_that_dies_is_left_out_with_the_reason(monkeypatch):
    monkeypatch.setattr(machines, "start_worker", lambda *_: finished(-4))
    assert machines.try_setting(Setting("it", {}), HERE) == ({}, "this processor cannot run that code (SIGILL)")
    monkeypatch.setattr(machines, "start_worker", lambda *_: finished(1, "traceback\nRuntimeError: baseline\n"))
    assert machines.try_setting(Setting("it", {}), HERE) == ({}, "RuntimeError: baseline")


@pytest.mark.parametrize(("known", "code"), [({"snare": "its heads"}, 0), ({}, 1)])
def test_patches_that_differ_are_named(known, code, monkeypatch, capsys):
    committed = {"ball": "aa", "snare": "bb"}
    monkeypatch.setattr(machines, "DEPENDS_ON_MACHINE", known)
    monkeypatch.setattr(machines, "read_shipped_digests", lambda: committed)
    monkeypatch.setattr(machines, "read_here", lambda: HERE | {"digests": committed})
    monkeypatch.setattr(machines, "settings", lambda _: [Setting("Zen", {}), Setting("v4", {}, "there is none")])
    monkeypatch.setattr(machines, "try_setting", lambda one, _: (committed | {"snare": "cc"}, one.problem))
    monkeypatch.setattr(machines, "sample_differences", lambda _, names: dict.fromkeys(names, 2e-9))
    assert machines.main(["--samples"]) == code
    lines = capsys.readouterr().out.splitlines()[1:]
    assert [" ".join(line.split()) for line in lines] == [
        "as it is 2 of 2 the same",
        "Zen 1 of 2 the same",
        "snare 2e-09 (!)" if code else "snare 2e-09",
        "v4 left out: there is none",
    ]
    assert machines.main(["--all"]) == 2
