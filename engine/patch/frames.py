"""Times in frames. All that turns seconds into frames does so here, so that a time is the same frame in a score, in a
MIDI file and live."""

import math

SAMPLE_RATE_RANGE = (4_000, 768_000)  # Hz
TIE = 1e-3  # frames, by which a time may miss the half for rounding errors: 0.235 s is 10363.5 frames at 44.1 kHz


def nearest_frame(seconds: float, samplerate: float) -> int:
    """The frame that is nearest to a time; of two, the later one."""
    return math.floor(seconds * samplerate + 0.5 + TIE)


def frame_count(seconds: float, samplerate: float) -> int:
    """The number of frames that a sound of so many seconds has; at least one."""
    return max(1, nearest_frame(seconds, samplerate))


def check_samplerate(samplerate: int) -> None:
    """Raise ValueError if a sample rate is out of range."""
    least, most = SAMPLE_RATE_RANGE
    if not least <= samplerate <= most:
        raise ValueError(f"samplerate = {samplerate} is out of range; {least} to {most} Hz")
