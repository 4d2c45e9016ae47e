"""Sound from outside as a force: what a microphone hears, or any other signal, pushes a body while it is played."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.kernel.data.enums import UNUSED_SLOT
from engine.live.audio_memory import RENDERED_AT_ONCE
from engine.patch.scene import Scene, scene_of_document
from engine.patch.tables import PulseForce

if TYPE_CHECKING:
    from engine.live.player import Player


@dataclass(frozen=True)
class AudioInput:
    """The body that audio input drives while a scene is played, its position, and the force at full scale.

    body:      the body it pushes
    newtons:   the force at full scale, N; positive pushes upwards
    at:        where on the body, as for a force of a patch: 0.3, [0.4, 0.6] or a point's name; None for a mass or an
               oscillator

    >>> import fdh
    >>> import numpy as np
    >>> scene = fdh.load("sympathetic_strings").replace("body.hammer.velocity", 0.0)  # silent by itself
    >>> player = fdh.Player(scene, gain=100.0, input=fdh.AudioInput("free", newtons=0.5, at=0.3))
    >>> noise = np.random.default_rng(1).uniform(-1.0, 1.0, 4410)
    >>> bool(player.read(4410).any()), bool(player.read(4410, noise).any())
    (False, True)
    """

    body: str
    newtons: float = 1.0
    at: Any = None


def with_input_force(scene: Scene, source: AudioInput, samplerate: int) -> Scene:
    """The scene with a force whose samples are written while it plays. Raises PatchError, as for any force."""
    seconds = RENDERED_AT_ONCE / samplerate
    force = {"kind": "pulse", "body": source.body, "amplitude": source.newtons, "duration": seconds}
    force |= {} if source.at is None else {"at": source.at}
    data = scene.document
    return scene_of_document(data | {"force": [*data.get("force", []), force]}, scene.folder)


class InputForce:
    """The force of audio input of a player: it writes samples into the force's table, and lets it begin anew.

    A step's force is the mean of the samples at its two ends (docs/design.md); that at its end is the next one to come,
    so that the force is one sample late.
    """

    def __init__(self, player: "Player", source: AudioInput) -> None:
        layout, force = player.layout, player.model.force
        assert force is not None
        self.place = next(n for n, f in enumerate(layout.islands.forces) if f is player.scene.force[-1])
        assert isinstance(player.scene.force[-1], PulseForce)
        self.newtons, self._last = source.newtons, 0.0
        self._player = player
        self._table = force.table[force.table_begin[self.place] : force.table_end[self.place]]
        self._table[:] = 0.0
        force.start[self.place] = UNUSED_SLOT

    def write(self, samples: np.ndarray) -> None:
        """Let samples, full scale = 1, act over the next frames, no more than are computed at once."""
        if not samples.any() and self._last == 0.0:
            return
        before = np.concatenate([[self._last], samples[:-1]])
        self._table[: len(samples)] = 0.5 * self.newtons * (before + samples)
        self._table[len(samples) :] = 0.0
        self._last = float(samples[-1])
        row = self._player.rows.force_again(self.place, 1.0, len(samples))
        self._player.queue_unlogged(row._replace(start=self._player.frame))


def as_samples(signal: Any, frames: int) -> np.ndarray:
    """A signal [frames] or [frames, channels], of which the first is used, as numbers. Raises TypeError,
    ValueError."""
    if isinstance(signal, np.ndarray) and signal.dtype.kind != "f":
        raise TypeError(f"the input is an array of {signal.dtype}; give floating-point numbers, full scale = 1")
    try:
        samples = np.asarray(signal, float)
    except (TypeError, ValueError):
        raise TypeError("the input is not an array of numbers; give one of [frames] or [frames, channels]") from None
    samples = samples[:, 0] if samples.ndim == 2 and samples.shape[1] > 0 else samples
    if samples.shape != (frames,):
        raise ValueError(f"the input has shape {np.shape(signal)}; give [{frames}] or [{frames}, channels]")
    if not np.isfinite(samples).all():
        raise ValueError("the input has samples that are not finite; give numbers, full scale = 1")
    return samples
