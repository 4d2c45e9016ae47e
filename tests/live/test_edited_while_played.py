"""A patch that is edited while it is played: pedals, wheels, controls, notes of a file, the recording and the log go
on, and what was played before takes no memory."""

import gc
import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, mostly_hard, needs_alsa, needs_portaudio
from test_drivers import run
from test_hot_reload import waited
from test_osc_commands import GUITAR, level

import engine
from engine.live import player as players
from engine.live.controls import Controls
from engine.live.hot_reload import PatchWatcher
from engine.live.key_allocator import live_scene
from engine.live.meter import join_readings
from engine.live.midi import MidiFilePlayer, make_allocator
from engine.live.midi_files import MidiNotes
from engine.live.midi_notes import Note
from engine.live.osc_commands import OscCommands
from engine.live.player import Player
from engine.live.replay import replay

RATE, BLOCK = 44_100, 441
MODES = "modes = 8", "modes = 9"
SIGMA = "body.string.sigma0"
PIANO = (ROOT / "patches" / "piano_c4.toml").read_text("utf-8")
MOVED = "displacement = -2e-3", "displacement = -3e-3"  # where a hammer begins is no live parameter


class Edited:
    """A patch in a file that a watcher watches, and a player with its controls and keys."""

    def __init__(self, path: Path, text: str, **options: object) -> None:
        self.path, self.text = path, text
        path.write_text(text, "utf-8")
        self.prepare = lambda scene: live_scene(scene) if scene.instrument else scene
        self.make = lambda scene: Player(scene, gain=1e-3, seconds=math.inf, **options)
        scene = self.prepare(engine.load(path))
        self.first = self.player = self.make(scene)
        self.controls = Controls(scene, self.first)
        self.commands = OscCommands(self.controls, make_allocator(self.first))
        self.file: MidiFilePlayer | None = None
        self.watch = PatchWatcher(path, scene, self.first, self.make, self.prepare, self._follow, self.controls.forget)

    def _follow(self, scene: engine.Scene, player: Player) -> None:
        self.commands.use(scene, player)
        self.player = player
        if self.file is not None:
            self.file.use(self.commands.keys)

    def edit(self, *changes: tuple[str, str]) -> list[str]:
        """Save the patch with changes; returns what the watcher says."""
        for change in changes:
            self.text = self.text.replace(*change, 1)
        self.path.write_text(self.text, "utf-8")
        return waited(self.watch)

    def switch(self, *changes: tuple[str, str]) -> None:
        """Edit the structure: another player takes over."""
        before = self.player
        assert "switched to the new version" in self.edit(*changes)[-1]
        assert self.player is not before and self.player.frame == 0

    def play(self, seconds: float) -> np.ndarray:
        """Play on, as a session does."""
        out = np.zeros((round(seconds * RATE / BLOCK), BLOCK, self.first.channels), np.float32)
        for block in out:
            for one in (self.file, self.controls, self.commands.keys):
                if one is not None:
                    one.poll()
            self.first.render_into(block)
        return out.reshape(-1, self.first.channels)

    def tell(self, kind: str, number: int, value: float) -> None:
        self.commands.keys.play(Note(0.0, kind, number, value))


@pytest.fixture
def string(tmp_path):
    """The piano string, whose losses OSC has set."""
    edited = Edited(tmp_path / "patch.toml", PIANO)
    edited.controls.receive("/body/string/sigma0", 8.0)
    edited.play(0.1)
    return edited


def pitch(sound: np.ndarray) -> float:
    """Frequency of the loudest partial, Hz."""
    spectrum = np.abs(np.fft.rfft(sound[:, 0] * np.hanning(len(sound)), 8 * len(sound)))
    return float(np.argmax(spectrum) * RATE / (8 * len(sound)))


# --- keys and wheels


@pytest.mark.parametrize("is_down", [True, False])
def test_a_pedal_stays_where_it_was(tmp_path, is_down):
    """A key that is let go after the edit sounds on if the pedal was down before it."""
    guitar = Edited(tmp_path / "guitar.toml", GUITAR, waiting=True)
    guitar.tell("sustain", 0, 127.0 * is_down)
    guitar.play(0.1)
    guitar.switch(MODES)
    guitar.tell("on", 60, 100)
    held = level(guitar.play(0.2))
    guitar.tell("off", 60, 64)
    assert (level(guitar.play(0.4)[-4410:]) > 0.3 * held) == is_down
    guitar.tell("sustain", 0, 0.0)
    assert level(guitar.play(0.5)[-4410:]) < 0.1 * held


