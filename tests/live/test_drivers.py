"""Live sound through real drivers without a sound card: an ALSA device that is a file, and JACK's dummy server,
captured by a second process. Each is skipped, with its reason, where its library is missing."""

import contextlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import ROOT, exit_code, needs_alsa, needs_portaudio

import engine
from bench.performance.live import played
from engine.api.pilot import Pilot
from engine.live.player import Player

PIANO = str(ROOT / "patches" / "piano_c4.toml")
needs_jack = pytest.mark.skipif(shutil.which("jackd") is None, reason="no jackd")


def run(*words: str, timeout: float = 120.0, environment: dict[str, str] | None = None) -> subprocess.CompletedProcess:
    """render.py as a program of its own."""
    command = [sys.executable, str(ROOT / "render.py"), *words]
    told = {"capture_output": True, "text": True, "timeout": timeout, "stdin": subprocess.DEVNULL}
    return subprocess.run(command, env={**os.environ, **(environment or {})}, **told)


def after_silence(raw: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """What a driver was given, from where the sound begins; it is preceded by blocks of zeros."""
    begin = int(np.argmax(raw.any(axis=1))) - int(np.argmax(wanted.any(axis=1)))
    assert begin >= 0
    return raw[begin : begin + len(wanted)]


@pytest.mark.system
@needs_portaudio
@needs_alsa
@pytest.mark.parametrize("callback", ["compiled", "python"])
def test_the_driver_is_given_what_the_log_says(tmp_path, file_device, callback):
    """Through PortAudio to an ALSA device that is a file, bit for bit."""
    environment, raw = file_device
    log, record, again = (str(tmp_path / name) for name in ("log.json", "record.wav", "again.wav"))
    words = ["--seconds", "0.7", "--callback", callback, "--event-log", log, "--record", record]
    done = run("play", PIANO, *words, environment=environment)
    assert done.returncode == 0, done.stderr
    assert "on default" in done.stdout and "load" in done.stdout and ", latency " in done.stdout
    assert run("replay", log, "-o", again).returncode == 0
    wanted = soundfile.read(again, dtype="float32")[0]
    assert len(wanted) == round(0.7 * 44_100) and wanted.any()
    given = np.fromfile(raw, np.float32).reshape(-1, wanted.shape[1])
    np.testing.assert_array_equal(after_silence(given, wanted), wanted)
    np.testing.assert_array_equal(soundfile.read(record, dtype="float32")[0], wanted)


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_devices_are_listed_and_chosen_by_name(file_device):
    environment, _ = file_device
    listed = run("devices", environment=environment)
    assert listed.returncode == 0 and "default, ALSA" in listed.stdout
    wrong = run("play", PIANO, "--device", "theremin", environment=environment)
    assert wrong.returncode == 1
    assert 'no device is called "theremin"; the devices are' in wrong.stderr and "default" in wrong.stderr


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_keys_of_a_terminal(tmp_path, file_device):
    """Strike, mute and quit, from a terminal, with the meter on it; the log says so, and the terminal is as before."""
    import pty
    import termios

    environment, _ = file_device
    log, (keys, terminal) = tmp_path / "log.json", pty.openpty()
    before = termios.tcgetattr(terminal)
    words = [sys.executable, str(ROOT / "render.py"), "play", PIANO, "--seconds", "3000", "--event-log", str(log)]
    told = {"stdin": terminal, "stdout": subprocess.PIPE, "stderr": terminal, "text": True}
    program = subprocess.Popen(words, env={**os.environ, **environment, "TERM": "xterm"}, **told)
    assert "on default" in program.stdout.readline()
    time.sleep(0.5)
    for key in (b" ", b"9", b"m", b"q"):
        os.write(keys, key)
        time.sleep(0.3)
    assert program.wait(10.0) == 0
    assert termios.tcgetattr(terminal) == before
    events = json.loads(log.read_text())["events"]
    assert [e["why"][0] for e in events if e["why"][0] != "quality"] == ["strike", "strike", "damp"]
    assert events[1]["row"][7] > events[0]["row"][7]  # harder
    shown = os.read(keys, 100_000).decode(errors="replace")
    assert "keys: space to strike" in shown and "load" in shown


# a driver that says no
REFUSES = """
class PortAudioError(Exception): pass
class default: device = (0, 0)
def query_devices(): return [dict(name='it', hostapi=0, max_output_channels={channels}, default_samplerate=48000.0)]
def query_hostapis(n): return dict(name='none')
class _ffi:
    def cast(kind, address): return address
def _StreamBase(**told): raise PortAudioError('no', {number})
OutputStream = _StreamBase
"""


@pytest.mark.system
@pytest.mark.parametrize(
    ("number", "what"),
    [
        (-9985, "it, none is busy; end the program that is using it, or choose another device with --device"),
        (-9997, "it, none does not support 44100 Hz; its default rate is 48000: give --samplerate 48000"),
        (-9998, "it, none has 1 channels, and the patch needs 2; change `channel` of its pickups"),
        (-9999, "it, none cannot be opened (no)"),
    ],
)
def test_a_device_that_refuses(tmp_path, number, what):
    """Busy, of another rate, of too few channels: each is said, with what to do."""
    (tmp_path / "sounddevice.py").write_text(REFUSES.format(number=number, channels=1 if number == -9998 else 2))
    words = ["play", PIANO, "--samplerate", "44100", "--ignore-speed"]
    done = run(*words, environment={"PYTHONPATH": str(tmp_path)})
    assert done.returncode == 1 and what in done.stderr, done.stderr


@pytest.mark.system
def test_no_device(tmp_path):
    (tmp_path / "sounddevice.py").write_text("def query_devices(): return []\n")
    done = run("play", PIANO, environment={"PYTHONPATH": str(tmp_path)})
    assert done.returncode == 1 and "no output device; rendering to a file does not need one" in done.stderr


@pytest.mark.system
def test_no_portaudio(tmp_path):
    """The message says how to install it; rendering still works."""
    (tmp_path / "sounddevice.py").write_text("raise OSError('PortAudio library not found')\n")
    environment = {"PYTHONPATH": str(tmp_path)}
    done = run("play", PIANO, environment=environment)
    assert done.returncode == 1 and "apt install libportaudio2" in done.stderr and "brew install" in done.stderr
    out = str(tmp_path / "a.wav")
    assert run(PIANO, "-o", out, "--seconds", "0.1", environment=environment).returncode == 0
    assert soundfile.info(out).frames == 4410


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_ctrl_c_fades_out_and_keeps_the_recording(tmp_path, file_device):
    environment, _ = file_device
    record = tmp_path / "r.wav"
    words = [sys.executable, str(ROOT / "render.py"), "play", PIANO, "--seconds", "3000", "--record", str(record)]
    program = subprocess.Popen(
        words, env={**os.environ, **environment}, stdout=subprocess.PIPE, text=True, stdin=subprocess.DEVNULL
    )
    assert "on default" in program.stdout.readline()
    time.sleep(0.3)
    program.send_signal(signal.SIGINT)
    assert program.wait(10.0) == 130
    assert soundfile.info(record).frames > 1000
    assert np.abs(soundfile.read(record)[0][-1]).max() < 1e-3


@pytest.mark.system
def test_what_is_too_heavy_is_refused(tmp_path):
    """With how fast it runs; unless forced."""
    (tmp_path / "sounddevice.py").write_text(
        "class default: device = (0, 0)\n"
        "def query_devices(): return [dict(name='it', hostapi=0, max_output_channels=2, default_samplerate=44100.0)]\n"
        "def query_hostapis(n): return dict(name='none')\n"
    )
    heavy = tmp_path / "heavy.toml"
    text = Path(PIANO).read_text("utf-8")
    for n in range(5):  # strings of 20 000 modes, each with a hammer: the kernel is that of the piano
        text += f"""
[[body]]
name = "s{n}"
kind = "string"
length = 1.0
mass = 1.0
frequency = 1.0
modes = 20000
sigma0 = 0.1
[[body]]
name = "h{n}"
kind = "mass"
mass = 3e-3
displacement = -1e-3
velocity = 4.0
[[contact]]
body = "h{n}"
on = "s{n}"
on_at = 0.1
stiffness = 4.5e9
exponent = 2.5
loss = 0.1
"""
    heavy.write_text(text, "utf-8")
    done = run("play", str(heavy), environment={"PYTHONPATH": str(tmp_path)}, timeout=240.0)
    assert done.returncode == 1
    assert "TOO SLOW for real time: 0." in done.stderr and "--ignore-speed" in done.stderr


def test_a_machine_busy_for_a_moment_refuses_nothing(monkeypatch):
    """What costs too much once, and not again, is the machine's; what always does is the patch's."""
    scene = engine.load(PIANO)
    play, blocks = Player.render_into, iter(range(10**9))

    def held_up(once: bool):
        def slow(player, out, *more):
            if not once or next(blocks) == 3:
                time.sleep(0.1)
            play(player, out, *more)

        return slow

    monkeypatch.setattr(Player, "render_into", held_up(once=True))
    assert Pilot(lambda: Player(scene), 256, 30.0, 1.5).speed > 1.0
    assert next(blocks) > 3
    monkeypatch.setattr(Player, "render_into", held_up(once=False))
    assert Pilot(lambda: Player(scene), 256, 30.0, 0.3).speed < 1.0


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--block-size", "many"], '"many" is not a block size; give 1 to 65536 frames'),
        (["--latency", "soon"], '"soon" is not a latency; give low, high, or seconds'),
        (["--callback", "rust"], '"rust" is not a callback; give compiled or python'),
        (["--latency", "-1"], '"-1" is not a latency'),
        (["--record", "no/such/r.wav"], "no such folder"),
        (["--record", "r.xyz"], '"r.xyz" is not the name of a known audio format'),
        (["--record", "r.wav", "--event-log", "r.wav"], "would be written twice"),
        (["--price"], "--price is now a command: render.py accuracy PATCH"),
        (["-o", "out.wav"], "unrecognized arguments: -o out.wav; --record OUT.wav records the sound"),
        (["--voices", "none"], '"none" is not a number of voices; give 1 to 64'),
    ],
)
def test_wrong_arguments_are_said(words, what, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(ROOT / "render.py")])
    assert exit_code("play", PIANO, *words) == 2 and what in capsys.readouterr().err


