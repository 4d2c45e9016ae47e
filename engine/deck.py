"""Plays a scene block by block as an audio driver asks for it, without the interpreter.

Everything is found by addresses on a desk of whole numbers that Python and the audio thread share: the kernel of the
scene, its Model, State and rooms, a ring of events, a ring of what was played. The same function plays for the
driver, for tests and for a replay.
"""

import math

from numba import types

from engine.energy import COLUMNS, HELD, SPENT, STORED
from engine.jit import callback, entry, jit
from engine.native import clock, floats, ints, invoke, publish, singles, watch

# the desk: whole numbers and addresses, set once …
BLOCK, POST, MODEL, STATE, PARTS, CHANNELS, SIZE, ROOMS, OUTS, LEDGERS, MIX = range(11)
EVENTS, VALUES, SLOTS, RECORD, KEPT, GAUGE, FADE, RATE, TIMES, TIMED = range(11, 21)
MODELS, LEVELS, LOWEST, ORDER, CHANGES, CHANGED, SPARE, TUNINGS = range(21, 29)
# … what Python changes: events put in so far, a wish to stop, the desk that takes over
PUT, STOP, NEXT, LEAVE = range(29, 33)
# … and what the audio thread does
END, TAKEN, FRAME, DONE, LIMITED, GAPS, CALLS, LEVEL, STEPS, CALM, RECORDED, WRONG, WAITING = range(33, 46)
DESK = 46
# gauges: numbers
GAIN, ENVELOPE, PEAK, WORST, BUSY, FIRST_BALANCE, ENERGY, ERROR, NEAR, FAR = range(10)
GAUGES = 10
# an event, whole numbers: what, island, first, last, when at the earliest, how long; and the frame it was taken
KIND, ISLAND, FIRST, LAST_OF, START, LENGTH, TOOK = range(7)
EVENT = 7
VALUE = 2  # numbers of an event

# kinds of events beside those of the score and of engine.post
QUALITY = 10  # play at level `first`
TUNE = 11  # at frame `length`, of `last` islands from `island` on, copy `first` tables as the list at `start` says
UNDERFLOW = 4  # flag of PortAudio: the driver ran dry before this block
CONTINUE, COMPLETE = 0, 1
RECOVERY = 0.1  # s, in which the limiter lets go
LOUDEST = 1e6  # of full scale, that the limiter follows
EASE = 1.0  # s, after which quality steps up again
HUSH = 9  # a kind of event (engine.post): the quietest `first` islands sleep
WEIGH = 12  # another: the energy of an island counts as supplied, times `first`


@jit
def play_at(desk, level):
    """Play at a level of quality: 0 as asked; then coarser models; then with ever more of the quietest asleep."""
    last, level = desk[LEVELS] - 1, max(0, min(level, desk[LOWEST]))
    desk[MODEL] = ints(desk[MODELS], desk[LEVELS])[min(level, last)]
    order = ints(desk[ORDER], EVENT)
    order[KIND], order[FIRST] = HUSH, max(0, level - last)
    if level > last or desk[LEVEL] > last:
        invoke(desk[POST], (desk[MODEL], desk[STATE], desk[ORDER], desk[ORDER], desk[FRAME]))
    desk[LEVEL] = level


@jit
def tune(desk, event):
    """Give some islands other tables; what that does to their energy is booked."""
    weigh(desk, event, -1)
    for i in range(event[FIRST]):
        order = ints(event[START] + 24 * i, 3)
        to, of = floats(order[0], order[2]), floats(order[1], order[2])
        for k in range(order[2]):
            to[k] = of[k]
    weigh(desk, event, 1)


@jit
def weigh(desk, event, sign):
    """Book the energies of some islands as supplied, or as taken."""
    order = ints(desk[ORDER], EVENT)
    for n in range(event[ISLAND], event[ISLAND] + event[LAST_OF]):
        order[KIND], order[ISLAND], order[FIRST] = WEIGH, n, sign
        invoke(desk[POST], (desk[MODEL], desk[STATE], desk[ORDER], desk[ORDER], desk[FRAME]))


@jit
def steer(desk, gauge, frames, share):
    """After a block: one level down if it came near its deadline; up again after a second of ease."""
    level = desk[LEVEL]
    desk[CALM] = desk[CALM] + frames if share < gauge[FAR] else 0
    if share > gauge[NEAR] and level < desk[LOWEST]:
        level += 1
    elif desk[CALM] > desk[RATE] * EASE and level > 0:
        level -= 1
    if level != desk[LEVEL]:
        change = ints(desk[CHANGES] + 16 * (desk[STEPS] % desk[CHANGED]), 2)
        change[0], change[1] = desk[FRAME], level
        play_at(desk, level)
        desk[CALM] = 0
        publish(desk, STEPS, desk[STEPS] + 1)


