"""Functions that are called where kernels are compiled with other effects: in a process of its own."""

import operator
import pickle
import sys

import pytest

from engine.compiler.special_kernels import ALL, EFFECTS, call_with_effects
from engine.faults import BuildError, Fault, PatchError


def test_all_effects_are_those_of_this_process():
    assert EFFECTS == ALL
    assert call_with_effects(ALL, "operator", "add", 1, 2) == operator.add(1, 2)


def test_others_are_the_constant_of_a_process_of_its_own():
    assert call_with_effects(5, "engine.compiler.special_kernels", "call_with_effects", 5, "operator", "add", 1, 2) == 3
    code = "__import__('engine.kernel.data.effects', fromlist=['EFFECTS']).EFFECTS"
    assert call_with_effects(5, "builtins", "eval", code) == 5


def test_what_it_raises_is_raised_here_and_a_death_is_said(monkeypatch):
    with pytest.raises(ZeroDivisionError):
        call_with_effects(5, "operator", "truediv", 1, 0)
    with pytest.raises(RuntimeError, match="the process that compiles a special kernel ended with 3"):
        call_with_effects(5, "os", "_exit", 3)
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    with pytest.raises(BuildError, match="kernels cannot be compiled; unset it"):
        call_with_effects(5, "engine.compiler.kernel_compiler", "compile_kernel", "module", "function", ())


@pytest.mark.parametrize("error", [BuildError(Fault("a.b", "kept")), PatchError([Fault("a.b", "kept")])], ids=str)
def test_faults_come_from_another_process_as_they_are(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error) and again.faults == error.faults


def test_a_frozen_program_says_that_it_cannot(monkeypatch):
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    with pytest.raises(RuntimeError, match="a frozen program cannot compile a special kernel; choose the general one"):
        call_with_effects(5, "operator", "add", 1, 2)
