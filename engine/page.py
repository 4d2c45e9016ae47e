"""A page of a render, to listen to and look at: one file of HTML that holds all it shows and asks for no network."""

import base64
import datetime
import io
import json
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine import draw, tell
from engine.feedback import finite
from engine.machine import machine

if TYPE_CHECKING:
    from engine.offline import Take

SHORT = 3.0  # s; what is longer is embedded as Ogg Vorbis, a tenth of the size
PLAYED = (8_000, 48_000)  # Hz, rates that every browser plays
ALARMS = ("NOT TO BE TRUSTED", "TOO SLOW")  # rows of the summary
PIECE = 1 << 16  # frames; libsndfile's Vorbis encoder has no stack for very many at once
# nothing is loaded from anywhere, and no script runs, whatever a patch has written into it
POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'"

STYLE = """
:root { color-scheme: light dark; --ink: #1d2129; --soft: #5d6470; --line: #dfe3e8; --card: #f5f7f9; --page: #fff;
  --accent: #1f6fb2; --bad: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --soft: #9aa2ad; --line: #2e343d; --card: #1c2128;
  --page: #14171c; --accent: #6cb2ee; --bad: #ff8a80; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1rem 3rem; max-width: 48rem; background: var(--page); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; overflow-wrap: anywhere; }
h1 { margin: 0; font-size: clamp(1.5rem, 5vw, 2.1rem); line-height: 1.2; text-wrap: balance; }
h2 { margin: 2.6rem 0 .8rem; padding-bottom: .3rem; border-bottom: 1px solid var(--line); font-size: 1.2rem; }
p { margin: .5rem 0; }
.soft, figcaption, footer { color: var(--soft); font-size: .875rem; }
audio { display: block; width: 100%; margin: 1.4rem 0 .4rem; }
dl { display: grid; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr)); gap: .6rem; margin: 1.4rem 0; }
dl div { padding: .7rem .85rem; border-radius: .6rem; background: var(--card); }
dt { color: var(--soft); font-size: .8rem; }
dd { margin: 0; font-size: 1.3rem; font-weight: 600; font-variant-numeric: tabular-nums; }
figure { margin: 0 0 1.5rem; }
img { display: block; max-width: 100%; height: auto; }
.scroll { overflow-x: auto; margin: .5rem 0 1rem; }
table { width: 100%; border-collapse: collapse; font-size: .875rem; font-variant-numeric: tabular-nums; }
th, td { padding: .35rem .9rem .35rem 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top;
  overflow-wrap: break-word; }
th { min-width: 7.5rem; font-weight: 500; color: var(--soft); }
.wide th, .wide td { min-width: 0; white-space: nowrap; }
.wide th:first-child { position: sticky; left: 0; background: var(--page); }
.bad th, .bad td { color: var(--bad); font-weight: 600; }
pre { overflow-x: auto; margin: 0; padding: 1rem; border-radius: .6rem; background: var(--card); font-size: .8125rem;
  line-height: 1.5; overflow-wrap: normal; tab-size: 4; }
details td { overflow-wrap: anywhere; }
summary { cursor: pointer; color: var(--accent); }
footer { margin-top: 3rem; padding-top: .8rem; border-top: 1px solid var(--line); }
"""


def page(
    title: str,
    text: str,
    take: "Take",
    audio: np.ndarray,
    stats: dict[str, Any],
    explained: dict[str, Any],
    priced: dict[str, Any] | None = None,
) -> str:
    """The whole page, as text.

    title, text: of the patch
    take:        the render, with its trace
    audio:       [frames, channels], at the level of the file
    stats:       what `--json` prints
    explained:   what engine.explain gives; priced: what engine.price gives, if it was asked

    Raises ValueError without a trace.
    """
    made, when = machine(), datetime.datetime.now().astimezone()
    channels = f"{stats['channels']} channels" if stats["channels"] > 1 else "mono"
    words = (Path(stats["patch"]).name, f"{stats['seconds']:g} s", channels, f"{stats['samplerate']} Hz")
    parts = [
        f"<header><h1>{escape(title)}</h1><p class=soft>{escape(' · '.join(words))}</p></header><main>",
        *player(title, audio, take.samplerate, stats["output"]),
        *key(stats, explained),
        *pictures(take, stats),
        "<h2>What was rendered</h2>",
        *table(tell.summed(stats).items()),
        "<p class=soft>This speed is that of a render which keeps a trace of every sample, for the pictures, on one"
        " core.</p>",
        "<h2>What was built, and what was left out</h2>",
        *table(explained["effects"].items()),
        *table(("contact left out", what) for what in explained["contacts_left_out"]),
        f"<p class=soft>Kernel {explained['kernel']}, islands: {len(explained['islands'])}; costs in ns"
        " per sample on one core, energies measured, no trace kept.</p>",
        *table(tell.islands(explained), wide=True),
        *(price(priced) if priced else ()),
        "<h2>All numbers</h2><details><summary>By the names of <code>--json</code>; SI units</summary>",
        *table((name, json.dumps(value, ensure_ascii=False)) for name, value in named(finite(stats))),
        f"</details><h2>The patch</h2><pre tabindex=0><code>{escape(text)}</code></pre></main>",
        f"<footer><p><time datetime={when.isoformat(timespec='seconds')}>{when:%Y-%m-%d %H:%M}</time> on",
        escape(f"{made.pop('processor')}, {made.pop('cores')} cores;"),
        escape(", ".join(f"{what} {version}" for what, version in made.items())) + "</p></footer>",
    ]
    head = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>",
    )
    return "\n".join([*head, *parts, "</body></html>\n"])


