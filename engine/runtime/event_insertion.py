"""Insert events while a scene is played. They join the score, as if it had contained them from the start."""

from engine.compiler.decorators import inline, kernel
from engine.compiler.intrinsics import float64_view, int64_view
from engine.compiler.struct_types import load_struct
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
from engine.kernel.interactions.contacts import compression_from_modes, reset_open_contacts
from engine.kernel.interactions.island_energy import island_energy
from engine.kernel.interactions.near_contacts import keep_all_contacts
from engine.kernel.modes.free_flight import end_flight
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.ordered_sums import accumulate
from engine.kernel.modes.point_rows import project
from engine.kernel.run.events import move_event, next_due
from engine.kernel.run.trace_rows import keep_energies
from engine.runtime.event_slots import DROPPED, VALUES_PER_EVENT, EventSlot

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
    """Insert an event into the score of its island, no sooner than `frame`, or carry out an order to sleep or to count
    energy. If the score is full, the event is dropped, and marked as DROPPED."""
    n, start, kind = event[EventSlot.ISLAND], max(event[EventSlot.START], frame), event[EventSlot.KIND]
    if kind == EventKind.SLEEP_QUIETEST:
        forget_next_steps(state)
        sleep_quietest(model, state, event[EventSlot.TARGET_BEGIN], frame)
        return
    if kind == EventKind.BOOK_ENERGY:
        make_island_ready(model, state, n, frame)
        book_island_energy(model, state, n, event[EventSlot.TARGET_BEGIN])
        return
    interrupt_at(state, n, start, frame)
    if kind == EventKind.PLUCK:
        retrigger_force(model.force, event[EventSlot.TARGET_BEGIN], start, value[0])
    elif model.events is not None:
        cursor = state.event_cursor[n]
        begin, end = model.islands.event[n], model.islands.event[n + 1]
        truncate_previous(model.events, cursor, begin, event, start)
        cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN
        unused = first_unused(model.events, begin, end)
        if unused == end:
            unused = compact_events(model.events, state.glide_start, cursor, begin, end, frame)
        if not insert_sorted(model.events, begin + cursor[EventCursor.NEXT], unused, end, event, value, start):
            event[EventSlot.TAKEN_AT] = DROPPED


@inline
def partition_of(islands, n):
    """Return the partition of the scene that island n belongs to."""
    partition = 0
    while islands.partition[partition + 1] <= n:
        partition += 1
    return partition


@inline
def interrupt_at(state, n, start, frame):
    """End the free flight and the sleep of island n at frame `start` at the latest, as something begins there.
    frame: the next one"""
    state.contact_free_until[n] = min(state.contact_free_until[n], start)
    state.sleep[n, Sleep.WAKE_FRAME] = min(state.sleep[n, Sleep.WAKE_FRAME], start)
    state.sleep[n, Sleep.STATIC_UNTIL] = min(state.sleep[n, Sleep.STATIC_UNTIL], start)
    if start <= frame:
        state.sleep[n, Sleep.FORCED] = 0


@inline
def make_island_ready(model, state, n, frame):
    """Wake an island, and update the state that was not computed while nothing could act on it."""
    if max(state.contact_free_until[n], state.sleep[n, Sleep.WAKE_FRAME]) >= frame:
        bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
        part, part_state = island_model(model, state, bounds), island_state(state, bounds)
        end_flight(part, part_state, frame)
        reset_open_contacts(part.contact, part_state)
        interrupt_at(state, n, frame, frame)
        state.contact_free_until[n] = 0


@inline
def book_island_energy(model, state, n, sign):
    """Count the energy of island n as supplied, times a sign. A positive sign means that coefficients are new:
    compressions, extensions and velocities are then computed again first."""
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    part, part_state = island_model(model, state, bounds), island_state(state, bounds)
    if sign > 0:
        keep_all_contacts(part.contact, part.connection, part_state)
        reset_compressions(part.contact, part_state)
        reset_connections(part.connection, part_state)
        reset_velocities(part.pickups, part_state)
        part_state.event_cursor[EventCursor.DAMPED] = DampedModes.UNKNOWN  # the loss of modes may be another now
        forget_drift(part_state)
    accumulate(part_state.energy_totals, EnergyTotal.SUPPLIED, sign * island_energy(part, part_state))


@inline
def reset_compressions(contact, state):
    """Compute the compressions from the modes, also in contact. If any is closed now, the island is in contact: else a
    check before the next step would open it, and its energy would be lost."""
    if contact is not None:
        for k in range(state.compression.shape[0]):
            state.compression[k] = compression_from_modes(contact, contact.other_rows, state, k)
            state.compression_compensation[k] = 0.0
            if state.compression[k] > 0.0:
                state.in_contact[0] = 1


