"""A page of a rendering, to listen to and look at: one HTML file that holds all it shows and needs no network."""

import base64
import datetime
import io
import json
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from engine.audio_formats import open_sound_file, write_pieces
from engine.provenance import describe_machine
from engine.report import console, plots
from engine.report.detail_plots import plot_first_contact, plot_string_shape
from engine.report.figures import panel_png
from engine.report.trace_signals import first_contact
from engine.report.work_precision_plot import draw_work_precision
from engine.wording import json_safe

if TYPE_CHECKING:
    from engine.analysis.profile import Profile
    from engine.analysis.string_shape import StringShape
    from engine.analysis.work_precision import WorkPrecisionStudy
    from engine.offline.render import RenderedArrays

MAX_FLAC_SECONDS = 3.0  # longer audio is embedded as Ogg Vorbis, a tenth of the size
BROWSER_RATES = (8_000, 48_000)  # Hz, rates that every browser plays
ALARM_ROW = "NOT TO BE TRUSTED"  # of the summary
# nothing is loaded from anywhere, and no script runs, whatever the text of a patch holds
SECURITY_POLICY = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'"

PAGE_CSS = """
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


class PageContents(NamedTuple):
    """A rendering, and all else that its page shows."""

    rendering: "RenderedArrays"  # with its trace
    audio: np.ndarray  # [frames, channels], at the level of the file
    stats: dict[str, Any]  # as `--json` prints them
    profile: "Profile"  # of the scene
    study: "WorkPrecisionStudy | None" = None  # of accuracy and cost
    shape: "StringShape | None" = None  # of a string that moves


def compose_page(
    title: str,
    text: str,
    contents: PageContents,
) -> str:
    """The whole page as HTML. title, text: of the patch. Raises ValueError without a trace."""
    rendering, audio, stats, profile, study, shape = contents
    channels = f"{stats['channels']} channels" if stats["channels"] > 1 else "mono"
    subtitle = (Path(stats["patch"]).name, f"{stats['seconds']:g} s", channels, f"{stats['samplerate']} Hz")
    head = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{SECURITY_POLICY}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title><style>{PAGE_CSS}</style></head><body>",
    )
    body = (
        f"<header><h1>{escape(title)}</h1><p class=soft>{escape(' · '.join(subtitle))}</p></header><main>",
        *audio_element(title, audio, rendering.samplerate, stats["output"]),
        *headline_numbers(stats, profile),
        *time_figures(rendering, stats),
        *detail_figures(rendering, shape),
        "<h2>What was rendered</h2>",
        *table_element(console.detailed_rows(stats).items()),
        "<p class=soft>This render kept a trace of every sample for the figures and ran on one core; its speed is lower"
        " than without a trace.</p>",
        *profile_section(profile),
        *(work_precision_section(study) if study else ()),
        "<h2>All numbers</h2><details><summary>With the names of <code>--json</code>, in SI units</summary>",
        *table_element((name, json.dumps(value, ensure_ascii=False)) for name, value in flatten(json_safe(stats))),
        f"</details><h2>The patch</h2><pre tabindex=0><code>{escape(text)}</code></pre></main>",
        *page_footer(),
    )
    return "\n".join([*head, *body, "</body></html>\n"])


def page_footer() -> Iterator[str]:
    """The time, the machine and the versions."""
    now, machine = datetime.datetime.now().astimezone(), describe_machine()
    yield f"<footer><p><time datetime={now.isoformat(timespec='seconds')}>{now:%Y-%m-%d %H:%M}</time> on"
    yield escape(f"{machine.pop('processor')}, {machine.pop('cores')} cores;")
    yield escape(", ".join(f"{name} {version}" for name, version in machine.items())) + "</p></footer>"


def audio_element(title: str, audio: np.ndarray, samplerate: int, output: str) -> Iterator[str]:
    """A player of the audio [frames, channels], never above full scale, with a note of how it differs from the
    file."""
    peak = float(np.abs(audio).max())
    data, mime_type = encode_for_browser(audio / max(1.0, peak), samplerate)
    yield f'<audio controls preload="metadata" aria-label="{escape(title)}" src="{data_uri(data, mime_type)}"></audio>'
    encoding = "FLAC, 16 bits" if mime_type == "audio/flac" else "Ogg Vorbis"
    changes = f", {audio.shape[1]} channels mixed to two" if audio.shape[1] > 2 else ""
    changes += f", attenuated by {20 * np.log10(peak):.0f} dB" if peak > 1.0 else ""
    size = f"{max(1, round(len(data) / 1e3))} kB"
    yield f"<p class=soft>Preview: {encoding}{changes}, {size}; full quality in {escape(Path(output).name)}.</p>"


def encode_for_browser(audio: np.ndarray, samplerate: int) -> tuple[bytes, str]:
    """A file that every browser plays, and its MIME type.

    audio: [frames, channels], within ±1; of more than two channels, the odd ones go left and the even ones right
    """
    from engine.offline.decimation import resample

    if audio.shape[1] > 2:
        audio = np.stack([audio[:, side::2].mean(axis=1) for side in (0, 1)], axis=1)
    if not BROWSER_RATES[0] <= samplerate <= BROWSER_RATES[1]:
        frames = max(1, round(len(audio) * BROWSER_RATES[1] / samplerate))
        audio, samplerate = resample(audio, samplerate, BROWSER_RATES[1], frames), BROWSER_RATES[1]
    is_short = len(audio) <= MAX_FLAC_SECONDS * samplerate
    file_format, subtype = ("FLAC", "PCM_16") if is_short else ("OGG", "VORBIS")
    data = io.BytesIO()
    with open_sound_file(data, samplerate, audio.shape[1], subtype, file_format) as file:
        write_pieces(file, audio)
    return data.getvalue(), f"audio/{file_format.lower()}"


def headline_numbers(stats: dict[str, Any], profile: "Profile") -> Iterator[str]:
    """The numbers to look at first: speed, energy error, iterations and contact."""
    newton, activity = stats["newton"], stats["activity"]
    rate = stats["samplerate"] * stats["accuracy"]["oversample"]
    nanoseconds = sum(island["ns_mean"] for island in profile["islands"])
    numbers = {
        "real time, untraced": f"{1e9 / max(nanoseconds, 1e-9) / rate:.3g} ×",
        "energy error": f"{stats['energy']['error_max']:.2g}",
        "Newton mean / max": f"{newton['mean']:.2f} / {newton['max']}" if newton["solves"] else "none",
        "in contact": f"{activity['contact']:.1%}",
    }
    yield f"<dl>{''.join(f'<div><dt>{name}</dt><dd>{value}</dd></div>' for name, value in numbers.items())}</dl>"


def time_figures(rendering: "RenderedArrays", stats: dict[str, Any]) -> Iterator[str]:
    """Waveform, spectrogram, energies and Newton iterations over the same time, one above another."""
    yield "<h2>Over time</h2>"
    energy, newton = stats["energy"], stats["newton"]
    has_contact = first_contact(rendering) is not None
    contact_note = "contact is shaded" if has_contact else "there is no contact"
    figures = {  # height in inches, and caption
        "waveform": (plots.waveform_height(rendering), f"Waveform in SI units, before any gain; {contact_note}."),
        "spectrogram": (2.7, f"Spectrogram, to {plots.SPECTROGRAM_DEPTH_DB:.0f} dB below its maximum."),
        "energies": (
            2.7,
            f"Energy: {energy['initial']:.4g} J initial, {energy['supplied']:.4g} supplied,"
            f" {energy['dissipated']:.4g} dissipated, {energy['final']:.4g} final; the error of the"
            f" balance is {energy['error_max']:.2g} of the maximum stored energy.",
        ),
        "iterations": (2.3, f"Newton iterations of each sample, at most {newton['max']}; {contact_note}."),
    }
    for name, (height, caption) in figures.items():
        yield figure_element(panel_png(plots.PANELS[name], rendering, height), caption)


def detail_figures(rendering: "RenderedArrays", shape: "StringShape | None") -> Iterator[str]:
    """The first contact and the shape of a string, if there are such."""
    contact = first_contact(rendering)
    if contact is not None:
        caption = "The first contact: its force and its compression, which is negative while the bodies are apart."
        yield figure_element(panel_png(plot_first_contact, contact, 2.7), caption)
    if shape is not None:
        caption = f"The shape of {shape.body} over its first two periods: displacement over time and position."
        yield figure_element(panel_png(plot_string_shape, shape, 3.2), caption)


def profile_section(profile: "Profile") -> Iterator[str]:
    """Effects, islands and their costs."""
    yield "<h2>Effects and coupled subsystems</h2>"
    yield from table_element(console.effect_rows(profile))
    islands = f"Kernel {profile['kernel']}, coupled subsystems (islands): {len(profile['islands'])}"
    yield f"<p class=soft>{islands}. Costs are in ns per sample on one core, with the energy balance and no trace.</p>"
    yield from table_element(console.island_rows(profile), has_head=True)


def work_precision_section(study: "WorkPrecisionStudy") -> Iterator[str]:
    """The section on accuracy and cost: the verdict, a plot and a table."""
    yield f"<h2>Accuracy and cost</h2><p>{escape(_capitalise(study['verdict']))}.</p>"
    if study["unmeasured"]:
        return
    png = panel_png(draw_work_precision, study, 5.0)
    yield figure_element(png, "Error against computation time per sample: this engine and other methods.")
    note = escape(_capitalise(console.reference_note(study)))
    yield f"<p class=soft>{note}. A star marks a Pareto-optimal setting.</p>"
    rows = console.work_precision_rows(study)
    yield from table_element(((f"{setting} {star}", *cells) for star, setting, *cells in rows), has_head=True)


def figure_element(png: bytes, caption: str) -> str:
    """A picture with its caption."""
    image = f'<img src="{data_uri(png, "image/png")}" alt="{escape(caption)}">'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>"


def table_element(rows: Iterable[Iterable[str]], has_head: bool = False) -> Iterator[str]:
    """A table of rows of cells, in a box of its own that scrolls; nothing if there are no rows.

    has_head: the first row is the head, and the table is as wide as it needs
    """
    cells = [[escape(cell) for cell in row] for row in rows]
    if not cells:
        return
    yield f'<div class="scroll{" wide" if has_head else ""}" tabindex=0><table>'
    if has_head:
        yield f"<thead><tr>{''.join(f'<th scope=col>{cell}</th>' for cell in cells.pop(0))}</tr></thead>"
    yield "<tbody>"
    for name, *values in cells:
        style = " class=bad" if name == ALARM_ROW else ""
        yield f"<tr{style}><th scope=row>{name}</th>{''.join(f'<td>{value}</td>' for value in values)}</tr>"
    yield "</tbody></table></div>"


def flatten(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names of nested dictionaries, joined by dots, with their values."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def data_uri(data: bytes, mime_type: str) -> str:
    """A URI that holds its data."""
    return f"data:{mime_type};base64,{base64.b64encode(data).decode('ascii')}"


def _capitalise(text: str) -> str:
    """The text with its first letter as a capital."""
    return text[0].upper() + text[1:]
