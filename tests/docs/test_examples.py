"""The scripts of docs/examples: each runs as it is, and what it writes or plays is right. Fakes stand for the sound
card and the MIDI port."""

import csv
import ctypes
import math
import re
import runpy
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT

import engine
from engine.analysis.features import features
from engine.live.controls import Controls
from engine.live.osc import OscServer, parse_address
from engine.live.osc_commands import OscCommands

FOLDER = ROOT / "docs" / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
RATE = 44_100
STREAM_CALLBACK = ctypes.CFUNCTYPE(
    ctypes.c_int, *[ctypes.c_void_p] * 2, ctypes.c_ulong, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p
)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a script as a program, in a folder of its own. Returns that folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run_script(name: str, *words: object) -> Path:
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *map(str, words)])
        runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
        return tmp_path

    return run_script


class SoundDevice(types.ModuleType):
    """In place of sounddevice: a device that plays as fast as it is given blocks, and keeps them."""

    class PortAudioError(Exception):
        pass

    class default:
        device = (0, 0)

    _ffi = types.SimpleNamespace(cast=lambda kind, address: address)

    def __init__(self) -> None:
        super().__init__("sounddevice")
        self.blocks: list[np.ndarray] = []
        self.OutputStream = lambda *words, **told: CallbackStream(self, *words, **told)
        self._StreamBase = lambda **told: CompiledStream(self, **told)

    def query_devices(self):
        return [{"name": "none", "hostapi": 0, "max_output_channels": 2, "default_samplerate": RATE}]

    def query_hostapis(self, number):
        return {"name": "none"}


class CallbackStream:
    """Plays for as long as the program sleeps."""

    def __init__(self, fake, samplerate, *, blocksize, channels, dtype, callback):
        self.fake, self.rate, self.callback = fake, samplerate, callback
        self.shape, self.dtype = (blocksize, channels), dtype

    def __enter__(self):
        self.fake.sleep = self.play

    def __exit__(self, *error):
        pass

    def play(self, milliseconds: int) -> None:
        for _ in range(round(milliseconds / 1000 * self.rate / self.shape[0])):
            block = np.zeros(self.shape, self.dtype)
            self.callback(block, len(block), None, 0)
            self.fake.blocks.append(block)


class CompiledStream:
    """Plays a block whenever it is asked for, or whether it is active."""

    def __init__(self, fake, *, callback, userdata, channels, blocksize, **told):
        self.fake, self.callback, self.userdata = fake, STREAM_CALLBACK(callback), userdata
        self.shape = blocksize, channels
        fake.stream = self

    def play(self, seconds: float) -> None:
        for _ in range(math.ceil(seconds * RATE / self.shape[0])):
            block = np.zeros(self.shape, np.float32)
            self.callback(None, block.ctypes.data, len(block), None, 0, self.userdata)
            self.fake.blocks.append(block)

    @property
    def active(self) -> bool:
        self.play(1e-3)
        return True

    def start(self) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture
def sounddevice(monkeypatch):
    device = SoundDevice()
    monkeypatch.setitem(sys.modules, "sounddevice", device)
    return device


