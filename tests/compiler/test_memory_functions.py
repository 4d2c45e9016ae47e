"""Memory functions of shipped kernels: each fills and moves as that of the C library, whatever the size and place."""

import ctypes
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from engine.compiler import machine_code

SIZES = [*range(70), 127, 128, 129, 320, 1000]
PLACES = [0, 1, 7, 8, 31, 32, 33, 64]  # in a block of memory, bytes
MEMORY = bytes(range(256)) * 8


@pytest.fixture(scope="module")
def engine_of_functions():
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    folder = Path(machine_code.__file__).parent
    whole = llvm.parse_assembly("")
    for file in machine_code.FUNCTIONS_OF_C["darwin"]:  # all but one in assembly
        text = (folder / f"{file}.ll").read_text("utf-8").replace("@", "@fdh_")  # beside the C library's
        whole.link_in(llvm.parse_assembly(text))
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3)
    with llvm.create_mcjit_compiler(whole, machine) as compiled:
        compiled.finalize_object()
        yield compiled


@pytest.fixture
def call(engine_of_functions):
    """Call a function with addresses and integers."""

    def called(name: str, *arguments: int) -> int:
        kind = ctypes.CFUNCTYPE(ctypes.c_void_p, *[ctypes.c_int64] * len(arguments))
        return kind(engine_of_functions.get_function_address(f"fdh_{name}"))(*arguments)

    return called


@pytest.mark.parametrize("place", PLACES)
def test_memory_is_filled_and_no_byte_beside_it(call, place):
    for size in SIZES:
        memory, pattern = ctypes.create_string_buffer(MEMORY), ctypes.create_string_buffer(b"0123456789abcdef", 16)
        begin, rest = ctypes.addressof(memory) + place, MEMORY[place + size :]
        assert call("memset", begin, 0x1A5, size) == begin
        assert memory.raw[:-1] == MEMORY[:place] + b"\xa5" * size + rest
        call("memset_pattern16", begin, ctypes.addressof(pattern), size)
        assert memory.raw[:-1] == MEMORY[:place] + (pattern.raw * 63)[:size] + rest
        for name in ("bzero", "__bzero"):
            call("memset", begin, 7, size)
            call(name, begin, size)
            assert memory.raw[:-1] == MEMORY[:place] + bytes(size) + rest


@pytest.mark.parametrize("to", PLACES)
@pytest.mark.parametrize("name", ["memmove", "memcpy"])
def test_memory_is_moved_even_onto_itself(call, name, to):
    for size in SIZES:
        for source in [*PLACES, 1023]:
            if name == "memcpy" and source < to + size and to < source + size:
                continue  # the language allows it no overlap
            memory = ctypes.create_string_buffer(MEMORY)
            begin = ctypes.addressof(memory)
            assert call(name, begin + to, begin + source, size) == begin + to
            assert memory.raw[:-1] == MEMORY[:to] + MEMORY[source : source + size] + MEMORY[to + size :]
