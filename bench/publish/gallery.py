"""The gallery: every patch with a picture, a sound, what to listen for, its sources, and two changes to try: a page for
each family of patches, and docs/gallery.md, which lists all.

The words are in bench/gallery.toml; all that is measured is measured here, from the patches as they are.
"""

import csv
import hashlib
import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.publish import mixed
from bench.publish.pieces import PIECES
from bench.publish.report import RESULTS, ROOT, publish, stamp
from bench.publish.sounds import SOUNDS, check_size, hear
from engine.analysis.features import features
from engine.analysis.string_shape import string_shape
from engine.instrument.expansion import expand_for_score
from engine.patch.paths import locate
from engine.report import plots
from engine.sweep.axes import SweepAxis
from engine.sweep.plan import scene_at

PAGE, WORDS = ROOT / "docs" / "gallery.md", ROOT / "bench" / "gallery.toml"
TEMPLATES = ROOT / "patches" / "templates"
PICTURES = ROOT / "docs" / "gallery"
TAIL = 2.0  # s, after a piece
COLOURS = 160  # of a picture
HEADER = [
    "patch",
    "length, s",
    "fundamental, Hz",
    "decay T60, s",
    "centroid, Hz",
    "peak, SI units",
    "energy error",
    "digest of the patch",
]
INTRODUCTION = """# Gallery

A picture and the sound of every patch, and two changes to try, with their measured effects: a page for each family.
Most instruments, such as the [guitar](gallery_plucked.md#guitar) and the [piano](gallery_pianos.md#piano), also play a
piece of half a minute or more.

<!-- families -->
<!-- /families -->

To render a patch, give its name: `uv run fdh render tanpura` writes `tanpura.wav`. A change such as
`contact.felt.on_at=0.5` sets the key `on_at` of the contact `felt`; `contact.0` is the first contact. This command
renders the patch with the change, into the folder `try`:
`uv run fdh sweep piano_c4 --vary contact.felt.on_at=0.5 -o try/`.
To make a sound of your own, copy the patch, `cp patches/tanpura.toml my_tanpura.toml`, and edit the copy
([first patch](first_patch.md)). The [glossary](glossary.md) explains the words.

`uv run python -m bench gallery` makes these pages, their pictures and their sounds.

<!-- mixed -->
<!-- /mixed -->
"""
LEGEND = """The fundamental is the lowest partial within 20 dB of the strongest; "none" means that no partial stands
out. T60 is computed from the energy that is still to come, between -5 and -25 dB; "none" means that the sound does
not fall so far, or not as decaying modes do. The centroid is the mean frequency, weighted by power. The digest is
the beginning of the SHA-256 of the patch; a test uses it to find out if this page is out of date.
"""
PLAYED = re.compile(r"^.*\(audio/\w+_piece\.ogg\).*$", re.MULTILINE)
COLUMNS = """| change | description | fundamental, Hz | T60, s | centroid, Hz | level, dB |
| --- | --- | --- | --- | --- | --- |"""
SECTION = re.compile(r"^## (\w+)\n.*?(?=^## |\Z)", re.DOTALL | re.MULTILINE)


class Family(NamedTuple):
    """Patches that share a page."""

    name: str
    title: str
    about: str
    patches: list[str]

    @property
    def page(self) -> Path:
        """Its page."""
        return PAGE.with_name(f"gallery_{self.name}.md")


def read_words() -> tuple[list[Family], dict[str, Any]]:
    """Return the families, and the words of each patch, in the order in which they are shown."""
    words = tomllib.loads(WORDS.read_text("utf-8"))
    families = [Family(**table) for table in words.pop("family")]
    return families, {name: words[name] for family in families for name in family.patches}


def path_of(name: str) -> Path:
    """The file of a patch, or of a template."""
    path = ROOT / "patches" / f"{name}.toml"
    return path if path.exists() else TEMPLATES / f"{name}.toml"


def run() -> None:
    """Render, draw and measure everything, and write the pages."""
    make(list(read_words()[1]), False, "gallery")
    mixed.make()
    check_size()


def make(names: list[str], of_numbers: bool, command: str) -> None:
    """Make the parts of some patches, and write all pages; the others stay as they are. of_numbers: pictures and sounds
    stay, too"""
    families, words = read_words()
    PICTURES.mkdir(exist_ok=True)
    SOUNDS.mkdir(exist_ok=True)
    parts = read_parts(families)
    captions, rows = read_rows()
    for name in names:
        print(name, flush=True)
        rows[name], parts[name] = exhibit(path_of(name), words[name], parts.get(name) if of_numbers else None)
    check_size()
    for family in families:
        head = [f"# {family.title}", "", f"{family.about} [All families](gallery.md).", ""]
        shown = [parts[name] for name in family.patches if name in parts]
        family.page.write_text("\n".join([*head, *shown]), "utf-8")
    PAGE.write_text(index(families), "utf-8")
    for family in families:
        for name in set(family.patches) & set(rows):
            rows[name][0] = f"[{name}]({family.page.name}#{name})"
    shown_names = "all" if len(names) == len(words) else ", ".join(names)
    caption = f"{stamp(command)}: {shown_names}"
    captions = [old for old in captions if not is_replaced(old, caption)] + [caption]
    publish("gallery", HEADER, [rows[name] for name in words if name in rows], made="\n\n".join(captions))


def is_replaced(old: str, new: str) -> bool:
    """True if all that a caption says was measured is measured anew, as another one says."""
    before, after = (set(caption.rpartition(": ")[2].split(", ")) for caption in (old, new))
    return after == {"all"} or before <= after