def test_a_wheel_stays_where_it_was(tmp_path):
    """A key that is pressed after the edit sounds two semitones higher; the wheel brings it back."""
    guitar = Edited(tmp_path / "guitar.toml", GUITAR, waiting=True)
    guitar.tell("bend", 0, 200.0)
    guitar.play(0.1)
    guitar.switch(MODES)
    guitar.tell("on", 60, 100)
    guitar.play(0.1)
    bent = pitch(guitar.play(0.5))
    guitar.tell("bend", 0, 0.0)
    guitar.play(0.1)
    plain = pitch(guitar.play(0.5))
    assert 1200 * math.log2(bent / plain) == pytest.approx(200.0, abs=5.0)


# --- controls


def test_what_osc_has_set_stays_unless_the_edit_says_otherwise(string):
    assert string.player.value(SIGMA) == 8.0
    string.switch(MOVED)
    string.play(0.05)
    assert string.player.value(SIGMA) == 8.0
    string.switch(MOVED[::-1], ("sigma0 = 0.5", "sigma0 = 0.7"))
    string.play(0.05)
    assert string.player.value(SIGMA) == 0.7


@pytest.mark.parametrize("later", [9.0, None])
def test_what_osc_sets_before_and_after_an_edit_of_the_value(string, later):
    """The newer counts, also where the patch gets the value back that it had first."""
    assert string.edit(("sigma0 = 0.5", "sigma0 = 0.7")) == ["body.string.sigma0 → 0.7"]
    if later is not None:
        string.controls.receive("/body/string/sigma0", later)
    string.play(0.1)
    string.switch(MOVED, *([] if later else [("sigma0 = 0.7", "sigma0 = 0.5")]))
    string.play(0.05)
    assert string.player.value(SIGMA) == (later or 0.5)


@pytest.mark.parametrize("seconds", mostly_hard([0.0, 0.1]))
def test_a_move_that_an_edit_interrupts_is_made(tmp_path, seconds):
    """One that came just before it, and one that is on its smoothed way; and a number of OSC."""
    told = '[[control]]\nkind = "osc"\naddress = "/loss"\nparameter = "body.string.sigma0"\nrange = [0.0, 8.0]\n'
    string = Edited(tmp_path / "patch.toml", f"{PIANO}\n{told}smoothing = 0.2\n")
    string.controls.receive("/loss", 1.0)
    string.play(seconds)
    string.controls.receive("/contact/felt/stiffness", 5e9)
    string.switch(MOVED)
    string.play(2.0)
    wanted = {"contact.felt.stiffness": 5e9, SIGMA: pytest.approx(8.0)}
    assert {path: string.player.value(path) for path in wanted} == wanted


# --- notes of a file


@pytest.mark.parametrize("kind", ["keys", "voices"])
def test_a_file_goes_on_where_it_was(tmp_path, kind):
    """Each note of the file sounds once, at its time, whichever player has it."""
    text, change = (GUITAR, MODES) if kind == "keys" else (PIANO, MOVED)
    options = {"waiting": True} if kind == "keys" else {"voices": 4, "lowest": 0.5}
    edited = Edited(tmp_path / "patch.toml", text, **options)
    on = [Note(0.13 * n, "on", 60 + n % 5, 100) for n in range(20)]
    notes = sorted([*on, *(Note(note.seconds + 0.1, "off", note.number, 64) for note in on)])
    edited.file = MidiFilePlayer(edited.commands.keys, MidiNotes(notes, {}, [], [], [], {}, 0.0, 3.0))
    begins, owners = [0], [edited.first]
    for one in (change, change[::-1]):
        edited.play(0.7)
        begins.append(begins[-1] + edited.player.frame)
        edited.switch(one)
        owners.append(edited.player)
    assert edited.play(2.0).any()
    heard, word = [], "pluck" if kind == "keys" else "strike"
    for begin, end, player in zip(begins, [*begins[1:], 1 << 40], owners, strict=True):
        told = [e for e in player.log()["events"] if e["why"][0] == word and e["frame"] is not None]
        starts = [begin + max(event["frame"], event["row"][4]) for event in told]
        heard += [start for start in starts if start < end]
    slack = 3 if kind == "keys" else 500  # a voice that is taken from another note begins 6 ms later
    assert len(heard) == len(on)
    np.testing.assert_allclose(sorted(heard), [note.seconds * RATE for note in on], atol=slack)


# --- memory


