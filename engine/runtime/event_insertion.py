"""Insert events while a scene is played. They join the score, as if it had contained them from the start."""

from engine.compiler.decorators import inline, kernel
from engine.compiler.intrinsics import float64_view, int64_view
from engine.compiler.struct_types import load_struct
from engine.kernel.contact.law import update_laws
from engine.kernel.data.effects import EFFECTS, EVENTS
from engine.kernel.data.enums import (
    UNUSED_SLOT,
    DampedModes,
    EnergyTotal,
    EventCursor,
    EventKind,
    Quantity,
    Sleep,
    SleepMonitor,
    StepKind,
)
from engine.kernel.data.island_view import island_bounds, island_model, island_state
from engine.kernel.interactions.connections import reset_connections
from engine.kernel.interactions.contacts import reset_compressions, reset_open_contacts
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.near_contacts import keep_all_contacts
from engine.kernel.modes.free_flight import end_flight
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import accumulate
from engine.kernel.modes.point_rows import project
from engine.kernel.run.events import move_event, next_due
from engine.kernel.run.fade import fade_frames, turn_fade
from engine.runtime.event_slots import DISPLACING, DROPPED, VALUES_PER_EVENT, EventSlot

EVENT_SLOTS = len(EventSlot)


@kernel
def insert_event_at(model, state, event, value, frame):
    """Insert an event, at an address, into the score of its island; it begins no sooner than `frame`."""
    insert_event(
        load_struct(model),
        load_struct(state),
        int64_view(event, EVENT_SLOTS),
        float64_view(value, VALUES_PER_EVENT),
        frame,
    )


@inline
def insert_event(model, state, event, value, frame):
    """Insert an event into the score of its island, no sooner than `frame`, or carry out an order to drop islands or to
    count energy. If the score is full, nothing changes, and the event is marked as DROPPED; but a release takes the
    place of the oldest event, and is marked as DISPLACING."""
    n, start, kind = event[EventSlot.ISLAND], max(event[EventSlot.START], frame), event[EventSlot.KIND]
    if kind == EventKind.DROP_QUIETEST:
        forget_next_steps(state)
        drop_quietest(model, state, event, frame)
        return
    if kind == EventKind.BOOK_ENERGY:
        make_island_ready(model, state, n, frame)
        book_island_energy(model, state, n, event[EventSlot.TARGET_BEGIN])
        return
    if EFFECTS & EVENTS:
        cursor = state.event_cursor[n]
        begin, end = model.islands.event[n], model.islands.event[n + 1]
        unused = first_unused(model.events, begin, end)
        if unused == end:
            unused = compact_events(model.events, state.glide_start, cursor, begin, end, frame)
        if unused == end and event[EventSlot.IS_RELEASE] != 0 and begin < end:
            model.events.end[begin + cursor[EventCursor.FIRST_ACTIVE]] = frame - 1
            cursor[EventCursor.NEXT] = max(cursor[EventCursor.NEXT], cursor[EventCursor.FIRST_ACTIVE] + 1)
            unused = compact_events(model.events, state.glide_start, cursor, begin, end, frame)
            event[EventSlot.TAKEN_AT] = DISPLACING
        if unused == end:
            event[EventSlot.TAKEN_AT] = DROPPED
            return
        interrupt_at(state, n, start)
        if kind != EventKind.DAMP:
            turn_fade(state.sleep[n], model.samplerate, frame)
        insert_sorted(model.events, begin + cursor[EventCursor.NEXT], unused, event, value, start)


@inline
def partition_of(islands, n):
    """Return the partition of the scene that island n belongs to."""
    partition = 0
    while islands.partition[partition + 1] <= n:
        partition += 1
    return partition


@inline
def interrupt_at(state, n, start):
    """End the free flight and the sleep of island n at frame `start` at the latest, as something begins there."""
    state.contact_free_until[n] = min(state.contact_free_until[n], start)
    state.sleep[n, Sleep.WAKE_FRAME] = min(state.sleep[n, Sleep.WAKE_FRAME], start)
    state.sleep[n, Sleep.STATIC_UNTIL] = min(state.sleep[n, Sleep.STATIC_UNTIL], start)


@inline
def make_island_ready(model, state, n, frame):
    """Bring an island up to a frame: wake it, and compute what was not while nothing could act on it."""
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    part, part_state = island_model(model, bounds), island_state(state, bounds)
    update_laws(part_state, frame + 0.0)
    if max(state.contact_free_until[n], state.sleep[n, Sleep.WAKE_FRAME]) >= frame:
        end_flight(part, part_state, frame)
        reset_open_contacts(part.contact, part_state)
        interrupt_at(state, n, frame)
        state.contact_free_until[n] = 0


