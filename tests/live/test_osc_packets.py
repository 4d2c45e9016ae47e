"""Packets of Open Sound Control: whatever comes, the next message is played; bundles are played at their times."""

import json
import random
import struct
import threading
import time
from contextlib import closing
from functools import reduce

import numpy as np
import pytest
from test_osc import packet, sent, waited
from test_osc_commands import GUITAR, Session

import engine
from engine.live.key_allocator import live_scene
from engine.live.osc import LOOPBACK, SECONDS_1900_TO_1970, OscServer, TimedMessage
from engine.live.osc_commands import MAX_WAITING
from engine.live.replay import replay

RATE = 44_100
AT_ONCE = bytes(7) + b"\1"
STIFFNESS = "/contact/felt/stiffness"
STRIKE, SOFTEN = packet("/strike", "hammer", 1.0), packet(STIFFNESS, 1e9)


def element(data: bytes, size: int | None = None) -> bytes:
    return struct.pack(">i", len(data) if size is None else size) + data


def bundle(*elements: bytes, tag: bytes = AT_ONCE) -> bytes:
    return b"#bundle\0" + tag + b"".join(elements)


def at_time(when: float, *messages: bytes) -> bytes:
    """A bundle to be played at a time, s since 1970."""
    return bundle(*map(element, messages), tag=struct.pack(">Q", round((when + SECONDS_1900_TO_1970) * 2**32)))


class TimedSession(Session):
    """A session whose time of day goes on with its sound."""

    now = 1_800_000_000.3

    def hand_on(self, *packets: bytes, count: int) -> None:
        """Send packets, and wait until all their messages have come."""
        count += self.server.messages
        sent(self.server.port, *packets)
        waited(lambda: self.server.messages == count)

    def play(self, seconds: float, block: int) -> None:
        """Play block by block; messages are looked at somewhere in each block."""
        out, end = np.zeros((block, self.player.channels), np.float32), self.now + seconds
        while self.now < end:
            passed = self.player.frame % 7 / 7 * block / RATE
            self.player.render_into(out)
            self.now += passed
            self.commands.poll()
            self.commands._controls.poll()
            self.now += block / RATE - passed

    def begun(self, kind: str) -> list[int]:
        """The frames at which events of a kind begin, or changes of a parameter."""
        return [event["row"][4] for event in self.player.log()["events"] if event["why"][0] == kind]


@pytest.fixture
def start(monkeypatch, request):
    """Start a session, which ends with the test."""

    def started(scene: engine.Scene, **options: object) -> TimedSession:
        session = TimedSession(scene, **options)
        request.addfinalizer(session.server.close)
        monkeypatch.setattr(time, "time", lambda: session.now)
        return session

    return started


# --- malformed packets, and noise

MALFORMED = {"no size": bundle(b"\0\0"), "no time": bundle(tag=b"\0\0\0\1"), "nothing": b"", "no message": b"noise"}
MALFORMED["500 bundles in each other"] = reduce(lambda data, _: bundle(element(data)), range(500), STRIKE)
for number in (-(2**31), -4, 0, 3, 6, 8, 2**31 - 1):
    MALFORMED[f"size {number}"] = bundle(element(b"", number))
    MALFORMED[f"size {number}, before data"] = bundle(element(b"/a\0\0", number))
    MALFORMED[f"size {number}, nested"] = bundle(element(MALFORMED[f"size {number}"]))
    MALFORMED[f"size {number}, behind a message"] = bundle(element(STRIKE), element(b"", number))


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_packet_is_said_once_and_the_next_message_is_played(name):
    received, lines = [], []
    with closing(OscServer((LOOPBACK, 0), lambda message: received.append(message) is None, lines.append)) as server:
        begin = time.monotonic()
        sent(server.port, *[MALFORMED[name]] * 5, STRIKE)
        waited(lambda: received or time.monotonic() > begin + 1.0)
    assert time.monotonic() - begin < 3.0
    assert received == [TimedMessage("/strike", ["hammer", 1.0], None)], "within a second"
    said = f"OSC: a packet of {len(MALFORMED[name])} bytes is malformed; such packets are ignored and counted"
    assert lines == [said] and server.remarks() == ["OSC: 5 malformed packets or messages were ignored"]


