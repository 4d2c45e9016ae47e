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
from engine.compiler.struct_types import load_struct, load_struct_like
from engine.kernel.data.enums import EventKind
from engine.live.shared_memory import Gauge, Slot
from engine.runtime.event_slots import EventSlot
from engine.runtime.jobs import Job
from engine.runtime.partitions import JOB_SLOTS, render_partitions
from engine.runtime.tremolo import tremolo_gain

EVENT_SLOTS = len(EventSlot)
COPY_BYTES = 24  # of a row of a table of copies: addresses to write to and to read from, and how many words
UNSIGNED_LONG = 0xFFFFFFFF  # the bits of one that every system has
OUTPUT_UNDERFLOW = 4  # flag of PortAudio: the driver ran dry before this block
CONTINUE, COMPLETE = 0, 1  # answers to PortAudio
MAX_ENVELOPE = 1e6  # of full scale: the largest level that the limiter follows
EASE_SECONDS = 1.0  # after which quality rises again


@inline
def model_in_use(memory):
    """Return the address of the Model that is played."""
    return memory.models[min(memory.counters[Slot.QUALITY], memory.models.shape[0] - 1)]


@inline
def insert_event(memory, event, values):
    """Pass an event to the scene."""
    model, frame = model_in_use(memory), memory.counters[Slot.FRAME]
    call_address(memory.insert_event, (model, memory.state, event.ctypes.data, values.ctypes.data, frame))


@inline
def insert_order(memory, kind, island, number):
    """Pass an event of the audio thread itself to the scene: one without a time and values."""
    order = memory.order
    order[EventSlot.KIND], order[EventSlot.ISLAND], order[EventSlot.TARGET_BEGIN] = kind, island, number
    insert_event(memory, order, memory.values[0])


@inline
def set_quality(memory, level):
    """Play at a quality level. Level 0 is the full quality; the next use coarser models, and then more and more of the
    quietest islands sleep."""
    last, level = memory.models.shape[0] - 1, max(0, min(level, memory.lowest_quality))
    before, memory.counters[Slot.QUALITY] = memory.counters[Slot.QUALITY], level
    if level != before:
        insert_order(memory, EventKind.SLEEP_QUIETEST, 0, max(0, level - last))


@inline
def exchange_tables(memory, event):
    """Exchange the tables of some islands, and count the change of their energy as supplied."""
    book_energy(memory, event, -1)
    for i in range(event[EventSlot.LENGTH]):
        copy = int64_view(event[EventSlot.TABLE] + COPY_BYTES * i, 3)
        to, of = float64_view(copy[0], copy[2]), float64_view(copy[1], copy[2])
        for k in range(copy[2]):
            to[k] = of[k]
    book_energy(memory, event, 1)


@inline
def book_energy(memory, event, sign):
    """Count the energies of the islands of an event as supplied if `sign` is 1, or as taken if it is -1."""
    for n in range(event[EventSlot.TARGET_BEGIN], event[EventSlot.TARGET_END]):
        insert_order(memory, EventKind.BOOK_ENERGY, n, sign)


@inline
def adapt_quality(memory, frames, share):
    """Lower the quality by one level if a block came near its deadline; raise it again after a second of low load."""
    counters, gauges = memory.counters, memory.gauges
    level = counters[Slot.QUALITY]
    counters[Slot.FRAMES_AT_EASE] = counters[Slot.FRAMES_AT_EASE] + frames if share < gauges[Gauge.LOAD_LOW] else 0
    if share > gauges[Gauge.LOAD_HIGH] and level < memory.lowest_quality:
        level += 1
    elif counters[Slot.FRAMES_AT_EASE] > memory.samplerate * EASE_SECONDS and level > 0:
        level -= 1
    if level != counters[Slot.QUALITY]:
        change = counters[Slot.QUALITY_CHANGES] % memory.quality_log.shape[0]
        memory.quality_log[change, 0], memory.quality_log[change, 1] = counters[Slot.FRAME], level
        set_quality(memory, level)
        counters[Slot.FRAMES_AT_EASE] = 0
        store_release(counters, Slot.QUALITY_CHANGES, counters[Slot.QUALITY_CHANGES] + 1)


@inline
def copy_event(events, source, target):
    """Copy an event from one row to another."""
    for i in range(EVENT_SLOTS):
        events[target, i] = events[source, i]