def player(title: str, audio: np.ndarray, samplerate: int, output: str) -> Iterator[str]:
    """What plays the sound, never above full scale."""
    peak = float(np.abs(audio).max())
    sound, kind = encoded(audio / max(1.0, peak), samplerate)
    yield f'<audio controls preload="metadata" aria-label="{escape(title)}" src="{uri(sound, kind)}"></audio>'
    name = "FLAC, 16 bits" if kind == "audio/flac" else "Ogg Vorbis"
    changed = f", its {audio.shape[1]} channels on two" if audio.shape[1] > 2 else ""
    changed += f", {20 * np.log10(peak):.0f} dB softer" if peak > 1.0 else ""
    size = f"{max(1, round(len(sound) / 1e3))} kB"
    yield f"<p class=soft>Here as {name}{changed}, {size}; in full in {escape(Path(output).name)}.</p>"


def encoded(audio: np.ndarray, samplerate: int) -> tuple[bytes, str]:
    """The sound as a browser plays it, and its type; of many channels, the odd ones left and the even ones right."""
    import soundfile

    from engine.offline import filtered_down

    if audio.shape[1] > 2:
        audio = np.stack([audio[:, side::2].mean(axis=1) for side in (0, 1)], axis=1)
    if not PLAYED[0] <= samplerate <= PLAYED[1]:
        frames = max(1, round(len(audio) * PLAYED[1] / samplerate))
        audio, samplerate = filtered_down(audio, samplerate, PLAYED[1], frames), PLAYED[1]
    short = len(audio) <= SHORT * samplerate
    kind, subtype = ("FLAC", "PCM_16") if short else ("OGG", "VORBIS")
    kept = io.BytesIO()
    with soundfile.SoundFile(kept, "w", samplerate, audio.shape[1], subtype, format=kind) as file:
        for begin in range(0, len(audio), PIECE):
            file.write(audio[begin : begin + PIECE])
    return kept.getvalue(), f"audio/{kind.lower()}"


def key(stats: dict[str, Any], explained: dict[str, Any]) -> Iterator[str]:
    """The numbers to look at first."""
    newton, activity = stats["newton"], stats["activity"]
    fine = stats["samplerate"] * stats["accuracy"]["oversample"]
    nanoseconds = sum(island["ns_mean"] for island in explained["islands"])
    numbers = {
        "real time, untraced": f"{1e9 / max(nanoseconds, 1e-9) / fine:.3g} ×",
        "energy error": f"{stats['energy']['error_max']:.2g}",
        "Newton mean / max": f"{newton['mean']:.2f} / {newton['max']}" if newton["solves"] else "none",
        "in contact": f"{activity['contact']:.1%}",
    }
    yield f"<dl>{''.join(f'<div><dt>{name}</dt><dd>{value}</dd></div>' for name, value in numbers.items())}</dl>"


def pictures(take: "Take", stats: dict[str, Any]) -> Iterator[str]:
    """Waveform, spectrogram, energies and Newton iterations, one above another."""
    yield "<h2>Over time</h2>"
    energy, newton = stats["energy"], stats["newton"]
    touching = "contact is shaded" if draw.traced(take)["force"].any() else "nothing touches"
    told = {
        "waveform": (2.3, f"Waveform in SI units, before any gain; {touching}."),
        "spectrogram": (2.7, f"Spectrogram, to {draw.DEPTH:.0f} dB below the loudest."),
        "energies": (
            2.7,
            f"Energy: {energy['initial']:.4g} J at first, {energy['supplied']:.4g} supplied,"
            f" {energy['dissipated']:.4g} dissipated, {energy['final']:.4g} left; the balance keeps to"
            f" {energy['error_max']:.2g} of the largest held.",
        ),
        "iterations": (2.3, f"Newton iterations of each sample, at most {newton['max']}; {touching}."),
    }
    for name, (height, caption) in told.items():
        yield picture(draw.inline(draw.PANELS[name], take, height), caption)


def price(found: dict[str, Any]) -> Iterator[str]:
    """What accuracy costs."""
    verdict = found["verdict"]
    yield f"<h2>What accuracy costs</h2><p>{escape(verdict[0].upper() + verdict[1:])}.</p>"
    if found["unmeasured"]:
        return
    held = tell.against(found)
    yield picture(draw.inline(draw.prices, found, 5.0), "Error against time per sample: this engine and other methods.")
    yield f"<p class=soft>{escape(held[0].upper() + held[1:])}. A star: nothing else beats it in both.</p>"
    yield from table(((f"{setting} {star}", *others) for star, setting, *others in tell.prices(found)), wide=True)


def picture(image: bytes, caption: str) -> str:
    """A picture with what it shows in words."""
    shown = f'<img src="{uri(image, "image/png")}" alt="{escape(caption)}">'
    return f"<figure>{shown}<figcaption>{escape(caption)}</figcaption></figure>"


def table(rows: Iterable[Iterable[str]], wide: bool = False) -> Iterator[str]:
    """A table that scrolls in a box of its own; nothing without rows. The first row of a wide one is its head."""
    cells = [[escape(cell) for cell in row] for row in rows]
    if not cells:
        return
    yield f'<div class="scroll{" wide" if wide else ""}" tabindex=0><table>'
    if wide:
        yield f"<thead><tr>{''.join(f'<th scope=col>{cell}</th>' for cell in cells.pop(0))}</tr></thead>"
    yield "<tbody>"
    for first, *others in cells:
        bad = " class=bad" if first in ALARMS else ""
        yield f"<tr{bad}><th scope=row>{first}</th>{''.join(f'<td>{cell}</td>' for cell in others)}</tr>"
    yield "</tbody></table></div>"


def named(values: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Nested names joined by dots, with their values."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from named(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def uri(data: bytes, kind: str) -> str:
    """Data as an address that holds it."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