@pytest.mark.system
def test_what_is_for_live_sound_alone_is_said():
    done = run(PIANO, "--record", "r.wav")
    assert done.returncode == 2 and "unrecognized arguments: --record r.wav; --record belongs to" in done.stderr
    done = run(PIANO, "--block-size", "64", "--callback", "python")
    assert done.returncode == 2 and "--block-size 64 --callback python; --block-size belongs to" in done.stderr
    done = run(PIANO, "--voices", "2")
    assert done.returncode == 2 and "--voices: requires --midi; give that too" in done.stderr
    done = run("replay", PIANO, "log.json")
    assert done.returncode == 2 and "unrecognized arguments: log.json" in done.stderr
    done = run("replay", "no.json")
    assert done.returncode == 2 and "cannot be read as a log" in done.stderr


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_what_cannot_be_built_is_said(file_device):
    done = run("play", PIANO, "--oversample", "2", environment=file_device[0])
    assert done.returncode == 2 and "accuracy.oversample: live sound cannot be oversampled" in done.stderr


@pytest.mark.system
@needs_portaudio
@needs_alsa
def test_one_channel_is_heard_on_both_sides(tmp_path, file_device):
    environment, raw = file_device
    record = tmp_path / "r.wav"
    mono = tmp_path / "mono.toml"
    mono.write_text(Path(PIANO).read_text("utf-8").replace("channel = 2", "channel = 1"), "utf-8")
    done = run("play", str(mono), "--seconds", "0.2", "--record", str(record), environment=environment)
    assert done.returncode == 0, done.stderr
    heard = soundfile.read(record, dtype="float32")[0]
    assert heard.shape == (8820, 2) and heard.any()
    np.testing.assert_array_equal(heard[:, 0], heard[:, 1])
    assert np.fromfile(raw, np.float32).size % 2 == 0


