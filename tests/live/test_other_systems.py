"""Windows and macOS, by fakes of the calls of these systems: nothing here ran on them."""

import ctypes
import os
import signal
import threading
import time
from types import SimpleNamespace

import pytest

from engine.cli import live_session
from engine.cli.console_window import CLOSED, delayed_closing
from engine.live import audio_device
from engine.runtime import helpers


class Console:
    """The calls of kernel32 that a console program makes."""

    def __init__(self):
        self.handlers, self.priorities = [], []

    def SetConsoleCtrlHandler(self, handler, add):
        self.handlers.append(handler) if add else self.handlers.remove(handler)
        return 1

    def GetCurrentThread(self):
        return -2

    def SetThreadPriority(self, thread, priority):
        self.priorities.append((thread.value, priority))
        return 1


@pytest.fixture
def windows(monkeypatch):
    """The console of a system that has the calls of Windows."""
    console = Console()
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=console), raising=False)
    monkeypatch.setattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE, raising=False)
    return console


def test_a_console_window_that_is_closed_waits_until_the_sound_has_faded(windows):
    """Windows ends the program as soon as the handler returns: that is after the session has ended."""
    order, told = [], threading.Event()
    with delayed_closing(told.set):
        (handler,) = windows.handlers
        system = threading.Thread(target=lambda: order.append(("handled", handler(CLOSED))))
        system.start()
        assert told.wait(5.0)
        system.join(0.2)
        assert system.is_alive(), "the program would have been ended"
        order.append("faded")
    system.join(5.0)
    assert order == ["faded", ("handled", 1)] and windows.handlers == []


def test_other_events_of_a_console_are_left_to_their_handlers(windows):
    with delayed_closing(lambda: pytest.fail("it was not closed")):
        assert [windows.handlers[0](event) for event in (0, 1)] == [0, 0]  # Ctrl-C and Ctrl-Break


@pytest.fixture
def handlers():
    """The handlers of signals are put back: who was told to end ignores what else comes, and hands that on."""
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    for number, how in before.items():
        signal.signal(number, how)


def test_a_closed_window_ends_a_session_as_a_signal_does(windows, handlers):
    with live_session.catch_signals() as interrupted:
        threading.Thread(target=windows.handlers[0], args=(CLOSED,)).start()
        end = time.monotonic() + 5.0
        while not interrupted and time.monotonic() < end:
            time.sleep(0.01)
        assert len(interrupted) == 1


def test_helpers_run_before_ordinary_threads_on_windows(windows):
    assert helpers.raise_priority()
    assert windows.priorities == [(ctypes.c_void_p(-2).value, helpers.TIME_CRITICAL)]


@pytest.mark.parametrize(("answer", "allowed"), [(0, True), (1, False)])
def test_helpers_run_before_ordinary_threads_on_macos(monkeypatch, answer, allowed):
    asked = []

    def set_class(quality, relative):
        asked.append((quality, relative))
        return answer

    monkeypatch.delattr(os, "sched_setscheduler", raising=False)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(pthread_set_qos_class_self_np=set_class))
    assert helpers.raise_priority() is allowed
    assert asked == [(0x21, 0)]


def test_a_system_without_priorities_plays_without_them(monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler", raising=False)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace())
    assert not helpers.raise_priority()


class Opened(Exception):
    """A stream was asked for."""


@pytest.fixture
def driver(monkeypatch):
    """A driver whose only device is that of a kind of system; it tells what it was asked for."""

    def make(system):
        def open_stream(**options):
            raise Opened(options)

        device = {"name": "Speakers", "hostapi": 0, "max_output_channels": 2, "default_samplerate": 48_000.0}
        fake = SimpleNamespace(
            default=SimpleNamespace(device=(0, 0)),
            query_devices=lambda kind=None: device if kind else [device],
            query_hostapis=lambda number: {"name": system},
            WasapiSettings=lambda **flags: ("WASAPI", flags),
            OutputStream=lambda callback, **options: open_stream(**options),
            Stream=lambda callback, **options: open_stream(**options),
            PortAudioError=RuntimeError,
        )
        monkeypatch.setattr(audio_device, "load_sounddevice", lambda: fake)

    return make


CONVERTS = "WASAPI", {"auto_convert": True}
PLAYER = SimpleNamespace(samplerate=44_100, channels=2, leave_to_device=lambda: None)


def test_wasapi_converts_the_rate_where_it_is_shared(driver):
    driver("Windows WASAPI")
    with pytest.raises(Opened) as asked:
        audio_device.open_stream(PLAYER, None, 256, None, compiled=False)
    assert asked.value.args[0]["samplerate"] == 44_100 and asked.value.args[0]["extra_settings"] == CONVERTS
    with pytest.raises(Opened) as asked:
        audio_device.open_duplex_stream(PLAYER, None, 256, None)
    assert asked.value.args[0]["extra_settings"] == (CONVERTS, CONVERTS)


@pytest.mark.parametrize("system", ["ALSA", "Core Audio", "MME", "ASIO"])
def test_other_drivers_are_asked_as_before(driver, system):
    driver(system)
    for ask in (lambda: audio_device.open_stream(PLAYER, None, 256, None, compiled=False), duplex):
        with pytest.raises(Opened) as asked:
            ask()
        assert "extra_settings" not in asked.value.args[0]


def duplex():
    """Ask for a stream that also listens."""
    audio_device.open_duplex_stream(PLAYER, None, 256, None)