@inline
def reset_velocities(pickups, state):
    """Set the previous velocities of acceleration pickups to the present ones, so that a pickup that was moved has no
    step in its signal."""
    for n in range(pickups.quantity.shape[0]):
        if pickups.quantity[n] == Quantity.ACCELERATION:
            state.previous_velocity[n] = project(pickups.rows, n, state.p)


@inline
def next_due_in(model, state, n, frame):
    """Return the frame of the next event or force for which island n must be awake; it is before `frame` if one goes
    on."""
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    part = island_model(model, state, bounds)
    return next_due(part.force, part.events, island_state(state, bounds), frame - 1)


@inline
def sleep_quietest(model, state, count, frame):
    """Put the quietest islands to sleep until something is due in them, or another order comes; wake those that slept
    by an earlier order. A sleeping island does not move, so that its energy stays the same. The last island that is
    awake stays awake, and so does one in contact."""
    islands, awake = state.sleep.shape[0], 0
    for n in range(islands):
        if state.sleep[n, Sleep.FORCED] != 0:
            make_island_ready(model, state, n, frame)
        awake += state.sleep[n, Sleep.WAKE_FRAME] <= frame
    for _ in range(count):
        quietest = -1
        for n in range(islands):
            is_awake = state.sleep[n, Sleep.WAKE_FRAME] <= frame and state.in_contact[n] == 0
            if is_awake and next_due_in(model, state, n, frame) > frame and is_quieter(state, n, quietest):
                quietest = n
        if quietest >= 0 and awake > 1:
            force_to_sleep(model, state, quietest, frame)
            awake -= 1


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
def force_to_sleep(model, state, n, frame):
    """Put island n to sleep until something is due in it."""
    make_island_ready(model, state, n, frame)
    due = next_due_in(model, state, n, frame)
    state.sleep[n, Sleep.WAKE_FRAME] = state.sleep[n, Sleep.STATIC_UNTIL] = due
    state.sleep[n, Sleep.FORCED] = 1
    bounds = island_bounds(model.islands, partition_of(model.islands, n), n)
    keep_energies(island_model(model, state, bounds), island_state(state, bounds))


@inline
def is_quieter(state, n, other):
    """True if island n is quieter than another, or if there is no other (a negative number)."""
    peaks = state.sleep_monitor
    return other < 0 or peaks[n, SleepMonitor.PEAK] < peaks[other, SleepMonitor.PEAK]


@inline
def retrigger_force(force, j, start, scale):
    """Start external force j again, `scale` times as strong. Old logs have a scale of 0, which counts as 1."""
    if force is not None:
        if force.start[j] <= start or force.start[j] >= UNUSED_SLOT:  # a force that has not begun yet is not changed
            force.start[j], force.scale[j] = start, scale if scale > 0.0 else 1.0


@inline
def truncate_previous(events, cursor, begin, event, start):
    """End running events where a newer one of the same kind and targets begins; but not damping that lasts longer."""
    kind, length = event[EventSlot.KIND], event[EventSlot.LENGTH]
    for j in range(begin + cursor[EventCursor.FIRST_ACTIVE], begin + cursor[EventCursor.NEXT]):
        same = events.target_begin[j] == event[EventSlot.TARGET_BEGIN]
        same = same and events.target_end[j] == event[EventSlot.TARGET_END] and events.kind[j] == kind
        if same and (kind != EventKind.DAMP or events.end[j] <= start + length):
            events.end[j] = min(events.end[j], start)


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
    """Remove the events that are over from an island's score, slots begin to end. Returns the first unused slot, after
    which all are unused."""
    kept, running, j = begin, 0, begin + cursor[EventCursor.FIRST_ACTIVE]
    while j < end and events.start[j] != UNUSED_SLOT:
        started = j < begin + cursor[EventCursor.NEXT]
        if not (started and events.end[j] <= frame):
            if kept != j:
                move_event(events, j, kept)
                glide_start[kept] = glide_start[j]
            kept += 1
            running += started
        j += 1
    for over in range(kept, j):
        events.start[over] = events.end[over] = UNUSED_SLOT
    cursor[EventCursor.FIRST_ACTIVE], cursor[EventCursor.NEXT] = 0, running
    return kept


@inline
def insert_sorted(events, first, unused, end, event, value, start):
    """Insert an event among those that have not begun, which slots `first` to `unused` hold, sorted by start. Returns
    True if there was an unused slot before `end`."""
    if unused == end:
        return False
    j = unused
    while j > first and events.start[j - 1] > start:
        move_event(events, j - 1, j)
        j -= 1
    events.kind[j], events.start[j] = event[EventSlot.KIND], start
    events.end[j] = start + event[EventSlot.LENGTH]
    events.target_begin[j], events.target_end[j] = event[EventSlot.TARGET_BEGIN], event[EventSlot.TARGET_END]
    events.value[j], events.value2[j] = value[0], value[1]
    return True
