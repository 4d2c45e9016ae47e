"""Open Sound Control: numbers arrive, whatever else comes; every live parameter has an address."""

import math
import socket
import time

import numpy as np
import pytest
from conftest import exit_code
from test_controls import FELT, PIANO, controlled

import engine
from engine.live.controls import Controls
from engine.live.osc import OscError, OscServer, TimedMessage, number_in, parse_address
from engine.live.osc_commands import OscCommands
from engine.live.player import Player


@pytest.fixture
def server():
    """A server at a free port, and what it received."""
    received: list[tuple[str, float]] = []

    def receive(message: TimedMessage) -> bool:
        value = number_in(message.arguments)
        if value is not None:
            received.append((message.address, value))
        return value is not None

    opened = OscServer(parse_address("0"), receive)
    yield opened, received
    opened.close()


def packet(address: str, *values: float | str) -> bytes:
    """A message of OSC."""
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)
    return builder.build().dgram


def sent(port: int, *packets: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for data in packets:
            out.sendto(data, ("127.0.0.1", port))


def waited(condition) -> None:
    begin = time.monotonic()
    while not condition():
        assert time.monotonic() - begin < 20.0, "it did not come"
        time.sleep(0.005)


def test_numbers_arrive_over_loopback(server):
    opened, received = server
    sent(opened.port, packet("/felt", 0.25), packet("/felt", 3), packet("/contact/felt/gap", -1e-3))
    waited(lambda: len(received) == 3)
    assert received[:2] == [("/felt", 0.25), ("/felt", 3.0)] and received[2][1] == pytest.approx(-1e-3)
    assert opened.remarks() == []


def test_malformed_packets_are_counted_and_never_fatal(server):
    """Noise, broken messages, texts, infinities: passed over; what comes after them arrives."""
    opened, received = server
    noise = np.random.default_rng(0)
    bad = [noise.bytes(int(noise.integers(1, 200))) for _ in range(200)]
    bad += [packet("/felt"), packet("/felt", 1.0, 2.0), packet("/felt", "high"), packet("/felt", math.inf)]
    bad += [packet("/felt", 1.0)[:n] for n in (1, 5, 9, 13)] + [b"#bundle\0" + bytes(4), b""]
    sent(opened.port, *bad, packet("/felt", 0.5))
    waited(lambda: ("/felt", 0.5) in received)
    assert opened.malformed >= 200
    assert opened.remarks() == [f"OSC: {opened.malformed} malformed packets or messages were ignored"]


@pytest.mark.hard
def test_a_flood_is_held(server):
    """10 kHz for half a second: the last number counts, and the sound gets one event a step, not one a message."""
    scene = controlled({"kind": "osc", "address": "/felt", "input": [0, 100]} | {k: FELT[k] for k in
                       ("parameter", "range", "curve")} | {"smoothing": 0.0})  # fmt: skip
    player = Player(scene, gain=1e-3, seconds=math.inf)
    controls, out = Controls(scene, player), np.zeros((441, player.channels), np.float32)
    flood = OscServer(parse_address("0"), OscCommands(controls, None).receive)
    try:
        for block in range(50):
            sent(flood.port, *(packet("/felt", (n * 7 + block) % 101) for n in range(100)))
            controls.poll()
            player.render_into(out)
        sent(flood.port, packet("/felt", 100.0))
        waited(lambda: flood.messages == 5001)
    finally:
        flood.close()
    player.render_into(out)
    controls.poll()
    player.render_into(np.zeros((4410, player.channels), np.float32))
    now = player.meter()
    assert now["dropped"] == 0 and now["energy_error"] <= 1e-12
    assert len(player.log()["events"]) <= 52
    assert player.value(FELT["parameter"]) == 1e10


def test_any_live_parameter_has_an_address():
    """Its path with slashes, in SI units; what has none is said at the end."""
    player = Player(engine.load(PIANO), seconds=math.inf)
    controls = Controls(player.scene, player)
    controls.receive("/contact/felt/stiffness", 2e9)
    controls.receive("/body/string/frequency", 300.0)
    controls.receive("/body/string/frequency", -300.0)
    controls.receive("/volume", 1.0)
    controls.poll()
    player.render_into(np.zeros((2048, player.channels), np.float32))
    assert player.state.potential_coefficient[0] * 3.5 == pytest.approx(2e9)
    first, second = controls.remarks()
    assert first.startswith("body.string.frequency: body.string.frequency = -300 is out of range")
    assert second == "OSC: no control or live parameter belongs to /volume (1 times)"


def test_addresses_and_ports_are_explained():
    assert parse_address("9000") == ("127.0.0.1", 9000) and parse_address("0.0.0.0:9") == ("0.0.0.0", 9)
    first = OscServer(parse_address("0"), lambda message: True)
    with pytest.raises(OscError, match=r"cannot listen at 127.0.0.1:\d+ \(.*\); give another --osc PORT"):
        OscServer(("127.0.0.1", first.port), lambda message: True)
    first.close()


def test_a_wrong_port_is_refused(capsys):
    assert exit_code("play", str(PIANO), "--osc", "nine") == 2
    assert '"nine" is not a port; give 1 to 65535, or HOST:PORT such as 0.0.0.0:9000' in capsys.readouterr().err
