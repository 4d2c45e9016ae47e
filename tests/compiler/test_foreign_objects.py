"""Code for macOS and Windows on x86-64, run here: the loader that the engine uses there reads its object files on any
system, and their instructions are those of this processor.

Functions for Windows take their arguments elsewhere: each call from Python goes through a function that passes them on.
"""

import ctypes

import llvmlite.binding as llvm
import numpy as np
import pytest

import engine
from engine.compiler import kernels, shipped
from engine.compiler.code_objects import Code, _llvm
from engine.compiler.targets import TARGETS, X86_64, fitting_targets, is_of_family, target_named
from engine.runtime import helpers, job_memory
from tests.compiler.test_shipped import skip_if_stale

FOREIGN = [t.name for t in TARGETS if t.machines == X86_64 and t.system != "linux"]
LLVM_TYPES = {ctypes.c_ssize_t: "i64", ctypes.c_double: "double", ctypes.c_void_p: "ptr"}
SCENES = ["tanpura", "bowed_vibraphone", "snare", "slack_bass"]


class ForeignCode:
    """The functions of an archive for another system, loaded here."""

    def __init__(self, name):
        self.path, self.is_windows = shipped.archive(target_named(name)), name.startswith("windows")
        self.engines = {part: self.load(part, name) for part in ("plain.o", "stages.o")}

    def load(self, part, name):
        _llvm()
        triple = target_named(name).triple
        empty = llvm.parse_assembly(f'target triple = "{triple}"')  # a loader reads objects of one form
        loaded = llvm.create_mcjit_compiler(empty, llvm.Target.from_triple(triple).create_target_machine())
        content = shipped.read_part(self.path, part)
        loaded.add_object_file(llvm.ObjectFileRef.from_data(content.machine_code))
        loaded.finalize_object()
        return loaded

    def find(self, module, function, kinds):
        """In place of `load_shipped`."""
        part, entry = shipped.read_about(self.path)["kernels"][shipped.kernel_key(module, function, kinds)]
        address = self.engines[part].get_function_address(entry)
        assert address
        return Code(address, self.engines[part])


def passed_on(address, types):
    """Return a function of this system that calls one of Windows, and what it lives with."""
    names = [LLVM_TYPES[one] for one in types]
    given = ", ".join(f"{name} %a{n}" for n, name in enumerate(names))
    source = (
        f"define i64 @passed_on({given}) {{\n  %target = inttoptr i64 {address} to ptr\n"
        f"  %result = call win64cc i64 %target({given})\n  ret i64 %result\n}}\n"
    )
    host = llvm.Target.from_default_triple().create_target_machine()
    made = llvm.create_mcjit_compiler(llvm.parse_assembly(source), host)
    made.finalize_object()
    return ctypes.CFUNCTYPE(None, *types)(made.get_function_address("passed_on")), made


@pytest.fixture
def foreign(request, monkeypatch):
    """The engine on code for another system."""
    skip_if_stale()
    target = target_named(request.param)
    needed = {feature for fitting in fitting_targets() for feature in fitting.needed}
    if not is_of_family(target_named("linux-x86-64")) or not set(target.needed) <= needed:
        pytest.skip("another processor")
    code, kept = ForeignCode(request.param), []

    def callable_from_python(self, *kinds):
        types = [kernels.C_TYPES[kind] if isinstance(kind, str) else ctypes.c_void_p for kind in kinds]
        address = self.address(*kinds)
        if not code.is_windows:
            return ctypes.CFUNCTYPE(None, *types)(address)
        function, engine_of_llvm = passed_on(address, types)
        kept.append(engine_of_llvm)
        return function

    monkeypatch.setattr(kernels, "load_stored", lambda *_: None)
    monkeypatch.setattr(kernels, "load_shipped", code.find)
    monkeypatch.setattr(kernels.Kernel, "callable", callable_from_python)
    for kernel in (job_memory.RENDER_BLOCK, job_memory.RENDER_JOB, helpers.HELP_CREW):
        monkeypatch.setattr(kernel, "_loaded", {})
    return code


def renderings():
    """The samples of some scenes, with one step a sample and with stages."""
    out = {name: engine.render(engine.load(name), 0.05, kernel="general", cores=1).audio for name in SCENES}
    scene = engine.load("piano_c4").replace({"accuracy.order": 4})
    return out | {"order 4": engine.render(scene, 0.02, kernel="general", cores=1).audio}


@pytest.fixture(scope="module")
def expected():
    return renderings()


@pytest.mark.parametrize("foreign", FOREIGN, indirect=True)
def test_code_for_another_system_makes_the_same_samples(expected, foreign):
    heard = renderings()
    assert heard.keys() == expected.keys() and len(foreign.engines) == 2
    for name, audio in heard.items():
        assert np.abs(audio).max() > 0.0
        np.testing.assert_array_equal(audio, expected[name])
