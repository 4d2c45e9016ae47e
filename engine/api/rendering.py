"""Renderings as they are used from Python: drawn, saved, and shown in a notebook."""

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from engine.analysis.contact_summaries import ContactSummaries
from engine.analysis.silence import explain_silence
from engine.api.trace_files import make_dataset, write_trace
from engine.argument_checks import checked_integer, checked_number
from engine.faults import RenderInterrupted
from engine.offline.render import RenderedArrays, render_arrays
from engine.offline.trace import TraceArrays, contact_names
from engine.output_files import TRACE_ENDINGS, apply_gain, atomic_write, check_audio_format
from engine.patch.accuracy import Accuracy
from engine.patch.error_messages import suggestion
from engine.patch.precision_key import PATH
from engine.patch.scene import Scene, check_scene
from engine.patch.scene_tables import MAX_LEVEL
from engine.report.figures import PICTURE_ENDINGS, PLOT_STYLES, PlotStyle, save_figure, set_title
from engine.sound.about import About
from engine.sound.form import PLAIN_FORM, SoundForm
from engine.sound.sound_file import SoundFile
from engine.wording import join_with_or

if TYPE_CHECKING:
    from xarray import Dataset

    from engine.api.page import Page

PANELS_WITHOUT_TRACE = ("waveform", "spectrogram")
PANEL_SIZE = 10.0, 2.5  # inches
SHOWN_SIZE = 8.0, 4.0  # of the picture in a notebook
SHOWN_SECONDS = 60.0  # of sound in a notebook; the rest is left out
NO_MATPLOTLIB = 'to draw needs matplotlib; pip install "fdh-engine[plot]", or uv sync --extra plot'


