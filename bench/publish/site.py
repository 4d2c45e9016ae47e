"""`uv run --group docs python -m bench site [FOLDER] [--play]`: the guides as a static site, in build/site if no
folder is given. With --play, the patches play on it: the gallery links a page for each (bench/publish/playable.py).

README.md is its front page, and all of docs/*.md is in it, with the files that they link to: pictures and sounds as
they are, sources and notebooks as pages. A link or an anchor that leads nowhere stops the build. The site loads nothing
from another host. It can be opened from its folder; its search needs a server (`python -m http.server -d FOLDER`).
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from bench.publish.gallery import read_words
from bench.publish.playable import make_pages

ROOT = Path(__file__).parents[2]
CONFIGURATION = Path(__file__).with_name("site.yml")
NAVIGATION = {  # pages of docs; those that are not named here come last
    "Start here": ["installation", "first_patch", "gallery", "glossary"],
    "Gallery": [f"gallery_{family.name}" for family in read_words()[0]],
    "Guides": ["joining", "bodies", "instruments", "live", "files", "export", "accuracy", "limits"],
    "Reference": ["cli", "patches", "api", "start_up"],
    "Science": ["scheme", "paper", "guarantees", "ruler", "bench", "recordings", "did_not_pay"],
    "For developers": ["architecture", "design", "extending"],
}
OTHERS = "More"
MATH_CHARACTERS = [  # Latin, Greek, punctuation, letter-like, arrows and operators, italic and sans-serif letters
    *((0x20, 0x7E), (0xA0, 0xFF), (0x370, 0x3FF), (0x2000, 0x205F), (0x2100, 0x22FF)),
    *((0x1D434, 0x1D467), (0x1D5A0, 0x1D5D3), (0x1D6E2, 0x1D71B)),
]
LINK = re.compile(r"(?<=\]\()([^()\s#]+)(?=(?:#[^()\s]*)?\))")
PLAYABLE = "play"  # the folder of the pages that play
LISTEN = re.compile(r"^Listen: \[(\w+)\.ogg\]\(.*\)$", re.MULTILINE)  # in the gallery
TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json", ".csv": "text", ".sh": "sh", ".txt": "text"}


def main(words: list[str]) -> int:
    """Build the site; returns the exit code."""
    plays, words = "--play" in words, [word for word in words if word != "--play"]
    if len(words) > 1 or words[:1] in (["--help"], ["-h"]):
        print(__doc__)
        return 2 if len(words) > 1 else 0
    folder = Path(words[0]) if words else ROOT / "build" / "site"
    if folder.exists() and any(folder.iterdir()) and not (folder / "404.html").exists():
        print(f"bench site: {folder} has files that are no site; name an empty folder", file=sys.stderr)
        return 2
    return build(folder, plays=plays)


def build(folder: Path, root: Path = ROOT, plays: bool = False) -> int:
    """Build the site of a copy of the project; returns 0, or 1 if something is broken, and the folder is as before.

    plays: the gallery has a page for each patch that plays it
    """
    from mkdocs.commands.build import build as build_site
    from mkdocs.config import load_config
    from mkdocs.exceptions import MkDocsException

    with tempfile.TemporaryDirectory() as place:
        source, built = Path(place) / "source", Path(place) / "built"
        source.mkdir()
        stage(root, source)
        if plays:
            add_playable_pages(source)
        write_math_font(source / "styles" / "math.woff")
        settings: dict[str, Any] = {"docs_dir": str(source), "site_dir": str(built), "nav": navigation(source)}
        try:
            build_site(load_config(str(CONFIGURATION), strict=True, **settings))
        except (MkDocsException, ValueError) as error:
            print(f"bench site: {error}", file=sys.stderr)
            return 1
        if folder.exists():
            shutil.rmtree(folder)
        shutil.copytree(built, folder)
    return 0


def stage(root: Path, folder: Path) -> None:
    """Copy the guides and all that they link to, each to its own place in the folder."""
    known = files_of(root)
    waiting = ["README.md", *sorted(name for name in known if re.fullmatch(r"docs/[^/]+\.md", name))]
    done: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name in done:
            continue
        done.add(name)
        if not page_of(name):
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(root / name, target)
            continue
        page = list_folder(name, known) if name.endswith("/") else read_page(root / name)
        text, linked = redirect_links(page, name, root, known)
        waiting += linked
        target = folder / page_of(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")


def add_playable_pages(source: Path) -> None:
    """Make a page for each patch that plays it, and link them where the gallery has the sounds of the patches."""
    (source / PLAYABLE).mkdir()
    names = make_pages(source / PLAYABLE)

    def add_link(match: re.Match[str]) -> str:
        return f"{match[0]} – [play it](../{PLAYABLE}/{match[1]}.html)" if match[1] in names else match[0]

    for page in (source / "docs").glob("gallery_*.md"):
        page.write_text(LISTEN.sub(add_link, page.read_text("utf-8")), "utf-8")


def write_math_font(path: Path) -> None:
    """Write a font for formulas, since few systems have one: the characters in use, out of STIX Two Math."""
    from fontTools import subset

    package = find_spec("ziamath")
    if package is None or package.origin is None:
        raise ModuleNotFoundError("ziamath, which brings the font of formulas: uv sync --group docs installs it")
    options = subset.Options(layout_features=["*"], name_IDs=["*"], flavor="woff")
    font = subset.load_font(str(Path(package.origin).parent / "fonts" / "STIXTwoMath-Regular.ttf"), options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(unicodes=[code for first, last in MATH_CHARACTERS for code in range(first, last + 1)])
    subsetter.subset(font)
    path.parent.mkdir(parents=True, exist_ok=True)
    subset.save_font(font, str(path), options)


def files_of(root: Path) -> set[str]:
    """The files of the project: those that Git tracks or would track."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    return {name for name in listed.split("\0") if name and (root / name).exists()}