def table(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size < 60_000


def test_render_and_plot(run, capsys):
    folder = run("render_and_plot", "new")
    sound, rate = soundfile.read(folder / "new" / "render_and_plot.wav", always_2d=True)
    assert np.abs(sound).max() == pytest.approx(10 ** (-1 / 20), rel=1e-6) and len(sound) == 2 * rate
    assert features(sound, rate)["fundamental_hz"] == pytest.approx(261.6, abs=0.5)
    assert is_picture(folder / "new" / "render_and_plot.png")
    assert "peak_force=" in capsys.readouterr().out


@pytest.mark.hard
def test_contact_durations_fall_with_stiffness(run):
    rows = table(run("sweep_contact_duration") / "sweep_contact_duration.csv")
    stiffness, duration = ([float(row[name]) for row in rows] for name in ("stiffness", "duration"))
    assert len(rows) == 13 and stiffness == sorted(stiffness) and duration == sorted(duration, reverse=True)
    assert 3.5e-3 > duration[0] > 1.5 * duration[-1] > 1.5e-3
    assert is_picture(Path("sweep_contact_duration.png"))


@pytest.mark.hard
def test_errors_fall_with_order_and_substeps(run):
    rows = table(run("compare_schemes") / "compare_schemes.csv")
    error = {tuple(row[name] for name in ("scheme", "order", "substeps", "oversample")): row for row in rows}
    error = {setting: float(row["relative_error"]) for setting, row in error.items()}
    exact = [error["exact", order, substeps, "1"] for order in "24" for substeps in "124"]
    fdh = [error["fdh", "2", "1", oversample] for oversample in ("1", "4", "16")]
    assert exact == sorted(exact, reverse=True) and fdh == sorted(fdh, reverse=True)
    assert exact[0] < fdh[0] and exact[-1] < 1e-5 and exact[1] / exact[2] == pytest.approx(4.0, rel=0.1)
    assert all(float(row["ns_per_sample"]) > 0.0 for row in rows)


@pytest.mark.hard
def test_sounds_have_the_parameters_that_made_them(run):
    folder = run("labelled_set") / "labelled_set"
    found = np.load(folder / "labelled_set.npz")
    assert found["audio"].shape == (36, 8000) and found["audio"].dtype == np.float32
    assert len({tuple(row) for row in found["parameters"].tolist()}) == 36 and np.isfinite(found["features"]).all()
    for n in (0, 17, 35):
        values = dict(zip(found["names"].tolist(), found["parameters"][n].tolist(), strict=True))
        scene = engine.load("piano_c4").replace(values)
        audio = engine.render(scene, seconds=0.5, samplerate=int(found["samplerate"])).audio[:, 0]
        np.testing.assert_allclose(found["audio"][n], audio, rtol=0, atol=1e-6 * np.abs(audio).max())
    assert len(table(folder / "index.csv")) == 36


def test_measured_modes_are_those_of_the_file(run):
    """Of the file that is there, once it is."""
    folder = run("own_modes_from_csv")
    assert features(*soundfile.read(folder / "own_modes_from_csv.wav", always_2d=True))[
        "fundamental_hz"
    ] == pytest.approx(523.0, abs=0.5)
    modes = (folder / "glass.csv").read_text("utf-8")
    (folder / "glass.csv").write_text(modes.replace("523.0,2.8", "610.0,2.8"), "utf-8")
    run("own_modes_from_csv")
    assert features(*soundfile.read(folder / "own_modes_from_csv.wav", always_2d=True))[
        "fundamental_hz"
    ] == pytest.approx(610.0, abs=0.5)


@pytest.mark.hard
def test_a_callback_of_ones_own_plays(run, sounddevice):
    """What the device is given is what is written: the sound of a player with a tremolo of 4 Hz, 6 dB deep."""
    sound, rate = soundfile.read(run("sounddevice_callback") / "sounddevice_callback.wav")
    given = np.concatenate(sounddevice.blocks)
    np.testing.assert_allclose(sound, given, rtol=0, atol=2**-14)
    assert len(given) == pytest.approx(5.0 * rate, rel=0.01) and 0.1 < np.abs(given).max() < 1.0
    plain = engine.Player(engine.load("tanpura"), rate, math.inf).read(rate)
    tremolo = 0.75 + 0.25 * np.sin(2 * np.pi * 4.0 * np.arange(40_000) / rate)[:, None]
    np.testing.assert_allclose(given[:40_000], plain[:40_000] * tremolo, rtol=0, atol=1e-6)
    before, after = (given[round(t * rate) : round((t + 0.25) * rate)] for t in (2.7, 3.1))
    assert np.sqrt(np.mean(after**2)) > 1.2 * np.sqrt(np.mean(before**2)), "it is plucked again"


@pytest.mark.hard
def test_a_note_of_a_port_is_heard(run, sounddevice, monkeypatch, capsys):
    """A4 has 440 Hz."""
    mido = pytest.importorskip("mido", reason="needs mido")

    class Port:
        name = "Keys 1"

        def __iter__(self):
            sounddevice.stream.play(0.1)
            yield mido.Message("note_on", note=69, velocity=100)
            sounddevice.stream.play(0.5)
            yield mido.Message("note_off", note=69)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

    monkeypatch.setattr(mido, "open_input", lambda name: Port())
    run("midi_keyboard")
    sound = np.concatenate(sounddevice.blocks)
    before, after = sound[: round(0.09 * RATE)], sound[round(0.1 * RATE) : round(0.6 * RATE)]
    assert np.abs(before).max() < 1e-3 and 0.05 < np.abs(after).max() <= 1.0
    assert features(after.astype(float), RATE)["strongest_hz"] == pytest.approx(440.0, abs=2.0)
    assert "A4" in capsys.readouterr().out


@pytest.mark.hard
def test_another_program_strikes_louder_and_louder(run, monkeypatch):
    """The time between two strikes is that of the player; the messages come over UDP."""
    pytest.importorskip("pythonosc", reason="needs python-osc")
    scene = engine.load("piano_c4").replace("body.hammer.velocity", 0.0).model_copy(update={"event": []})
    player, levels, deadline = engine.Player(scene, seconds=math.inf, gain=0.01), [], time.monotonic() + 20.0
    commands = OscCommands(Controls(scene, player), None)
    server = OscServer(parse_address("0"), commands.receive)

    def play(seconds: float) -> None:
        while server.messages <= len(levels) and time.monotonic() < deadline:
            pass
        while commands._waiting:
            commands.poll()
        sound = player.read(round(seconds * RATE))
        levels.append(float(np.sqrt(np.mean(sound[-RATE // 10 :] ** 2))))

    try:
        with monkeypatch.context() as patched:
            patched.setattr(time, "sleep", play)
            run("osc_from_another_program", server.port, 0.3)
        play(0.3)
    finally:
        server.close()
    struck, damped = levels[:4], levels[4]
    assert len(levels) == server.messages == 5 and struck == sorted(struck) and struck[0] > 0.0
    assert damped < 0.1 * struck[-1] and struck[-1] > 4 * struck[0]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_short_says_how_to_run_it_and_is_listed(path):
    text = path.read_text("utf-8")
    assert 20 <= len(text.splitlines()) <= 40
    assert text.startswith('"""') and re.search(rf"    uv run (--extra \w+ )?python docs/examples/{path.name}\b", text)
    assert f"[{path.name}]({path.name})" in (FOLDER / "README.md").read_text("utf-8")


def test_all_scripts_are_tested_and_all_pictures_are_small_and_shown():
    page, source = (FOLDER / "README.md").read_text("utf-8"), Path(__file__).read_text("utf-8")
    assert len(SCRIPTS) == 8 and all(f'run("{path.stem}"' in source for path in SCRIPTS)
    assert all(is_picture(path) and f"]({path.name})" in page for path in FOLDER.glob("*.png"))
    assert {path.suffix for path in FOLDER.iterdir() if path.is_file()} == {".py", ".md", ".png", ".mid"}
