"""Plug-ins in programs that others have written: jalv for LV2, pedalboard and DawDreamer for VST3, Wine for Windows."""

import json
import shutil
import subprocess
import sys
import time
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import engine
from engine.api.page import level_of
from engine.cli.main import main
from engine.export.plugin_data import PluginSettings, make_plugin_data
from engine.export.plugin_library import BUILDS, DPF, write_sources
from tests.compiler.test_shipped import skip_if_stale
from tests.export.key_messages import TWO_TINES, midi_of
from tests.export.plugins import is_same, needs_linker, play_live
from tests.live.two_ways import Message

pytestmark = [needs_linker, pytest.mark.hard]
RATE, BLOCK, FRAMES = 48_000, 256, 48_128
SONG = [
    Message(467, "on", 60, 64),
    Message(11_038, "on", 64, 96),
    Message(13_243, "off", 60, 64),
    Message(26_473, "on", 67, 127),
    Message(39_703, "on", 72, 32),
    Message(41_908, "off", 72, 64),
]
HOST = Path(__file__).with_name("vst3_host.py")
DRIVER = Path(__file__).with_name("plugin_driver.c")
WINE = next(filter(None, map(shutil.which, ("wine64", "/usr/lib/wine/wine64", "wine"))), None)


def exported(name, folder, *words):
    """Export a patch with its tables for RATE; return the scene and what live sound plays."""
    skip_if_stale()
    assert main(["export", name, "--plugin", str(folder), "--rates", str(RATE), *words]) == 0
    scene = engine.load(name)
    return scene, play_live(scene, RATE, level_of(scene, RATE), SONG, FRAMES)