@jit
def waiting(desk, n):
    """The tuning that waits at place n for its frame."""
    return ints(desk[TUNINGS] + 8 * EVENT * n, EVENT)


@jit
def put_off(desk, event):
    """Let a tuning wait for its frame, behind those of sooner frames and of the same."""
    n = desk[WAITING]
    while n > 0 and waiting(desk, n - 1)[TOOK] > event[TOOK]:
        later, sooner = waiting(desk, n), waiting(desk, n - 1)
        for i in range(EVENT):
            later[i] = sooner[i]
        n -= 1
    own = waiting(desk, n)
    for i in range(EVENT):
        own[i] = event[i]
    desk[WAITING] += 1


@jit
def tune_due(desk):
    """Do the tunings whose frame has come."""
    due = 0
    while due < desk[WAITING] and waiting(desk, due)[TOOK] <= desk[FRAME]:
        tune(desk, waiting(desk, due))
        due += 1
    if due > 0:
        desk[WAITING] -= due
        for n in range(desk[WAITING]):
            own, later = waiting(desk, n), waiting(desk, n + due)
            for i in range(EVENT):
                own[i] = later[i]


@jit
def take_events(desk):
    """Hand the events that have been put in to the scene, and note when; tunings wait for their frame. Returns how
    many frames may be computed until the next tuning."""
    while desk[TAKEN] != watch(desk, PUT) and desk[WAITING] < desk[SLOTS]:
        slot = desk[TAKEN] % desk[SLOTS]
        place, value = desk[EVENTS] + 8 * EVENT * slot, desk[VALUES] + 8 * VALUE * slot
        event = ints(place, EVENT)
        event[TOOK] = desk[FRAME]
        if event[KIND] == QUALITY:
            play_at(desk, event[FIRST])
        elif event[KIND] == TUNE:
            event[TOOK] = max(event[LENGTH], desk[FRAME])
            put_off(desk, event)
        else:
            invoke(desk[POST], (desk[MODEL], desk[STATE], place, value, desk[FRAME]))
        publish(desk, TAKEN, desk[TAKEN] + 1)
    tune_due(desk)
    return waiting(desk, 0)[TOOK] - desk[FRAME] if desk[WAITING] > 0 else desk[SIZE]


@jit
def mix(desk, gauge, frames):
    """Compute the next frames of all parts, add them, and follow their energies."""
    parts = desk[PARTS]
    rooms, outs, ledgers = ints(desk[ROOMS], parts), ints(desk[OUTS], parts), ints(desk[LEDGERS], parts)
    for part in range(parts):
        invoke(desk[BLOCK], (desk[MODEL], desk[STATE], rooms[part], part, frames))
    count = frames * desk[CHANNELS]
    total = floats(desk[MIX], count)
    for part in range(parts):
        out = floats(outs[part], count)
        for i in range(count):
            total[i] = out[i] if part == 0 else total[i] + out[i]
    for i in range(frames):
        stored, spent, held = 0.0, 0.0, 0.0
        for part in range(parts):
            row = floats(ledgers[part] + 8 * COLUMNS * i, COLUMNS)
            stored, spent, held = stored + row[STORED], spent + row[SPENT], held + row[HELD]
        if desk[FRAME] == 0 and i == 0:
            gauge[FIRST_BALANCE] = stored + spent
        gauge[ENERGY] = held if held > gauge[ENERGY] else gauge[ENERGY]  # max() would hide what is not a number
        error = abs(stored + spent - gauge[FIRST_BALANCE])
        gauge[ERROR] = max(gauge[ERROR], error) if error < math.inf else math.inf


@jit
def put_out(desk, gauge, out, frames):
    """Bring the mix to the output: gain, fades at start and stop, and a limiter of last resort."""
    channels = desk[CHANNELS]
    total = floats(desk[MIX], frames * channels)
    release = math.exp(-1.0 / (RECOVERY * desk[RATE]))
    for i in range(frames):
        frame = desk[FRAME] + i
        risen, left = (frame + 0.5) / desk[FADE], (desk[END] - frame - 0.5) / desk[LEAVE]
        level = gauge[GAIN] * max(0.0, min(1.0, risen, left))
        loudest = 0.0
        for c in range(channels):
            value = total[i * channels + c]
            if not math.isfinite(value):
                value = total[i * channels + c] = 0.0
                desk[WRONG] += 1
            loudest = max(loudest, abs(value) * abs(level))
        gauge[PEAK] = max(gauge[PEAK], loudest)
        gauge[ENVELOPE] = min(LOUDEST, max(loudest, gauge[ENVELOPE] * release))
        if gauge[ENVELOPE] > 1.0:
            level /= gauge[ENVELOPE]
            desk[LIMITED] += 1
        for c in range(channels):
            out[i * channels + c] = min(1.0, max(-1.0, total[i * channels + c] * level))


