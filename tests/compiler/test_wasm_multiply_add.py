"""Fused multiply-adds of a WebAssembly module become replaceable, and nothing else of it changes."""

import pytest

from engine.compiler.wasm_multiply_add import make_replaceable

HEAD = b"\0asm\1\0\0\0" + b"\1\5\1\x60\0\1\x7b" + b"\3\2\1\0"  # one function, that returns a vector
PAIRS = b"\x41\0\xfd\x0f" * 3  # three vectors of zeros


def module_of(code, variables=b"\0"):
    body = variables + code + b"\x0b"
    return HEAD + bytes([10, len(body) + 2, 1, len(body)]) + body


def test_a_multiply_add_names_a_variable_that_nothing_else_uses():
    """The function had two local variables; the third is new."""
    replaceable = make_replaceable(module_of(PAIRS + b"\xfd\x87\x02", b"\1\2\x7f"))
    assert replaceable == module_of(PAIRS + b"\xfd\x87\x02\x41\x82\x80\0\x1a" + b"\1" * 6, b"\2\2\x7f\1\x7b")


def test_bytes_of_a_constant_are_no_instruction():
    constant = b"\xfd\x0c\xfd\x87\x02" + bytes(13)
    assert make_replaceable(module_of(constant)) == module_of(constant, b"\1\1\x7b")


def test_a_larger_one_of_two_is_the_same_in_all_browsers():
    assert make_replaceable(module_of(PAIRS[:8] + b"\xfd\x90\x02")) == module_of(PAIRS[:8] + b"\xfd\xf7\1", b"\1\1\x7b")


def test_other_relaxed_instructions_are_refused():
    with pytest.raises(ValueError, match="not known here: fd8802"):
        make_replaceable(module_of(PAIRS + b"\xfd\x88\x02"))
