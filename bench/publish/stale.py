"""`uv run python -m bench stale [--mark]`: which published tables were measured with kernels other than the present.

The caption of a table names the kernels that it measured, by the first digits of the digest of their machine code in
the archive for x86-64-v3, which is the same on every machine: a comment in a source changes nothing. With --mark, the
pages of docs mark the tables of older kernels, those that name none among them, and docs/bench.md and
docs/recordings.md list theirs at the top. That takes no measurement.
"""

import hashlib
import re
import textwrap
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from engine.compiler import cache
from engine.compiler.shipped import archive, read_about, read_part, sources_of
from engine.compiler.targets import target_named

ROOT = Path(__file__).parents[2]
LINE_LENGTH = 120  # of the summary
DIGITS = 8  # of a digest, in a caption
MARK = ", **older kernels**"  # at the end of a caption
TABLE = re.compile(r"<!-- bench:(\w+) -->\n(.*?)<!-- /bench:\1 -->", re.DOTALL)
CAPTION = re.compile(r"^`uv run python -m bench (\w+)`, ([\d-]+), .*$", re.MULTILINE)
KERNELS = re.compile(rf", kernels ([0-9a-f]{{{DIGITS}}})\b")
SUMMARY = re.compile(r"<!-- older kernels -->\n.*?<!-- /older kernels -->", re.DOTALL)


class PublishedTable(NamedTuple):
    """A table on a page, as its caption says."""

    name: str
    command: str  # the measurement that makes it
    date: str
    kernels: str | None  # that it measured, separated by commas; None if it does not say

    def is_older(self, present: str) -> bool:
        """True if any of it measured other kernels than the present ones, or does not say which."""
        return self.kernels != present


@lru_cache
def present_kernels(path: Path | None = None) -> str:
    """The first digits of the digest of the machine code in an archive, by default in that for x86-64-v3."""
    path = path or archive(target_named("linux-x86-64-v3"))
    parts = sorted(read_about(path)["parts"])
    return hashlib.sha256(b"".join(read_part(path, part).machine_code for part in parts)).hexdigest()[:DIGITS]


def measured_kernels() -> str:
    """What a new table has measured: the kernels of the archives, or the digits of the present sources if the archives
    were made from others."""
    present = sources_of(archive(target_named("linux-x86-64-v3"))) == cache.source_digest()
    return present_kernels() if present else cache.source_digest()[:DIGITS]


def tables_of(text: str) -> list[PublishedTable]:
    """The tables of a page that have a caption."""
    tables = []
    for name, block in TABLE.findall(text):
        if caption := CAPTION.search(block):
            tables.append(PublishedTable(name, caption[1], caption[2], kernels_of(caption[0])))
    return tables


def kernels_of(caption: str) -> str | None:
    """The kernels that a caption names, separated by commas; None if it names none."""
    return ", ".join(dict.fromkeys(KERNELS.findall(caption))) or None


def mark_older(text: str, present: str) -> str:
    """A page with the captions of its tables of older kernels marked, those of the present ones not, and its summary of
    them, where it has one, made anew."""

    def mark(caption: re.Match[str]) -> str:
        plain = caption[0].removesuffix(MARK)
        return plain if kernels_of(plain) == present else plain + MARK

    marked = TABLE.sub(lambda table: CAPTION.sub(mark, table[0]), text)
    return SUMMARY.sub(lambda _: f"<!-- older kernels -->\n{summarise(text, present)}\n<!-- /older kernels -->", marked)


def summarise(text: str, present: str) -> str:
    """How many tables of a page are of older kernels, and the measurements that make them, in a sentence."""
    tables = tables_of(text)
    older = [table for table in tables if table.is_older(present)]
    if not older:
        return f"All {len(tables)} tables of this page were measured with the present kernels."
    commands = ", ".join(f"`{command}`" for command in dict.fromkeys(table.command for table in older))
    count = f"{len(older)} of the" if len(older) < len(tables) else "All"
    sentence = (
        f"{count} {len(tables)} tables of this page were measured with older kernels, and their captions say so. These "
        f"measurements make them: {commands}."
    )
    return textwrap.fill(sentence, LINE_LENGTH, break_on_hyphens=False)


def marked_pages() -> list[Path]:
    """The pages of which tables are marked."""
    return sorted((ROOT / "docs").glob("*.md"))


def mark_pages() -> None:
    """Mark the tables of older kernels on all pages."""
    for page in marked_pages():
        text = page.read_text("utf-8")
        if (marked := mark_older(text, present_kernels())) != text:
            page.write_text(marked, "utf-8")


def is_finished(command: str) -> bool:
    """True if a measurement makes tables, and all of them are of the present kernels."""
    pages = (ROOT / "README.md", *marked_pages())
    tables = [table for page in pages for table in tables_of(page.read_text("utf-8")) if table.command == command]
    return bool(tables) and not any(table.is_older(present_kernels()) for table in tables)


def older_tables() -> Iterator[tuple[Path, PublishedTable]]:
    """The tables of older kernels on all pages, those of the README first."""
    for page in (ROOT / "README.md", *marked_pages()):
        for table in tables_of(page.read_text("utf-8")):
            if table.is_older(present_kernels()):
                yield page, table


def main(words: list[str]) -> int:
    """Print the tables of older kernels, or mark them with --mark; return the exit code."""
    if words not in ([], ["--mark"]):
        print("bench stale: unknown " + " ".join(words) + "; --mark, or nothing")
        return 2
    if words:
        mark_pages()
    for page, table in older_tables():
        kernels = f"kernels {table.kernels}" if table.kernels else "kernels not named"
        print(f"{table.command:<12} {table.name:<22} {table.date}  {kernels:<18} {page.relative_to(ROOT)}")
    print(f"the present kernels are {present_kernels()}")
    return 0
