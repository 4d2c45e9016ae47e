"""Warning of sound below what ears can follow."""

import numpy as np

from engine.assembly.pickup_points import channel_gains
from engine.bodies import Mass
from engine.patch.scene import Scene

LOWEST_HEARD = 20.0  # Hz
MAX_SHARE = 0.95  # of the energy of a sound, below LOWEST_HEARD
MIN_SECONDS = 0.5  # of a sound: ten periods of LOWEST_HEARD
BLOCK_FRAMES = 1 << 16  # whose spectra are taken: so many take little memory
HEARD = "velocity", "acceleration", "pressure"  # quantities of sound; others are to be looked at


def warn_of_infrasound(scene: Scene, audio: np.ndarray, samplerate: int) -> list[str]:
    """Warn of a sound that lies below 20 Hz: of the channels on which a pickup hears a body that sounds, and not the
    flight of a mass.

    audio: [frames, channels]
    """
    masses = {body.name for body in scene.body if isinstance(body, Mass)}
    pickups = [p for p in scene.pickup if p.quantity in HEARD and p.body not in masses]
    channels = sorted({channel for pickup in pickups for channel, _ in channel_gains(pickup)})
    if not channels or len(audio) < MIN_SECONDS * samplerate:
        return []
    low, total = 0.0, 0.0
    with np.errstate(all="ignore"):
        for begin in range(0, len(audio), BLOCK_FRAMES):
            block = audio[begin : begin + BLOCK_FRAMES, channels]
            powers = np.sum(np.abs(np.fft.rfft(block, axis=0)) ** 2, axis=1) / len(block)
            powers[1:] *= 2.0  # each but the first stands for two
            total += float(np.sum(powers))
            low += float(np.sum(powers[np.fft.rfftfreq(len(block), 1 / samplerate) < LOWEST_HEARD]))
        if not low > MAX_SHARE * total:
            return []
    share = np.floor(1000 * low / total) / 10  # 99.96 % is not all
    return [
        f"{share:.1f}% of the sound lies below {LOWEST_HEARD:g} Hz, too low for ears: stiffer or smaller bodies, or"
        " harder and shorter strikes, sound higher"
    ]