def index(families: list[Family]) -> str:
    """The page that lists all."""
    lines = [f"- [{family.title}]({family.page.name}): {', '.join(family.patches)}" for family in families]
    listed = "<!-- families -->\n" + "\n".join(lines) + "\n<!-- /families -->"
    introduction = mixed.insert(INTRODUCTION).replace("<!-- families -->\n<!-- /families -->", listed)
    return "\n".join([introduction, "<!-- bench:gallery -->\n<!-- /bench:gallery -->\n", LEGEND])


def read_parts(families: list[Family]) -> dict[str, str]:
    """Return the parts of the pages as they are, by the names of their patches."""
    texts = [family.page.read_text("utf-8") for family in families if family.page.exists()]
    return {part[1]: part[0].rstrip("\n") + "\n" for text in texts for part in SECTION.finditer(text)}


def read_rows() -> tuple[list[str], dict[str, list[str]]]:
    """Return the captions and the rows of the table as it is, by the names of their patches."""
    with open(RESULTS / "gallery.csv", newline="", encoding="utf-8") as file:
        (made,), _, *rows = csv.reader(file)
    captions = made.removeprefix("# ").split("\n\n")
    return captions, {row[0][1 : row[0].index("]")]: row for row in rows}


def exhibit(path: Path, words: dict[str, Any], present: str | None = None) -> tuple[list[str], str]:
    """A row of the table, and a part of the page. present: the part as it is, of which only numbers are made anew; its
    pictures and sounds too if None"""
    scene = engine.load(path)
    rendering = engine.render(scene, trace=present is None)
    found = features(rendering.audio, rendering.samplerate)
    if present is None:
        hear(rendering, SOUNDS / f"{path.stem}.ogg")
        see(scene, rendering, PICTURES / f"{path.stem}.png")
    energy = rendering.stats["energy"]["error_max"]
    numbers = [cell(found[key]) for key in ("fundamental_hz", "t60_s", "centroid_hz")]
    row = [path.stem, f"{scene.seconds:g}", *numbers, f"{found['peak']:.2g}", f"{energy:.0e}", mark(path)]
    lines = [f"## {path.stem}", "", f"**{scene.title}.** {words['listen']}", ""]
    lines += [f"![{scene.title}](gallery/{path.stem}.png)", "", f"Listen: [{path.stem}.ogg](audio/{path.stem}.ogg)", ""]
    if "piece" in words:
        played = None if present is None else PLAYED.search(present)
        lines += [played[0] if played else play(scene, words["piece"], path.stem), ""]
    lines += [COLUMNS, "| none | the patch as it is | " + " | ".join(numbers) + " | 0 |"]
    lines += [attempt(path, trial, found) for trial in words["try"]]
    lines += ["", f"Sources: {sources(path)}", ""]
    return row, "\n".join(lines)


def play(scene: engine.Scene, piece: str, name: str) -> str:
    """Render a piece, and say what it is."""
    score = PIECES[piece].score
    document = (scene.instrument or {}) | {"seconds": score.end + TAIL}
    rendering = engine.render(scene.with_expansion(expand_for_score(document, score)))
    hear(rendering, SOUNDS / f"{name}_piece.ogg")
    error = rendering.stats.energy.error_max
    sound = f"A piece of {score.end + TAIL:.0f} s: [{name}_piece.ogg](audio/{name}_piece.ogg)"
    return f"{sound}. {PIECES[piece].about}. {len(score.notes)} notes, energy error {error:.0e}."


def attempt(path: Path, trial: dict[str, Any], before: dict[str, float | None]) -> str:
    """A change to try, as a line of a table, with what it does."""
    after = features(engine.render(changed(path, trial["set"])).audio, 44_100)
    level = 20 * np.log10((after["rms"] or np.nan) / (before["rms"] or np.nan))
    changes = [f"`{what}={shown(value)}`" for what, value in trial["set"].items()]
    changes = [changes[0], trial["as"]] if "as" in trial else changes
    numbers = [cell(after[key]) for key in ("fundamental_hz", "t60_s", "centroid_hz")]
    return "| " + " | ".join([", ".join(changes), trial["what"], *numbers, f"{level:+.0f}"]) + " |"


def changed(path: Path, values: dict[str, Any]) -> engine.Scene:
    """A patch with some of its values changed. Raises ValueError if it has no such values."""
    data, scene = tomllib.loads(path.read_text("utf-8")), engine.load(path)
    axes = [SweepAxis(what, locate(what, scene, data)[0], (value,)) for what, value in values.items()]
    return scene_at(data, str(path), axes, tuple(values.values()))


def shown(value: Any) -> str:
    """A value as one would write it: in few digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def cell(value: float | None) -> str:
    """A number of a few digits, or that there is none."""
    return "none" if value is None else f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def mark(path: Path) -> str:
    """What the sound of a patch was made of: all but its level, which normalised files do not have."""
    return hashlib.sha256(re.sub(rb"(?m)^level = .*\n", b"", path.read_bytes())).hexdigest()[:10]


def sources(path: Path) -> str:
    """The comment at the head of a patch: what it is and where its numbers are from."""
    found = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("#"):
            break
        if not line.startswith("#:"):
            found.append(line.lstrip("# "))
    return " ".join(found)


def see(scene: engine.Scene, rendering: engine.Rendering, path: Path) -> None:
    """A small picture of the render."""
    from PIL import Image

    plots.plot_rendering(rendering, scene.title, path, string_shape(scene, rendering))
    with Image.open(path) as drawn:
        small = drawn.convert("RGB").quantize(COLOURS)
    small.save(path, optimize=True)
