"""Events that come while a scene is played: they join the score, as if it had always said so."""

from engine.deck import EVENT, FIRST, HUSH, ISLAND, KIND, LAST_OF, LENGTH, START, VALUE, WEIGH
from engine.energy import SUPPLIED, book
from engine.events import NEVER, held
from engine.held import let
from engine.islands import cut_model, cut_state
from engine.jit import entry, jit
from engine.native import floats, ints
from engine.rest import LEVEL, STILL, UNTIL

PLUCK = 8  # a kind of event beside those of the score: external force `first` begins anew


@entry
def post(model, state, event, value, frame):
    """Write an event, at an address, into the score of its island; it begins no sooner than `frame`."""
    add(let(model), let(state), ints(event, EVENT), floats(value, VALUE), frame)


@jit
def add(model, state, event, value, frame):
    """As `post`, of what is held. A full score drops the event."""
    n, start = event[ISLAND], max(event[START], frame)
    if event[KIND] == HUSH:
        hush(state, event[FIRST], frame)
        return
    if event[KIND] == WEIGH:
        weigh(model, state, n, event[FIRST])
    elif event[KIND] == PLUCK:
        again(model.force, event[FIRST], start)
    elif model.events is not None:
        following = state.next_event[n]
        begin, end = model.islands.event[n], model.islands.event[n + 1]
        tidy(model.events, state.event_from, following, begin, end, frame)
        insert(model.events, following, begin, end, event, value, start)
    state.clear[n] = min(state.clear[n], start)
    state.asleep[n, UNTIL], state.asleep[n, STILL] = (
        min(state.asleep[n, UNTIL], start),
        min(state.asleep[n, STILL], start),
    )


@jit
def weigh(model, state, n, sign):
    """Book the energy that island n holds."""
    part = 0
    while model.islands.part[part + 1] <= n:
        part += 1
    island = cut_model(model, state, n)
    own = cut_state(model.islands, state, part, n)
    book(own.account, SUPPLIED, sign * held(island, own))


@jit
def hush(state, count, frame):
    """Put the quietest islands to sleep until they are told otherwise, and wake those that were told before. What
    they hold they keep: to sleep takes and gives no energy."""
    islands = state.asleep.shape[0]
    for n in range(islands):
        if state.asleep[n, UNTIL] == NEVER:
            state.asleep[n, UNTIL] = state.asleep[n, STILL] = frame
            state.clear[n] = min(state.clear[n], frame)
    for _ in range(min(count, islands - 1)):
        quietest = -1
        for n in range(islands):
            awake = state.asleep[n, UNTIL] <= frame
            if awake and (quietest < 0 or state.rest[n, LEVEL] < state.rest[quietest, LEVEL]):
                quietest = n
        if quietest >= 0:
            state.asleep[quietest, UNTIL] = state.asleep[quietest, STILL] = NEVER


@jit
def again(force, j, start):
    """Let external force j begin anew."""
    if force is not None:
        force.start[j] = start


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
    """Put an event where its start belongs among those that have not begun."""
    if events.start[end - 1] != NEVER:
        return
    j = end - 1
    while j > begin + following[1] and events.start[j - 1] > start:
        events.kind[j], events.start[j], events.end[j] = events.kind[j - 1], events.start[j - 1], events.end[j - 1]
        events.first[j], events.last[j] = events.first[j - 1], events.last[j - 1]
        events.a[j], events.b[j] = events.a[j - 1], events.b[j - 1]
        j -= 1
    events.kind[j], events.start[j], events.end[j] = event[KIND], start, start + event[LENGTH]
    events.first[j], events.last[j] = event[FIRST], event[LAST_OF]
    events.a[j], events.b[j] = value[0], value[1]
