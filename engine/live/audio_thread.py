"""Play a scene block by block for an audio driver, without the Python interpreter.

The same function plays for the driver, for tests and for a replay.
"""

import math

from engine.compiler.decorators import inline, kernel
from engine.compiler.intrinsics import (
    call_address,
    float32_view,
    float64_view,
    int64_view,
    load_acquire,
    monotonic_seconds,
    store_release,
)
from engine.kernel.data.enums import EventKind
from engine.live.shared_memory import Gauge, Slot
from engine.runtime.event_slots import VALUES_PER_EVENT, EventSlot
from engine.runtime.jobs import Job
from engine.runtime.partitions import JOB_SLOTS, render_partitions

SLOTS, GAUGES, EVENT_SLOTS = len(Slot), len(Gauge), len(EventSlot)
UNSIGNED_LONG = 0xFFFFFFFF  # the bits of one that every system has
OUTPUT_UNDERFLOW = 4  # flag of PortAudio: the driver ran dry before this block
CONTINUE, COMPLETE = 0, 1  # answers to PortAudio
LIMITER_RELEASE = 0.1  # s, in which the limiter lets go
MAX_ENVELOPE = 1e6  # of full scale: the largest level that the limiter follows
EASE_SECONDS = 1.0  # after which quality rises again


@inline
def insert_queued_event(shared, event, value):
    """Pass an event to the scene, by the addresses of its numbers."""
    model, state, frame = shared[Slot.MODEL], shared[Slot.STATE], shared[Slot.FRAME]
    call_address(shared[Slot.INSERT_EVENT], (model, state, event, value, frame))


@inline
def set_quality(shared, level):
    """Play at a quality level. Level 0 is the full quality; the next use coarser models, and then more and more of the
    quietest islands sleep."""
    last, level = shared[Slot.MODEL_COUNT] - 1, max(0, min(level, shared[Slot.LOWEST_QUALITY]))
    shared[Slot.MODEL] = int64_view(shared[Slot.MODELS], shared[Slot.MODEL_COUNT])[min(level, last)]
    order = int64_view(shared[Slot.ORDER], EVENT_SLOTS)
    order[EventSlot.KIND], order[EventSlot.TARGET_BEGIN] = EventKind.SLEEP_QUIETEST, max(0, level - last)
    if level > last or shared[Slot.QUALITY] > last:
        insert_queued_event(shared, shared[Slot.ORDER], shared[Slot.ORDER])
    shared[Slot.QUALITY] = level


@inline
def apply_tuning(shared, event):
    """Exchange the tables of some islands, and count the change of their energy as supplied."""
    book_energy(shared, event, -1)
    for i in range(event[EventSlot.TARGET_BEGIN]):
        order = int64_view(event[EventSlot.START] + 24 * i, 3)
        to, of = float64_view(order[0], order[2]), float64_view(order[1], order[2])
        for k in range(order[2]):
            to[k] = of[k]
    book_energy(shared, event, 1)


@inline
def book_energy(shared, event, sign):
    """Count the energies of some islands as supplied if `sign` is 1, or as taken if it is -1."""
    order = int64_view(shared[Slot.ORDER], EVENT_SLOTS)
    for n in range(event[EventSlot.ISLAND], event[EventSlot.ISLAND] + event[EventSlot.TARGET_END]):
        order[EventSlot.KIND], order[EventSlot.ISLAND], order[EventSlot.TARGET_BEGIN] = EventKind.BOOK_ENERGY, n, sign
        insert_queued_event(shared, shared[Slot.ORDER], shared[Slot.ORDER])