@inline
def postpone_exchange(memory, event):
    """Let an exchange of tables wait for its frame, behind those of earlier frames and of the same."""
    waiting, n = memory.exchanges, memory.counters[Slot.EXCHANGES_WAITING]
    while n > 0 and waiting[n - 1, EventSlot.TAKEN_AT] > event[EventSlot.TAKEN_AT]:
        copy_event(waiting, n - 1, n)
        n -= 1
    for i in range(EVENT_SLOTS):
        waiting[n, i] = event[i]
    memory.counters[Slot.EXCHANGES_WAITING] += 1


@inline
def make_due_exchanges(memory):
    """Make the exchanges of tables whose frame has come."""
    waiting, counters, due = memory.exchanges, memory.counters, 0
    while due < counters[Slot.EXCHANGES_WAITING] and waiting[due, EventSlot.TAKEN_AT] <= counters[Slot.FRAME]:
        exchange_tables(memory, waiting[due])
        due += 1
    if due > 0:
        counters[Slot.EXCHANGES_WAITING] -= due
        for n in range(counters[Slot.EXCHANGES_WAITING]):
            copy_event(waiting, n + due, n)


@inline
def drain_queue(memory):
    """Pass the queued events to the scene, and record the frame of each; exchanges of tables wait for their frame.
    Return the number of frames that may be computed until the next exchange."""
    counters, size = memory.counters, memory.events.shape[0]
    while (
        counters[Slot.READ_INDEX] != load_acquire(counters, Slot.WRITE_INDEX)
        and counters[Slot.EXCHANGES_WAITING] < size
    ):
        slot = counters[Slot.READ_INDEX] % size
        event = memory.events[slot]
        event[EventSlot.TAKEN_AT] = counters[Slot.FRAME]
        if event[EventSlot.KIND] == EventKind.QUALITY:
            set_quality(memory, event[EventSlot.TARGET_BEGIN])
        elif event[EventSlot.KIND] == EventKind.EXCHANGE_TABLES:
            event[EventSlot.TAKEN_AT] = max(event[EventSlot.START], counters[Slot.FRAME])
            postpone_exchange(memory, event)
        else:
            insert_event(memory, event, memory.values[slot])
        store_release(counters, Slot.READ_INDEX, counters[Slot.READ_INDEX] + 1)
    make_due_exchanges(memory)
    if counters[Slot.EXCHANGES_WAITING] == 0:
        return memory.audio.shape[0]
    return memory.exchanges[0, EventSlot.TAKEN_AT] - counters[Slot.FRAME]


@inline
def output_stage(memory, out, frames):
    """Write the mix to the output, with tremolo, gain, fades at start and stop, and a limiter as a last protection."""
    counters, gauges, audio = memory.counters, memory.gauges, memory.audio
    channels, depth = audio.shape[1], gauges[Gauge.TREMOLO_DEPTH]
    for i in range(frames):
        frame = counters[Slot.FRAME] + i
        risen = (frame + 0.5) / counters[Slot.FADE_IN_FRAMES]
        remaining = (counters[Slot.END] - frame - 0.5) / counters[Slot.FADE_OUT_FRAMES]
        level = gauges[Gauge.GAIN] * max(0.0, min(1.0, risen, remaining))
        loudest = 0.0
        for c in range(channels):
            if not math.isfinite(audio[i, c]):
                audio[i, c] = 0.0
                counters[Slot.NONFINITE_SAMPLES] += 1
            if depth > 0.0:
                turns = frame * gauges[Gauge.TREMOLO_TURNS] + c * gauges[Gauge.TREMOLO_SPREAD]
                audio[i, c] *= tremolo_gain(turns, depth)
            loudest = max(loudest, abs(audio[i, c]) * abs(level))
        gauges[Gauge.PEAK] = max(gauges[Gauge.PEAK], loudest)
        gauges[Gauge.ENVELOPE] = min(MAX_ENVELOPE, max(loudest, gauges[Gauge.ENVELOPE] * memory.release))
        if gauges[Gauge.ENVELOPE] > 1.0:
            level /= gauges[Gauge.ENVELOPE]
            counters[Slot.LIMITED_SAMPLES] += 1
        for c in range(channels):
            out[i * channels + c] = min(1.0, max(-1.0, audio[i, c] * level))


@inline
def play_scene(memory, out, frames):
    """Play frames of one scene, no more than are computed at once, into `out`: single precision, channels
    interleaved."""
    int64_view(memory.job, JOB_SLOTS)[Job.MODEL] = model_in_use(memory)
    render_partitions(memory.job, frames)
    output_stage(memory, out, frames)
    store_release(memory.counters, Slot.FRAME, memory.counters[Slot.FRAME] + frames)


