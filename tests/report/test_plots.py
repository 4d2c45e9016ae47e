"""Pictures of a rendering: what they show, and that nothing in them is cut, covered or lost in print."""

import itertools
import re
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT

import engine
from engine.analysis.string_shape import StringShape
from engine.cli import main
from engine.report import detail_plots, figures, plots, work_precision_plot
from engine.report.trace_signals import first_contact

BALL = ROOT / "patches" / "bouncing_ball.toml"
OFFENDING_TITLE = "Costs $5 to $6 x^{ and is a long title " * 4


@pytest.fixture(scope="module")
def ball():
    return engine.render(engine.load(BALL), seconds=0.5, trace=True)


def drawn(draw, subject):
    """The axes of a figure on which a panel is drawn, with its layout made."""
    from matplotlib.figure import Figure

    figure = Figure((10.0, 2.5), layout="constrained")
    axes = figure.subplots()
    draw(axes, subject)
    figure.draw_without_rendering()
    return axes


@pytest.mark.parametrize("name", [figures.LEVEL_MAP, figures.SIGNED_MAP])
def test_maps_can_be_read_in_greyscale(name):
    """Lightness rises or falls along the whole map."""
    from matplotlib import colormaps

    lightness = colormaps[name](np.linspace(0.0, 1.0, 64))[:, :3] @ [0.299, 0.587, 0.114]
    steps = np.diff(lightness)
    assert np.all(steps > 0.0) or np.all(steps < 0.0)
    assert abs(lightness[-1] - lightness[0]) > 0.6


def test_every_channel_has_a_lane_of_its_own(ball):
    """And its place on the axis is that of its samples."""
    sound = np.sin(np.arange(4410) / 10.0)[:, None] * [1.0, 0.5, 2.0]
    silent = {"time": np.zeros(4410), "force": np.zeros((4410, 0))}
    axes = drawn(plots.plot_waveform, SimpleNamespace(audio=sound, samplerate=44_100, trace=silent))
    lanes = [lane.get_paths()[0].get_extents() for lane in axes.collections]
    assert len(lanes) == 3
    for upper, lower in itertools.pairwise(lanes):
        assert lower.y1 < upper.y0
    assert [lane.height for lane in lanes] == pytest.approx([2.0, 1.0, 4.0], rel=1e-2)
    low, high = axes.get_ylim()
    assert low < lanes[2].y0 and lanes[0].y1 < high
    assert [text.get_text() for text in axes.texts] == ["channel 1", "channel 2", "channel 3"]


@pytest.mark.hard
def test_legends_and_colour_bars_stand_beside_the_axes(ball):
    for draw in (plots.plot_energies, plots.plot_spectrogram):
        axes = drawn(draw, ball)
        inside, whole = axes.get_window_extent(), axes.figure.bbox
        legend = axes.get_legend()
        beside = [legend.get_window_extent()] if legend is not None else []
        beside += [bar.get_tightbbox() for bar in axes.child_axes]
        assert beside
        for box in beside:
            assert not box.overlaps(inside)
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1 + 1.0 and box.y1 <= whole.y1 + 1.0


