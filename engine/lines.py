"""Where the statements of a TOML text begin, in time proportional to its length."""

import re
import tomllib
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

Where = tuple[str | int, ...]

DEEP = 32  # tables or lists in each other, or names of a dotted key; Python's reader cannot take a thousand
# strings and comments whole, closed or not, and the signs by which a statement ends; names joined by too many dots
PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
TOKEN = re.compile(
    rf"(?P<deep>(?<![\w.-])(?:{PART}\.[ \t]*+){{{DEEP}}})"
    r'|"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5})?'
    r"|'''(?:[^']|'(?!''))*+(?:'{3,5})?"
    r'|"(?:[^"\\\n]|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+"
    r"|[\[\]{}=\n]",
    re.DOTALL,
)
BARE = re.compile(r"[A-Za-z0-9_-]+")


class TooDeep(ValueError):
    """Tables or lists stand in each other too deep; `line` says where."""

    def __init__(self, line: int) -> None:
        super().__init__(f"tables, lists or dotted keys go deeper than {DEEP}")
        self.line = line


def statements(text: str) -> Iterator[tuple[int, str]]:
    """Line of each statement, and what it begins with: [a header], or the key before its equals sign.

    The text need not be valid. Raises TooDeep.
    """
    line, begin, depth, key = 1, 0, 0, ""
    for token in TOKEN.finditer(text):
        sign = token[0]
        if token.lastgroup or depth > DEEP:
            raise TooDeep(line + text.count("\n", begin, token.start()))
        if sign == "=" and not key:
            key = text[begin : token.start()].strip()
        elif key and sign in ("[", "{"):
            depth += 1
        elif key and sign in ("]", "}"):
            depth -= 1
        elif sign == "\n" and depth <= 0:
            head = key or text[begin : token.start()].strip()
            if head and not head.startswith("#"):
                yield line, head
            line += text.count("\n", begin, token.end())
            begin, depth, key = token.end(), 0, ""
    head = key or text[begin:].strip()
    if head and not head.startswith("#"):
        yield line, head


def locate(text: str) -> dict[Where, int]:
    """Line of every key and table of a valid TOML text, by path: ("body", 0, "mass") → 7.

    What stands within a value has the line at which its statement begins, and no entry of its own.
    """
    lines: dict[Where, int] = {(): 1}
    table: Where = ()
    counts: dict[Where, int] = {}
    for line, head in statements(text.replace("\r\n", "\n")):
        names, several = _parts(head)
        if not head.startswith("["):
            for end in range(1, len(names) + 1):
                lines.setdefault(table + names[:end], line)
            continue
        table = _opened(names, several, counts)
        lines.setdefault(table, line)
        if isinstance(table[-1], int):  # the first of an array stands for it
            lines.setdefault(table[:-1], line)
    return lines


def line_of(lines: dict[Where, int], where: Where) -> int:
    """The line of a path, or of the nearest part that it lies in."""
    while where not in lines:
        where = where[:-1]
    return lines[where]


@lru_cache(1024)
def _parts(head: str) -> tuple[Where, bool]:
    """The names that a header or a key is made of, and whether it is the header of an [[array]]."""
    if BARE.fullmatch(head):
        return (head,), False
    value: Any = tomllib.loads(head if head.startswith("[") else f"{head} = 0")
    names: Where = ()
    while isinstance(value, dict) and value:
        name, value = next(iter(value.items()))
        names += (name,)
    return names, isinstance(value, list)


def _opened(names: Where, several: bool, counts: dict[Where, int]) -> Where:
    """The path a header opens; tables of arrays are counted."""
    path: Where = ()
    for n, name in enumerate(names, 1):
        path += (name,)
        if several and n == len(names):
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path += (counts[path],)
    return path