@pytest.mark.system
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc")
@pytest.mark.parametrize("cores", [1, 2])
def test_players_that_were_left_take_no_memory(tmp_path, monkeypatch, cores):
    """Twenty edits of a vibraphone: only the last player is held, the sound goes on, and the recording is complete. The
    heap settles in the first ten; players that are held take 7 MB each."""
    monkeypatch.setattr(players, "LET_GO_SECONDS", 0.01)
    text = (ROOT / "patches" / "vibraphone.toml").read_text("utf-8")
    edited = Edited(tmp_path / "vibraphone.toml", text, waiting=True, cores=cores, log=False)
    made, heard, recorded, sizes = [edited.first], [], [], []
    for n in range(20):
        edited.tell("on", 60 + n, 100)
        heard.append(edited.play(0.3))
        assert heard[-1].any() and np.isfinite(heard[-1]).all()
        edited.switch((f"modes = {3 + n % 2}", f"modes = {4 - n % 2}"))
        heard.append(edited.play(0.1))
        recorded.append(edited.first.fetch_recording())
        made.append(edited.player)
        for _ in range(2):
            edited.first.let_go()
            time.sleep(0.02)
        gc.collect()
        sizes.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
        assert [player.memory.is_held for player in made] == [False] * (n + 1) + [True]
    assert sizes[-1] - sizes[9] < 12e6 and edited.first.lost_frames == 0
    np.testing.assert_array_equal(np.concatenate(recorded), np.concatenate(heard))


def test_readings_of_a_session_are_joined():
    """What is counted adds up, and the worst is that of any player; the rest is what the last one says."""
    now = Player(engine.load("piano_c4"), gain=1e-3).meter()
    before = replace(now, seconds=2.0, dropouts=3, dropped=5, worst_block=0.7, energy_error=1e-15, quality=-2)
    other = replace(now, seconds=1.5, dropouts=1, dropped=0, worst_block=0.9, energy_error=1e-13, quality=-1)
    last = replace(now, seconds=0.25, dropouts=0, dropped=1, worst_block=0.1, energy_error=0.0, peak=0.5)
    assert join_readings([before, other], last) == replace(
        last, seconds=3.75, dropouts=4, dropped=6, worst_block=0.9, energy_error=1e-13
    )


# --- the program


def program(folder: Path, environment: dict[str, str], *words: str) -> subprocess.Popen:
    """`fdh play --watch` of a patch in a folder, once it has said on what it plays."""
    (folder / "patch.toml").write_text(PIANO, "utf-8")
    command = [sys.executable, str(ROOT / "render.py"), "play", str(folder / "patch.toml"), "--watch", "--json", *words]
    command += ["--block-size", "16", "--callback", "python"]  # else a device that is a file is too fast to be recorded
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, "text": True}
    made = subprocess.Popen(command, env={**os.environ, **environment}, **pipes)
    while "blocks of" not in (line := made.stderr.readline()):
        assert line
    return made


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_a_session_with_edits_has_one_log_one_recording_and_one_summary(tmp_path, file_device):
    """The log replays to what was recorded, bit for bit; the summary counts from the beginning."""
    log, record, again = (str(tmp_path / name) for name in ("log.json", "record.wav", "again.wav"))
    made = program(tmp_path, file_device[0], "--event-log", log, "--record", record)
    for text in (PIANO.replace(*MOVED), PIANO):
        time.sleep(0.4)
        (tmp_path / "patch.toml").write_text(text, "utf-8")
        assert "switched to the new version" in made.stderr.readline()
    time.sleep(0.4)
    made.send_signal(signal.SIGINT)
    said, errors = made.communicate(timeout=30.0)
    assert made.returncode == 130 and "Traceback" not in errors
    wanted, live = soundfile.read(record, dtype="float32")[0], json.loads(said)["live"]
    parts = [json.loads(Path(log).read_text("utf-8"))]
    while "next" in parts[-1]:
        parts.append(parts[-1]["next"])
    assert len(parts) == 3 and live["lost"] == 0
    assert live["seconds"] == pytest.approx(len(wanted) / parts[0]["samplerate"], abs=0.05) and len(wanted) > 44_100
    assert run("replay", log, "-o", again).returncode == 0 and wanted.any()
    np.testing.assert_array_equal(soundfile.read(again, dtype="float32")[0], wanted)


@pytest.mark.system
@needs_portaudio
@needs_alsa
@pytest.mark.parametrize(("count", "seconds"), [(3, 0.002), (9, 0.02)])
def test_many_signals_end_it_as_one_does(tmp_path, file_device, count, seconds):
    """With a summary, a log that can be replayed, and the exit code of Ctrl-C, however late the last one comes."""
    log = tmp_path / "log.json"
    made = program(tmp_path, file_device[0], "--event-log", str(log))
    time.sleep(0.4)
    for _ in range(count):
        made.send_signal(signal.SIGINT)
        time.sleep(seconds)
    said, errors = made.communicate(timeout=30.0)
    assert made.returncode == 130 and errors == ""
    assert json.loads(said)["live"]["seconds"] > 0.0
    assert replay(json.loads(log.read_text("utf-8"))).any()
