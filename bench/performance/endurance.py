"""Whether anything grows while sound goes on: memory, and the error of the energy that the meter shows. An hour is
rendered as live sound, in blocks of the audio callback; and JACK's dummy server, if there is one, plays five minutes.

`python -m bench.performance.endurance PATCH MINUTES IS_PLAYED` is a process that does one of these.
"""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.performance.live import BLOCK, serve
from bench.publish.report import ROOT, publish
from engine.live import audio_device
from engine.live.player import Player

PATCHES = {"piano_c4": "struck every second, felt changed every minute", "driven_ball": "driven continuously"}
MINUTES, LIVE_MINUTES = 60, 5
SAMPLES_A_MINUTE = 6
SETTLED = 0.1  # of the time: what is loaded and allocated at first is no growth
HEADER = [
    "scene",
    "minutes",
    "memory",
    "growth of memory per hour",
    "events in the log",
    "energy error at the start",
    "energy error at the end",
    "dropouts",
]


class Moment(NamedTuple):
    """What was measured at a time."""

    minutes: float  # of sound
    memory: int  # resident bytes
    log: int  # events kept for the log
    energy_error: float
    dropouts: int


def resident_bytes() -> int:
    """Memory of this process."""
    words = Path("/proc/self/status").read_text("utf-8").split("VmRSS:")[1].split()
    return 1024 * int(words[0])


def measure(player: Player, minutes: float) -> Moment:
    """A look at a player, as a session takes one."""
    player.fetch_recording()
    meter = player.meter()
    return Moment(minutes, resident_bytes(), len(player.log()["events"]), meter.energy_error, meter.dropouts)


def act(player: Player, patch: str, second: int) -> None:
    """What is done to a patch in a second of sound."""
    if patch == "piano_c4":
        player.strike()
        if second % 60 == 0:
            player.set("contact.felt.stiffness", [3e9, 6e9][second // 60 % 2])


def render(patch: str, minutes: int) -> list[Moment]:
    """Render as the audio callback does, as fast as that goes."""
    player = Player(engine.load(patch), seconds=np.inf, gain=0.01)
    out, moments, blocks = np.zeros((BLOCK, player.channels), np.float32), list[Moment](), player.samplerate // BLOCK
    for second in range(60 * minutes):
        act(player, patch, second)
        for _ in range(blocks):
            player.render_into(out)
        if second % (60 // SAMPLES_A_MINUTE) == 0:
            moments.append(measure(player, player.frame / player.samplerate / 60))
    return moments


def play(patch: str, minutes: int) -> list[Moment]:
    """Play on JACK, in real time."""
    player, moments, second = Player(engine.load(patch), seconds=np.inf, gain=0.01), list[Moment](), 0
    stream = audio_device.open_stream(player, "JACK Audio", BLOCK, None, True)
    stream.start()
    begin = time.monotonic()
    while second < 60 * minutes:
        time.sleep(max(0.0, begin + second - time.monotonic()))
        act(player, patch, second)
        if second % (60 // SAMPLES_A_MINUTE) == 0:
            moments.append(measure(player, player.frame / player.samplerate / 60))
        second += 1
    stream.stop()
    stream.close()
    return moments


def growth(moments: list[Moment]) -> float:
    """How many bytes an hour adds, by a straight line, once all is settled."""
    settled = [moment for moment in moments if moment.minutes >= SETTLED * moments[-1].minutes]
    return float(np.polyfit([m.minutes for m in settled], [m.memory for m in settled], 1)[0]) * 60


def measured_apart(patch: str, minutes: int, environment: dict[str, str] | None) -> list[Moment]:
    """The moments of a process of its own. environment: of a client of JACK; None: rendered"""
    words = [
        sys.executable,
        "-m",
        "bench.performance.endurance",
        patch,
        str(minutes),
        str(int(environment is not None)),
    ]
    done = subprocess.run(words, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return [Moment(*moment) for moment in json.loads(done.stdout.splitlines()[-1])]


def row(name: str, moments: list[Moment]) -> list[Any]:
    """A line of the table."""
    last = moments[-1]
    return [
        name,
        f"{last.minutes:.0f}",
        f"{last.memory / 1e6:.0f} MB",
        f"{growth(moments) / 1e6:+.2f} MB",
        str(last.log),
        f"{moments[1].energy_error:.1e}",
        f"{last.energy_error:.1e}",
        str(last.dropouts),
    ]


def run() -> None:
    """Measure all, and publish it."""
    rows = [row(f"`{p}`, {what}; rendered", measured_apart(p, MINUTES, None)) for p, what in PATCHES.items()]
    if shutil.which("jackd") is None:
        rows.append(["skipped: five live minutes need jackd", *[""] * (len(HEADER) - 1)])
    else:
        server, environment = serve(BLOCK)
        try:
            for patch, what in PATCHES.items():
                rows.append(row(f"`{patch}`, {what}; live", measured_apart(patch, LIVE_MINUTES, environment)))
        finally:
            server.terminate()
            server.wait(10)
    publish("endurance", HEADER, rows)


if __name__ == "__main__":
    chosen = play if sys.argv[3] == "1" else render
    print(json.dumps(chosen(sys.argv[1], int(sys.argv[2]))))
