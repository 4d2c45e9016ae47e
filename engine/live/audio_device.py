"""Sound devices: PortAudio by way of sounddevice, imported when needed; renders and tests need neither."""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from engine.live.player import Player

NO_PORTAUDIO = """the PortAudio library is not installed; rendering to a file does not need it. To play live:
  Debian, Ubuntu   apt install libportaudio2
  Fedora           dnf install portaudio
  macOS            brew install portaudio
  Windows          pip install --force-reinstall sounddevice, which brings it"""
WASAPI = "Windows WASAPI"
DEVICE_UNAVAILABLE, INVALID_SAMPLE_RATE, INVALID_CHANNELS = -9985, -9997, -9998  # error numbers of PortAudio


class DeviceError(RuntimeError):
    """The sound cannot be played. The message says why and what to do."""


def load_sounddevice() -> Any:
    """The module sounddevice. Raises DeviceError if its library is missing."""
    try:
        import sounddevice
    except OSError as error:
        raise DeviceError(NO_PORTAUDIO) from error
    return sounddevice


def output_devices() -> list[tuple[int, str, int, int]]:
    """Output devices: number, name, channels, own sample rate in Hz. Raises DeviceError."""
    sounddevice = load_sounddevice()
    devices = []
    for number, device in enumerate(sounddevice.query_devices()):
        if device["max_output_channels"] > 0:
            name = full_name(sounddevice, device)
            devices.append((number, name, device["max_output_channels"], round(device["default_samplerate"])))
    return devices


def full_name(sounddevice: Any, device: Any) -> str:
    """The name of a device, and of the driver that plays it."""
    return f"{device['name']}, {sounddevice.query_hostapis(device['hostapi'])['name']}"


def converting_settings(sounddevice: Any, name: str) -> Any:
    """Settings of a stream that let Windows convert its sample rate; None for other drivers than WASAPI, which takes
    no rate but its own while it is shared with other programs. name: the full name of the device"""
    return sounddevice.WasapiSettings(auto_convert=True) if name.endswith(f", {WASAPI}") else None


def find_output(device: str | None) -> tuple[int, str, int, int]:
    """The output device of a number or a part of a name; the default one if None. Raises DeviceError."""
    devices = output_devices()
    if not devices:
        raise DeviceError("there is no output device; rendering to a file does not need one")
    if device is None:
        number = load_sounddevice().default.device[1]
        return next((d for d in devices if d[0] == number), devices[0])
    matching = [d for d in devices if (device.isdecimal() and d[0] == int(device)) or device.lower() in d[1].lower()]
    numbered = [d for d in matching if device.isdecimal() and d[0] == int(device)]
    if len(numbered or matching) != 1:
        listing = "\n".join(f"  {number}  {name}" for number, name, _, _ in devices)
        message = "several devices match" if matching else "no device is called"
        raise DeviceError(f'{message} "{device}"; the devices are\n{listing}')
    return (numbered or matching)[0]


def open_stream(
    player: "Player", device: str | None, frames: int, latency: str | float | None, compiled: bool = True
) -> Any:
    """A stream, not yet started, that plays; the compiled callback, or an ordinary one in Python.

    frames: of a block; 0 leaves it to the driver
    Raises DeviceError.
    """
    from engine.live import kernels

    sounddevice = load_sounddevice()
    number, name, channels, rate = find_output(device)
    options = {
        "samplerate": player.samplerate,
        "blocksize": frames,
        "device": number,
        "channels": player.channels,
        "dtype": "float32",
        "latency": latency,
    }
    if settings := converting_settings(sounddevice, name):
        options["extra_settings"] = settings
    player.leave_to_device()
    try:
        if not compiled:
            return sounddevice.OutputStream(callback=_python_callback(player, sounddevice), **options)
        ffi = sounddevice._ffi
        address = ffi.cast("PaStreamCallback *", kernels.portaudio_callback())
        stream = sounddevice._StreamBase(
            kind="output", callback=address, userdata=ffi.cast("void *", player.memory.address), **options
        )
        stream.player = player  # it owns all that the audio thread reads
        return stream
    except sounddevice.PortAudioError as error:
        number = error.args[1] if len(error.args) > 1 else 0
        given, needed = player.samplerate, player.channels
        message = {
            DEVICE_UNAVAILABLE: "is busy; end the program that is using it, or choose another device with --device",
            INVALID_SAMPLE_RATE: f"does not support {given} Hz; its default rate is {rate}: give --samplerate {rate}",
            INVALID_CHANNELS: f"has {channels} channels, and the patch needs {needed}; change `channel` of its pickups",
        }.get(number, f"cannot be opened ({error.args[0]})")
        raise DeviceError(f"{name} {message}") from error


def open_duplex_stream(player: Any, device: str | None, frames: int, latency: str | float | None) -> Any:
    """A stream, not yet started, that plays and listens to the default input, whose first channel goes to the player's
    `play_block`. Arguments and errors as of `open_stream`."""
    import numpy as np

    sounddevice = load_sounddevice()
    number, name, _, _ = find_output(device)

    def fill_block(heard: "np.ndarray", out: "np.ndarray", frames: int, time: Any, status: Any) -> None:
        if player.finished:
            out[:] = 0.0
            raise sounddevice.CallbackStop
        player.play_block(out, np.clip(np.nan_to_num(heard[:, 0]), -1.0, 1.0))  # some drivers give what is in memory

    options = {"samplerate": player.samplerate, "blocksize": frames, "latency": latency, "dtype": "float32"}
    player.leave_to_device()
    try:
        heard = full_name(sounddevice, sounddevice.query_devices(kind="input"))
        settings = converting_settings(sounddevice, heard), converting_settings(sounddevice, name)
        if any(settings):
            options["extra_settings"] = settings
        return sounddevice.Stream(device=(None, number), channels=(1, player.channels), callback=fill_block, **options)
    except (sounddevice.PortAudioError, ValueError) as error:
        raise DeviceError(f"{name} and the default input cannot be opened together ({error})") from error


def _python_callback(player: "Player", sounddevice: Any) -> Any:
    """A callback in Python, of the same samples."""
    from time import perf_counter as time_now

    from engine.live import kernels
    from engine.live.shared_memory import Slot

    def fill_block(out: "np.ndarray", frames: int, time: Any, status: Any) -> None:
        if status.output_underflow:
            player.counters[Slot.UNDERRUNS] += 1
        if player.finished:
            out[:] = 0.0
            raise sounddevice.CallbackStop
        begin = time_now()
        player.render_into(out)
        kernels.kernel_of_memory(kernels.RECORD_LOAD)(player.memory.address, frames, time_now() - begin)

    return fill_block


def start_stream(stream: Any) -> None:
    """Let a stream play. Raises DeviceError."""
    try:
        stream.start()
    except load_sounddevice().PortAudioError as error:
        raise DeviceError(f"the device cannot be started ({error.args[0]})") from error


def detach_portaudio() -> None:
    """After a device has vanished: nothing of PortAudio is to be waited for when the program ends."""
    import atexit

    if "sounddevice" in sys.modules:
        atexit.unregister(sys.modules["sounddevice"]._exit_handler)