@dataclass(frozen=True, eq=False, repr=False)
class Rendering(RenderedArrays):
    """A rendered scene.

    audio:      float64 [frames, channels], in the SI units of the pickups; never normalised
    samplerate: Hz
    stats:      what is known of it, by the names of `fdh render --json`: `stats.energy.error_max`, or
                `stats["energy"]["error_max"]`; `stats.as_dict()` has all
    trace:      arrays of every sample by name (engine.offline.trace.TraceArrays), or None; sample 0 is the initial
                state
    scene:      what was rendered

    >>> import fdh
    >>> rendering = fdh.render(fdh.load("bouncing_ball"), seconds=0.5, trace=True)
    >>> rendering.audio.shape, rendering.stats.trusted
    ((22050, 1), True)
    >>> float(rendering.trace["compression"].max()) > 0.0
    True
    """

    scene: Scene

    def __repr__(self) -> str:
        seconds, channels = len(self.audio) / self.samplerate, self.audio.shape[1]
        parts = [f"{seconds:g} s at {self.samplerate} Hz", f"{channels} channel{'s' * (channels > 1)}"]
        parts += [f"peak {self.stats.peak:.3g}", f"energy error {self.stats.energy.error_max:.1e}"]
        parts += ["trace of every sample"] if self.trace is not None else []
        return f"<Rendering: {', '.join(parts)}{'' if self.stats.trusted else '; NOT TO BE TRUSTED'}>"

    @property
    def silence(self) -> str | None:
        """The reason why a rendering is silent, and what would make it sound; None if it is not silent."""
        stats = self.stats
        return explain_silence(self.scene, stats.seconds, stats.samplerate, stats.peak, stats)

    @property
    def contacts(self) -> ContactSummaries:
        """Each contact in plain numbers (engine.analysis.contact_summaries.ContactSummary), by its name in the patch:
        when it touches, how long, how strongly. A contact without a name is `contact.0`, `contact.1`, …, by its place
        in the patch.

        A contact at several points is listed once: it touches as long as any of its points does, and its force is the
        sum of theirs. The points are found as `NAME.0`, `NAME.1`, …; where they lie is in
        `trace["contact_positions"]`.

        Raises ValueError without a trace; and KeyError, which names the nearest one, for an unknown name.

        >>> import fdh
        >>> rendering = fdh.render(fdh.load("piano_c4"), seconds=0.1, trace=True)
        >>> felt = rendering.contacts["felt"]
        >>> print(f"{felt.first_duration * 1e3:.2f} ms, {felt.peak_force:.1f} N, {felt.touches} touch")
        2.01 ms, 11.9 N, 1 touch
        >>> rendering.contacts["fellt"]
        Traceback (most recent call last):
        KeyError: 'no contact "fellt"; did you mean "felt"?'
        """
        if self.trace is None:
            raise ValueError("contacts need a trace; render with trace=True")
        return ContactSummaries(self.trace, contact_names(self.scene))

    def page(self, slide: Sequence[str] = (), voices: int = 0) -> "Page":
        """Make a page that plays the scene in any browser, where it can be struck and changed: `fdh.export_page` of
        the scene, at the sample rate of the rendering. A notebook shows it.

        slide:  live parameters that get a slider there, as of `fdh.export_page`
        voices: how many notes a keyboard there plays at a time, likewise

        Raises CannotExport (a ValueError) with the reason if the scene cannot become a page.

        >>> import fdh
        >>> rendering = fdh.render(fdh.load("bouncing_ball"), seconds=0.5)
        >>> rendering.page().save("ball.html")
        """
        from engine.api.page import export_page

        return export_page(self.scene, self.samplerate, slide=slide, voices=voices)

    def plot(self, *panels: str, style: str = "screen") -> np.ndarray:
        """Draw the rendering with matplotlib's pyplot, a panel below another, as `fdh render --plot` does.

        panels: some of waveform, spectrogram, energies, iterations; if none is named, all that can be drawn: without
                a trace, the first two
        style:  screen; or paper: as wide as a column of a journal, 86 mm, with letters of 8 points and no title

        Returns the axes, an array. Raises ValueError for another panel or style, or a panel that needs a trace which
        is not there; ImportError without matplotlib.

        >>> import fdh
        >>> rendering = fdh.render(fdh.load("bouncing_ball"), seconds=0.5, trace=True)
        >>> axes = rendering.plot("waveform", "energies")
        >>> axes[0].figure.savefig("ball.png")
        """
        names, look = self._checked_panels(panels), _checked_style(style)
        pyplot = _matplotlib("pyplot")
        with _matplotlib("rc_context")(look.settings):
            figure = pyplot.figure(figsize=look.size(PANEL_SIZE[0], PANEL_SIZE[1] * len(names)), layout="constrained")
            return self._draw(figure, names, look)

    def save(
        self,
        path: str | Path,
        gain: float | None = None,
        subtype: str | None = None,
        style: str = "screen",
        form: SoundForm = PLAIN_FORM,
    ) -> float:
        """Write the sound to a file, in the format of its name: .wav, .flac, .ogg and more. A name that ends in .npz,
        .nc, .mat or .csv gets the trace instead, and in .png, .pdf or .svg the picture.

        gain:    dB; if None, the sound is normalised to -1 dBFS, for SI units may be tiny, and fades out for 5 ms where
                 it is cut. 0 keeps SI units and all samples, and
                 `rendering.scene.level` is the level of the patch
        subtype: FLOAT (of a .wav, if None), PCM_24, PCM_16 or DOUBLE
        style:   of a picture, as of `plot`
        form:    trim, fade, loop, loudness and dither; a gain or a subtype that is given as well has its place

        Returns the gain that was applied, dB. Warns of samples that a file of integers cuts off. Raises ValueError
        if the format is none or cannot hold the sound, if the gain is out of range, or there is no trace to write;
        OSError if the file cannot be written: it is then as it was before.

        >>> import fdh
        >>> rendering = fdh.render(fdh.load("bouncing_ball"), seconds=0.5)
        >>> gain = rendering.save("ball.wav")
        >>> rendering.save("ball_in_si_units.wav", gain=0.0)
        0.0
        >>> gain = rendering.save("ball.pdf", style="paper")
        >>> gain = rendering.save("ball_for_a_game.wav", form=fdh.SoundForm(trim=True, loudness=-23.0))
        """
        path, look = _checked_path(path), _checked_style(style)
        ending = path.suffix.lower()
        if ending in TRACE_ENDINGS:
            if self.trace is None:
                raise ValueError("there is no trace to write; render with trace=True")
            write_trace(path, self.trace, self._facts)
            return 0.0
        if ending in PICTURE_ENDINGS:
            with atomic_write(path) as part:
                part.write_bytes(self._picture(PANEL_SIZE, self._checked_panels(()), look, ending))
            return 0.0
        subtype = subtype or form.subtype
        if faults := check_audio_format(path, subtype, "path"):
            others = f" for the sound, in .npz for the trace, or in {join_with_or(PICTURE_ENDINGS)} for the picture"
            messages = [fault.message.replace("--subtype ", "subtype ") for fault in faults]
            raise ValueError("; ".join(m + others if m.endswith("end it in .wav") else m for m in messages))
        gain = form.gain if gain is None else gain
        if gain is not None and not -MAX_LEVEL <= (gain := checked_number("gain", gain)) <= MAX_LEVEL:
            raise ValueError(f"gain = {gain:g} is out of range; {-MAX_LEVEL:g} to {MAX_LEVEL:g} dB")
        form = replace(form, subtype=subtype, gain=gain, loudness=form.loudness if gain is None else None)
        author, licence = self.scene.author, self.scene.licence
        file = SoundFile(path, form, About(self.scene.title, kernel=self.stats.kernel, author=author, licence=licence))
        sound = file.prepare(self.audio, self.samplerate, self.silence is not None)
        if cut := sound.clipping:
            remedy = f"gain={cut.safe_gain:.1f} fits"
            warnings.warn(
                f"{path}: {cut.count} of {cut.total} samples are beyond ±1 and clipped; {remedy}", stacklevel=2
            )
        try:
            sound.write()
        except RuntimeError as error:
            raise ValueError(f"{path}: {error}") from None
        return sound.gain

    @property
    def _facts(self) -> dict[str, str]:
        """Facts that files of a trace have beside it."""
        texts = {"accuracy": json.dumps(self.stats.accuracy), "kernel": self.stats.kernel, "title": self.scene.title}
        return texts | {"patch_text": self.scene.to_toml()}

    def to_xarray(self) -> "Dataset":
        """Return the trace as an xarray.Dataset: `time`, and bodies, contacts and frictions by their names, with units;
        the patch, the accuracy and the version are its attributes. Raises ValueError without a trace; ImportError
        without xarray.

        >>> import fdh
        >>> trace = fdh.render(fdh.load("bouncing_ball"), seconds=0.5, trace=True).to_xarray()
        >>> float(trace.force.sel(contact_name="contact.0").max().round()), trace.force.attrs["units"]
        (1024.0, 'N')
        """
        if self.trace is None:
            raise ValueError("there is no trace; render with trace=True")
        return make_dataset(self.trace, self._facts)

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: a player of the first minute, the main numbers, and a picture."""
        return "\n".join(self._html())

    def _html(self) -> Iterator[str]:
        from engine.report.html import data_uri, encode_for_browser

        shown = self.audio[: round(SHOWN_SECONDS * self.samplerate)]
        audio, _ = apply_gain(shown, 0.0 if self.silence else self.stats.peak, None)
        data, mime_type = encode_for_browser(audio, self.samplerate)
        yield f"<p><strong>{escape(self.scene.title)}</strong> {escape(repr(self)[1:-1])}</p>"
        yield f'<audio controls src="{data_uri(data, mime_type)}"></audio>'
        if len(shown) < len(self.audio):
            yield f"<p>The first {SHOWN_SECONDS:g} s of it.</p>"
        yield "<p>Its method <code>page()</code> lets you play the patch here.</p>"
        for line in [*self.stats.reasons, *self.stats.warnings]:
            yield f"<p>{escape(line)}</p>"
        try:
            size = SHOWN_SIZE[0], SHOWN_SIZE[1] / 2
            png = self._picture(size, PANELS_WITHOUT_TRACE, PLOT_STYLES["screen"], ".png")
        except ImportError:
            return
        yield f'<img alt="waveform and spectrogram" src="{data_uri(png, "image/png")}">'

    def _checked_panels(self, panels: tuple[str, ...]) -> tuple[str, ...]:
        """The panels to draw. Raises ValueError."""
        from engine.report.plots import PANELS

        if unknown := [name for name in panels if name not in PANELS]:
            raise ValueError(f"no panel {unknown[0]!r}; {suggestion(str(unknown[0]), [*PANELS])}")
        if self.trace is not None:
            return panels or tuple(PANELS)
        if bare := [name for name in panels if name not in PANELS_WITHOUT_TRACE]:
            raise ValueError(f"there is no trace to draw {bare[0]} of; render with trace=True")
        return panels or PANELS_WITHOUT_TRACE

    def _draw(self, figure: Any, names: tuple[str, ...], look: PlotStyle) -> np.ndarray:
        """Draw panels on a figure, one below another; returns their axes."""
        from engine.report.plots import PANELS

        axes = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
        untouched = {"time": np.zeros(len(self.audio)), "force": np.zeros((len(self.audio), 0))}
        drawn = self if self.trace is not None else replace(self, trace=cast(TraceArrays, untouched))
        for panel_axes, name in zip(axes, names, strict=True):
            PANELS[name](panel_axes, drawn)
            panel_axes.label_outer()
        set_title(axes[0], self.scene.title, look.title)
        return np.asarray(axes)

    def _picture(self, panel_size: tuple[float, float], names: tuple[str, ...], look: PlotStyle, ending: str) -> bytes:
        """A picture of some panels, in the format of an ending; matplotlib's pyplot and its backend are left alone."""
        new_figure, picture = _matplotlib("figure").Figure, BytesIO()
        with _matplotlib("rc_context")(look.settings):
            figure = new_figure(look.size(panel_size[0], panel_size[1] * len(names)), layout="constrained")
            self._draw(figure, names, look)
            save_figure(figure, picture, ending, look.dpi)
        return picture.getvalue()


