"""`uv run python -m bench playable [FOLDER]`: a static site on which every shipped patch plays, in build/playable if no
folder is given.

Each patch is one page that needs nothing else, and index.html leads to them. Copy the folder to any static host, or
open it from disk.
"""

import shutil
import sys
import tempfile
from html import escape
from pathlib import Path

import engine
from engine.api.page import export_page
from engine.export.faults import CannotExport
from engine.export.page import template
from engine.files import SHIPPED_PATCHES, shipped_names

ROOT = Path(__file__).parents[2]
HEAD = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Patches that play</title>
<style>{style}
ul {{ list-style: none; padding: 0; display: grid; gap: .6rem;
  grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); }}
li a {{ display: block; padding: .7rem .9rem; border-radius: .6rem; background: var(--card); color: var(--ink);
  text-decoration: none; }}
li a:hover {{ outline: 2px solid var(--accent); }}
</style>
</head>
<body>
<h1>Patches that play</h1>
<p class="soft">Each page computes its sound itself: bodies that vibrate and really collide. Recent Chrome, Edge,
Firefox and Safari play them.</p>
<ul>
"""


def main(words: list[str]) -> int:
    """Build the site; returns the exit code."""
    if len(words) > 1 or words[:1] in (["--help"], ["-h"]):
        print(__doc__)
        return 0 if len(words) == 1 else 2
    folder = Path(words[0] if words else ROOT / "build" / "playable")
    with tempfile.TemporaryDirectory() as temporary:
        made = make_pages(Path(temporary))
        if folder.exists():
            shutil.rmtree(folder)
        shutil.copytree(temporary, folder)
    size = sum(path.stat().st_size for path in folder.iterdir())
    print(f"{folder}: {len(made)} pages, {size / 1e6:.1f} MB; open {folder / 'index.html'}")
    return 0


def make_pages(folder: Path) -> list[str]:
    """Write a page for each shipped patch that can become one, and the index. Returns the names of the patches."""
    made, entries = list[str](), list[str]()
    for name in shipped_names():
        path, scene = SHIPPED_PATCHES / f"{name}.toml", engine.load(name)
        try:
            page = export_page(scene, text=path.read_text("utf-8"), command=f"fdh export {name}")
        except CannotExport as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        page.save(folder / f"{name}.html")
        made.append(name)
        entries.append(f'<li><a href="{escape(name)}.html">{escape(scene.title or name)}</a></li>\n')
    index = HEAD.format(style=template("page.css")) + "".join(entries) + "</ul>\n</body>\n</html>\n"
    (folder / "index.html").write_text(index, "utf-8")
    return made
