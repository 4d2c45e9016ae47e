"""Fused multiply-adds of a WebAssembly module that can be replaced where a browser lacks them (relaxed SIMD).

A replaceable one is a sequence of fixed length, which names a local variable of its function that nothing else uses. So
a script makes a product and a sum of it in its place, and the length of nothing changes:

    f64x2.relaxed_madd, i32.const local, drop, nop, …  →  local.set local, f64x2.mul, local.get local, f64x2.add

What a compiler makes of constants that are dropped is nothing.
"""

import re

from engine.compiler.wasm_module import Reader, number_bytes, read_sections

TYPES, FUNCTIONS, CODE = 1, 3, 10  # kinds of sections
VECTOR = 0x7B  # the type of local variables of 128 bits
MULTIPLY_ADD = b"\xfd\x87\x02"
BRANCH_TABLE = b"\x0e"
NOT_RELAXED = {b"\xfd\x8f\x02": b"\xfd\xf6\x01", b"\xfd\x90\x02": b"\xfd\xf7\x01"}  # min and max: f64x2.pmin, pmax
NOPS = 6
REPLACEABLE = re.compile(re.escape(MULTIPLY_ADD) + rb"\x41..[\x00-\x7f]\x1a\x01{%d}" % NOPS, re.DOTALL)

NUMBER = rb"[\x80-\xff]*+[\x00-\x7f]"
INSTRUCTIONS = re.compile(  # any, but tables of branches and relaxed ones
    rb"(?:[\x00\x01\x05\x0b\x0f\x1a\x1b\x45-\xc4]"
    rb"|[\x02-\x04\x0c\x0d\x10\x20-\x26\x3f-\x42]" + NUMBER + rb"|[\x11\x28-\x3e]" + NUMBER * 2 + rb"|\x43.{4}|\x44.{8}"
    rb"|\xfc(?:[\x00-\x07]|\x0a..|\x0b.)"
    rb"|\xfd(?:[\x00-\x0b\x5c\x5d]" + NUMBER * 2 + rb"|[\x0c\x0d].{16}|[\x15-\x22].|[\x54-\x5b]" + NUMBER * 2 + rb"."
    rb"|[\x0e-\x14\x23-\x53\x5e-\x7f]|[\x80-\xff]\x01))*+",
    re.DOTALL,
)


def make_replaceable(module: bytes) -> bytes:
    """Return a module whose multiply-adds are replaceable, and which has no other relaxed instructions.

    Raises ValueError for an instruction that the kernels do not use.
    """
    sections = dict(read_sections(module))
    parameters = _parameter_counts(sections)
    code, count = Reader(sections[CODE]), 0
    bodies = bytearray(number_bytes(code.number()))
    for given in parameters:
        body, replaced = _replaceable_body(code.take(code.number()), given)
        bodies += number_bytes(len(body)) + body
        count += replaced
    sections[CODE] = bytes(bodies)
    out = module[:8] + b"".join(bytes([kind]) + number_bytes(len(body)) + body for kind, body in sections.items())
    if len(REPLACEABLE.findall(out)) != count:  # a script could not tell them apart
        raise ValueError("other bytes of the module look like a multiply-add")
    return out


def _parameter_counts(sections: dict[int, bytes]) -> list[int]:
    """Return how many parameters each function of a module takes."""
    types, counts = Reader(sections[TYPES]), list[int]()
    for _ in range(types.number()):
        types.byte()  # says that it is a function
        counts.append(types.number())
        types.take(counts[-1])
        types.take(types.number())
    functions = Reader(sections[FUNCTIONS])
    return [counts[functions.number()] for _ in range(functions.number())]


def _replaceable_body(body: bytes, parameters: int) -> tuple[bytes, int]:
    """Return the body of a function with a further local variable, and how many multiply-adds it has."""
    reader = Reader(body)
    groups = reader.number()
    begin, local = reader.place, parameters
    for _ in range(groups):
        local += reader.number()
        reader.byte()
    variables = number_bytes(groups + 1) + body[begin : reader.place] + bytes([1, VECTOR])
    number = bytes([local & 0x7F | 0x80, local >> 7 & 0x7F | 0x80, local >> 14])  # of three bytes, whatever it is
    replaceable = MULTIPLY_ADD + b"\x41" + number + b"\x1a" + b"\x01" * NOPS
    code, count = bytearray(), 0
    while not reader.is_over:
        run = INSTRUCTIONS.match(body, reader.place)
        code += run[0] if run else b""
        reader.place += len(run[0]) if run else 0
        begin, head = reader.place, body[reader.place : reader.place + 3]
        if head == MULTIPLY_ADD or head in NOT_RELAXED:
            code += NOT_RELAXED.get(head, replaceable)
            count += head == MULTIPLY_ADD
            reader.take(3)
        elif head[:1] == BRANCH_TABLE:
            reader.byte()
            for _ in range(reader.number() + 1):
                reader.number()
            code += body[begin : reader.place]
        elif head:
            raise ValueError(f"the kernels use an instruction of WebAssembly that is not known here: {head.hex()}")
    return variables + bytes(code), count