def page_of(name: str) -> str:
    """The Markdown file of the site that shows a file or a folder; empty for a file that is copied as it is."""
    if name.endswith("/"):
        return f"{name}index.md"
    suffix = Path(name).suffix
    return name if suffix == ".md" else f"{name}.md" if suffix in LANGUAGES or suffix == ".ipynb" else ""


def read_page(path: Path) -> str:
    """A file as Markdown."""
    text = path.read_text("utf-8")
    if path.suffix == ".md":
        return text
    if path.suffix == ".ipynb":
        cells = ((cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"])
        return "\n\n".join(source if kind == "markdown" else fenced(source, "python") for kind, source in cells)
    return f"# {path.name}\n\n{fenced(text, LANGUAGES[path.suffix])}"


def list_folder(name: str, known: set[str]) -> str:
    """A folder as Markdown: links to the files of the project in it."""
    files = sorted(other.removeprefix(name) for other in known if other.startswith(name))
    return "\n".join([f"# {name}", "", *(f"- [{file}]({file})" for file in files if "/" not in file), ""])


def fenced(text: str, language: str) -> str:
    """Text as a block of code."""
    return f"````{language}\n{text.rstrip()}\n````\n"


def redirect_links(text: str, name: str, root: Path, known: set[str]) -> tuple[str, list[str]]:
    """A page with its links to sources and folders led to the pages of these, and what of the project it links to.

    Others are left as they are: the build finds those that lead nowhere.
    """
    linked: list[str] = []
    here = root / name if name.endswith("/") else (root / name).parent

    def redirect(match: re.Match[str]) -> str:
        target = (here / match[1]).resolve()
        relative = target.relative_to(root.resolve()).as_posix() if target.is_relative_to(root.resolve()) else ""
        if any(other.startswith(f"{relative}/") for other in known):
            linked.append(f"{relative}/")
            return f"{match[1].rstrip('/')}/index.md"
        if relative not in known:
            return match[1]
        linked.append(relative)
        return match[1] + page_of(relative).removeprefix(relative)

    return LINK.sub(redirect, text), linked


def navigation(source: Path) -> list[Any]:
    """The navigation of all guides, in the groups that are named above."""
    pages = {path.stem: path for path in sorted((source / "docs").glob("*.md")) if "." not in path.stem}
    groups = {group: [name for name in names if name in pages] for group, names in NAVIGATION.items()}
    named = {name for names in groups.values() for name in names}
    groups[OTHERS] = [name for name in pages if name not in named]
    parts = {group: [{title_of(pages[name]): f"docs/{name}.md"} for name in names] for group, names in groups.items()}
    return [{"FDH engine": "README.md"}, *({group: part} for group, part in parts.items() if part)]


def title_of(page: Path) -> str:
    """The first heading of a page."""
    found = TITLE.search(page.read_text("utf-8"))
    return found[1] if found else page.stem
