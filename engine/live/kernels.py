"""The kernels of live sound, as Python calls them."""

from collections.abc import Callable
from functools import lru_cache

from engine.compiler.kernels import Kernel
from engine.compiler.kinds import FLOAT, INT, Kind
from engine.compiler.struct_handle import pointer_kind
from engine.live.shared_memory import EMPTY

AUDIO_THREAD = "engine.live.audio_thread"
MEMORY = pointer_kind(EMPTY)
PUBLISH_EVENT = Kernel(AUDIO_THREAD, "publish_event")
PLAY_INTO = Kernel(AUDIO_THREAD, "play_into")
WITHDRAW_EXCHANGE = Kernel(AUDIO_THREAD, "withdraw_exchange")
TAKE_EVENTS = Kernel(AUDIO_THREAD, "take_events")
RECORD_LOAD = Kernel(AUDIO_THREAD, "record_load_at")
PORTAUDIO_CALLBACK = Kernel(AUDIO_THREAD, "portaudio_callback")
KINDS: dict[Kernel, tuple[Kind, ...]] = {
    PUBLISH_EVENT: (MEMORY,),
    PLAY_INTO: (MEMORY, INT, INT),
    WITHDRAW_EXCHANGE: (INT,),
    TAKE_EVENTS: (MEMORY,),
    RECORD_LOAD: (MEMORY, INT, FLOAT),
    PORTAUDIO_CALLBACK: (*[INT] * 5, MEMORY),
}


@lru_cache
def kernel_of_memory(kernel: Kernel) -> Callable[..., None]:
    """Return a kernel that Python calls with the address of the shared memory, and its other arguments."""
    return kernel.callable(*KINDS[kernel])


def portaudio_callback() -> int:
    """Return the address of what PortAudio calls: engine.live.audio_thread.portaudio_callback."""
    return PORTAUDIO_CALLBACK.address(*KINDS[PORTAUDIO_CALLBACK])
