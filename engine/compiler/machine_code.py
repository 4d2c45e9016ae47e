"""Machine code of kernels for any machine that LLVM knows, as an object file that needs the C library alone.

Numba makes LLVM's intermediate code, which is taken before anything in it is fitted to the machine that compiles. It is
then optimised and translated for the target.
"""

import importlib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core.codegen import CPUCodeLibrary

from engine.compiler.decorators import kernel, prepared_to_compile
from engine.compiler.kernel_compiler import numba_type
from engine.compiler.kinds import INT, Kind
from engine.compiler.numba_patches import SkipInlinedLibraries
from engine.compiler.wasm_arithmetic import wasm_arithmetic


class Target(NamedTuple):
    """A machine that code is made for."""

    triple: str  # as LLVM names it
    processor: str
    tested_in: str  # "use": on such machines; "an emulator"; "" if neither was at hand
    features: str = ""  # beyond those of the processor
    relocation: str = "pic"
    integers: bool = False  # True: entries take integers for addresses, as `call_address` passes them


WASM = Target(
    "wasm32-unknown-unknown",
    "generic",
    "use",
    "+simd128,+relaxed-simd,+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals",
    relocation="static",  # its constants stay where they are: it is linked with nothing
    integers=True,
)
TARGETS = {
    "x86_64-linux": Target("x86_64-unknown-linux-gnu", "x86-64-v3", "use"),
    "aarch64-linux": Target("aarch64-unknown-linux-gnu", "generic", "an emulator"),
    "aarch64-macos": Target("aarch64-apple-macosx11.0.0", "apple-m1", ""),
    "x86_64-windows": Target("x86_64-pc-windows-gnu", "x86-64-v3", ""),
}


class NeutralCode(NamedTuple):
    """Intermediate code that is not yet fitted to any machine."""

    text: str
    symbol: str  # of its function, which has Numba's calling convention
    kinds: tuple[Kind, ...]  # of its arguments


def neutral_code(module: str, function: str, kinds: tuple[Kind, ...]) -> NeutralCode:
    """Return the intermediate code of a kernel for arguments of these kinds, pointers or integers."""
    dispatcher = kernel(getattr(importlib.import_module(module), function).py_func, from_python=False)
    with prepared_to_compile(), _first_code_kept(function) as kept, suppress(_CodeKept):
        dispatcher.compile(tuple(map(numba_type, kinds)))
    text = str(kept[0])
    names = [f.name for f in llvm.parse_assembly(text).functions if not f.is_declaration]
    symbol = next(name for name in names if function in name and not name.startswith("cfunc"))
    return NeutralCode(text, symbol, kinds)


class _CodeKept(Exception):
    """The intermediate code is there: Numba need not go on."""


@contextmanager
def _first_code_kept(function: str) -> Iterator[list[Any]]:
    """Let Numba stop at the intermediate code of a kernel, before it is optimised; it is put in the list."""
    library_class: Any = CPUCodeLibrary
    plain, kept = (library_class._optimize_functions, library_class._optimize_final_module), list[Any]()

    def keep(library: Any) -> None:
        if not SkipInlinedLibraries.active() and library.name == function:
            kept.append(library._final_module)
            raise _CodeKept

    library_class._optimize_functions, library_class._optimize_final_module = lambda self, module: None, keep
    try:
        yield kept
    finally:
        library_class._optimize_functions, library_class._optimize_final_module = plain


def object_code(codes: Mapping[str, NeutralCode], target: Target, tables: Mapping[str, bytes]) -> bytes:
    """Return an object file with functions, by name, that take pointers and 64-bit integers and return nothing, and
    with constant tables, by name."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.processor,
        features=target.features,
        opt=3,
        reloc="static" if target is WASM else "pic",
        codemodel="default",
    )
    modules = [_module(code, entry, target, machine) for entry, code in codes.items()]
    modules.append(llvm.parse_assembly("".join(map(_table, tables, tables.values()))))
    for module in modules:
        for value in (*module.functions, *module.global_variables):
            if not value.is_declaration and value.name not in {**codes, **tables}:
                value.linkage = "internal"
    whole = modules[0]
    for module in modules[1:]:
        whole.link_in(module)
    whole.verify()
    _optimise(whole, machine)
    return bytes(machine.emit_object(whole))


def _module(code: NeutralCode, entry: str, target: Target, machine: Any) -> Any:
    """Return the module of a kernel, fitted to a target."""
    text = re.sub(r"^target datalayout.*$", f'target datalayout = "{machine.target_data}"', code.text, flags=re.M)
    text = re.sub(r"^target triple.*$", f'target triple = "{target.triple}"', text, flags=re.M)
    text = re.sub(r'"target-(cpu|features)"="[^"]*"', "", text)
    text = re.sub(r'^define [^\n]*@"?cfunc\.[^\n]*\{\n.*?^\}\n', "", text, flags=re.M | re.S)  # for callers in Python
    if target is WASM:
        text = wasm_arithmetic(text)
    return llvm.parse_assembly(text + _entry(code, entry, target.integers))


def _entry(code: NeutralCode, entry: str, integers: bool) -> str:
    """Return the source of the function that others call: it passes its arguments on, in Numba's calling convention."""
    given = ["i64" if integers or kind == INT else "ptr" for kind in code.kinds]
    taken = ["i64" if kind == INT else "ptr" for kind in code.kinds]
    places = range(len(given))
    changed = [f"  %p{i} = inttoptr i64 %a{i} to ptr\n" for i in places if given[i] != taken[i]]
    passed = ", ".join(f"{taken[i]} %{'a' if given[i] == taken[i] else 'p'}{i}" for i in places)
    return f"""
define void @{entry}({", ".join(f"{given[i]} %a{i}" for i in places)}) {{
{"".join(changed)}  %result = alloca i64
  %exception = alloca ptr
  %status = call i32 @"{code.symbol}"(ptr %result, ptr %exception, {passed})
  ret void
}}
"""


def _table(name: str, content: bytes) -> str:
    """Return the source of a constant table."""
    escaped = "".join(f"\\{byte:02x}" for byte in content)
    return f'@{name} = constant [{len(content)} x i8] c"{escaped}", align 64\n'


def _optimise(module: Any, machine: Any) -> None:
    """Optimise as Numba does: each function by itself first, so that what is inlined is small."""
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.loop_interleaving = True
    options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    passes = builder.getFunctionPassManager()
    for function in module.functions:
        if not function.is_declaration:
            passes.run(function, builder)
    builder.getModulePassManager().run(module, builder)