def test_a_server_ends_while_a_message_is_still_being_done():
    done, begun = threading.Event(), threading.Event()
    with closing(OscServer((LOOPBACK, 0), lambda message: begun.set() is None and done.wait(20.0))) as server:
        sent(server.port, STRIKE)
        assert begun.wait(20.0)
        begin = time.monotonic()
    assert time.monotonic() - begin < 3.0
    done.set()


COMMANDS = [("/pluck", "string"), ("/damp", "string"), ("/mute", 1), ("/note", "C4", 100), ("/note", 60, 0), ("/no", 1)]
VALID = [STRIKE, SOFTEN, *(packet(*message) for message in COMMANDS)]


def noise(chance: random.Random) -> bytes:
    """Random bytes, or a message or a bundle with some of its bytes changed, inserted or cut off."""
    kind = chance.randrange(4)
    if kind == 0:
        return chance.choice([b"", b"/", b"#bundle\0", b"/strike\0,"]) + chance.randbytes(chance.randrange(300))
    data = chance.choice(VALID)
    for _ in range(chance.randrange(1, 4) if kind > 1 else 0):
        sizes = [None, None, None, chance.randrange(-8, 64), chance.randrange(-(2**31), 2**31)]
        parts = [element(chance.choice([data, *VALID]), chance.choice(sizes)) for _ in range(chance.randrange(4))]
        soon = at_time(time.time() + chance.uniform(-1.0, 1.0)) + b"".join(parts)
        data = chance.choice([bundle(*parts), bundle(*parts, tag=chance.randbytes(8)), soon])
    for _ in range(chance.randrange(4) if kind < 3 else 0):
        at = chance.randrange(len(data))
        data = data[:at] + chance.randbytes(chance.randrange(1, 6)) + data[at + chance.randrange(6) :]
    return data[: chance.randrange(len(data) + 1)] if chance.random() < 0.1 else data


@pytest.mark.hard
@pytest.mark.parametrize("count", [3_000, pytest.param(100_000, marks=pytest.mark.hard)])
def test_noise_neither_stops_nor_slows_what_comes_after_it(start, count):
    """No packet takes 50 ms, and none of what it says is fatal to the sound."""
    session, chance, seconds = start(engine.load("piano_c4")), random.Random(1), []
    server, take = session.server, session.server._take

    def measure(data: bytes) -> None:
        begin = time.thread_time()
        take(data)
        once = time.thread_time() - begin
        if once >= 0.05:  # by the packet, or by a collection of all that other tests left: once more says which
            begin = time.thread_time()
            take(data)
            once = min(once, time.thread_time() - begin)
        seconds.append(once)

    server._take = measure
    for n in range(50, count + 1, 50):
        sent(server.port, *(noise(chance) for _ in range(50)))
        waited(lambda n=n: len(seconds) == n)
        session.play(0.005, 64)
    assert server._thread.is_alive() and max(seconds) < 0.05
    assert min(server.malformed, server.messages) > 0.1 * count, "some of it makes sense, and some does not"
    assert session.send(("/strike", "hammer", 2.0)).any()
    assert session.played()[-1] == ["strike", "hammer"] and session.player.meter()["energy_error"] <= 1e-12


# --- times


@pytest.fixture
def guitar(tmp_path):
    (tmp_path / "guitar.toml").write_text(GUITAR, "utf-8")
    return live_scene(engine.load(tmp_path / "guitar.toml"))


QUARTER = round(0.25 * RATE)


@pytest.mark.parametrize("block", [64, 256])
@pytest.mark.parametrize(("message", "value"), [(("/strike", "hammer"), 1.0), ((STIFFNESS,), 1e9)])
def test_bundles_are_as_far_apart_as_their_times(start, message, value, block):
    """To the frame, though one comes after the other. A replay of the log is the same sound, bit for bit."""
    session = start(engine.load("piano_c4"))
    session.play(0.05, block)
    when, frame = session.now + 0.1, session.player.frame
    for n in range(3):
        session.hand_on(at_time(when + 0.25 * n, packet(*message, value * (n + 1))), count=1)
        session.play(0.03, block)
    session.play(0.8, block)
    begun = session.begun(message[0][1:].replace("/", "."))
    assert np.diff(begun).tolist() == [QUARTER] * 2 and 0 <= begun[0] - frame - round(0.1 * RATE) <= block
    assert session.commands.notices.take() == [] and session.server.late == 0
    heard = session.player.fetch_recording()
    np.testing.assert_array_equal(replay(json.loads(json.dumps(session.player.log())))[: len(heard)], heard)
    assert session.player.meter()["energy_error"] <= 1e-12


