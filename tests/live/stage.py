"""A session under JACK's dummy driver that a source of MIDI plays."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from test_drivers import start


def play_on_stage(folder: Path, jack: dict[str, str], source: str, script: str, words: list[str]) -> None:
    """Let a program play while a source sends what a script says, and end it.

    jack:   variables of the environment that lead to the server
    source: name of the port that the script opens; it waits for a line, and prints "done"
    words:  of the command play
    """
    environment = jack | {"MIDO_BACKEND": "socket_midi", "FDH_TEST_MIDI": str(folder)}
    environment |= {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    sender = subprocess.Popen([sys.executable, "-c", script], env={**os.environ, **environment}, **pipes)
    while not (folder / f"{source}.port").exists():
        assert sender.poll() is None
        time.sleep(0.05)
    program = start(environment, "play", *words, "--device", "JACK Audio", "--block-size", "256")
    try:
        sender.stdin.write("go\n")
        sender.stdin.flush()
        assert sender.stdout.readline().strip() == "done"
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=60.0)
    finally:
        sender.kill()
        program.kill()
    assert program.returncode == 130, errors