def test_a_spectrogram_has_a_tone_at_its_frequency_and_level():
    time = np.arange(44_100) / 44_100
    sound = np.stack([np.sin(2 * np.pi * 1000 * time), 0.1 * np.sin(2 * np.pi * 8000 * time)], 1)
    begins, frequency, level = plots.spectrogram(sound, 44_100)
    middle = level[len(begins) // 2]
    assert frequency[middle.argmax()] == pytest.approx(1000, rel=0.02)
    assert middle.max() == pytest.approx(0.0, abs=0.5)
    near = np.abs(frequency / 8000 - 1) < 0.02
    assert middle[near].max() == pytest.approx(-20.0, abs=0.5)
    assert middle[np.abs(frequency / 4000 - 1) < 0.05].max() < -60.0


def test_the_first_contact_is_that_of_the_trace(ball):
    """The ball lands at √(2·0.2/9.81) = 0.2019 s; its force is kc·s^α."""
    contact = first_contact(ball)
    assert contact.begin == pytest.approx(0.2019, abs=1e-3)
    assert contact.force.max() == ball.trace["force"].max()
    assert contact.time[0] < 0.0 and contact.compression[0] < 0.0
    touching = contact.force > 0.0
    assert np.all(contact.compression[touching][2:-2] > 0.0) and not touching[0] and not touching[-1]
    axes = drawn(detail_plots.plot_first_contact, contact)
    (other,) = [panel for panel in axes.figure.axes if panel is not axes]
    zero = [panel.transData.transform((0.0, 0.0))[1] for panel in (axes, other)]
    assert zero[0] == pytest.approx(zero[1], abs=0.01)
    assert "force, kN" in axes.get_ylabel() and "compression, mm" in other.get_ylabel()


def test_of_contacts_that_begin_together_the_strongest_is_the_first():
    force = np.zeros((100, 3))
    force[20:40, 0], force[21:40, 1], force[50:60, 2] = 1.0, 5.0, 9.0
    trace = {"time": np.arange(100) / 1e4, "force": force, "compression": force - 0.1}
    contact = first_contact(SimpleNamespace(trace=trace, audio=np.zeros((100, 1)), samplerate=10_000))
    assert contact.force.max() == 5.0 and contact.begin == pytest.approx(21e-4)
    trace["force"] = np.zeros((100, 3))
    assert first_contact(SimpleNamespace(trace=trace, audio=np.zeros((100, 1)), samplerate=10_000)) is None


def test_zero_is_the_middle_of_the_colours_of_a_shape():
    time, places = np.arange(50) / 1000, np.linspace(0.0, 1.0, 11)
    shape = StringShape("c4", time, places, 1e-3 * np.sin(np.pi * places) * (1.0 + np.sin(time * 100))[:, None])
    axes = drawn(detail_plots.plot_string_shape, shape)
    (mesh,) = axes.collections
    assert mesh.norm(0.0) == pytest.approx(0.5)
    assert mesh.get_array().shape == (11, 50)
    assert axes.child_axes[0].get_ylabel() == "displacement, mm" and '"c4"' in axes.get_ylabel()


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.04, "40 mJ"), (999.0, "999 J"), (1e3, "1 kJ"), (1e-6, "1 µJ"), (2.5e-9, "2.5 nJ"), (0.0, "0 J")],
)
def test_units_have_prefixes(value, text):
    assert figures.si_text(value, "J") == text


@pytest.mark.hard
def test_a_whole_picture_is_written_whatever_its_title(ball, tmp_path):
    from matplotlib.image import imread

    plots.plot_rendering(ball, OFFENDING_TITLE, tmp_path / "ball.png")
    image = imread(tmp_path / "ball.png")[:, :, :3]
    edges = [image[:3], image[-3:], image[:, :3], image[:, -3:]]
    assert all((edge == 1.0).all() for edge in edges), "something is cut"


@pytest.mark.hard
def test_names_of_settings_cover_no_other_and_are_not_cut():
    """Eight settings, some of them at nearly the same place, one in a corner."""
    places = [(10, 1e-1), (10.5, 1.1e-1), (10.7, 9e-2), (12, 1e-1), (20, 1e-2), (21, 1e-2), (300, 1e-6), (295, 1.1e-6)]
    rows = [
        {"setting": f"order 2, {n} ×", "ns_per_sample": x, "error": y, "front": n % 2 == 0, "bands_db": 0.0}
        for n, (x, y) in enumerate(places)
    ]
    axes = drawn(work_precision_plot.draw_work_precision, {"rows": rows})
    labels = [text.get_window_extent() for text in axes.texts]
    inside = axes.get_window_extent()
    assert len(labels) == 8
    for a, b in itertools.combinations(labels, 2):
        assert not a.overlaps(b)
    for label in labels:
        assert inside.x0 <= label.x0 and label.x1 <= inside.x1 and inside.y0 <= label.y0 and label.y1 <= inside.y1


# --- files of pictures


