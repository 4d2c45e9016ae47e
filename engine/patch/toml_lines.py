"""Lines of the keys of a TOML text, found in time proportional to its length."""

import re
import tomllib
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

from engine.bodies.table import KeyPath

MAX_NESTING = 32  # of tables or lists, or names of a dotted key; Python's reader fails at a thousand

KEY_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
# strings and comments as wholes, closed or not; the signs that end a statement; keys with too many dots
TOKEN = re.compile(
    rf"(?P<deep>(?<![\w.-])(?:{KEY_PART}\.[ \t]*+){{{MAX_NESTING}}})"
    r'|"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5})?'
    r"|'''(?:[^']|'(?!''))*+(?:'{3,5})?"
    r'|"(?:[^"\\\n]|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+"
    r"|[\[\]{}=\n]",
    re.DOTALL,
)
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class NestedTooDeep(ValueError):
    """Tables or lists are nested too deep in a text, at `line`."""

    def __init__(self, line: int) -> None:
        super().__init__(f"tables, lists or dotted keys go deeper than {MAX_NESTING}")
        self.line = line


def split_statements(text: str) -> Iterator[tuple[int, str]]:
    """The line of each statement, and what it begins with: [a header], or the key before its equals sign.

    The text need not be valid. Raises NestedTooDeep.
    """
    line, begin, depth, key = 1, 0, 0, ""
    for token in TOKEN.finditer(text):
        sign = token[0]
        if token.lastgroup or depth > MAX_NESTING:
            raise NestedTooDeep(line + text.count("\n", begin, token.start()))
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


def locate_keys(text: str) -> dict[KeyPath, int]:
    """The line of every key and table of a valid TOML text, by path: ("body", 0, "mass") → 7.

    Keys within a value, such as {x = 1}, have no entry; `nearest_line` gives them the line of their statement.
    """
    lines: dict[KeyPath, int] = {(): 1}
    table: KeyPath = ()
    counts: dict[KeyPath, int] = {}
    for line, head in split_statements(text.replace("\r\n", "\n")):
        names, is_array = _split_names(head)
        if not head.startswith("["):
            for end in range(1, len(names) + 1):
                lines.setdefault(table + names[:end], line)
            continue
        table = _opened_path(names, is_array, counts)
        lines.setdefault(table, line)
        if isinstance(table[-1], int):  # the first of an array stands for it
            lines.setdefault(table[:-1], line)
    return lines


def nearest_line(lines: dict[KeyPath, int], path: KeyPath) -> int:
    """The line of a path, or of the innermost table or key with an entry that it lies in."""
    while path not in lines:
        path = path[:-1]
    return lines[path]


@lru_cache(1024)
def _split_names(head: str) -> tuple[KeyPath, bool]:
    """The names that a header or a key is made of, and whether it is the header of an [[array]]."""
    if BARE_KEY.fullmatch(head):
        return (head,), False
    value: Any = tomllib.loads(head if head.startswith("[") else f"{head} = 0")
    names: KeyPath = ()
    while isinstance(value, dict) and value:
        name, value = next(iter(value.items()))
        names += (name,)
    return names, isinstance(value, list)


def _opened_path(names: KeyPath, is_array: bool, counts: dict[KeyPath, int]) -> KeyPath:
    """The path that a header opens. counts: the number of the last table of each array; it is kept up to date."""
    path: KeyPath = ()
    for n, name in enumerate(names, 1):
        path += (name,)
        if is_array and n == len(names):
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path += (counts[path],)
    return path
