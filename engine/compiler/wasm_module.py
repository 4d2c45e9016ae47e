"""An object file of LLVM for WebAssembly as a module: such a file is one but for its exports, which are added here. No
linker is needed.

Its memory, its stack and its table of functions are those of who runs it: imports `env.__linear_memory`,
`env.__stack_pointer` and `env.__indirect_function_table`. Its constants begin at address 0.
"""

from collections.abc import Iterator, Sequence

CUSTOM, EXPORTS = 0, 7  # kinds of sections
ORDER = (1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 10, 11)  # of the kinds of sections in a module
SYMBOL_TABLE = 8  # a part of the section "linking"
FUNCTION, DATA, SECTION = 0, 1, 3  # kinds of symbols
UNDEFINED, EXPLICIT_NAME = 0x10, 0x40  # flags of a symbol


class Reader:
    """Reads the numbers and names of a module, one after the other."""

    def __init__(self, content: bytes) -> None:
        self.content, self.place = content, 0

    def byte(self) -> int:
        """Return the next byte."""
        self.place += 1
        return self.content[self.place - 1]

    def number(self) -> int:
        """Return the next unsigned number: seven bits a byte, the lowest first (LEB128)."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    def take(self, count: int) -> bytes:
        """Return the next `count` bytes."""
        self.place += count
        return self.content[self.place - count : self.place]

    def name(self) -> str:
        """Return the next name."""
        return self.take(self.number()).decode()

    @property
    def is_over(self) -> bool:
        """True at the end."""
        return self.place >= len(self.content)


def number_bytes(number: int) -> bytes:
    """Return an unsigned number as a module has it."""
    out = bytearray()
    while number >= 0x80:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*out, number])


def with_exports(content: bytes, names: Sequence[str]) -> bytes:
    """Return an object file as a module that exports some of its functions. Raises KeyError if one is not in it."""
    sections = list(read_sections(content))
    linking = next(reader for kind, body in sections if kind == CUSTOM and (reader := _named(body, "linking")))
    index = _function_numbers(linking)
    exports = number_bytes(len(names))
    for name in names:
        exports += number_bytes(len(name)) + name.encode() + bytes([FUNCTION]) + number_bytes(index[name])
    kept = [(kind, body) for kind, body in sections if kind != CUSTOM]  # the others are names and relocations
    kept = sorted([*kept, (EXPORTS, exports)], key=lambda section: ORDER.index(section[0]))
    return content[:8] + b"".join(bytes([kind]) + number_bytes(len(body)) + body for kind, body in kept)


def read_sections(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the kind and the content of each section of a module. Raises ValueError if it is none."""
    reader = Reader(content)
    if reader.take(8) != b"\0asm\1\0\0\0":
        raise ValueError("this is no WebAssembly")
    while not reader.is_over:
        kind = reader.byte()
        yield kind, reader.take(reader.number())


def _named(body: bytes, name: str) -> Reader | None:
    """Return a reader of the content of a custom section, if it has this name."""
    reader = Reader(body)
    return reader if reader.name() == name else None


def _function_numbers(linking: Reader) -> dict[str, int]:
    """Return the numbers of the functions that a file defines, by their names, from its section "linking"."""
    linking.number()  # version
    numbers = dict[str, int]()
    while not linking.is_over:
        kind = linking.byte()
        part = Reader(linking.take(linking.number()))
        for _ in range(part.number() if kind == SYMBOL_TABLE else 0):
            symbol, flags = part.byte(), part.number()
            if symbol == DATA:
                part.name()
                for _ in range(0 if flags & UNDEFINED else 3):
                    part.number()
            elif symbol == SECTION:
                part.number()
            else:
                number, is_here = part.number(), not flags & UNDEFINED
                name = part.name() if is_here or flags & EXPLICIT_NAME else ""
                if symbol == FUNCTION and is_here:
                    numbers[name] = number
    return numbers
