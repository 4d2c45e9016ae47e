"""Live sound: how long callbacks take against their deadline, idle and while Python works, the compiled one and one in
Python; and the largest scenes that can be played.

Callbacks are called by JACK's dummy server, in real time, if there is one; each measurement is a process of its own.
`python -m bench.performance.live COMPILED FRAMES LOAD SECONDS PATCH` is such a process.
"""

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

import engine
from bench.publish.report import ROOT, publish
from bench.scenes.families import bank, hammered, tanpuras
from engine.live.shared_memory import Gauge, Slot

SECONDS = 3.0
SIZES = (64, 128, 256, 512)
BLOCK = 256
SHARE = 0.7  # of a deadline, that the worst block may take
RUNS = 3
PATCH = "tanpura_drone"
LOADS = ("idle", "runs a loop", "runs a long call")  # the last holds the interpreter's lock for 30 ms or more


def serve(frames: int) -> tuple[subprocess.Popen[bytes], dict[str, str]]:
    """A JACK server without a sound card, and the environment of its clients."""
    name = f"fdh-bench{os.getpid()}"
    told = {"JACK_DEFAULT_SERVER": name, "JACK_NO_START_SERVER": "1", "JACK_NO_AUDIO_RESERVATION": "1"}
    environment = {k: v for k, v in os.environ.items() if k != "DISPLAY"} | told
    words = ["jackd", "-r", "-p", "128", "-n", name, "-d", "dummy", "-r", "44100", "-p", str(frames)]
    server = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(1.5)
    return server, environment


def played(
    compiled: bool, frames: int, load: str, seconds: float, environment: dict[str, str], patch: str = PATCH
) -> dict[str, float]:
    """What a process tells that plays a patch for a while."""
    words = [sys.executable, "-m", "bench.performance.live", str(int(compiled)), str(frames), load, str(seconds), patch]
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def play(compiled: bool, frames: int, load: str, seconds: float, patch: str) -> None:
    """Play, and print what the callbacks took."""
    from engine.live import audio_device
    from engine.live.player import Player

    player = Player(engine.load(ROOT / "patches" / f"{patch}.toml"), gain=0.01, seconds=np.inf)
    stream = audio_device.open_stream(player, "JACK Audio", frames, None, compiled)
    stream.start()
    time.sleep(0.3)
    player.counters[Slot.UNDERRUNS] = player.counters[Slot.CALLS] = 0
    begin = time.monotonic()
    while time.monotonic() - begin < seconds:
        if load == "idle":
            time.sleep(0.05)
        elif load == "runs a loop":
            sum(i * i for i in range(2000))
        else:
            sum(range(2_000_000))
    calls, gaps = int(player.counters[Slot.CALLS]), int(player.counters[Slot.UNDERRUNS])
    elapsed = time.monotonic() - begin
    times = player.memory.shared.loads[: min(calls, len(player.memory.shared.loads))]
    told = {"calls": calls / (elapsed * 44_100 / frames), "gaps": gaps, "mean": float(times.mean())}
    print(json.dumps(told | {"p99": float(np.quantile(times, 0.99)), "max": float(times.max())}), flush=True)
    stream.stop()
    stream.close()


def callbacks() -> None:
    """Both callbacks, at all sizes."""
    header = [
        "callback",
        "Python thread",
        "frames per block",
        "mean load",
        "load, 99th percentile",
        "maximum load",
        "dropouts",
        "calls made / calls due",
    ]
    if shutil.which("jackd") is None:
        publish("callbacks", header, [["skipped: needs jackd", *[""] * 7]], "live")
        return
    rows = []
    for frames in SIZES:
        server, environment = serve(frames)
        try:
            for compiled in (True, False):
                for load in LOADS:
                    found = played(compiled, frames, load, SECONDS, environment)
                    shares = [f"{found[key]:.1%}" for key in ("mean", "p99", "max")]
                    name = "compiled" if compiled else "Python"
                    rows.append([name, load, str(frames), *shares, f"{found['gaps']:.0f}", f"{found['calls']:.0%}"])
        finally:
            server.terminate()
            server.wait(10)
    publish("callbacks", header, rows, "live")


def worst(scene: engine.Scene, cores: int) -> float:
    """The dearest block of the first half second over its deadline; of each block the fastest of some runs."""
    from engine.live import kernels
    from engine.live.player import Player

    kind = ctypes.CFUNCTYPE(
        ctypes.c_int, *[ctypes.c_void_p] * 2, ctypes.c_ulong, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_void_p
    )
    answer = kind(kernels.portaudio_callback())
    found, awake = [], scene.model_copy(update={"accuracy": scene.accuracy.replace(silence=-np.inf)})
    for _ in range(RUNS):
        player = Player(awake, gain=1e-3, cores=cores)
        if not player.state.p.any() and not player.scene.force:
            player.state.p[:] = 1.0  # a bank at rest would sleep
        player.gauges[Gauge.LOAD_HIGH] = np.inf  # at the full quality
        out = np.zeros((BLOCK, player.channels), np.float32)
        for _ in range(22_050 // BLOCK):
            answer(None, out.ctypes.data, BLOCK, None, 0, player.memory.address)
        found.append(player.memory.shared.loads[: int(player.counters[Slot.CALLS])].copy())
    return float(np.min(found, axis=0)[1:].max())


def largest(scene_of: Callable[[int], engine.Scene], size: int, cores: int) -> tuple[int, float]:
    """The largest scene whose worst block takes no more than its share, and that share, to 10 %; or the largest that
    may be written."""
    least, share = 0, 0.0
    most = None
    while most is None or most > 1.1 * least + 1:
        try:
            now = worst(scene_of(size), cores)
        except ValueError:  # too many bodies
            now = np.inf
        if now <= SHARE:
            least, share = size, now
        else:
            most = size
        size = 2 * size if most is None else (least + most) // 2
        if size == least:
            break
    return least, share


def chord(voices: int) -> engine.Scene:
    """Voices of the piano as notes are played with, an octave down, all struck at once."""
    from engine.live.voices import replicate, retune

    scene = replicate(retune(engine.load(ROOT / "patches" / "piano_c4.toml"), 0.5), voices)
    body = [b.model_copy(update={"velocity": 4.0}) if b.kind == "mass" else b for b in scene.body]
    return scene.model_copy(update={"body": body})


def scenes() -> None:
    """The largest of each family."""
    rows = []
    for name, scene_of, size in (
        ("free modes", bank, 8000),
        ("hammered strings of 61 modes, all at once", lambda n: hammered(n, 61), 64),
        ("tanpura strings, 16-point bridges", lambda n: tanpuras(n, 16), 8),
        ("polyphony: voices of piano_c4, all struck at once", chord, 64),
    ):
        found = [largest(scene_of, size, cores) for cores in (1, 2)]
        rows.append([name, *(text for most, share in found for text in (str(most), f"{share:.0%}"))])
    share = "worst block / deadline"
    header = [f"n, blocks of {BLOCK}", "largest n, one core", share, "largest n, two cores", share]
    publish("playable", header, rows, "live")


def run() -> None:
    """Measure and publish."""
    callbacks()
    scenes()


if __name__ == "__main__":
    play(sys.argv[1] == "1", int(sys.argv[2]), sys.argv[3], float(sys.argv[4]), sys.argv[5])