@inline
def adapt_quality(shared, gauge, frames, share):
    """Lower the quality by one level if a block came near its deadline; raise it again after a second of low load."""
    level = shared[Slot.QUALITY]
    shared[Slot.FRAMES_AT_EASE] = shared[Slot.FRAMES_AT_EASE] + frames if share < gauge[Gauge.LOAD_LOW] else 0
    if share > gauge[Gauge.LOAD_HIGH] and level < shared[Slot.LOWEST_QUALITY]:
        level += 1
    elif shared[Slot.FRAMES_AT_EASE] > shared[Slot.SAMPLERATE] * EASE_SECONDS and level > 0:
        level -= 1
    if level != shared[Slot.QUALITY]:
        entry = shared[Slot.QUALITY_CHANGES] % shared[Slot.QUALITY_LOG_SIZE]
        change = int64_view(shared[Slot.QUALITY_LOG] + 16 * entry, 2)
        change[0], change[1] = shared[Slot.FRAME], level
        set_quality(shared, level)
        shared[Slot.FRAMES_AT_EASE] = 0
        store_release(shared, Slot.QUALITY_CHANGES, shared[Slot.QUALITY_CHANGES] + 1)


@inline
def waiting_tuning(shared, n):
    """Return number n of the exchanges of tables that wait for their frame."""
    return int64_view(shared[Slot.TUNINGS] + 8 * EVENT_SLOTS * n, EVENT_SLOTS)


@inline
def postpone_tuning(shared, event):
    """Let an exchange of tables wait for its frame, behind those of earlier frames and of the same."""
    n = shared[Slot.WAITING_TUNINGS]
    while n > 0 and waiting_tuning(shared, n - 1)[EventSlot.TAKEN_AT] > event[EventSlot.TAKEN_AT]:
        later, sooner = waiting_tuning(shared, n), waiting_tuning(shared, n - 1)
        for i in range(EVENT_SLOTS):
            later[i] = sooner[i]
        n -= 1
    tuning = waiting_tuning(shared, n)
    for i in range(EVENT_SLOTS):
        tuning[i] = event[i]
    shared[Slot.WAITING_TUNINGS] += 1


@inline
def apply_due_tunings(shared):
    """Make the exchanges of tables whose frame has come."""
    due = 0
    while due < shared[Slot.WAITING_TUNINGS] and waiting_tuning(shared, due)[EventSlot.TAKEN_AT] <= shared[Slot.FRAME]:
        apply_tuning(shared, waiting_tuning(shared, due))
        due += 1
    if due > 0:
        shared[Slot.WAITING_TUNINGS] -= due
        for n in range(shared[Slot.WAITING_TUNINGS]):
            tuning, later = waiting_tuning(shared, n), waiting_tuning(shared, n + due)
            for i in range(EVENT_SLOTS):
                tuning[i] = later[i]


@inline
def drain_queue(shared):
    """Pass the queued events to the scene, and record the frame of each; exchanges of tables wait for their frame.
    Returns the number of frames that may be computed until the next exchange."""
    size = shared[Slot.QUEUE_SIZE]
    while shared[Slot.READ_INDEX] != load_acquire(shared, Slot.WRITE_INDEX) and shared[Slot.WAITING_TUNINGS] < size:
        slot = shared[Slot.READ_INDEX] % size
        place, value = shared[Slot.EVENTS] + 8 * EVENT_SLOTS * slot, shared[Slot.VALUES] + 8 * VALUES_PER_EVENT * slot
        event = int64_view(place, EVENT_SLOTS)
        event[EventSlot.TAKEN_AT] = shared[Slot.FRAME]
        if event[EventSlot.KIND] == EventKind.QUALITY:
            set_quality(shared, event[EventSlot.TARGET_BEGIN])
        elif event[EventSlot.KIND] == EventKind.EXCHANGE_TABLES:
            event[EventSlot.TAKEN_AT] = max(event[EventSlot.LENGTH], shared[Slot.FRAME])
            postpone_tuning(shared, event)
        else:
            insert_queued_event(shared, place, value)
        store_release(shared, Slot.READ_INDEX, shared[Slot.READ_INDEX] + 1)
    apply_due_tunings(shared)
    if shared[Slot.WAITING_TUNINGS] == 0:
        return shared[Slot.CHUNK_FRAMES]
    return waiting_tuning(shared, 0)[EventSlot.TAKEN_AT] - shared[Slot.FRAME]


