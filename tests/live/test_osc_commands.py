"""Messages of Open Sound Control play a patch: hammers, plucks, dampers and notes; what cannot be played is said once,
and the sound goes on. All messages come over a real UDP socket."""

import argparse
import json
import logging
import math
import os
import re
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import ROOT, needs_alsa, needs_portaudio
from test_osc import packet, sent, waited

import engine
from engine.cli.live_session import PlayerFactory
from engine.live.controls import Controls
from engine.live.key_allocator import live_scene
from engine.live.midi import make_allocator
from engine.live.midi_notes import Note
from engine.live.notices import MAX_LINES
from engine.live.osc import OscServer, parse_address
from engine.live.osc_commands import MAX_WAITING, OscCommands
from engine.live.player import Player
from engine.live.replay import replay

GUITAR = """
[keyboard]
keys = "C3..C5"

[[key.body]]
name = "string"
kind = "string"
length = 0.6
mass = 0.003
frequency = "= f"
sigma0 = 1.0
modes = 8

[[key.pickup]]
body = "string"
at = 0.3

[[key.on]]
kind = "pluck"
body = "string"
at = 0.2
amplitude = "= 2*v"
duration = 1e-3

[[key.damper]]
body = "string"
sigma = 30.0
"""


class Session:
    """A player that a server of OSC acts on."""

    def __init__(self, scene: engine.Scene, **options: object) -> None:
        self.player = Player(scene, gain=1e-3, seconds=math.inf, **options)
        self.commands = OscCommands(Controls(scene, self.player), make_allocator(self.player))
        self.server = OscServer(parse_address("0"), self.commands.receive, self.commands.notices.add)

    def send(self, *messages: tuple[object, ...]) -> np.ndarray:
        """Send messages; returns a tenth of a second of sound after they were played."""
        count = self.server.messages
        sent(self.server.port, *(packet(*message) for message in messages))
        waited(lambda: self.server.messages == count + len(messages))
        while self.commands._waiting:
            self.commands.poll()
        out = np.zeros((4410, self.player.channels), np.float32)
        self.player.render_into(out)
        return out

    def played(self) -> list[list[object]]:
        """What the log of the player has."""
        return [event["why"] for event in self.player.log()["events"]]


@pytest.fixture
def start():
    """Start a session, which ends with the test."""
    sessions = []

    def started(scene: engine.Scene, **options: object) -> Session:
        sessions.append(Session(scene, **options))
        return sessions[-1]

    yield started
    for session in sessions:
        session.server.close()


@pytest.fixture
def guitar(tmp_path):
    path = tmp_path / "guitar.toml"
    path.write_text(GUITAR, "utf-8")
    return engine.load(path)


def level(sound: np.ndarray) -> float:
    return float(np.sqrt(np.mean(sound**2)))


def test_a_hammer_is_struck_by_its_name_at_a_velocity(start):
    """Or at that of the patch; or all hammers without a name. Harder is louder; the log replays it bit for bit."""
    session = start(engine.load("piano_c4").model_copy(update={"event": []}))
    sounds = []
    for velocity in (0.5, 5.0):
        quiet = [session.send(("/mute",)) for _ in range(10)][-1]
        sounds.append(session.send(("/strike", "hammer", velocity)))
    session.send(("/strike", "hammer"), ("/strike",), ("/strike", 3))
    assert level(sounds[1]) > 5 * level(sounds[0]) > 50 * level(quiet)
    rows = [event["row"] for event in session.player.log()["events"] if event["why"] == ["strike", "hammer"]]
    root = math.sqrt(session.player.scene.body[1].mass)
    assert [row[7] / root for row in rows] == pytest.approx([0.5, 5.0, 2.5, 2.5, 3.0])
    heard = session.player.fetch_recording()
    np.testing.assert_array_equal(replay(json.loads(json.dumps(session.player.log())))[: len(heard)], heard)
    assert session.player.meter()["energy_error"] <= 1e-12
    assert session.commands.notices.take() == [] and session.server.remarks() == []


def test_plucks_dampers_and_mute(start):
    session = start(engine.load("tanpura"))
    whole = session.send(("/mute",), ("/pluck", "string"))
    half = session.send(("/pluck", "string", 0.5))
    damped = session.send(("/damp", "string"))
    session.send(("/pluck",), ("/damp",), ("/mute", 1), ("/mute", 0))
    assert level(whole) > 0.0 and half.any() and level(damped) < level(half)
    kinds = [why[0] for why in session.played()]
    assert kinds.count("pluck") == 3 and kinds.count("damp") == 4  # a button that is let go sends 0
    assert session.commands.notices.take() == []


