"""Ports of MIDI: of the driver of the system, and of JACK, which has ports of its own."""

import os
import sys
import types

import pytest

from engine.live import midi_drivers
from engine.live.midi_drivers import MidiError, list_ports, open_port

mido = pytest.importorskip("mido", reason="needs mido")


class Driver:
    """A driver with ports, or one that does not answer."""

    def __init__(self, names: list[str] | None) -> None:
        self.names = names

    def get_input_names(self) -> list[str]:
        if self.names is None:
            raise OSError("no server")
        return self.names

    def open_input(self, name: str) -> tuple["Driver", str]:
        return self, name


@pytest.fixture
def drivers(monkeypatch):
    """Sets the ports of the system, and of JACK; None of a driver that does not answer."""
    monkeypatch.delenv("MIDO_BACKEND", raising=False)
    rtmidi = types.SimpleNamespace(API_UNIX_JACK=3, get_compiled_api=lambda: [2, 3])
    monkeypatch.setitem(sys.modules, "rtmidi", rtmidi)

    def use(system: list[str] | None, jack: list[str] | None) -> tuple[Driver, Driver]:
        ours, theirs = Driver(system), Driver(jack)
        monkeypatch.setattr(mido, "get_input_names", ours.get_input_names)
        monkeypatch.setattr(mido, "open_input", ours.open_input)
        monkeypatch.setattr(mido, "Backend", lambda name: theirs if name.endswith("/UNIX_JACK") else None)
        return ours, theirs

    return use


def test_ports_of_jack_are_found_beside_those_of_the_system(drivers):
    system, jack = drivers(["Keys 1"], ["seq:out", "Keys 1"])
    assert list_ports() == ["Keys 1", "seq:out"]
    assert open_port("seq") == (jack, "seq:out") and open_port("keys") == (system, "Keys 1")


def test_one_driver_that_does_not_answer_hides_no_ports_of_the_other(drivers):
    drivers(None, ["seq:out"])
    assert list_ports() == ["seq:out"]
    drivers(["Keys 1"], None)
    assert list_ports() == ["Keys 1"]
    drivers(None, None)
    with pytest.raises(MidiError, match=r"there are no MIDI ports \(no server\); give a .mid file"):
        list_ports()


def test_a_driver_that_is_asked_for_is_the_only_one(drivers, monkeypatch):
    drivers(["Keys 1"], ["seq:out"])
    monkeypatch.setenv(midi_drivers.OF_MIDO, "mido.backends.rtmidi")
    assert list_ports() == ["Keys 1"]


def test_what_libraries_print_stays_away_from_the_terminal(drivers, capfd):
    drivers(["Keys 1"], ["seq:out"])
    with midi_drivers._silent_libraries():
        os.write(2, b"cannot connect to a server")
    assert capfd.readouterr().err == "" and list_ports()
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"
