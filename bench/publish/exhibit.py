"""`uv run python -m bench exhibit [--numbers] PATCH …`: make the parts of docs/gallery.md that show these patches. The
others stay as they are, and the page says what was made when; `bench gallery` makes all of it. With --numbers, pictures
and sounds stay too, and without a PATCH it makes the numbers of all."""

import csv
import re
import sys
import tomllib

from bench.publish import stale
from bench.publish.gallery import PAGE, PICTURES, WORDS, exhibit
from bench.publish.report import RESULTS, ROOT, stamp
from bench.publish.sounds import SOUNDS, check_size

TABLE = re.compile(r"(<!-- bench:gallery -->\n)(.*?)(\n<!-- /bench:gallery -->)", re.DOTALL)
SECTIONS = re.compile(r"^## .*(?=^`uv run python -m bench gallery`)", re.DOTALL | re.MULTILINE)
SECTION = re.compile(r"^## (\w+)\n.*?(?=^## |\Z)", re.DOTALL | re.MULTILINE)


NUMBERS = "--numbers"


def main(arguments: list[str]) -> int:
    """Make the parts of some patches, in the order of bench/gallery.toml."""
    words = tomllib.loads(WORDS.read_text("utf-8"))
    of_numbers, names = NUMBERS in arguments, [name for name in arguments if name != NUMBERS]
    names = names or (list(words) if of_numbers else [])
    if not names or (unknown := [name for name in names if name not in words]):
        print(f"bench exhibit: {WORDS.name} has no {unknown[0]}" if names else __doc__, file=sys.stderr)
        return 2
    PICTURES.mkdir(exist_ok=True)
    SOUNDS.mkdir(exist_ok=True)
    present = parts_of(PAGE.read_text("utf-8")) if of_numbers else {}
    made = {}
    for name in names:
        print(name, flush=True)
        made[name] = exhibit(ROOT / "patches" / f"{name}.toml", words[name], present.get(name))
    check_size()
    shown = "all" if len(names) == len(words) else ", ".join(names)
    caption = f"{stamp('exhibit')}: {'numbers of ' if of_numbers else ''}{shown}"
    rows = replace_rows({name: row for name, (row, _) in made.items()}, list(words), caption)
    PAGE.write_text(
        replace_parts(rows, {name: part for name, (_, part) in made.items()}, list(words), caption), "utf-8"
    )
    stale.mark_pages()
    return 0


def parts_of(page: str) -> dict[str, str]:
    """Return the parts of the page, by the names of their patches."""
    sections = SECTIONS.search(page)
    assert sections is not None  # the page ends in its caption
    return {section[1]: section[0] for section in SECTION.finditer(sections[0])}


def replace_rows(made: dict[str, list[str]], order: list[str], caption: str) -> list[list[str]]:
    """Replace rows of bench/results/gallery.csv; return its header and all rows in order."""
    path = RESULTS / "gallery.csv"
    with open(path, newline="", encoding="utf-8") as file:
        captions, header, *rows = csv.reader(file)
    by_name = {row[0][1 : row[0].index("]")]: row for row in rows} | made
    rows = [by_name[name] for name in order if name in by_name]
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([[", ".join(captions) + f"; {caption}"], header, *rows])
    return [header, *rows]


def replace_parts(rows: list[list[str]], made: dict[str, str], order: list[str], caption: str) -> str:
    """Return the page with a table of these rows, and with the parts of some patches in their places."""
    page = PAGE.read_text("utf-8")
    lines = ["| " + " | ".join(row) + " |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]]]

    def renew(table: re.Match[str]) -> str:
        captions = table[2].partition("\n\n")[2]
        return table[1] + "\n".join([*lines, "", captions, "", caption]) + table[3]

    page = TABLE.sub(renew, page)
    parts = parts_of(page) | {name: f"{part}\n" for name, part in made.items()}
    sections = SECTIONS.search(page)
    assert sections is not None  # as in parts_of
    shown = "".join(parts[name] for name in order if name in parts)
    return page[: sections.start()] + shown + page[sections.end() :]