# --- JACK: paced in real time

# plugs itself into what another program plays
CAPTURE = """
import sys, time, numpy as np, sounddevice as sd
found = [i for i, d in enumerate(sd.query_devices()) if "JACK" in sd.query_hostapis(d["hostapi"])["name"]
         and d["max_input_channels"] > 0 and "system" not in d["name"]]
parts = []
def take(data, frames, when, status): parts.append(data.copy())
with sd.InputStream(device=found[0], channels=2, samplerate=44100, dtype="float32", callback=take):
    time.sleep(1.5)
np.save(sys.argv[1], np.concatenate(parts))
"""
LIVE = ("play", PIANO, "--device", "JACK Audio")


def start_jack(name: str):
    """The environment of the clients of a new server, and the server; None if it does not answer. On a machine that
    does nothing else it runs before all ordinary threads, as on a stage."""
    environment = {"JACK_DEFAULT_SERVER": name, "JACK_NO_START_SERVER": "1", "JACK_NO_AUDIO_RESERVATION": "1"}
    priority = ["-R", "-P", "70"] if os.environ.get("FDH_REHEARSAL_QUIET") == "1" else ["-r"]
    command = ["jackd", *priority, "-p", "128", "-n", name, "-d", "dummy", "-r", "44100", "-p", "256"]
    clean = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    server = subprocess.Popen(command, env=clean | environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _ in range(20):
        time.sleep(0.3)
        if shutil.which("jack_lsp") is None:  # it comes with jackd, but not everywhere
            time.sleep(1.2)
            return environment, server if server.poll() is None else None
        found = subprocess.run(["jack_lsp"], env=clean | environment, capture_output=True, text=True)
        if "system:playback_1" in found.stdout:
            return environment, server
    server.kill()
    return environment, None


@pytest.fixture
def jack(tmp_path):
    """A dummy server of its own, and the environment of its clients."""
    name = f"fdh_{os.environ.get('PYTEST_XDIST_WORKER', 'alone')}"  # one that was killed keeps its name's place
    environment, server = start_jack(name)
    if server is None:
        environment, server = start_jack(f"{name}_again")
    if server is None:
        pytest.skip("jackd does not start here")
    yield environment, server
    with contextlib.suppress(ProcessLookupError):
        server.terminate()
    with contextlib.suppress(subprocess.TimeoutExpired):
        server.wait(5.0)
    server.kill()


def start(environment: dict[str, str], *words: str) -> subprocess.Popen:
    """render.py at work: it has said on what it plays."""
    command = [sys.executable, str(ROOT / "render.py"), *words]
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "stdin": subprocess.DEVNULL}
    program = subprocess.Popen(command, env={**os.environ, **environment}, **told)
    assert "blocks of" in program.stdout.readline()
    return program