def render(
    scene: Scene,
    seconds: float | None = None,
    samplerate: int = 44_100,
    trace: bool = False,
    cores: int | None = None,
    progress: Callable[[float], None] | None = None,
    kernel: str | None = None,
    trace_shapes: bool = False,
    **accuracy: Any,
) -> Rendering:
    """Render a scene.

    seconds:    length; the scene's own if None
    samplerate: Hz
    trace:      keep every sample's displacements, forces and energies
    cores:      how many may share the work; all of the machine's if None. The samples are the same
    progress:   called now and then with the share rendered, 0 to 1
    kernel:     general or special (engine.runtime.kernel_choice). The samples are the same
    trace_shapes: keep a trace, and with it shapes of strings, bars and sheets: 4000 of each at most and 64 MB in all,
                evenly apart
    accuracy:   scheme, order, substeps, max_error, max_substeps, least_detuning, tolerance, oversample, iterations,
                silence: of each, what the scene says if absent or None (engine.patch.accuracy)

    Raises TypeError if an argument is of the wrong kind or unknown, ValueError if one is out of range, BuildError
    (a ValueError) if the scene cannot be built at this sample rate. The KeyboardInterrupt of Ctrl-C has the part that
    is rendered, if there is one: a Rendering, its `rendering`.

    >>> import fdh
    >>> fdh.render(fdh.load("bouncing_ball"), seconds=0.1, substeps=4).stats.accuracy["substeps"]
    4
    >>> fdh.render("bouncing_ball")
    Traceback (most recent call last):
    TypeError: 'bouncing_ball' is the name of a patch, not a scene; give fdh.load('bouncing_ball')
    """
    check_scene(scene)
    check_accuracy_names(accuracy, "render")
    given = None if seconds is None else checked_number("seconds", seconds)
    rate = checked_integer("samplerate", samplerate)
    used_cores = None if cores is None else checked_integer("cores", cores)
    try:
        arrays = render_arrays(scene, given, rate, bool(trace), used_cores, progress, kernel, trace_shapes, **accuracy)
    except RenderInterrupted as stop:
        stop.rendering = Rendering(**vars(stop.rendering), scene=scene)
        raise
    return Rendering(**vars(arrays), scene=scene)