@pytest.mark.parametrize("voices", [0, 3])
def test_notes_in_bundles_begin_and_end_at_their_times(start, guitar, voices):
    """Each is let go when the next one begins, whether keys or voices play them."""
    session = start(engine.load("piano_c4") if voices else guitar, voices=voices, waiting=not voices)
    when, kind = session.now + 0.1, "strike" if voices else "pluck"
    for n, (key, before) in enumerate([(62, 55), (64, 62), (67, 64)]):
        session.hand_on(at_time(when + 0.25 * n, packet("/note", key, 100), packet("/note", before, 0)), count=2)
        session.play(0.01, 64)
    session.play(0.8, 64)
    begun = session.begun(kind)
    assert np.diff(begun).tolist() == [QUARTER] * 2 and session.begun("damp") == begun[1:]
    assert session.player.meter()["energy_error"] <= 1e-12


def test_bundles_in_a_bundle_have_times_of_their_own_and_those_without_a_time_are_played_at_once(start):
    session = start(engine.load("piano_c4"))
    first, second = (at_time(session.now + seconds, STRIKE) for seconds in (0.1, 0.35))
    session.hand_on(bundle(element(STRIKE)), bundle(element(STRIKE), tag=bytes(8)), count=2)
    session.hand_on(at_time(session.now + 0.1, second, first), count=2)
    session.play(0.5, 64)
    now, then, *later = session.begun("strike")
    assert now == then == 0 and np.diff(later).tolist() == [QUARTER] and session.server.remarks() == []


def test_a_late_bundle_is_played_at_once_said_once_and_counted(start):
    session = start(engine.load("piano_c4"))
    session.play(0.05, 64)
    frame = session.player.frame
    for late in (0.5, 0.01, 1e6):
        session.hand_on(at_time(session.now - late, STRIKE, SOFTEN), count=2)
    session.play(0.01, 64)
    taken = [event["frame"] for event in session.player.log()["events"] if event["why"][0] == "strike"]
    assert len(taken) == 3 and all(frame <= one <= frame + 128 for one in taken)
    assert session.player.value("contact.felt.stiffness") == 1e9
    late = "OSC: a message came 500 ms after its time; such messages are done at once, and counted"
    assert session.commands.notices.take() == [late]
    assert session.server.remarks() == ["OSC: 6 messages came after their time"]


def test_a_bundle_a_quarter_of_an_hour_ahead_is_refused_and_said(start):
    """Nearly a minute ahead is possible."""
    session = start(engine.load("piano_c4"))
    far, near = session.now + 1000.0, session.now + 59.0
    session.hand_on(*[at_time(far, STRIKE)] * 2, at_time(near, STRIKE), at_time(far, SOFTEN), count=4)
    session.play(0.01, 64)
    said = "its time is 1000 s ahead; give at most 60 s"
    assert session.commands.notices.take() == [f"OSC /strike: {said}", f"OSC {STIFFNESS}: {said}"]
    assert session.commands.remarks() == ["OSC: 3 messages could not be played"]
    assert session.begun("strike") == [pytest.approx(59 * RATE, abs=64)]
    assert session.player.value("contact.felt.stiffness") == 4.5e9


def test_a_key_is_let_go_however_many_messages_wait(start, guitar):
    session = start(guitar, waiting=True)
    assert session.send(("/note", 60, 100)).any()
    for _ in range(4):
        session.hand_on(*[STRIKE] * 300, count=300)
    assert len(session.commands._waiting) == MAX_WAITING
    session.hand_on(packet("/note", 60, 0), packet("/damp", "C5_string"), packet("/mute", 0), count=3)
    assert session.commands.refused == 1200 - MAX_WAITING
    session.send()
    assert [why for why in session.played() if why[0] == "damp"] == [["damp", "C4_string"], ["damp", "C5_string"]]