@jit
def run(desk, out, frames):
    """Play so many frames, no more than are computed at once, into `out`: single precision, channels interleaved."""
    gauge = floats(desk[GAUGE], GAUGES)
    mix(desk, gauge, frames)
    put_out(desk, gauge, out, frames)
    publish(desk, FRAME, desk[FRAME] + frames)


@jit
def taken_over(desk):
    """The desk that is played now: the first, or of those that took over the first that has not ended."""
    while desk[DONE] != 0 and watch(desk, NEXT) != 0:
        desk = ints(desk[NEXT], DESK)
    return desk


@jit
def perform(top, out, frames):
    """Play so many frames of what is on, and of what takes over from it while the one fades into the other."""
    desk, count = taken_over(top), frames * top[CHANNELS]
    following = watch(desk, NEXT)
    if watch(desk, STOP) != 0 or following != 0:
        desk[END] = min(desk[END], desk[FRAME] + desk[LEAVE])
    sounding = frames if following != 0 else max(0, min(frames, desk[END] - desk[FRAME]))
    run(desk, out, frames)
    if following != 0:
        later = singles(desk[SPARE], count)
        run(ints(following, DESK), later, frames)
        for i in range(count):
            out[i] = min(1.0, max(-1.0, out[i] + later[i]))
    if desk[FRAME] >= desk[END]:
        publish(desk, DONE, 1)
    record, room = singles(top[RECORD], top[KEPT] * top[CHANNELS]), top[KEPT] * top[CHANNELS]
    begin = top[RECORDED] * top[CHANNELS]
    for i in range(sounding * top[CHANNELS]):
        record[(begin + i) % room] = out[i]
    publish(top, RECORDED, top[RECORDED] + sounding)


@jit
def perform_all(top, output, frames):
    """As `perform`, any number of frames, to an address."""
    done = 0
    while done < frames:
        desk = taken_over(top)
        count, following = min(frames - done, top[SIZE], take_events(desk)), watch(desk, NEXT)
        if following != 0:
            count = min(count, take_events(ints(following, DESK)))
        perform(top, singles(output + 4 * done * top[CHANNELS], count * top[CHANNELS]), count)
        done += count


@jit
def took(desk, gauge, frames, seconds):
    """Note how long a block took, as a share of its deadline."""
    share = seconds * desk[RATE] / max(1, frames)
    floats(desk[TIMES], desk[TIMED])[desk[CALLS] % desk[TIMED]] = share
    desk[CALLS] += 1
    gauge[BUSY] += seconds
    gauge[WORST] = max(gauge[WORST], share)


@entry
def note(address, frames, seconds):
    """The same, from a callback in Python."""
    desk = ints(address, DESK)
    took(desk, floats(desk[GAUGE], GAUGES), frames, seconds)


@entry
def put_in(address, kind, island, first, last, start, length, a, b):
    """Put an event into the ring, from Python: 1 if there was room. `start`: frame it begins at, at the earliest;
    `length`: in frames."""
    desk = ints(address, DESK)
    if desk[PUT] - watch(desk, TAKEN) >= desk[SLOTS]:
        return 0
    slot = desk[PUT] % desk[SLOTS]
    event, value = ints(desk[EVENTS] + 8 * EVENT * slot, EVENT), floats(desk[VALUES] + 8 * VALUE * slot, VALUE)
    event[KIND], event[ISLAND], event[FIRST], event[LAST_OF] = kind, island, first, last
    event[START], event[LENGTH] = start, length
    value[0], value[1] = a, b
    publish(desk, PUT, desk[PUT] + 1)
    return 1


@entry
def play(address, output, frames):
    """Play some frames, from Python.

    address: of the desk; output: address of single-precision room for them, channels interleaved
    """
    perform_all(ints(address, DESK), output, frames)


@callback(types.int32(types.voidptr, types.intp, types.ulong, types.voidptr, types.ulong, types.intp))
def answer(source, output, frames, time, flags, address):
    """What PortAudio calls. Nothing here can raise, wait, or ask for memory."""
    begin = clock()
    top = ints(address, DESK)
    desk, count = taken_over(top), types.int64(frames)
    if flags & UNDERFLOW:
        desk[GAPS] += 1
    if desk[DONE] != 0:
        out = singles(output, count * top[CHANNELS])
        for i in range(count * top[CHANNELS]):
            out[i] = 0.0
        return COMPLETE
    perform_all(top, output, count)
    spent, gauge = clock() - begin, floats(desk[GAUGE], GAUGES)
    took(desk, gauge, count, spent)
    if watch(desk, NEXT) == 0:  # while one sound fades into another, two are computed
        steer(desk, gauge, count, spent * desk[RATE] / max(1, count))
    return CONTINUE
