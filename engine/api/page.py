"""A patch as a page that plays, from Python and in a notebook."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from html import escape, unescape
from pathlib import Path

from engine.api.pilot import Pilot
from engine.argument_checks import checked_integer
from engine.compiler.kernel_name import KernelName
from engine.export.faults import CannotExport
from engine.export.film import still_of
from engine.export.page import PageSettings, make_page
from engine.live.key_allocator import live_scene
from engine.live.player import Player
from engine.output_files import write_text
from engine.patch.scene import Scene, check_scene

PILOT_SECONDS = 2.0  # of a scene, that are played to find its level
BLOCK = 256  # frames
NOTEBOOK_HEIGHT = 760  # pixels, of a page in a notebook
KERNELS = (KernelName.GENERAL, KernelName.SPECIAL)


@dataclass(frozen=True)
class Page:
    """A page that plays a patch. A notebook shows it.

    html: the whole file
    """

    html: str

    @property
    def policy(self) -> str:
        """The Content-Security-Policy of the page, with hashes of its script and its style: what a site that sends one
        of its own needs to allow."""
        policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', self.html)
        return unescape(policy[1]) if policy else ""

    def save(self, path: str | Path) -> None:
        """Write the page to a file, which a browser opens. Raises OSError if it cannot be written; what was there
        before is kept then."""
        write_text(Path(path), self.html)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: the page in a frame."""
        style = f"width: 100%; height: {NOTEBOOK_HEIGHT}px; border: 0"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}" allow="autoplay; midi"></iframe>'


@dataclass(frozen=True)
class Picture:
    """A picture of a patch. A notebook shows it.

    png: the whole file
    """

    png: bytes

    def _repr_png_(self) -> bytes:
        """Return what a notebook shows."""
        return self.png


def show(scene: Scene) -> Page | Picture:
    """Return what a notebook shows of a scene: the page that plays it and draws what moves, without its header, patch
    and footer; where the scene cannot become a page, a picture of what moves, soon after its beginning.

    Raises CannotExport (a ValueError), which says why there is no page, if nothing of it can be drawn either;
    ImportError if the picture lacks matplotlib.

    >>> import fdh
    >>> page = fdh.show(fdh.load("bouncing_ball"))
    >>> page.save("ball.html")
    """
    check_scene(scene)
    try:
        page = export_page(scene)
    except CannotExport as reason:
        try:
            return Picture(still_of(scene))
        except CannotExport:
            raise reason from None
    return Page(page.html.replace("<body>", '<body class="embed">', 1))


def export_page(
    scene: Scene,
    samplerate: int = 44_100,
    kernel: str = "general",
    text: str | None = None,
    command: str = "fdh.export_page(scene)",
    slide: Sequence[str] = (),
    voices: int = 0,
) -> Page:
    """Make a page that plays a scene in any browser, computed there: one HTML file that needs no network.

    samplerate: Hz
    kernel:  general, the same for all patches; or special, compiled for this one, which takes a minute: a page of half
             the size, which takes half the time
    text:    of the patch, which the page shows; the scene as JSON if None
    command: that makes the page, which it shows
    slide:   live parameters that get a slider, such as `body.string.frequency`: a pitch, a tension, a length or a loss
             needs tables for each of 25 positions, which make the page larger; `bend` is an instrument's pitch wheel
    voices:  of a patch that is no instrument: how many notes of a keyboard, on which it is tuned, sound at a time

    >>> import fdh
    >>> page = fdh.export_page(fdh.load("piano_c4"))  # doctest: +SKIP
    >>> page.save("piano_c4.html")  # doctest: +SKIP

    Raises TypeError or ValueError for a wrong argument; CannotExport (a ValueError) with the reason if the scene cannot
    become a page; BuildError (a ValueError) if it cannot be built.
    """
    check_scene(scene)
    samplerate = checked_integer("samplerate", samplerate)
    if kernel not in KERNELS:
        raise ValueError(f"no kernel of a page is called {kernel!r}; there are {' and '.join(KERNELS)}")
    if (voices := checked_integer("voices", voices)) < 0:
        raise ValueError(f"voices = {voices} is out of range; give 0, which means no keyboard, or more")
    if text is None:
        text = scene.model_dump_json(exclude_unset=True, indent=2)
    about = {"title": scene.title or "A patch", "text": text, "command": command}
    return Page(
        make_page(
            scene,
            partial(level_of, scene, samplerate),
            PageSettings(samplerate, kernel, (slide,) if isinstance(slide, str) else slide, voices),
            about,
        )
    )


def level_of(scene: Scene, samplerate: int) -> float:
    """Return the gain of the scene's `level`; if it has none, that which brings to half of full scale its first two
    seconds, or the middle key of an instrument, as loud as can be."""
    if scene.level_factor is not None:
        return scene.level_factor
    is_instrument = scene.instrument is not None
    played = live_scene(scene) if is_instrument else scene
    kernel = KernelName.GENERAL  # which need not be compiled
    make = partial(Player, played, samplerate, math.inf, waiting=is_instrument, kernel=kernel)
    return Pilot(make, BLOCK, 0.0 if is_instrument else PILOT_SECONDS, plays_keys=is_instrument).gain
