"""`uv run python -m bench pieces [PATCH …]`: render the pieces of the gallery, all or those of some patches. `canon` is
the one for three instruments. The rest of the gallery stays as it is."""

import re
import sys
import tomllib

import engine
from bench.publish import mixed
from bench.publish.gallery import PAGE, WORDS, play
from bench.publish.report import ROOT
from bench.publish.sounds import check_size

MIXED = "canon"


def main(names: list[str]) -> int:
    """Render the pieces of some patches, or of all, and describe them on the page; return the exit code."""
    words = tomllib.loads(WORDS.read_text("utf-8"))
    known = [*(name for name in words if "piece" in words[name]), MIXED]
    if unknown := [name for name in names if name not in known]:
        print(f"bench pieces: {unknown[0]} has no piece; {', '.join(known)} have one", file=sys.stderr)
        return 2
    page = PAGE.read_text("utf-8")
    for name in names or known:
        print(name, flush=True)
        if name == MIXED:
            mixed.make()
            page = mixed.insert(page)
        else:
            scene = engine.load(ROOT / "patches" / f"{name}.toml")
            page = replace_line(page, name, play(scene, words[name]["piece"], name))
    check_size()
    PAGE.write_text(page, "utf-8")
    return 0


def replace_line(page: str, name: str, line: str) -> str:
    """Return a page with another line for the piece of a patch."""
    return re.sub(rf"^.*\[{name}_piece\.ogg\].*$", lambda _: line, page, flags=re.MULTILINE)