@inline
def book_island_energy(model, state, n, sign):
    """Count the energy of island n as supplied, times a sign. A positive sign means that coefficients are new:
    compressions and extensions are then computed again first."""
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    part, part_state = island_model(model, bounds), island_state(state, bounds)
    count_velocities(part.pickups, part_state, sign)
    if sign > 0:
        keep_all_contacts(part.contact, part_state)
        reset_compressions(part.contact, part_state)
        reset_connections(part.connection, part_state)
        part_state.event_cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN  # the loss of modes may be another now
        forget_drift(part_state)
    accumulate(part_state.energy_totals, EnergyTotal.SUPPLIED, sign * island_energy(part, part_state))


@inline
def count_velocities(pickups, state, sign):
    """Take the present velocities from the previous ones of acceleration pickups, or add them (`sign` is 1): between
    the two, a pickup may move, or its rows change, and its signal has no step."""
    for n in range(pickups.quantity.shape[0]):
        if pickups.quantity[n] == Quantity.ACCELERATION:
            state.previous_velocity[n] += sign * project(pickups.rows, n, state.p)


@inline
def next_due_in(model, state, n, frame):
    """Return the frame of the next event or force for which island n must be awake; it is before `frame` if one goes
    on."""
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    part = island_model(model, bounds)
    return next_due(part.force, part.events, island_state(state, bounds), frame - 1)


@inline
def drop_quietest(model, state, order, frame):
    """Let so many islands fade out as an order says, the quietest that sound; it is replaced by how many do. The last
    one goes on, and so does one in contact, or on which something begins soon.

    order: TARGET_BEGIN: number of islands
    """
    islands, sounding, faded = state.sleep.shape[0], 0, 0
    for n in range(islands):
        sounding += not is_silent(state.sleep, n, frame)
    end = frame + fade_frames(model.samplerate)
    while faded < order[EventSlot.TARGET_BEGIN] and sounding > 1:
        quietest = -1
        for n in range(islands):
            may_end = state.in_contact[n] == 0 and not is_silent(state.sleep, n, frame)
            if may_end and is_quieter(state, n, quietest) and next_due_in(model, state, n, frame) > end:
                quietest = n
        if quietest < 0:
            break
        state.sleep[quietest, Sleep.FADE_END] = end
        sounding -= 1
        faded += 1
    order[EventSlot.TARGET_BEGIN] = faded


@inline
def is_silent(sleep, n, frame):
    """True if island n sleeps, or fades out."""
    return sleep[n, Sleep.WAKE_FRAME] > frame or sleep[n, Sleep.FADE_END] > 0


@inline
def forget_next_steps(state):
    """Let no island use what it knows of its next step: with another quality, that step has another length."""
    for n in range(state.drift_kind.shape[0]):
        state.drift_kind[n] = StepKind.UNKNOWN
    forget_margins(state.refinement)


@inline
def forget_margins(refinement):
    """Let no island use the margins of its last samples in stages. refinement: RefinementState or None"""
    if refinement is not None:
        for n in range(refinement.margin_valid.shape[0]):
            refinement.margin_valid[n] = 0


@inline
def is_quieter(state, n, other):
    """True if island n is quieter than another, or if there is no other (a negative number)."""
    peaks = state.sleep_monitor
    return other < 0 or peaks[n, SleepMonitor.PEAK] < peaks[other, SleepMonitor.PEAK]


@inline
def first_unused(events, begin, end):
    """Return the first unused slot of an island's score, slots begin to end; `end` if there is none. All after it are
    unused."""
    while begin < end:
        middle = (begin + end) // 2
        if events.start[middle] == UNUSED_SLOT:
            end = middle
        else:
            begin = middle + 1
    return begin


@inline
def compact_events(events, glide_start, cursor, begin, end, frame):
    """Remove the events that were over before this frame from an island's score, slots begin to end. Returns the first
    unused slot, after which all are unused."""
    kept, running, j = begin, 0, begin + cursor[EventCursor.FIRST_ACTIVE]
    while j < end and events.start[j] != UNUSED_SLOT:
        started = j < begin + cursor[EventCursor.NEXT]
        if not (started and events.end[j] < frame):  # a glide that ends now is still to be ended
            if kept != j:
                move_event(events, j, kept)
                glide_start[kept] = glide_start[j]
            kept += 1
            running += started
        j += 1
    for over in range(kept, j):
        events.start[over] = events.end[over] = UNUSED_SLOT
    cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT] = 0, running
    if kept < j:
        cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN  # a damper may be among them
    return kept


@inline
def insert_sorted(events, first, unused, event, value, start):
    """Insert an event among those that have not begun, which slots `first` to `unused` hold, sorted by start; behind
    those of the same start."""
    j = unused
    while j > first and events.start[j - 1] > start:
        move_event(events, j - 1, j)
        j -= 1
    events.kind[j], events.start[j] = event[EventSlot.KIND], start
    events.end[j] = start + event[EventSlot.LENGTH]
    events.target_begin[j], events.target_end[j] = event[EventSlot.TARGET_BEGIN], event[EventSlot.TARGET_END]
    events.value[j], events.value2[j], events.value3[j] = value[0], value[1], value[2]
