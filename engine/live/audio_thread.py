"""Play a scene block by block for an audio driver, without the Python interpreter.

The same function plays for the driver, for tests and for a replay.
"""

import math

from engine.compiler.decorators import INT64_0, inline, kernel
from engine.compiler.intrinsics import (
    atomic_exchange,
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
from engine.runtime.event_slots import DISPLACING, DROPPED, VALUES_PER_EVENT, EventSlot
from engine.runtime.jobs import Job
from engine.runtime.partitions import JOB_SLOTS, render_partitions
from engine.runtime.tremolo import tremolo_gain

EVENT_SLOTS = len(EventSlot)
WORD_BYTES = 8
GROUPED_BYTES = WORD_BYTES * (EVENT_SLOTS + VALUES_PER_EVENT)  # of a row of a group: integers, and then values
COPY_BYTES = 24  # of a row of a table of copies: addresses to write to and to read from, and how many words
UNSIGNED_LONG = 0xFFFFFFFF  # the bits of one that every system has
OUTPUT_UNDERFLOW = 4  # flag of PortAudio: the driver ran dry before this block
CONTINUE, COMPLETE = 0, 1  # answers to PortAudio
MAX_ENVELOPE = 1e6  # of full scale: the largest level that the limiter follows
EASE_SECONDS = 1.0  # in which a higher quality would have fitted, after which it rises again
HOLD_SECONDS = 0.03  # until islands that fade out cost nothing: before that, no other does
MEAN_SECONDS = 0.1  # of the mean load
FORGET_SECONDS = 20.0  # in which what a higher quality cost is forgotten
TICKET_MADE, TICKET_WITHDRAWN = 1, 2  # of an exchange of tables; 0: neither


@inline
def model_in_use(memory):
    """Return the address of the Model that is played."""
    return memory.models[min(memory.counters[Slot.QUALITY], memory.models.shape[0] - 1)]


@inline
def insert_event(memory, event, values):
    """Pass an event to the scene. values: their address"""
    model, frame = model_in_use(memory), memory.counters[Slot.FRAME]
    call_address(memory.insert_event, (model, memory.state, event.ctypes.data, values, frame))


@inline
def insert_order(memory, kind, island, number):
    """Pass an event of the audio thread itself to the scene: one without a time and values."""
    row = memory.single_event
    row[EventSlot.KIND], row[EventSlot.ISLAND], row[EventSlot.TARGET_BEGIN] = kind, island, number
    insert_event(memory, row, memory.values.ctypes.data)


@inline
def set_quality(memory, level):
    """Play at a quality level. Level 0 is the full quality, the next use coarser models, and at each of those that
    follow one more island fades out, the quietest that sounds. Return how many do."""
    counters, last = memory.counters, memory.models.shape[0] - 1
    before, counters[Slot.QUALITY] = counters[Slot.QUALITY], max(0, level)
    insert_order(memory, EventKind.DROP_QUIETEST, 0, max(0, counters[Slot.QUALITY] - max(before, last)))
    return memory.single_event[EventSlot.TARGET_BEGIN]


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


# --- quality: the load of each block says whether it is to be lower, or may be higher


@inline
def adapt_quality(memory, frames, share):
    """Lower the quality if a block came near its deadline: to the next model, or by an island. Raise it after a second
    in which the next higher one would have fitted."""
    counters, gauges, coarsest = memory.counters, memory.gauges, memory.models.shape[0] - 1
    level = counters[Slot.QUALITY]
    fits = load_of_better(memory, level, share) < gauges[Gauge.LOAD_LOW]
    counters[Slot.FRAMES_AT_EASE] = counters[Slot.FRAMES_AT_EASE] + frames if fits else 0
    is_late = share > gauges[Gauge.LOAD_HIGH]
    holds = level >= coarsest and counters[Slot.FRAMES_AT_LEVEL] < HOLD_SECONDS * memory.samplerate
    if is_late and not holds:
        change_quality(memory, level + 1, share)
    elif level > 0 and counters[Slot.FRAMES_AT_EASE] > EASE_SECONDS * memory.samplerate:
        change_quality(memory, min(level - 1, coarsest), share)  # islands that faded out are silent anyway
    counters[Slot.FRAMES_AT_LEVEL] += frames
    weight = frames / min(counters[Slot.FRAMES_AT_LEVEL], MEAN_SECONDS * memory.samplerate)
    gauges[Gauge.MEAN_LOAD] += min(weight, 1.0) * (share - gauges[Gauge.MEAN_LOAD])


@inline
def load_of_better(memory, level, share):
    """Estimate the load at the next better level: by how much it was higher when that was left, which is forgotten in
    time. share: the load at this level"""
    counters, gauges = memory.counters, memory.gauges
    if level >= memory.models.shape[0] or counters[Slot.LEVEL_BEFORE] != level - 1:
        return share  # islands that are silent cost nothing when they may sound again
    age = counters[Slot.FRAMES_AT_LEVEL] / (FORGET_SECONDS * memory.samplerate)
    return share + max(0.0, gauges[Gauge.LOAD_BEFORE] - gauges[Gauge.MEAN_LOAD]) * max(0.0, 1.0 - age)


@inline
def change_quality(memory, level, share):
    """Change to a level of quality, unless no island is left that could fade out; the change is logged. share: the load
    of the block"""
    counters, gauges, before = memory.counters, memory.gauges, memory.counters[Slot.QUALITY]
    gauges[Gauge.LOAD_BEFORE] = gauges[Gauge.MEAN_LOAD] if counters[Slot.FRAMES_AT_LEVEL] > 0 else share
    faded = set_quality(memory, level)
    if level > before and level >= memory.models.shape[0] and faded == 0:
        counters[Slot.QUALITY] = before
    if counters[Slot.QUALITY] != before:
        change = counters[Slot.QUALITY_CHANGES] % memory.quality_log.shape[0]
        memory.quality_log[change, 0], memory.quality_log[change, 1] = counters[Slot.FRAME], counters[Slot.QUALITY]
        store_release(counters, Slot.QUALITY_CHANGES, counters[Slot.QUALITY_CHANGES] + 1)
        counters[Slot.LEVEL_BEFORE] = before
    counters[Slot.FRAMES_AT_EASE] = counters[Slot.FRAMES_AT_LEVEL] = 0


# --- events that wait for their frame
#
# `order` is a ring of all rows of `waiting`: those that wait, sorted by frame, and then the unused ones. Events of one
# frame stay in the order in which they were told. An event goes to its island only for the block in which it begins:
# until then it changes nothing, and may be cancelled.


@inline
def row_at(memory, n):
    """Return the row of the n-th event that waits; behind the last, an unused one."""
    order = memory.order
    return order[(memory.counters[Slot.FIRST_WAITING] + n) % order.shape[0]]


@inline
def place_row(memory, n, row):
    """Let a row be that of the n-th event that waits."""
    order = memory.order
    order[(memory.counters[Slot.FIRST_WAITING] + n) % order.shape[0]] = row


@inline
def keep_waiting(memory, slot):
    """Let an event of the queue wait for its frame."""
    counters, event, n = memory.counters, memory.events[slot], memory.counters[Slot.WAITING]
    row = row_at(memory, n)
    for i in range(EVENT_SLOTS):
        memory.waiting[row, i] = event[i]
    for i in range(VALUES_PER_EVENT):
        memory.waiting_values[row, i] = memory.values[slot, i]
    start = max(event[EventSlot.START], counters[Slot.FRAME])
    memory.waiting[row, EventSlot.START] = start
    while n > 0 and memory.waiting[row_at(memory, n - 1), EventSlot.START] > start:
        place_row(memory, n, row_at(memory, n - 1))
        n -= 1
    place_row(memory, n, row)
    counters[Slot.WAITING] += 1


@inline
def remove_waiting(memory, n):
    """Forget the n-th event that waits."""
    counters, row = memory.counters, row_at(memory, n)
    for k in range(n, 0, -1):
        place_row(memory, k, row_at(memory, k - 1))
    place_row(memory, INT64_0, row)
    counters[Slot.FIRST_WAITING] = (counters[Slot.FIRST_WAITING] + 1) % memory.order.shape[0]
    counters[Slot.WAITING] -= 1


@inline
def cancel_note(memory, note, frame):
    """Forget the events of a note that have not begun before a frame."""
    for n in range(memory.counters[Slot.WAITING] - 1, -1, -1):
        event = memory.waiting[row_at(memory, n)]
        if event[EventSlot.NOTE] == note and event[EventSlot.START] >= frame:
            remove_waiting(memory, n)
    # removing moves what waits before it by one, so that the rest keeps its number


@inline
def record_drop(memory, index):
    """Record that the event of an index in the queue was dropped after it was taken."""
    counters, dropped = memory.counters, memory.dropped
    dropped[counters[Slot.DROPPED] % dropped.shape[0]] = index
    store_release(counters, Slot.DROPPED, counters[Slot.DROPPED] + 1)


@inline
def drain_queue(memory):
    """Take the queued events, and record the frame of each: what is to be done at a frame waits for it. While too many
    wait, the rest stays in the queue."""
    counters, size, most = memory.counters, memory.events.shape[0], memory.waiting.shape[0]
    while counters[Slot.READ_INDEX] != load_acquire(counters, Slot.WRITE_INDEX) and counters[Slot.WAITING] < most:
        slot = counters[Slot.READ_INDEX] % size
        event, frame = memory.events[slot], counters[Slot.FRAME]
        event[EventSlot.INDEX], event[EventSlot.TAKEN_AT] = counters[Slot.READ_INDEX], frame
        if event[EventSlot.KIND] == EventKind.QUALITY:
            set_quality(memory, event[EventSlot.TARGET_BEGIN])
        elif event[EventSlot.KIND] == EventKind.CANCEL:
            cancel_note(memory, event[EventSlot.NOTE], max(event[EventSlot.START], frame))
        else:
            if event[EventSlot.KIND] == EventKind.EXCHANGE_TABLES:
                event[EventSlot.TAKEN_AT] = max(event[EventSlot.START], frame)
            keep_waiting(memory, slot)
        store_release(counters, Slot.READ_INDEX, counters[Slot.READ_INDEX] + 1)


@inline
def make_exchange(memory, event):
    """Make an exchange of tables, unless it was withdrawn."""
    if event[EventSlot.TICKET] != 0:
        if atomic_exchange(int64_view(event[EventSlot.TICKET], 1), 0, TICKET_MADE) == TICKET_WITHDRAWN:
            return
    exchange_tables(memory, event)


@inline
def begin_group(memory, group, frame):
    """Pass the events of a group to their islands. None is dropped, as they are releases."""
    one = memory.single_event
    for i in range(group[EventSlot.LENGTH]):
        address = group[EventSlot.TABLE] + GROUPED_BYTES * i
        row = int64_view(address, EVENT_SLOTS)
        for k in range(EVENT_SLOTS):
            one[k] = row[k]
        one[EventSlot.START], one[EventSlot.TAKEN_AT] = group[EventSlot.START], frame
        insert_event(memory, one, address + WORD_BYTES * EVENT_SLOTS)
        memory.counters[Slot.DISPLACED] += one[EventSlot.TAKEN_AT] == DISPLACING


@inline
def begin_events(memory, frames):
    """Pass the events that begin within the next frames to their islands, and make the exchanges of tables that are due
    now. Return for how many of these frames nothing else is to be done."""
    counters = memory.counters
    while counters[Slot.WAITING] > 0:
        row, frame = row_at(memory, INT64_0), counters[Slot.FRAME]
        event = memory.waiting[row]
        ahead = event[EventSlot.START] - frame
        if ahead >= frames:
            return frames
        if event[EventSlot.KIND] == EventKind.EXCHANGE_TABLES:
            if ahead > 0:
                return ahead
            make_exchange(memory, event)
        elif event[EventSlot.KIND] == EventKind.GROUP:
            begin_group(memory, event, frame)
        else:
            event[EventSlot.TAKEN_AT] = frame
            insert_event(memory, event, memory.waiting_values[row].ctypes.data)
            if event[EventSlot.TAKEN_AT] == DROPPED and ahead > 0:
                return ahead  # there may be room when it begins
            if event[EventSlot.TAKEN_AT] == DROPPED:
                record_drop(memory, event[EventSlot.INDEX])
            elif event[EventSlot.TAKEN_AT] == DISPLACING:
                counters[Slot.DISPLACED] += 1
        remove_waiting(memory, INT64_0)
    return frames


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
        drain_queue(memory)
        count = begin_events(memory, min(frames - done, top.audio.shape[0]))
        following = load_acquire(memory.counters, Slot.SUCCESSOR)
        if following != 0:
            successor = load_struct_like(memory, following)
            drain_queue(successor)
            count = begin_events(successor, count)
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


@inline
def take_load(memory, frames, seconds):
    """Record the time of a block, and adapt the quality to it; not while one sound fades into another, as then two are
    computed."""
    record_load(memory, frames, seconds)
    if load_acquire(memory.counters, Slot.SUCCESSOR) == 0:
        adapt_quality(memory, frames, seconds * memory.samplerate / max(1, frames))


@kernel
def record_load_at(address, frames, seconds):
    """Record the time of a block, as a share of its deadline, from a callback in Python, and adapt the quality to it.
    address: of the shared memory"""
    take_load(load_struct(address), frames, seconds)


@kernel
def publish_event(address):
    """Let the audio thread see an event that Python has written to the next row of the queue."""
    counters = load_struct(address).counters
    store_release(counters, Slot.WRITE_INDEX, counters[Slot.WRITE_INDEX] + 1)


@kernel
def withdraw_exchange(ticket):
    """Withdraw an exchange of tables, unless it was made. ticket: the address of its ticket, behind which the number
    that the ticket had is written"""
    numbers = int64_view(ticket, 2)
    numbers[1] = atomic_exchange(numbers, 0, TICKET_WITHDRAWN)


@kernel
def take_events(address):
    """Take the queued events without playing anything: for the thread that renders, from Python. address: of the shared
    memory"""
    drain_queue(load_struct(address))


@kernel
def play_into(address, output, frames):
    """Play some frames, from Python.

    address: of the shared memory; output: address of single-precision room for them, channels interleaved
    """
    play_frames(load_struct(address), output, frames)


@kernel
def portaudio_callback(source, output, frames, time, flags, address):
    """Play a block when PortAudio calls. Nothing here can raise, wait, or ask for memory."""
    top = load_struct(address)
    begin = monotonic_seconds(top.counters[Slot.CLOCK])
    memory, count = memory_in_use(top), frames & UNSIGNED_LONG
    if flags & OUTPUT_UNDERFLOW:
        memory.counters[Slot.UNDERRUNS] += 1
    if memory.counters[Slot.FINISHED] != 0:
        silence = float32_view(output, count * top.audio.shape[1])
        for i in range(silence.shape[0]):
            silence[i] = 0.0
        return COMPLETE
    play_frames(top, output, count)
    spent = monotonic_seconds(top.counters[Slot.CLOCK]) - begin
    take_load(memory, count, spent)
    return CONTINUE