def test_notes_are_played_by_the_keys_of_an_instrument(start, guitar):
    """By MIDI number or name, as from a MIDI port: velocity 0 lets a key go, and its damper comes down."""
    session = start(live_scene(guitar), waiting=True)
    assert not session.send().any()
    first = session.send(("/note", 60, 100))
    held = session.send()
    let_go = session.send(("/note", "C4", 0))
    session.send(("/note", 62.0, 80.0), ("/note", "F#3", 127), ("/note", "60", 1))
    assert level(first) > 0.0 and level(let_go) < 0.5 * level(held)
    assert session.commands.keys.played_notes() == {"F#3": "1 times", "C4": "2 times", "D4": "1 times"}
    parameter = "/body/C4_string/frequency"
    session.send((parameter, 270.0))  # beside parameters
    session.commands._controls.poll()
    assert session.player.value("body.C4_string.frequency") == 270.0


def test_notes_are_played_by_voices(start):
    """A name of the patch stands for its copies in all voices."""
    session = start(engine.load("piano_c4"), voices=2, lowest=0.5)
    assert session.send(("/note", "C4", 64), ("/note", 64, 100)).any()
    session.send(("/note", 60, 0), ("/strike", "hammer", 1.0))
    assert session.commands.keys.played_notes() == {"string": "C4, E4 (+400 c)"}
    strikes = [why[1] for why in session.played() if why[0] == "strike"]
    assert sorted(strikes[:2]) == sorted(strikes[2:]) == ["hammer_0", "hammer_1"]


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (("/strike", "hamer"), '/strike: no hammer is called "hamer"; there are "hammer"'),
        (("/strike", "string"), '/strike: no hammer is called "string"; there are "hammer"'),
        (("/strike", "hammer", 1.0, 2.0), '/strike: cannot take "hammer" 1.0 2.0; /strike [NAME] [VELOCITY]'),
        (("/strike", "hammer", math.nan), '/strike: cannot take "hammer" nan; /strike [NAME] [VELOCITY]'),
        (("/strike", "hammer", 1e30), "/strike: velocity = 1e+30 is out of range"),
        (("/pluck", "string"), "/pluck: the patch has no pluck; it needs a [[force]] of kind pluck"),
        (("/damp", "strng"), '/damp: no body is called "strng"; there are "string", "hammer"'),
        (("/damp", 1), "/damp: cannot take 1; /damp [NAME]"),
        (("/note", 60, 64), "/note: notes need voices that can be tuned; give --voices 8"),
        (("/note", 60), "/note: cannot take 60; /note KEY VELOCITY"),
        (("/note", "H4", 64), '/note: "H4" is not a key; give 0 to 127, or a name such as "C4"'),
        (("/note", 60.5, 64), "/note: 60.5 is not a key"),
        (("/note", 60, 200), "/note: velocity 200 is out of range; give 0, which releases the key, to 127"),
        (("/mute", "now"), '/mute: cannot take "now"; /mute'),
        (("/strike", "a\n\x1b[2J" + "b" * 5000), r'/strike: no hammer is called "a\n\x1b[2Jbbb'),
        (
            ("/strik", "hammer"),
            "no control or live parameter is called /strik; /strike, /pluck, /damp, /note, /mute play",
        ),
        (("/volume\x1b[2J" + "x" * 5000, 1.0), r"no control or live parameter is called /volume\x1b[2Jxxx"),
    ],
)
def test_what_cannot_be_played_is_said_once_and_the_sound_goes_on(start, message, says):
    session = start(engine.load("piano_c4"))
    for _ in range(3):
        assert session.send(message).any()
    lines = session.commands.notices.take()
    assert len(lines) == 1 and lines[0].startswith("OSC") and says in lines[0]
    assert len(lines[0]) < 200 and lines[0].isprintable()
    assert session.send(("/strike", "hammer", 2.0)).any() and ["strike", "hammer"] in session.played()


def test_keys_that_the_instrument_has_not_are_said(start, guitar):
    session = start(live_scene(guitar), waiting=True)
    session.send(("/note", "C7", 90), ("/note", "C7", 90), ("/strike",), ("/strike", "C4_string"))
    lines = session.commands.notices.take()
    assert "OSC /note: C7 is beyond the keys or pitches of the patch; C3 to C5" in lines and len(lines) == 2
    assert session.commands.remarks() == ["OSC: 3 messages could not be played"]


def test_a_control_of_the_patch_comes_before_a_command(start):
    table = engine.load("piano_c4").model_dump(exclude_unset=True)
    control = {"kind": "osc", "address": "/strike", "parameter": "contact.felt.stiffness", "range": [1e8, 1e10]}
    session = start(engine.Scene.model_validate(table | {"control": [control | {"smoothing": 0.0}]}))
    session.send(("/strike", 1.0))
    session.commands._controls.poll()
    assert session.player.value("contact.felt.stiffness") == 1e10
    assert ["strike", "hammer"] not in session.played()