@inline
def memory_in_use(memory):
    """Return the shared memory of the scene that is played: the first, or the first of its successors that has not
    ended."""
    while memory.counters[Slot.FINISHED] != 0 and load_acquire(memory.counters, Slot.SUCCESSOR) != 0:
        memory = load_struct_like(memory, memory.counters[Slot.SUCCESSOR])
    return memory


@inline
def play_block(top, out, frames):
    """Play frames of the present scene, and of its successor while one fades into the other."""
    memory, channels = memory_in_use(top), top.audio.shape[1]
    counters = memory.counters
    following = load_acquire(counters, Slot.SUCCESSOR)
    if load_acquire(counters, Slot.STOP_REQUESTED) != 0 or following != 0:
        counters[Slot.END] = min(counters[Slot.END], counters[Slot.FRAME] + counters[Slot.FADE_OUT_FRAMES])
    sounding = frames if following != 0 else max(0, min(frames, counters[Slot.END] - counters[Slot.FRAME]))
    play_scene(memory, out, frames)
    if following != 0:
        later = float32_view(memory.spare.ctypes.data, frames * channels)
        play_scene(load_struct_like(memory, following), later, frames)
        for i in range(frames * channels):
            out[i] = min(1.0, max(-1.0, out[i] + later[i]))
    if counters[Slot.FRAME] >= counters[Slot.END]:
        store_release(counters, Slot.FINISHED, 1)
    record, begin = top.record, top.counters[Slot.RECORDED]
    for i in range(sounding):
        for c in range(channels):
            record[(begin + i) % record.shape[0], c] = out[i * channels + c]
    store_release(top.counters, Slot.RECORDED, begin + sounding)


@inline
def play_frames(top, output, frames):
    """Play any number of frames of the present scene and its successors, to an address."""
    done, channels = 0, top.audio.shape[1]
    while done < frames:
        memory = memory_in_use(top)
        count = min(frames - done, top.audio.shape[0], drain_queue(memory))
        following = load_acquire(memory.counters, Slot.SUCCESSOR)
        if following != 0:
            count = min(count, drain_queue(load_struct_like(memory, following)))
        play_block(top, float32_view(output + 4 * done * channels, count * channels), count)
        done += count


@inline
def record_load(memory, frames, seconds):
    """Record the time of a block, as a share of its deadline."""
    counters, gauges, loads = memory.counters, memory.gauges, memory.loads
    share = seconds * memory.samplerate / max(1, frames)
    loads[counters[Slot.CALLS] % loads.shape[0]] = share
    counters[Slot.CALLS] += 1
    gauges[Gauge.SECONDS_USED] += seconds
    gauges[Gauge.MAX_LOAD] = max(gauges[Gauge.MAX_LOAD], share)


@kernel
def record_load_at(address, frames, seconds):
    """Record the time of a block, as a share of its deadline, from a callback in Python. address: of the shared
    memory"""
    record_load(load_struct(address), frames, seconds)


@kernel
def publish_event(address):
    """Let the audio thread see an event that Python has written to the next row of the queue."""
    counters = load_struct(address).counters
    store_release(counters, Slot.WRITE_INDEX, counters[Slot.WRITE_INDEX] + 1)


@kernel
def play_into(address, output, frames):
    """Play some frames, from Python.

    address: of the shared memory; output: address of single-precision room for them, channels interleaved
    """
    play_frames(load_struct(address), output, frames)


@kernel
def portaudio_callback(source, output, frames, time, flags, address):
    """Play a block when PortAudio calls. Nothing here can raise, wait, or ask for memory."""
    begin = monotonic_seconds()
    top = load_struct(address)
    memory, count = memory_in_use(top), frames & UNSIGNED_LONG
    if flags & OUTPUT_UNDERFLOW:
        memory.counters[Slot.UNDERRUNS] += 1
    if memory.counters[Slot.FINISHED] != 0:
        silence = float32_view(output, count * top.audio.shape[1])
        for i in range(silence.shape[0]):
            silence[i] = 0.0
        return COMPLETE
    play_frames(top, output, count)
    spent = monotonic_seconds() - begin
    record_load(memory, count, spent)
    if load_acquire(memory.counters, Slot.SUCCESSOR) == 0:  # while one sound fades into another, two are computed
        adapt_quality(memory, count, spent * memory.samplerate / max(1, count))
    return CONTINUE