def check_accuracy_names(accuracy: Mapping[str, Any], caller: str) -> None:
    """Raise TypeError for a keyword that is not a key of [accuracy]. caller: the function that was given it"""
    for name in accuracy:
        if name not in Accuracy.model_fields and name != PATH[1]:  # which is read with a note
            raise TypeError(f"{caller} has no argument {name!r}; {suggestion(name, [*Accuracy.model_fields])}")


def _checked_path(path: Any) -> Path:
    """A path. Raises TypeError if it is none."""
    if not isinstance(path, str | Path):
        raise TypeError(f'{path!r} is not a path; give the name of a file, such as "sound.wav"')
    return Path(path)


def _checked_style(style: Any) -> PlotStyle:
    """A style of pictures. Raises ValueError for one that does not exist."""
    if style not in PLOT_STYLES:
        raise ValueError(f"no style {style!r}; {suggestion(str(style), [*PLOT_STYLES])}")
    return PLOT_STYLES[style]


def _matplotlib(name: str) -> Any:
    """A module of matplotlib, or a function of it. Raises ImportError, which says how to get it."""
    import importlib

    try:
        matplotlib = importlib.import_module("matplotlib")
        return getattr(matplotlib, name) if hasattr(matplotlib, name) else importlib.import_module(f"matplotlib.{name}")
    except ImportError as error:
        raise ImportError(NO_MATPLOTLIB) from error
