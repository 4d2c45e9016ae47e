"""The kernels of live sound, as Python calls them."""

import ctypes
from collections.abc import Callable
from functools import lru_cache

from engine.compiler.kernels import Kernel
from engine.compiler.kinds import FLOAT, INT, Kind

AUDIO_THREAD = "engine.live.audio_thread"
ENQUEUE = Kernel(AUDIO_THREAD, "enqueue")
PLAY_INTO = Kernel(AUDIO_THREAD, "play_into")
RECORD_LOAD = Kernel(AUDIO_THREAD, "record_load_py")
PORTAUDIO_CALLBACK = Kernel(AUDIO_THREAD, "portaudio_callback")
KINDS: dict[Kernel, tuple[Kind, ...]] = {
    ENQUEUE: (*[INT] * 7, FLOAT, FLOAT),
    PLAY_INTO: (INT, INT, INT),
    RECORD_LOAD: (INT, INT, FLOAT),
    PORTAUDIO_CALLBACK: (INT,) * 6,
}


@lru_cache
def enqueue() -> Callable[..., int]:
    """Puts an event into a queue: engine.live.audio_thread.enqueue."""
    return ENQUEUE.callable(*KINDS[ENQUEUE], result=ctypes.c_ssize_t)


@lru_cache
def play_into() -> Callable[..., None]:
    """Plays some frames into memory: engine.live.audio_thread.play_into."""
    return PLAY_INTO.callable(*KINDS[PLAY_INTO])


@lru_cache
def record_load() -> Callable[..., None]:
    """Notes how long a block took: engine.live.audio_thread.record_load_py."""
    return RECORD_LOAD.callable(*KINDS[RECORD_LOAD])


def portaudio_callback() -> int:
    """Address of what PortAudio calls: engine.live.audio_thread.portaudio_callback."""
    return PORTAUDIO_CALLBACK.address(*KINDS[PORTAUDIO_CALLBACK])