@pytest.mark.hard
def test_a_flood_of_commands_takes_neither_memory_nor_the_session(start):
    """50 000 strikes: what there is no room for is counted, one look at them is short, and the sound goes on."""
    session = start(engine.load("piano_c4"))
    strike = packet("/strike", "hammer", 1.0)

    def have_come() -> bool:
        sent(session.server.port, *[strike] * 100)  # some get lost on a busy machine
        return session.server.messages >= 50_000

    waited(have_come)
    assert len(session.commands._waiting) == MAX_WAITING and session.commands.refused >= 40_000
    begin = time.perf_counter()
    session.commands.poll()
    assert time.perf_counter() - begin < 0.1
    assert session.send().any()
    assert "messages could not be played" in session.commands.remarks()[0]


# --- malformed packets and long addresses

MALFORMED = [
    b"/felt\0\0\0,I\0\0",  # a type that the parser does not know
    b"/felt\0\0\0,fX\0" + b"\x3f\x80\0\0",
    b"#bundle\0" + bytes(7) + b"\1" + b"\0\0\0\x08" + b"nonsense",
    b"#bundle\0" + bytes(8) + b"\0\0\0\x04" + b"\xff\xff\xff\xff",
    b"noise",
    b"/felt\0\0\0f\0\0\0",
]


def test_malformed_packets_are_said_once_and_counted(start, caplog, capfd):
    """The parser's warnings are not printed, line for line; those of the program around it are."""
    session = start(engine.load("piano_c4"))
    sent(session.server.port, *MALFORMED * 50)
    waited(lambda: session.server.malformed == 300)
    logging.getLogger().warning("of another")
    assert [record.message for record in caplog.records] == ["of another"]
    assert capfd.readouterr().err == ""
    lines = session.commands.notices.take()
    assert lines == ["OSC: a packet of 12 bytes is malformed; such packets are ignored and counted"]
    assert re.fullmatch(r"OSC: \d+ malformed packets or messages were ignored", session.server.remarks()[0])


def test_many_unknown_addresses_are_few_and_short_lines(start):
    session = start(engine.load("piano_c4"))
    session.send(*((f"/a{n}" + "x" * 3000, 1.0) for n in range(200)))
    lines = session.commands.notices.take()
    assert len(lines) == MAX_LINES + 1 and "further messages of this kind are not shown" in lines[-1]
    (line,) = session.commands._controls.remarks()
    assert len(line) < 1000 and line.count("...") == 10


# --- the command


@pytest.mark.hard
@pytest.mark.parametrize("name", ["snare", "guitar"])
def test_an_instrument_that_waits_for_notes_has_a_level(name):
    """Its middle key, played as loud as can be, is near half of full scale, whatever unit its pickups have, if the
    patch gives no level."""
    asked = argparse.Namespace(
        tuning=None,
        keyboard_map=None,
        cores=1,
        seconds=None,
        midi=None,
        osc="0",
        voices=None,
        watch=False,
        block_size=256,
        event_log=None,
    )
    asked.kernel, asked.json, asked.ignore_speed = "general", True, True
    asked.gain, asked.accuracy = None, {}
    factory = PlayerFactory(asked, 44_100, 2)
    document = engine.load(name).document
    del document["level"]
    player = factory.make_player(factory.prepare(engine.Scene.model_validate(document)), 0.1)
    keys = make_allocator(player)
    keys.play(Note(0.0, "on", keys.keys[len(keys.keys) // 2], 127))
    player.render_into(np.zeros((11_025, player.channels), np.float32))
    assert 0.3 < player.meter().peak < 0.6 and player.meter().limited == 0


@needs_portaudio
@needs_alsa
@pytest.mark.hard
def test_an_instrument_is_played_over_the_network(tmp_path, file_device, guitar):
    """`fdh play --osc` plays until it is stopped; the log has the notes, and what is wrong is printed once."""
    log = tmp_path / "log.json"
    words = ["play", str(tmp_path / "guitar.toml"), "--osc", "0", "--event-log", str(log), "--kernel", "general"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, "text": True}
    program = subprocess.Popen(
        [sys.executable, str(ROOT / "render.py"), *words], env={**os.environ, **file_device[0]}, **pipes
    )
    try:
        port = int(re.search(r"OSC at port (\d+)", program.stdout.readline()).group(1))
        for message in [("/note", "C4", 100)] + [("/note", "C9", 100)] * 3:
            sent(port, packet(*message))
        assert select.select([program.stderr], [], [], 30.0)[0]
        sent(port, packet("/note", 60, 0))
        time.sleep(0.5)
        program.send_signal(signal.SIGINT)
        output, errors = program.communicate(timeout=30.0)
    finally:
        program.kill()
    assert errors.count("OSC /note: C9 is beyond the keys") == 1 and "3 messages could not be played" in errors
    kinds = [event["why"][0] for event in json.loads(log.read_text())["events"]]
    assert [kind for kind in kinds if kind in ("pluck", "damp")] == ["pluck", "damp"]
    assert "C4 plays 1 times" in output