@inline
def output_stage(shared, gauge, out, frames):
    """Write the mix to the output, with gain, fades at start and stop, and a limiter as a last protection."""
    channels = shared[Slot.CHANNELS]
    total = float64_view(int64_view(shared[Slot.JOB], JOB_SLOTS)[Job.AUDIO], frames * channels)
    release = math.exp(-1.0 / (LIMITER_RELEASE * shared[Slot.SAMPLERATE]))
    for i in range(frames):
        frame = shared[Slot.FRAME] + i
        risen, left = (
            (frame + 0.5) / shared[Slot.FADE_IN_FRAMES],
            (shared[Slot.END] - frame - 0.5) / shared[Slot.FADE_OUT_FRAMES],
        )
        level = gauge[Gauge.GAIN] * max(0.0, min(1.0, risen, left))
        loudest = 0.0
        for c in range(channels):
            value = total[i * channels + c]
            if not math.isfinite(value):
                value = total[i * channels + c] = 0.0
                shared[Slot.NONFINITE_SAMPLES] += 1
            loudest = max(loudest, abs(value) * abs(level))
        gauge[Gauge.PEAK] = max(gauge[Gauge.PEAK], loudest)
        gauge[Gauge.ENVELOPE] = min(MAX_ENVELOPE, max(loudest, gauge[Gauge.ENVELOPE] * release))
        if gauge[Gauge.ENVELOPE] > 1.0:
            level /= gauge[Gauge.ENVELOPE]
            shared[Slot.LIMITED_SAMPLES] += 1
        for c in range(channels):
            out[i * channels + c] = min(1.0, max(-1.0, total[i * channels + c] * level))


@inline
def play_scene(shared, out, frames):
    """Play frames of one scene, no more than are computed at once, into `out`: single precision, channels
    interleaved."""
    gauge = float64_view(shared[Slot.GAUGES], GAUGES)
    int64_view(shared[Slot.JOB], JOB_SLOTS)[Job.MODEL] = shared[Slot.MODEL]
    render_partitions(shared[Slot.JOB], frames)
    output_stage(shared, gauge, out, frames)
    store_release(shared, Slot.FRAME, shared[Slot.FRAME] + frames)


@inline
def current_player(shared):
    """Return the shared memory of the scene that is played: the first, or the first of its successors that has not
    ended."""
    while shared[Slot.FINISHED] != 0 and load_acquire(shared, Slot.SUCCESSOR) != 0:
        shared = int64_view(shared[Slot.SUCCESSOR], SLOTS)
    return shared


@inline
def play_block(top, out, frames):
    """Play frames of the present scene, and of its successor while one fades into the other."""
    shared, count = current_player(top), frames * top[Slot.CHANNELS]
    following = load_acquire(shared, Slot.SUCCESSOR)
    if load_acquire(shared, Slot.STOP_REQUESTED) != 0 or following != 0:
        shared[Slot.END] = min(shared[Slot.END], shared[Slot.FRAME] + shared[Slot.FADE_OUT_FRAMES])
    sounding = frames if following != 0 else max(0, min(frames, shared[Slot.END] - shared[Slot.FRAME]))
    play_scene(shared, out, frames)
    if following != 0:
        later = float32_view(shared[Slot.SPARE], count)
        play_scene(int64_view(following, SLOTS), later, frames)
        for i in range(count):
            out[i] = min(1.0, max(-1.0, out[i] + later[i]))
    if shared[Slot.FRAME] >= shared[Slot.END]:
        store_release(shared, Slot.FINISHED, 1)
    room = top[Slot.RECORD_FRAMES] * top[Slot.CHANNELS]
    record = float32_view(top[Slot.RECORD], room)
    begin = top[Slot.RECORDED] * top[Slot.CHANNELS]
    for i in range(sounding * top[Slot.CHANNELS]):
        record[(begin + i) % room] = out[i]
    store_release(top, Slot.RECORDED, top[Slot.RECORDED] + sounding)


