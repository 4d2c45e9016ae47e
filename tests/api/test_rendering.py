"""A rendering in the hands of a Python user: drawn, saved, shown in a notebook; and arguments of the wrong kind."""

import math
import warnings

import numpy as np
import pytest
import soundfile
from conftest import exit_code

import engine

BALL = engine.load("bouncing_ball")


@pytest.fixture(scope="module")
def traced():
    return engine.render(BALL, seconds=0.5, trace=True)


@pytest.fixture(scope="module")
def plain():
    return engine.render(BALL, seconds=0.5)


@pytest.fixture
def pyplot():
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")


def test_a_rendering_says_in_a_line_what_it_is(traced, plain):
    assert repr(plain).startswith("<Rendering: 0.5 s at 44100 Hz, 1 channel, peak ") and len(repr(plain)) < 120
    assert "trace of every sample" in repr(traced)


@pytest.mark.hard
def test_all_panels_are_drawn_over_the_time_of_the_sound(pyplot, traced):
    axes = traced.plot()
    assert len(axes) == 4 and axes[0].get_title() == BALL.title
    assert axes[0].get_xlim() == (0.0, 0.5)
    held = axes[2].lines[0].get_ydata()
    assert held.max() == pytest.approx(traced.trace["total"].max(), rel=1e-3)


def test_without_a_trace_what_is_heard_is_drawn(pyplot, plain):
    assert [axes.get_ylabel().partition(",")[0] for axes in plain.plot()] == ["velocity", "frequency"]
    with pytest.raises(ValueError, match="there is no trace to draw energies of; render with trace=True"):
        plain.plot("energies")
    with pytest.raises(ValueError, match="no panel 'wavform'; did you mean \"waveform\""):
        plain.plot("wavform")


def test_a_saved_sound_is_normalised_unless_a_gain_is_given(plain, tmp_path):
    gain = plain.save(tmp_path / "a.wav")
    sound, rate = soundfile.read(tmp_path / "a.wav")
    assert rate == 44_100 and np.abs(sound).max() == pytest.approx(10 ** (-1 / 20), rel=1e-6)
    faded = 221  # samples: the sound goes on, and fades out for 5 ms
    wanted = plain.audio[:, 0] * 10 ** (gain / 20)
    np.testing.assert_allclose(sound[:-faded], wanted[:-faded], rtol=0, atol=1e-6)
    assert sound[-1] == 0.0
    assert plain.save(str(tmp_path / "b.wav"), gain=0, subtype="DOUBLE") == 0.0
    assert (soundfile.read(tmp_path / "b.wav", always_2d=True)[0] == plain.audio).all()


def test_silence_is_not_made_loud(tmp_path):
    still = engine.render(BALL.replace({"body.ball.velocity": 0.0, "body.ball.displacement": 0.0, "gravity": 0.0}))
    assert still.save(tmp_path / "still.wav") == 0.0


@pytest.mark.hard
def test_trace_and_picture_are_saved_by_the_ends_of_their_names(traced, plain, tmp_path):
    traced.save(tmp_path / "a.npz")
    assert (np.load(tmp_path / "a.npz")["force"] == traced.trace["force"]).all()
    plain.save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="there is no trace to write; render with trace=True"):
        plain.save(tmp_path / "b.npz")


def test_what_cannot_be_written_is_refused_and_nothing_is_lost(plain, tmp_path):
    (tmp_path / "a.wav").write_text("old")
    with pytest.raises(ValueError, match="format"):
        plain.save(tmp_path / "a.doc")
    with pytest.raises(ValueError, match='unknown sample format "PCM_12"'):
        plain.save(tmp_path / "a.wav", subtype="PCM_12")
    with pytest.raises(OSError):
        plain.save(tmp_path / "none" / "a.wav")
    with pytest.raises(TypeError, match="3 is not a path; give the name of a file, such as"):
        plain.save(3)
    assert [p.name for p in tmp_path.iterdir()] == ["a.wav"] and (tmp_path / "a.wav").read_text() == "old"


def test_a_rendering_is_itself_and_no_other(plain):
    assert plain == plain and plain != engine.render(BALL, seconds=0.01) and len({plain, plain}) == 1


@pytest.mark.parametrize("gain", [math.nan, math.inf, -401.0])
def test_a_gain_that_no_sound_can_have_is_refused(plain, tmp_path, gain):
    with pytest.raises(ValueError, match=r"gain = .* is out of range; -400 to 400 dB"):
        plain.save(tmp_path / "a.wav", gain=gain)
    assert not list(tmp_path.iterdir())


def test_numbers_of_numpy_are_settings_of_accuracy_too():
    said = engine.render(BALL, seconds=0.01, order=np.int64(4), substeps=np.int64(2), tolerance=np.float32(0.0078125))
    accuracy = said.stats.accuracy
    assert (accuracy["order"], accuracy["substeps"], accuracy["tolerance"]) == (4, 2, 0.0078125)