def noisy_rendering(begin: float, seconds: float) -> SimpleNamespace:
    """Four seconds of noise in two channels, with one contact of so many seconds."""
    rate, frames = 8000, 32_000
    force = np.zeros((frames, 1))
    force[round(begin * rate) : round((begin + seconds) * rate)] = 1.0
    energies = dict.fromkeys(("total", "dissipated", "supplied"), np.ones(frames))
    trace = {"time": np.arange(frames) / rate, "force": force, "compression": force - 0.5, **energies}
    trace["iterations"] = force[:, 0].astype(int)
    audio = np.random.default_rng(1).normal(size=(frames, 2))
    return SimpleNamespace(audio=audio, samplerate=rate, trace=trace)


@pytest.mark.hard
@pytest.mark.parametrize(("seconds", "shown"), [(0.001, False), (0.2, True)])
def test_iterations_have_a_panel_only_where_it_would_show_something(seconds, shown, tmp_path, monkeypatch):
    """One blow of a millisecond is a line at the edge of four seconds; the picture of the contact below has it."""
    drawn_panels = []
    monkeypatch.setitem(plots.PANELS, "iterations", lambda *_: drawn_panels.append("iterations"))
    rendering = noisy_rendering(1.0, seconds)
    rendering.trace |= {"contacts": np.array(["felt"]), "contact_positions": np.zeros((1, 1))}
    plots.plot_rendering(rendering, "blow", tmp_path / "blow.png")
    assert drawn_panels == ["iterations"] * shown


@pytest.mark.parametrize("dpi", [50, 72, 120, 300])
@pytest.mark.parametrize("begin", [1.0, 1.001, 1.0025, 2.7181])
def test_a_short_contact_is_shaded_over_two_pixels(dpi, begin):
    """At every resolution: 0.125 ms of four seconds would be a thirtieth of a pixel."""
    from matplotlib.figure import Figure

    figure = Figure((10.0, 2.5), layout="constrained", dpi=dpi)
    axes = figure.subplots()
    plots.shade_contact(axes, noisy_rendering(begin, 1 / 8000))
    axes.set(xlim=(0.0, 4.0))
    pixels = image_of(figure)
    x0, x1 = (round(x) for x in axes.bbox.intervalx)
    row = pixels[len(pixels) // 2, x0 + 3 : x1 - 3, 2]  # blue, of which orange has none
    assert 2 <= np.count_nonzero(row < row.max()) <= max(3, dpi // 40)
    assert row.min() == pytest.approx(row[row < row.max()].max(), abs=2), "an edge is half shaded"


def image_of(figure) -> np.ndarray:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_contacts_that_would_overlap_are_not_shaded_twice():
    from engine.report.contact_shading import widen

    assert widen([(3.0, 3.1), (1.0, 1.2), (1.3, 2.0), (3.05, 3.06)], 0.5) == [(1.0, 2.0), (3.0, 3.55)]
    assert widen([(1.0, 3.0), (1.5, 2.0)], 0.0) == [(1.0, 3.0)]


SLOWER = [(ending, style) for ending in (".pdf", ".svg", ".PNG") for style in ("screen", "paper")][:-1]


@pytest.mark.hard
@pytest.mark.parametrize(
    ("ending", "style"), [(".PNG", "paper"), *(pytest.param(*case, marks=pytest.mark.hard) for case in SLOWER)]
)
def test_pictures_are_written_in_the_format_of_their_name(tmp_path, ending, style):
    """They are small, though the sound is dense, and the same whenever they are drawn."""
    rendering = noisy_rendering(1.0, 0.25)
    for name in ("one", "two"):
        plots.plot_rendering(rendering, "Noise", tmp_path / f"{name}{ending}", None, style)
    data = (tmp_path / f"one{ending}").read_bytes()
    assert data == (tmp_path / f"two{ending}").read_bytes()
    assert data.startswith({".pdf": b"%PDF-", ".svg": b"<?xml", ".PNG": b"\x89PNG"}[ending])
    assert len(data) < 2e6
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.hard
def test_a_picture_for_paper_is_as_wide_as_a_column_with_letters_of_eight_points(ball, tmp_path):
    """3.4 inches are 244.8 points. Letters are TrueType, as publishers want them, and there is no title."""
    plots.plot_rendering(ball, "Noise", tmp_path / "ball.pdf", None, "paper")
    data = (tmp_path / "ball.pdf").read_bytes()
    width = re.search(rb"/MediaBox \[ 0 0 ([0-9.]+) ", data)
    assert width is not None and float(width[1]) == pytest.approx(3.4 * 72)
    assert (b"/Type3" not in data and b"/TrueType" in data) or b"/Type0" in data
    text = b"".join(zlib.decompress(part) for part in re.findall(rb"stream\r?\n(x.*?)\r?\nendstream", data, re.S)[:1])
    sizes = {float(size) for size in re.findall(rb"/F\d+ ([0-9.]+) Tf", text)}
    assert sizes == {8.0}


def test_panels_for_paper_are_not_cut_and_their_legends_stand_above_them(ball):
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    look = figures.PLOT_STYLES["paper"]
    with rc_context(look.settings):
        figure = Figure(look.size(10.0, 2.5), layout="constrained")
        axes = figure.subplots()
        plots.plot_energies(axes, ball)
        figure.draw_without_rendering()
    box, inside = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 and not box.overlaps(inside)
    assert inside.width > 0.7 * figure.bbox.width


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--plot", "x.jpg"], '--plot: "x.jpg" is not the name of a picture; end it in .png, .pdf or .svg'),
        (["--plot", "x.pdf", "--plot-style", "papier"], '--plot-style: "papier" is not a style; give screen or paper'),
        (["--plot-style", "paper"], "--plot-style: requires --plot; give that too"),
    ],
)
@pytest.mark.parametrize("command", ["render", "accuracy"])
def test_pictures_that_cannot_be_are_refused(capsys, command, words, says):
    assert main.main([command, str(BALL), *words]) == 2
    assert capsys.readouterr().err == f"fdh {says}\n"