@inline
def play_frames(top, output, frames):
    """Play any number of frames of the present scene and its successors, to an address."""
    done = 0
    while done < frames:
        shared = current_player(top)
        count, following = (
            min(frames - done, top[Slot.CHUNK_FRAMES], drain_queue(shared)),
            load_acquire(shared, Slot.SUCCESSOR),
        )
        if following != 0:
            count = min(count, drain_queue(int64_view(following, SLOTS)))
        play_block(top, float32_view(output + 4 * done * top[Slot.CHANNELS], count * top[Slot.CHANNELS]), count)
        done += count


@inline
def record_load(shared, gauge, frames, seconds):
    """Record the time of a block, as a share of its deadline."""
    share = seconds * shared[Slot.SAMPLERATE] / max(1, frames)
    float64_view(shared[Slot.LOADS], shared[Slot.LOAD_COUNT])[shared[Slot.CALLS] % shared[Slot.LOAD_COUNT]] = share
    shared[Slot.CALLS] += 1
    gauge[Gauge.SECONDS_USED] += seconds
    gauge[Gauge.MAX_LOAD] = max(gauge[Gauge.MAX_LOAD], share)


@kernel
def record_load_py(address, frames, seconds):
    """Record the time of a block, as a share of its deadline, from a callback in Python. address: of the shared
    memory"""
    shared = int64_view(address, SLOTS)
    record_load(shared, float64_view(shared[Slot.GAUGES], GAUGES), frames, seconds)


@kernel
def enqueue(address, kind, island, first, last, start, length, a, b):
    """Put an event into the queue, from Python. Returns 1 if there was room, else 0. `start`: the earliest frame at
    which it begins; `length`: in frames."""
    shared = int64_view(address, SLOTS)
    if shared[Slot.WRITE_INDEX] - load_acquire(shared, Slot.READ_INDEX) >= shared[Slot.QUEUE_SIZE]:
        return 0
    slot = shared[Slot.WRITE_INDEX] % shared[Slot.QUEUE_SIZE]
    event = int64_view(shared[Slot.EVENTS] + 8 * EVENT_SLOTS * slot, EVENT_SLOTS)
    value = float64_view(shared[Slot.VALUES] + 8 * VALUES_PER_EVENT * slot, VALUES_PER_EVENT)
    event[EventSlot.KIND], event[EventSlot.ISLAND], event[EventSlot.TARGET_BEGIN], event[EventSlot.TARGET_END] = (
        kind,
        island,
        first,
        last,
    )
    event[EventSlot.START], event[EventSlot.LENGTH] = start, length
    value[0], value[1] = a, b
    store_release(shared, Slot.WRITE_INDEX, shared[Slot.WRITE_INDEX] + 1)
    return 1


@kernel
def play_into(address, output, frames):
    """Play some frames, from Python.

    address: of the shared memory; output: address of single-precision room for them, channels interleaved
    """
    play_frames(int64_view(address, SLOTS), output, frames)


@kernel
def portaudio_callback(source, output, frames, time, flags, address):
    """Play a block when PortAudio calls. Nothing here can raise, wait, or ask for memory."""
    begin = monotonic_seconds()
    top = int64_view(address, SLOTS)
    shared, count = current_player(top), frames & UNSIGNED_LONG
    if flags & OUTPUT_UNDERFLOW:
        shared[Slot.UNDERRUNS] += 1
    if shared[Slot.FINISHED] != 0:
        out = float32_view(output, count * top[Slot.CHANNELS])
        for i in range(count * top[Slot.CHANNELS]):
            out[i] = 0.0
        return COMPLETE
    play_frames(top, output, count)
    spent, gauge = monotonic_seconds() - begin, float64_view(shared[Slot.GAUGES], GAUGES)
    record_load(shared, gauge, count, spent)
    if load_acquire(shared, Slot.SUCCESSOR) == 0:  # while one sound fades into another, two are computed
        adapt_quality(shared, gauge, count, spent * shared[Slot.SAMPLERATE] / max(1, count))
    return CONTINUE