@pytest.mark.system
@needs_portaudio
@needs_jack
def test_another_program_hears_what_the_log_says(tmp_path, jack):
    """Played in real time to JACK and captured there by a second process, bit for bit."""
    environment, _ = jack
    log, again, captured = tmp_path / "log.json", tmp_path / "again.wav", tmp_path / "captured.npy"
    program = start(environment, *LIVE, "--seconds", "4", "--event-log", str(log))
    time.sleep(0.3)
    capture = [sys.executable, "-c", CAPTURE, str(captured)]
    subprocess.run(capture, env={**os.environ, **environment}, timeout=60.0, check=True, stdin=subprocess.DEVNULL)
    assert program.wait(60.0) == 0
    assert run("replay", str(log), "-o", str(again)).returncode == 0
    wanted, heard = soundfile.read(again, dtype="float32")[0], np.load(captured)
    assert json.loads(log.read_text())["samplerate"] == 44_100
    best = 0
    for begin in range(1000, len(heard) - 4096, 4096):  # a gap of the server's spoils one stretch, not all
        at = np.flatnonzero((wanted == heard[begin]).all(axis=1))
        best += any(np.array_equal(wanted[n : n + 4096], heard[begin : begin + 4096]) for n in at)
    assert best >= 3


@pytest.mark.system
@needs_portaudio
@needs_jack
def test_a_device_that_vanishes(tmp_path, jack):
    """The program leaves within a few seconds, says so, and keeps what was recorded."""
    environment, server = jack
    record = tmp_path / "r.wav"
    program = start(environment, *LIVE, "--seconds", "3000", "--record", str(record))
    time.sleep(1.0)
    server.kill()
    _, told = program.communicate(timeout=30.0)  # a few seconds, unless the machine is busy
    assert program.returncode == 1 and "was disconnected; the recording is kept" in told
    assert soundfile.info(record).frames > 10_000


@pytest.mark.system
@needs_portaudio
@needs_jack
def test_the_compiled_callback_does_not_wait_for_python(jack):
    """While Python is in calls that hold its lock for 30 ms or more, the callback in Python comes late; the compiled
    one does not. As a ratio: a machine without real-time rights may lose a block of either."""
    environment, _ = jack
    late = {True: math.inf, False: math.inf}
    for _ in range(3):  # the least of each: what else the machine does only makes them later
        for compiled in late:
            found = played(compiled, 256, "a long call", 3.0, os.environ | environment, "piano_c4")
            lost = found["gaps"] + max(0.0, 1.0 - found["calls"]) * 3.0 * 44_100 / 256
            late[compiled] = min(late[compiled], lost)
        if late[True] < late[False] / 4:
            break
    assert late[False] > 20
    assert late[True] < late[False] / 4
