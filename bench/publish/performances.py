"""`uv run python -m bench pieces [PATCH …]`: render the pieces of the gallery, all or those of some patches. `canon` is
the one for three instruments. The rest of the gallery stays as it is."""

import re
import sys

import engine
from bench.publish import mixed
from bench.publish.gallery import PAGE, path_of, play, read_words
from bench.publish.sounds import check_size

MIXED = "canon"


def main(names: list[str]) -> int:
    """Render the pieces of some patches, or of all, and describe them on their pages; return the exit code."""
    families, words = read_words()
    known = [*(name for name in words if "piece" in words[name]), MIXED]
    if unknown := [name for name in names if name not in known]:
        print(f"bench pieces: {unknown[0]} has no piece; {', '.join(known)} have one", file=sys.stderr)
        return 2
    page_of = {name: family.page for family in families for name in family.patches}
    for name in names or known:
        print(name, flush=True)
        if name == MIXED:
            mixed.make()
            PAGE.write_text(mixed.insert(PAGE.read_text("utf-8")), "utf-8")
        else:
            line = play(engine.load(path_of(name)), words[name]["piece"], name)
            page_of[name].write_text(replace_line(page_of[name].read_text("utf-8"), name, line), "utf-8")
    check_size()
    return 0


def replace_line(page: str, name: str, line: str) -> str:
    """Return a page with another line for the piece of a patch."""
    return re.sub(rf"^.*\[{name}_piece\.ogg\].*$", lambda _: line, page, flags=re.MULTILINE)