def test_samples_that_are_cut_off_are_warned_of(plain, tmp_path):
    with pytest.warns(UserWarning, match=r"samples are beyond ±1 and clipped; gain=.* fits"):
        plain.save(tmp_path / "a.wav", gain=200.0, subtype="PCM_16")


def test_a_notebook_shows_sound_picture_and_numbers(pyplot, plain):
    backend = pyplot.get_backend()
    page = plain._repr_html_()
    assert "data:audio/flac;base64," in page and "data:image/png;base64," in page and "energy error" in page
    assert "<code>page()</code> lets you play the patch here" in page
    assert pyplot.get_backend() == backend and not pyplot.get_fignums(), "figures of the user's own are left alone"


@pytest.mark.hard
def test_a_rendering_makes_a_page_of_its_scene():
    rendering = engine.render(BALL, samplerate=48_000)
    assert rendering.page() == engine.export_page(BALL, samplerate=48_000)
    assert "<iframe" in rendering.page()._repr_html_()


@pytest.mark.parametrize(
    ("call", "kind", "says"),
    [
        (lambda: engine.render(None), TypeError, 'None is not a scene; give one, such as fdh.load("tanpura")'),
        (lambda: engine.render("tanpura"), TypeError, "not a scene; give fdh.load('tanpura')"),
        (lambda: engine.render({"body": []}), TypeError, "give fdh.load of it"),
        (lambda: engine.render(BALL, "long"), TypeError, "seconds = 'long' is not a number; give one, such as 1.0"),
        (lambda: engine.render(BALL, samplerate=44.1e3), TypeError, "samplerate = 44100.0 is not a whole number"),
        (lambda: engine.render(BALL, samplerate=44), ValueError, "samplerate = 44 is out of range; 4000 to 768000 Hz"),
        (lambda: engine.render(BALL, seconds=-1), ValueError, "seconds = -1 is out of range"),
        (lambda: engine.render(BALL, cores="two"), TypeError, "cores = 'two' is not a whole number"),
        (lambda: engine.render(BALL, oder=4), TypeError, "no argument 'oder'; did you mean \"order\"?"),
        (lambda: engine.render(BALL, order=3), ValueError, "order = 3 is out of range"),
        (lambda: engine.load(3), TypeError, '3 is not a path; give one, or a shipped name: fdh.load("tanpura")'),
        (lambda: engine.load(None), TypeError, "None is not a path"),
        (lambda: engine.load({"bdy": []}), engine.PatchError, 'scene bdy: unknown key; did you mean "body"?'),
        (lambda: engine.Player("tanpura"), TypeError, "give fdh.load('tanpura')"),
        (lambda: engine.Player(BALL, gain="loud"), TypeError, "gain = 'loud' is not a number"),
        (lambda: engine.Player(BALL, samplerate=4.5), TypeError, "samplerate = 4.5 is not a whole number"),
        (
            lambda: engine.Player(BALL, samplerate=100),
            ValueError,
            "samplerate = 100 is out of range; 4000 to 768000 Hz",
        ),
        (lambda: engine.Player(BALL, seconds=0), ValueError, "seconds = 0 is out of range; more than 0"),
        (lambda: engine.Player(BALL, seconds=math.nan), ValueError, "seconds = nan is out of range; more than 0"),
        (lambda: engine.Player(BALL, voices=-1), ValueError, "voices = -1 is out of range; 0 or more"),
        (lambda: engine.Player(BALL, cores=0), ValueError, "cores = 0 is out of range; at least 1"),
        (lambda: engine.render(BALL, seconds=True), TypeError, "seconds = True is not a number"),
        (
            lambda: engine.render(BALL, max_substeps=2),
            engine.BuildError,
            "has no effect without max_error; give that too",
        ),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused_with_the_remedy(call, kind, says):
    with pytest.raises(kind) as refused:
        call()
    assert says in str(refused.value) and len(str(refused.value)) < 200


@pytest.mark.parametrize(("gain", "subtype"), [(None, None), (40.0, "PCM_16"), (395.0, None)])
def test_the_command_writes_what_python_saves(tmp_path, gain, subtype):
    """Both bring a sound to the level of its file by the same function, also where it is clipped."""
    options = [] if gain is None else [f"--gain={gain}"]
    options += [] if subtype is None else ["--subtype", subtype]
    words = "render", "bouncing_ball", "--seconds", "0.1", "-o", str(tmp_path / "command.wav"), *options
    assert exit_code(*words) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        engine.render(BALL, seconds=0.1).save(tmp_path / "python.wav", gain, subtype)
    command, python = (soundfile.read(tmp_path / f"{name}.wav")[0] for name in ("command", "python"))
    np.testing.assert_array_equal(command, python)
    infos = [soundfile.info(str(tmp_path / f"{name}.wav")) for name in ("command", "python")]
    assert infos[0].subtype == infos[1].subtype and infos[0].samplerate == infos[1].samplerate