def run_host(host, bundle):
    """Return what a host plays, [frames, 2], and what it says of the plug-in."""
    messages = json.dumps([[m.frame, midi_of(m.kind, m.key, m.value)] for m in SONG])
    command = [sys.executable, HOST, host, bundle, str(RATE), str(BLOCK), str(FRAMES)]
    done = subprocess.run(command, input=messages.encode(), capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    said = next(line for line in done.stderr.decode().splitlines() if line.startswith("{"))
    return np.frombuffer(done.stdout, np.float32).reshape(-1, 2), json.loads(said)


@pytest.mark.skipif(not DPF.is_dir(), reason="the package dpf-source is not there")
def test_vst3_in_pedalboard_has_the_samples_of_live_sound(tmp_path):
    """Under the title of its patch; parameters begin at its values."""
    if find_spec("pedalboard") is None:
        pytest.skip("pedalboard is not there")
    _, expected = exported("vibraphone", tmp_path, "--format", "vst3")
    audio, said = run_host("pedalboard", tmp_path / "vibraphone.vst3")
    assert is_same(audio[:FRAMES], expected)
    assert said["name"] == engine.load("vibraphone").title and said["maker"] == "fdh-engine"
    assert list(said["parameters"]) == ["lost_events"]
    assert main(["export", "piano_c4", "--plugin", str(tmp_path), "--format", "vst3", "--rates", str(RATE)]) == 0
    _, said = run_host("pedalboard", tmp_path / "piano_c4.vst3")
    stiffness = next(value for name, value in said["parameters"].items() if "felt_stiffness" in name)
    assert stiffness == pytest.approx(0.5, abs=1e-6)  # in the middle, by ratios


@pytest.mark.skipif(not DPF.is_dir(), reason="the package dpf-source is not there")
def test_vst3_in_dawdreamer_sounds_like_live_sound(tmp_path):
    """As exactly as that host gives the times of notes: in each tenth of a second, the level is within 0.3 dB."""
    if find_spec("dawdreamer") is None:
        pytest.skip("dawdreamer is not there")
    _, expected = exported("vibraphone", tmp_path, "--format", "vst3")
    audio, said = run_host("dawdreamer", tmp_path / "vibraphone.vst3")
    levels = [[np.std(x[n : n + 4800]) for n in range(4800, FRAMES - 4800, 4800)] for x in (audio, expected)]
    off = 20 * np.log10(np.divide(*levels))
    assert len(off) >= 8 and np.abs(off).max() < 0.3 and said["name"]


def test_without_dpf_it_is_said_where_to_get_it(tmp_path, capsys):
    words = ["--format", "vst3", "--dpf", str(tmp_path / "nowhere")]
    assert main(["export", "bouncing_ball", "--plugin", str(tmp_path / "out"), *words]) == 2
    assert "dpf-source" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.system
@pytest.mark.skipif(not (shutil.which("jalv") and shutil.which("jackd")), reason="jalv or jackd is not there")
def test_lv2_in_jalv_has_the_samples_of_live_sound(tmp_path, monkeypatch):
    """Under JACK's dummy driver, with notes at their samples."""
    if find_spec("jack") is None:
        pytest.skip("JACK-Client is not there")
    _, expected = exported("vibraphone", tmp_path, "--format", "lv2")
    monkeypatch.setenv("LV2_PATH", str(tmp_path))
    monkeypatch.setenv("JACK_DEFAULT_SERVER", "plugins")
    monkeypatch.setenv("JACK_NO_AUDIO_RESERVATION", "1")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(["jackd", "-r", "-d", "dummy", "-r", str(RATE), "-p", "1024"], **quiet)
    time.sleep(1.5)
    words = ["jalv", "-i", "-n", "plug", "urn:fdh-engine:vibraphone"]
    host = subprocess.Popen(words, stdin=subprocess.PIPE, **quiet)
    try:
        audio = play_through_jack(2, 1024)
    finally:
        for process in (host, server):
            process.terminate()
            process.wait(10)
    delays = [n for n in range(0, 4 * 1024 + 1, 1024) if is_same(audio[n : n + FRAMES], expected)]
    assert len(delays) == 1  # of the graph: a few of its periods


def play_through_jack(channels, period):
    """Play SONG to a program called plug and return what comes back, [frames, channels]."""
    import jack

    client = jack.Client("test")
    port, inputs = client.midi_outports.register("m"), [client.inports.register(f"i{n}") for n in range(channels)]
    kept, state = [], {"frame": -1}

    @client.set_process_callback
    def process(frames):
        port.clear_buffer()
        if state["frame"] < 0:
            return
        for message in SONG:
            if state["frame"] <= message.frame < state["frame"] + frames:
                port.write_midi_event(message.frame - state["frame"], midi_of(message.kind, message.key, message.value))
        kept.append(np.stack([one.get_array().copy() for one in inputs], 1))
        state["frame"] += frames

    with client:
        deadline = time.monotonic() + 20.0
        while len(client.get_ports("plug")) <= channels and time.monotonic() < deadline:
            time.sleep(0.05)
        client.connect(port, client.get_ports("plug", is_midi=True, is_input=True)[0])
        for one, ours in zip(client.get_ports("plug", is_audio=True, is_output=True), inputs, strict=True):
            client.connect(one, ours)
        time.sleep(0.5)
        state["frame"] = 0
        while state["frame"] < FRAMES + 8 * period:
            time.sleep(0.1)
    return np.concatenate(kept)


@pytest.mark.skipif(WINE is None, reason="no Wine")
def test_windows_code_computes_the_same(tmp_path):
    """The player as a program of Windows, under Wine, and of Linux: the same samples."""
    skip_if_stale()
    scene = engine.load(TWO_TINES)
    data = make_plugin_data(scene, PluginSettings("tines", partial(level_of, scene, RATE), [RATE]))
    path = tmp_path / "tines.fdh"
    path.write_bytes(data.content)
    sums = {}
    for system, runner in {"linux": [], "windows": [WINE]}.items():
        build, folder = BUILDS[system][0], tmp_path / system
        folder.mkdir()
        inputs = write_sources(folder, build.levels)
        program = folder / "driver.exe"
        flags = ["-O2", "-ffp-contract=off", "-fno-sanitize=all", f"-I{folder}"]
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", build.triple, *flags]
        subprocess.run([*zig, "-o", program, DRIVER, *inputs, *["-lm"] * (system == "linux")], check=True)
        command = [*runner, program, str(RATE), "tines.fdh"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
        sums[system] = done.stdout.split()
    assert sums["linux"][0] == "played," and sums["linux"] == sums["windows"]
