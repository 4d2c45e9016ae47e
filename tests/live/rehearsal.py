"""Play a rehearsal to a running `fdh play`: a score from a virtual MIDI port with pedal and wheel, sliders by OSC, a
source that goes and comes back, and edits of the patch. Prints what was sent, as JSON.

python rehearsal.py SCORE PATCH OSC_PORT SECONDS
"""

import json
import sys
import time
from pathlib import Path

import mido
from pythonosc.udp_client import SimpleUDPClient
from socket_midi import Source

SOURCE = "rehearsal"  # name of the port
PEDAL_EVERY, WHEEL_EVERY, SLIDER_EVERY = 1 / 80, 1 / 150, 1 / 100  # s
EDIT_EVERY, AWAY = 20.0, 3.0  # s between two edits of the patch, and for which the source is gone
BEGIN = 1.0  # s
QUIET = 2.5  # s after the source is back, until it plays: it is looked for once a second


def triangle(seconds: float, period: float) -> float:
    """Return a number that goes from 0 to 1 and back in a period."""
    share = seconds / period % 1.0
    return 2.0 * min(share, 1.0 - share)


class Rehearsal:
    """What is sent, and when: seconds of the monotonic clock."""

    def __init__(self, score: Path, patch: Path, port: int) -> None:
        self.score = [m for m in mido.MidiFile(score) if m.type in ("note_on", "note_off") or m.time]
        self.patch, self.sliders = patch, SimpleUDPClient("127.0.0.1", port)
        self.text, self.source = patch.read_text("utf-8"), Source(SOURCE)
        self.notes: list[tuple[float, int]] = []
        self.edits = self.slid = 0
        self.due = {"pedal": 0.0, "wheel": 0.0, "slider": 0.0, "edit": EDIT_EVERY / 2}

    def keep_moving(self, now: float) -> None:
        """Move what is due: pedal, wheel, slider, patch."""
        if now >= self.due["pedal"]:
            self.due["pedal"] += PEDAL_EVERY
            self.source.send([0xB0, 64, round(127 * triangle(now, 1.7))])
        if now >= self.due["wheel"]:
            self.due["wheel"] += WHEEL_EVERY
            bend = 8192 + round(4000 * (triangle(now, 2.3) - 0.5))
            self.source.send([0xE0, bend & 127, bend >> 7])
        if now >= self.due["slider"]:
            self.due["slider"] += SLIDER_EVERY
            self.slid += 1
            self.sliders.send_message("/pickup/0/gain", 0.5 + 0.5 * triangle(now, 3.1))
        if now >= self.due["edit"]:
            self.due["edit"] += EDIT_EVERY
            self.edits += 1
            title = f'title = "Rehearsal {self.edits}"'
            self.patch.write_text(self.text.replace(self.text.split("\n")[self.title_line()], title), "utf-8")

    def title_line(self) -> int:
        """Return which line of the patch has its title."""
        return next(n for n, line in enumerate(self.text.split("\n")) if line.startswith("title"))

    def play(self, seconds: float) -> None:
        """Play the score again and again, with the source gone for a while in the middle."""
        begin, at, gone = time.monotonic(), 0.0, False
        while True:
            for message in self.score:
                at += message.time
                while (now := time.monotonic() - begin) < at:
                    self.keep_moving(now)
                    time.sleep(0.001)
                if now > seconds:
                    return
                if message.type in ("note_on", "note_off"):
                    self.source.send(message.bytes())
                    if message.type == "note_on" and message.velocity:
                        self.notes.append((time.monotonic(), message.note))
                if not gone and now > seconds / 2:
                    gone = True
                    self.source.close()
                    time.sleep(AWAY)
                    self.source = Source(SOURCE)
                    time.sleep(QUIET)
                    at = time.monotonic() - begin
                    self.due = dict.fromkeys(self.due, at) | {"edit": at + EDIT_EVERY / 2}


if __name__ == "__main__":
    rehearsal = Rehearsal(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
    sys.stdin.readline()  # once the program plays …
    time.sleep(BEGIN)  # … and its stream has begun
    rehearsal.play(float(sys.argv[4]))
    time.sleep(1.0)
    print(json.dumps({"notes": rehearsal.notes, "edits": rehearsal.edits, "slid": rehearsal.slid}))
