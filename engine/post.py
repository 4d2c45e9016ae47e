"""Events that come while a scene is played: they join the score, as if it had always said so."""

from engine.contact import resync, separated
from engine.deck import EVENT, FIRST, HUSH, ISLAND, KIND, LAST_OF, LENGTH, START, TOOK, VALUE, WEIGH
from engine.energy import SUPPLIED, book
from engine.events import DAMP, NEVER, held
from engine.held import let
from engine.islands import cut_model, cut_state
from engine.jit import entry, jit
from engine.native import floats, ints
from engine.rest import HUSHED, LEVEL, STILL, UNTIL

DROPPED = -1  # instead of the frame at which an event was taken
PLUCK = 8  # a kind of event beside those of the score: external force `first` begins anew


@entry
def post(model, state, event, value, frame):
    """Write an event, at an address, into the score of its island; it begins no sooner than `frame`."""
    add(let(model), let(state), ints(event, EVENT), floats(value, VALUE), frame)


@jit
def add(model, state, event, value, frame):
    """As `post`, of what is held. What does not fit into a full score is dropped, and marked so."""
    n, start = event[ISLAND], max(event[START], frame)
    if event[KIND] == HUSH:
        hush(model, state, event[FIRST], frame)
        return
    if max(state.clear[n], state.asleep[n, UNTIL]) > frame:
        rouse(model, state, n, frame)
    if event[KIND] == WEIGH:
        weigh(model, state, n, event[FIRST])
    elif event[KIND] == PLUCK:
        again(model.force, event[FIRST], start, value[0])
    elif model.events is not None:
        following = state.next_event[n]
        begin, end = model.islands.event[n], model.islands.event[n + 1]
        overrule(model.events, following, begin, event, start)
        tidy(model.events, state.event_from, following, begin, end, frame)
        if not insert(model.events, following, begin, end, event, value, start):
            event[TOOK] = DROPPED


@jit
def part_of(islands, n):
    """The part of the scene that island n belongs to."""
    part = 0
    while islands.part[part + 1] <= n:
        part += 1
    return part


@jit
def rouse(model, state, n, frame):
    """Wake an island, or bring up to date what it has not looked at while nothing could act on it."""
    island = cut_model(model, state, n)
    own = cut_state(model.islands, state, part_of(model.islands, n), n)
    resync(island.contact, island.partner, own)
    state.asleep[n, HUSHED] = 0
    state.asleep[n, UNTIL] = min(state.asleep[n, UNTIL], frame)
    state.asleep[n, STILL] = min(state.asleep[n, STILL], frame)
    state.clear[n] = min(state.clear[n], frame)


@jit
def weigh(model, state, n, sign):
    """Book the energy that island n holds; if as supplied, its tables are new, and so are its compressions."""
    island = cut_model(model, state, n)
    own = cut_state(model.islands, state, part_of(model.islands, n), n)
    if sign > 0:
        renew(island.contact, island.partner, own)
    book(own.account, SUPPLIED, sign * held(island, own))


@jit
def due(model, state, n, frame):
    """When the next thing happens to an island that would have to be awake for it."""
    return min(event_due(model.events, model.islands, state, n, frame), push_due(model.force, model.islands, n, frame))


@jit
def renew(contact, partner, state):
    """Read the compressions from the modes, also in contact."""
    if contact is not None:
        for k in range(contact.barrier.shape[0]):
            state.compression[k] = separated(contact, partner, state, k)
            state.residue[k] = 0.0


@jit
def event_due(events, islands, state, n, frame):
    """When an event of its score runs."""
    if events is None:
        return NEVER
    following = islands.event[n] + state.next_event[n, 1]
    for j in range(islands.event[n] + state.next_event[n, 0], following):
        if events.end[j] > frame:
            return frame
    return events.start[following] if following < islands.event[n + 1] else NEVER


@jit
def push_due(force, islands, n, frame):
    """When an external force acts."""
    found = NEVER
    if force is not None:
        for j in range(islands.force[n], islands.force[n + 1]):
            over = force.start[j] + force.begin[j + 1] - force.begin[j]
            if over > frame or force.after[j] != 0.0:
                found = min(found, max(frame, force.start[j]))
    return found


@jit
def hush(model, state, count, frame):
    """Put the quietest islands to sleep until something is due in them, or they are told otherwise; and wake those that
    were told before. Nothing in them moves, so that to sleep takes and gives no energy. The last one awake stays so,
    and so does one in contact."""
    islands, awake = state.asleep.shape[0], 0
    for n in range(islands):
        if state.asleep[n, HUSHED] != 0:
            rouse(model, state, n, frame)
        awake += state.asleep[n, UNTIL] <= frame
    for _ in range(count):
        quietest = -1
        for n in range(islands):
            able = state.asleep[n, UNTIL] <= frame and state.touching[n] == 0 and due(model, state, n, frame) > frame
            if able and (quietest < 0 or state.rest[n, LEVEL] < state.rest[quietest, LEVEL]):
                quietest = n
        if quietest >= 0 and awake > 1:
            rouse(model, state, quietest, frame)
            state.asleep[quietest, UNTIL] = state.asleep[quietest, STILL] = due(model, state, quietest, frame)
            state.asleep[quietest, HUSHED] = 1
            awake -= 1


@jit
def again(force, j, start, scale):
    """Let external force j begin anew, so many times as strong; logs of old have 0 there."""
    if force is not None:
        if force.start[j] <= start or force.start[j] >= NEVER:  # one that is still to come is left alone
            force.start[j], force.scale[j] = start, scale if scale > 0.0 else 1.0


@jit
def overrule(events, following, begin, event, start):
    """What runs now ends where a newer event of its kind, on the same, begins; but for what lasts longer."""
    for j in range(begin + following[0], begin + following[1]):
        same = events.kind[j] == event[KIND] and events.first[j] == event[FIRST] and events.last[j] == event[LAST_OF]
        if same and (event[KIND] != DAMP or events.end[j] <= start + event[LENGTH]):
            events.end[j] = min(events.end[j], start)


@jit
def tidy(events, origins, following, begin, end, frame):
    """Forget events of an island's score, rows begin to end, that are over."""
    kept, running = begin, 0
    for j in range(begin + following[0], end):
        started = j < begin + following[1]
        if started and events.end[j] <= frame:
            continue
        if kept != j:
            events.kind[kept], events.start[kept], events.end[kept] = events.kind[j], events.start[j], events.end[j]
            events.first[kept], events.last[kept] = events.first[j], events.last[j]
            events.a[kept], events.b[kept], origins[kept] = events.a[j], events.b[j], origins[j]
        kept += 1
        running += started
    for j in range(kept, end):
        events.start[j] = events.end[j] = NEVER
    following[0], following[1] = 0, running


@jit
def insert(events, following, begin, end, event, value, start):
    """Put an event where its start belongs among those that have not begun; returns whether it fitted."""
    if begin == end or events.start[end - 1] != NEVER:
        return False
    j = end - 1
    while j > begin + following[1] and events.start[j - 1] > start:
        events.kind[j], events.start[j], events.end[j] = events.kind[j - 1], events.start[j - 1], events.end[j - 1]
        events.first[j], events.last[j] = events.first[j - 1], events.last[j - 1]
        events.a[j], events.b[j] = events.a[j - 1], events.b[j - 1]
        j -= 1
    events.kind[j], events.start[j], events.end[j] = event[KIND], start, start + event[LENGTH]
    events.first[j], events.last[j] = event[FIRST], event[LAST_OF]
    events.a[j], events.b[j] = value[0], value[1]
    return True