@pytest.mark.hard
def test_a_rendering_saves_its_picture_for_paper(ball, tmp_path):
    for name in ("ball.pdf", "ball.svg"):
        assert ball.save(tmp_path / name, style="paper") == 0.0
    assert b"[ 0 0 244.8 " in (tmp_path / "ball.pdf").read_bytes()
    assert len(ball.plot("waveform", "energies", style="paper")) == 2
    with pytest.raises(ValueError, match=r"no style 'papier'; did you mean .paper.\?"):
        ball.plot(style="papier")
    with pytest.raises(ValueError, match=r"end it in \.wav .* or in \.png, \.pdf or \.svg for the picture"):
        ball.save(tmp_path / "ball.jpg")


def test_the_axis_of_the_waveform_names_what_is_registered(ball):
    from matplotlib.figure import Figure

    scene = engine.load("bouncing_ball")
    rendering = engine.render(scene, seconds=0.3, trace=True)
    axes = Figure().subplots()
    plots.plot_waveform(axes, rendering)
    assert axes.get_ylabel() == "velocity, m/s"
    two = scene.replace({"pickup.0.gain": 2.0})
    axes.clear()
    plots.plot_waveform(axes, engine.render(two, seconds=0.3, trace=True))
    assert axes.get_ylabel() == "output, SI units"


@pytest.mark.parametrize("panels", [("waveform",), ("energies", "contact"), ("contact",), ("shape",)])
def test_the_panels_that_are_named_are_drawn(ball, tmp_path, panels):
    plots.plot_rendering(ball, "ball", tmp_path / "all.png")
    plots.plot_rendering(ball, "ball", tmp_path / "some.png", panels=panels)
    from matplotlib.image import imread

    assert imread(tmp_path / "some.png").shape[0] < 0.7 * imread(tmp_path / "all.png").shape[0]


def test_an_unknown_panel_is_refused(tmp_path, capsys):
    from engine.cli import main

    assert main.main(["render", "bouncing_ball", "--plot", str(tmp_path / "a.png"), "--plot-panels", "wave"]) == 2
    assert '"wave" is not a panel; give waveform, spectrogram' in capsys.readouterr().err
