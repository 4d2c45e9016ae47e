"""A player as it is used from Python: on a device, or block by block."""

import math
import time
from functools import partial
from typing import Any

import numpy as np

from engine.api.audio_input import AudioInput, InputForce, as_samples, with_input_force
from engine.api.pilot import Pilot
from engine.argument_checks import checked_integer
from engine.live import audio_device, player
from engine.live.audio_memory import RENDERED_AT_ONCE
from engine.patch.frames import frame_count
from engine.patch.scene import Scene, check_scene

PILOT_SECONDS = 2.0  # of a scene, that are played to find its level
POLL_SECONDS = 0.01  # between two looks at whether all is over
BLOCK_SIZE = 256  # frames


class Player(player.Player):
    """A scene that is played while events come: strikes, plucks, dampers, live parameters.

    seconds: until it fades out; the scene's own if None; `math.inf`: until it is stopped
    gain:    factor on SI units; if None, that of the scene's `level`. Without a level, the first two seconds of the
             scene are computed beforehand, and their peak is brought to half of full scale, or left in SI units if they
             are silent. What is louder than full scale is limited
    input:   an AudioInput: the sound of a microphone, or what `read` is given, pushes a body
    options: some of these:

    voices:  so many copies of the scene, each of which can be tuned
    lowest:  ratio of the lowest pitch they will be tuned to
    general: exponents of contacts can be changed
    cores:   how many share the work; 1 if absent
    kernel:  general or special (engine.runtime.kernel_choice)
    waiting: forces of limited duration wait until `pluck` starts them

    `channels` is the number of channels, and `samplerate` the sample rate in Hz.

    Block by block, without a device or in an audio callback of your own:

    >>> import fdh
    >>> player = fdh.Player(fdh.load("tanpura"))
    >>> block = player.read(1024)
    >>> block.shape, block.dtype.name
    ((1024, 2), 'float32')
    >>> player.pluck("string", scale=0.5)
    >>> block = player.read(44100)
    >>> bool(0.0 < abs(block).max() <= 1.0), player.frame
    (True, 45124)

    On a device, as long as the block lasts; then it fades out:

    >>> with fdh.Player(fdh.load("tanpura"), seconds=10.0) as player:  # doctest: +SKIP
    ...     player.wait(2.0)
    ...     player.pluck("string")
    ...     player.wait()

    Raises TypeError if an argument is of the wrong kind, PatchError if there is nothing where the input is to push,
    BuildError if the scene cannot be built.
    """

    def __init__(
        self,
        scene: Scene,
        samplerate: int = 44_100,
        seconds: float | None = None,
        gain: float | None = None,
        input: AudioInput | None = None,
        **options: Any,
    ) -> None:
        check_scene(scene)
        samplerate = checked_integer("samplerate", samplerate)
        self._stream: Any = None
        self._input: InputForce | None = None
        if input is not None and not isinstance(input, AudioInput):
            raise TypeError(
                f'{input!r} is not an input; give one, such as fdh.AudioInput("string", newtons=1.0, at=0.3)'
            )
        if input is not None and options.get("voices"):
            raise ValueError("a player of voices takes no audio input; leave out voices, or the input")
        gain = scene.level_factor if gain is None else gain
        if gain is None:
            make = partial(player.Player, scene, samplerate, math.inf, **options)
            gain = Pilot(make, frame_count(min(PILOT_SECONDS, scene.seconds), samplerate), PILOT_SECONDS).gain
        played = scene if input is None else with_input_force(scene, input, samplerate)
        super().__init__(played, samplerate, seconds, gain, **options)
        if input is not None:
            self._input = InputForce(self, input)
            self.rows.input = self._input.place

    # --- block by block

    def read(self, frames: int, input: Any = None) -> np.ndarray:
        """Play the next frames: single precision [frames, channels], silence once all is over.

        input: what pushes the body of the AudioInput meanwhile: [frames] or [frames, channels], of which the first is
               used, full scale = 1; silence if None. It acts one sample late

        Raises RuntimeError while a device plays; TypeError or ValueError for other frames or inputs.

        >>> import fdh
        >>> player = fdh.Player(fdh.load("piano_c4"), gain=0.1)
        >>> player.read(44100).shape
        (44100, 2)
        """
        frames = checked_integer("frames", frames)
        if frames < 0:
            raise ValueError(f"frames = {frames} is out of range; 0 or more")
        if self._stream is not None:
            raise RuntimeError("a device plays; read what it played with fetch_recording, or close it first")
        out = np.zeros((frames, self.channels), np.float32)
        self.play_block(out, None if input is None else as_samples(input, frames))
        return out

    def play_block(self, out: np.ndarray, samples: np.ndarray | None = None) -> None:
        """Play the next len(out) frames into out, single precision [frames, channels], with samples [frames] as input.
        Raises ValueError if there are samples, and the player has no input."""
        if samples is not None and self._input is None:
            raise ValueError("this player has no input; Player(scene, input=fdh.AudioInput(…)) has one")
        if self._input is None:
            self.render_into(out)
            return
        for begin in range(0, len(out), RENDERED_AT_ONCE):
            part = out[begin : begin + RENDERED_AT_ONCE]
            heard = np.zeros(len(part)) if samples is None else samples[begin : begin + len(part)]
            self._input.write(heard)
            self.render_into(part)

    def log(self) -> dict[str, Any]:
        """All that was done, as JSON can hold it; `fdh replay` makes the same sound of it. Raises RuntimeError with
        audio input, which no log holds."""
        if self._input is not None:
            raise RuntimeError("audio input is in no log; keep it as a file, and render it as a force of kind file")
        return super().log()

    # --- on a device

    def start(
        self, device: str | None = None, block_size: int = BLOCK_SIZE, latency: str | float | None = None
    ) -> "Player":
        """Let a device play, in the background, and return the player.

        device:     its number or a part of its name (`fdh devices` lists them); the default one if None
        block_size: frames at a time; 0 leaves it to the driver
        latency:    "low", "high" or seconds; the device's own if None

        With an input, the default input device is recorded, and each block passes through Python, which causes dropouts
        where Python is busy. Raises DeviceError (a RuntimeError); RuntimeError if a device plays already.
        """
        if self._stream is not None:
            raise RuntimeError("a device plays already; close it first")
        open_stream = audio_device.open_stream if self._input is None else audio_device.open_duplex_stream
        self._stream = open_stream(self, device, checked_integer("block_size", block_size), latency)
        audio_device.start_stream(self._stream)
        return self

    def wait(self, seconds: float = math.inf) -> None:
        """Wait until all is over, or so many seconds have passed, or the device has stopped by itself."""
        end = time.monotonic() + seconds
        while not self.finished and self._stream is not None and self._stream.active and time.monotonic() < end:
            time.sleep(min(POLL_SECONDS, max(0.0, end - time.monotonic())))

    def close(self) -> None:
        """Fade out, and close the device."""
        if self._stream is not None:
            self.stop()
            self.wait(1.0)
            self._stream.close()
            self._stream = None

    def __enter__(self) -> "Player":
        """Start on the default device, unless it has been started."""
        return self if self._stream is not None else self.start()

    def __exit__(self, *error: object) -> None:
        self.close()
