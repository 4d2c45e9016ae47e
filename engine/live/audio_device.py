"""Sound devices: PortAudio by way of sounddevice, imported when asked for; renders and tests need neither."""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from engine.live.player import Player

MISSING = """no PortAudio library; rendering to a file needs none. To play live:
  Debian, Ubuntu   apt install libportaudio2
  Fedora           dnf install portaudio
  macOS            brew install portaudio
  Windows          pip install --force-reinstall sounddevice, which brings it"""
BUSY, RATE, CHANNELS = -9985, -9997, -9998  # error numbers of PortAudio


class SoundError(RuntimeError):
    """What stands against playing, and what would be right."""


def library() -> Any:
    """The module sounddevice. Raises SoundError if its library is missing."""
    try:
        import sounddevice
    except OSError as error:
        raise SoundError(MISSING) from error
    return sounddevice


def outputs() -> list[tuple[int, str, int, int]]:
    """Output devices: number, name, channels, own sample rate in Hz. Raises SoundError."""
    sounddevice = library()
    found = []
    for number, device in enumerate(sounddevice.query_devices()):
        if device["max_output_channels"] > 0:
            name = f"{device['name']}, {sounddevice.query_hostapis(device['hostapi'])['name']}"
            found.append((number, name, device["max_output_channels"], round(device["default_samplerate"])))
    return found


def output(device: str | None) -> tuple[int, str, int, int]:
    """The output device of a number or a part of a name; the default one if None. Raises SoundError."""
    found = outputs()
    if not found:
        raise SoundError("no output device; rendering to a file needs none")
    if device is None:
        number = library().default.device[1]
        return next((d for d in found if d[0] == number), found[0])
    chosen = [d for d in found if (device.isdecimal() and d[0] == int(device)) or device.lower() in d[1].lower()]
    exact = [d for d in chosen if device.isdecimal() and d[0] == int(device)]
    if len(exact or chosen) != 1:
        some = "\n".join(f"  {number}  {name}" for number, name, _, _ in found)
        what = "several devices match" if chosen else "no device is called"
        raise SoundError(f'{what} "{device}"; there are\n{some}')
    return (exact or chosen)[0]


def stream(
    player: "Player", device: str | None, frames: int, latency: str | float | None, compiled: bool = True
) -> Any:
    """A stream, not yet started, that plays; the compiled callback, or an ordinary one in Python.

    frames: of a block; 0 leaves it to the driver
    Raises SoundError.
    """
    from engine.live import audio_thread

    sounddevice = library()
    number, name, channels, own = output(device)
    told = {
        "samplerate": player.samplerate,
        "blocksize": frames,
        "device": number,
        "channels": player.channels,
        "dtype": "float32",
        "latency": latency,
    }
    try:
        if not compiled:
            return sounddevice.OutputStream(callback=_answer(player, sounddevice), **told)
        ffi = sounddevice._ffi
        address = ffi.cast("PaStreamCallback *", audio_thread.portaudio_callback.address)
        made = sounddevice._StreamBase(
            kind="output", callback=address, userdata=ffi.cast("void *", player.shared.ctypes.data), **told
        )
        made.player = player  # it owns all that the audio thread reads
        return made
    except sounddevice.PortAudioError as error:
        number = error.args[1] if len(error.args) > 1 else 0
        what = {
            BUSY: "is busy; end the program that plays on it, or choose another with --device",
            RATE: f"does not play at {player.samplerate} Hz; its own rate is {own}: --samplerate {own}",
            CHANNELS: f"has {channels} channels, and the patch {player.channels}: `channel` of its pickups",
        }.get(number, f"cannot be opened ({error.args[0]})")
        raise SoundError(f"{name} {what}") from error


def _answer(player: "Player", sounddevice: Any) -> Any:
    """A callback in Python, of the same samples."""
    from time import perf_counter as time_now

    from engine.live import audio_thread
    from engine.live.shared_memory import Slot

    def answer(out: "np.ndarray", frames: int, time: Any, status: Any) -> None:
        if status.output_underflow:
            player.shared[Slot.UNDERRUNS] += 1
        if player.finished:
            out[:] = 0.0
            raise sounddevice.CallbackStop
        begin = time_now()
        player.render_into(out)
        audio_thread.record_load_py(player.shared.ctypes.data, frames, time_now() - begin)

    return answer


def start(made: Any) -> None:
    """Let a stream play. Raises SoundError."""
    try:
        made.start()
    except library().PortAudioError as error:
        raise SoundError(f"the device cannot be started ({error.args[0]})") from error


def forget() -> None:
    """After a device has vanished: nothing of PortAudio is to be waited for when the program ends."""
    import atexit

    if "sounddevice" in sys.modules:
        atexit.unregister(sys.modules["sounddevice"]._exit_handler)
