"""Machine code of kernels for any machine that LLVM knows, as an object file that needs nothing from outside.

Numba makes LLVM's intermediate code, which is taken before anything in it is fitted to the machine that compiles. It is
then optimised and translated for the target.
"""

import importlib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
from numba.core import types
from numba.core.codegen import CPUCodeLibrary

from engine.compiler.decorators import kernel, prepared_to_compile
from engine.compiler.kinds import FLOAT, INT, Kind, example_of
from engine.compiler.numba_patches import SkipInlinedLibraries
from engine.compiler.struct_types import StructHandleType
from engine.compiler.targets import WASM, Target
from engine.compiler.wasm_arithmetic import wasm_arithmetic

FUNCTIONS_OF_C = {  # that instructions may become: files of their sources, by system
    "linux": ("memory_functions",),
    "darwin": ("memory_functions", "memory_functions_macos"),
    "win32": ("memory_functions", "memory_functions_windows"),
}


class NeutralCode(NamedTuple):
    """Intermediate code that is not yet fitted to any machine."""

    text: str
    symbol: str  # of its function, which has Numba's calling convention
    kinds: tuple[Kind, ...]  # of its arguments


def neutral_code(module: str, function: str, kinds: tuple[Kind, ...]) -> NeutralCode:
    """Return the intermediate code of a kernel for arguments of these kinds: pointers, integers and numbers."""
    dispatcher = kernel(getattr(importlib.import_module(module), function).py_func, from_python=False)
    with prepared_to_compile(), _first_code_kept(function) as kept, suppress(_CodeKept):
        dispatcher.compile(tuple(map(numba_type, kinds)))
    text = str(kept[0])
    names = [f.name for f in llvm.parse_assembly(text).functions if not f.is_declaration]
    symbol = next(name for name in names if function in name and not name.startswith("cfunc"))
    return NeutralCode(text, symbol, kinds)


def numba_type(kind: Kind) -> Any:
    """Return Numba's type for the kind of an argument."""
    if isinstance(kind, str):
        return {INT: types.int64, FLOAT: types.float64}[kind]
    return StructHandleType(numba.typeof(example_of(kind[1])))


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


class ObjectCode(NamedTuple):
    """An object file, and the functions of others that it calls."""

    content: bytes
    needed: list[str]


def object_code(codes: Mapping[str, NeutralCode], target: Target, tables: Mapping[str, bytes]) -> ObjectCode:
    """Return an object file with functions, by name, and with constant tables, by name.

    The functions take pointers, 64-bit integers and doubles, and return a 64-bit integer, which is 0 where kernels
    return nothing.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.processor,
        features=target.features,
        opt=3,
        reloc="static" if target is WASM else "pic",  # its constants stay where they are: it is linked with nothing
        codemodel="small",
    )
    layout = f'target datalayout = "{machine.target_data}"\ntarget triple = "{target.triple}"\n'
    modules = [_module(code, entry, target, layout) for entry, code in codes.items()]
    modules.append(llvm.parse_assembly(layout + "".join(map(_table, tables, tables.values()))))
    for module in modules:
        for value in (*module.functions, *module.global_variables):
            if not value.is_declaration and value.name not in {**codes, **tables}:
                value.linkage = "internal"
    whole = modules[0]
    for module in modules[1:]:
        whole.link_in(module)
    whole.verify()
    _optimise(whole, machine)
    _shorten_names(whole, {*codes, *tables})
    if codes and target is not WASM:  # which has instructions for these
        _add_functions_of_c(whole, target.system)
    needed = sorted(f.name for f in whole.functions if f.is_declaration and not f.name.startswith("llvm."))
    return ObjectCode(bytes(machine.emit_object(whole)), needed)


def _shorten_names(whole: Any, kept: set[str]) -> None:
    """Name what nobody calls from outside by numbers: Numba's names have thousands of letters."""
    values = [v for v in (*whole.functions, *whole.global_variables) if not v.is_declaration and v.name not in kept]
    for number, value in enumerate(values):
        value.name = f"local_{number}"


def _add_functions_of_c(whole: Any, system: str) -> None:
    """Add functions that instructions may become: where they are missing, a linker or a loader would have to find
    them."""
    llvm.initialize_native_asmparser()  # one of them is in assembly
    names = list[str]()
    for file in FUNCTIONS_OF_C.get(system, FUNCTIONS_OF_C["linux"]):
        added = llvm.parse_assembly(Path(__file__).with_name(f"{file}.ll").read_text("utf-8"))
        names += [function.name for function in added.functions if not function.is_declaration]
        whole.link_in(added)
    for name in names:
        whole.get_function(name).linkage = "internal"


def _module(code: NeutralCode, entry: str, target: Target, layout: str) -> Any:
    """Return the module of a kernel, fitted to a target. layout: lines that say which"""
    text = re.sub(r"^target (datalayout|triple).*$", "", code.text, flags=re.M)
    text = re.sub(r'"target-(cpu|features)"="[^"]*"', "", text)
    text = re.sub(r'^define [^\n]*@"?cfunc\.[^\n]*\{\n.*?^\}\n', "", text, flags=re.M | re.S)  # for callers in Python
    text = _with_instructions_for_roots(text)
    if target is WASM:
        text = wasm_arithmetic(text)
    return llvm.parse_assembly(layout + text + _entry(code, entry, target is WASM))


def _with_instructions_for_roots(text: str) -> str:
    """Return intermediate code that takes square roots by an instruction, and not by a function of the C library, which
    would also note errors."""
    text, calls = re.subn(r"^declare double @sqrt\([^\n]*\n", "", text, flags=re.M)
    if calls:
        text = text.replace("@sqrt(", "@llvm.sqrt.f64(")
        if "declare double @llvm.sqrt.f64(" not in text:
            text += "declare double @llvm.sqrt.f64(double)\n"
    return text


def _entry(code: NeutralCode, entry: str, is_wasm: bool) -> str:
    """Return the source of the function that others call: it passes its arguments on, in Numba's calling convention. In
    WebAssembly it takes integers for addresses, as `call_address` passes them, and returns nothing."""
    plain = {INT: "i64", FLOAT: "double"}
    taken = [plain.get(kind, "ptr") if isinstance(kind, str) else "ptr" for kind in code.kinds]
    given = ["i64" if is_wasm else kind for kind in taken]
    places = range(len(given))
    changed = [f"  %p{i} = inttoptr i64 %a{i} to ptr\n" for i in places if given[i] != taken[i]]
    passed = ", ".join(f"{taken[i]} %{'a' if given[i] == taken[i] else 'p'}{i}" for i in places)
    return f"""
define {"void" if is_wasm else "i64"} @{entry}({", ".join(f"{given[i]} %a{i}" for i in places)}) {{
{"".join(changed)}  %result = alloca i64
  store i64 0, ptr %result
  %exception = alloca ptr
  %status = call i32 @"{code.symbol}"(ptr %result, ptr %exception, {passed})
  %returned = load i64, ptr %result
  ret {"void" if is_wasm else "i64 %returned"}
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
