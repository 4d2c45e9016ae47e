"""docs/contact_signs.png: what at, side, barrier, gap and the signs of displacements mean, in one drawing."""

from typing import Any

from bench.publish.report import ROOT
from engine.report.figures import BLUE, ORANGE, open_figure

PICTURE = ROOT / "docs" / "contact_signs.png"
STRING_ENDS = 0.1, 0.9  # of the width of a panel
AT = 0.35  # fraction of the length
OFFSET = 0.55  # barrier or gap, in the unit of the drawing
GREY = "0.45"
TOUCHED = "0.25"
MONO = {"family": "monospace", "size": 9, "va": "top"}


def run() -> None:
    """Draw the four cases, and write the picture."""
    with open_figure(PICTURE, 10.0, 7.6, dpi=110, nrows=2, ncols=2) as panels:
        (above, below), (hammer, ball) = panels
        draw_barrier(above, side="above")
        draw_barrier(below, side="below")
        draw_bodies(hammer, side="above")
        draw_bodies(ball, side="below")
        above.figure.suptitle(
            "Displacements u are positive upwards, each from its body at rest. The compression s is positive while two"
            " things press\non each other, with the force that pushes them apart; it is negative while they are apart.",
            size=10,
        )
    print(PICTURE.relative_to(ROOT))


def draw_barrier(axes: Any, side: str) -> None:
    """A string and a fixed barrier on one side of it."""
    up = 1.0 if side == "above" else -1.0
    prepare(axes, f'A fixed barrier, side = "{side}"')
    x = place(AT)
    draw_string(axes, 0.0, "string")
    axes.text(STRING_ENDS[1] + 0.02, 0.0, "u = 0", va="center", size=9, color=GREY)
    axes.add_patch(hatched((x - 0.13, up * OFFSET + min(0.0, up * 0.22)), 0.26, 0.22))
    axes.text(x + 0.15, up * (OFFSET + 0.11), "barrier", va="center", size=9)
    measure(axes, x, 0.0, up * OFFSET, "barrier > 0" if up > 0 else "barrier < 0")
    show_at(axes, "at", -1.0 if up > 0 else 1.0)
    formula = "s = u − barrier" if up > 0 else "s = barrier − u"
    code = f'body = "string"\nat = {AT}\nside = "{side}"\nbarrier = {"2e-3" if up > 0 else "-2e-3"}'
    write(
        axes, code, f"{formula}\nthey touch where the string\nmoves {'up' if up > 0 else 'down'} to the barrier and on"
    )


def draw_bodies(axes: Any, side: str) -> None:
    """A mass and a string, or what else it touches, on one side of it."""
    up = 1.0 if side == "above" else -1.0
    name, other = ("hammer", "string") if up > 0 else ("ball", "membrane")
    prepare(axes, f'Two bodies, side = "{side}"')
    x, rest = place(AT), up * OFFSET
    draw_string(axes, rest, other)
    axes.add_patch(disc((x, -up * 0.13), 0.13))
    axes.text(x - 0.16, -up * 0.16, name, va="center", ha="right", size=9)
    arrow(axes, x, -up * 0.28, up * 0.22, GREY)
    measure(axes, x, 0.0, rest, "gap > 0")
    axes.plot((x - 0.18, x + 0.18), (0.0, 0.0), ":", color=GREY, lw=0.9)
    show_at(axes, "on_at", up)
    formula = f"s = u({name}) − u({other}) − gap" if up > 0 else f"s = u({other}) − u({name}) − gap"
    code = f'body = "{name}"\non = "{other}"\non_at = {AT if up > 0 else [AT, 0.5]}\nside = "{side}"\ngap = 1e-3'
    velocity = "> 0" if up > 0 else "< 0"
    write(axes, code, f"{formula}\nthe {other} is {side} the {name},\nwhose velocity {velocity} moves it there")


def prepare(axes: Any, title: str) -> None:
    """An empty panel, and the direction that is positive."""
    axes.set(xlim=(0.0, 1.0), ylim=(-2.15, 1.15))
    axes.set_axis_off()
    axes.set_title(title, size=11, loc="left", weight="bold")
    axes.annotate("", (0.035, 0.5), (0.035, -0.5), arrowprops={"arrowstyle": "->", "color": TOUCHED})
    axes.text(0.02, 0.56, "+u", size=10, va="bottom")


def place(fraction: float) -> float:
    """Where on a panel a fraction of the length lies."""
    return STRING_ENDS[0] + fraction * (STRING_ENDS[1] - STRING_ENDS[0])


def draw_string(axes: Any, rest: float, name: str) -> None:
    """A string, or a membrane from the side, at rest."""
    axes.plot(STRING_ENDS, (rest, rest), color=BLUE, lw=1.8)
    axes.plot(STRING_ENDS, (rest, rest), "o", color=TOUCHED, ms=4)
    axes.text(place(0.78), rest + 0.05, name, size=9, color=BLUE, va="bottom")


def measure(axes: Any, x: float, low: float, high: float, name: str) -> None:
    """A distance, with its name."""
    x += 0.07
    axes.annotate(
        "", (x, high), (x, low), arrowprops={"arrowstyle": "<->", "color": ORANGE, "shrinkA": 0, "shrinkB": 0}
    )
    axes.text(x + 0.015, (low + high) / 2, name, size=9, color=ORANGE, va="center",
              bbox={"fc": "white", "ec": "none", "pad": 1})  # fmt: skip


def show_at(axes: Any, key: str, side: float) -> None:
    """The fraction of the length at which two things touch, from the end that is 0. side: where it is drawn, ±1"""
    y = side * 0.95
    both_ends = {"arrowstyle": "<->", "color": GREY, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (place(AT), y), (place(0.0) + 0.015, y), arrowprops=both_ends)
    axes.text(place(AT / 2), y + 0.03, f"{key} × length", ha="center", va="bottom", size=9, color=GREY)
    for fraction in (0.0, 1.0):
        axes.text(place(fraction), y, f"{fraction:g}", ha="center", va="center", size=9, color=GREY,
                  bbox={"fc": "white", "ec": "none", "pad": 1})  # fmt: skip


def write(axes: Any, code: str, words: str) -> None:
    """The keys of the contact, and what they mean."""
    axes.text(0.06, -1.22, code, **MONO)
    axes.text(0.42, -1.22, words, size=10, va="top", linespacing=1.4)


def arrow(axes: Any, x: float, begin: float, length: float, colour: str) -> None:
    """An arrow along u."""
    axes.annotate("", (x, begin + length), (x, begin), arrowprops={"arrowstyle": "->", "color": colour})


def hatched(corner: tuple[float, float], width: float, height: float) -> Any:
    """A barrier."""
    from matplotlib.patches import Rectangle

    return Rectangle(corner, width, height, fc="0.9", ec=TOUCHED, hatch="////", lw=0.8)


def disc(middle: tuple[float, float], radius: float) -> Any:
    """A mass."""
    from matplotlib.patches import Ellipse

    return Ellipse(middle, 0.55 * radius, 2 * radius, fc="0.85", ec=TOUCHED)
