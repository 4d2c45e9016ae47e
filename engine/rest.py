"""Sleep: an island whose vibration and sound have died is not computed until something is due, or a
body that still flies comes near another.

It is decided on the scene's own grid of samples, so that blocks of any size give the same. What
vibrates is left as it is and its pickups are silent, which changes the output by less than
`Model.silence` of its peak; free masses fly on.
"""

from engine.energy import DISSIPATED, book
from engine.events import quiet
from engine.force import idle
from engine.jit import ZERO, jit, outlined
from engine.modes import close_mode, open_mode

LEVEL, LOUDEST, MOST = 0, 1, 2  # of State.rest: peak output since the last look, ever; largest energy, J
KEPT = 3
UNTIL, STILL, SLEPT, HUSHED = 0, 1, 2, 3  # of State.asleep
NAPS = 4


@jit
def hear(state, value):
    """Keep the peak of what the pickups of an island give."""
    state.rest[LEVEL] = max(state.rest[LEVEL], abs(value))


@jit
def sleep_on(force, events, state, frame, ahead):
    """Stay asleep for so many samples from this frame on, unless something is due in them. Nothing flies."""
    if idle(force, frame, ahead) and quiet(events, state, frame, ahead):
        state.asleep[UNTIL] = state.asleep[STILL] = frame + ahead


@jit
def heard_flying(gravity, loose, state):
    """Whether a pickup hears a free mass that moves."""
    if loose is None:
        return False
    return loose.heard[0] and flies(gravity, loose, state)


@jit
def fall_asleep(silence, gravity, loose, state, frame, ahead, energy):
    """After the step of this frame, with nothing in reach: sleep for so many samples if all has died.
    `energy` is that of vibration, J."""
    rest = state.rest
    rest[MOST] = max(rest[MOST], energy)
    rest[LOUDEST] = max(rest[LOUDEST], rest[LEVEL])
    dead = energy <= silence * silence * rest[MOST] and rest[LEVEL] <= silence * rest[LOUDEST]
    if dead and not heard_flying(gravity, loose, state):
        until = frame + 1 + ahead
        state.asleep[UNTIL], state.asleep[STILL] = until, ZERO if flies(gravity, loose, state) else until
    rest[LEVEL] = 0.0


@jit
def flies(gravity, loose, state):
    """Whether a free mass moves, or is about to; in an island that was put to sleep it waits."""
    if loose is None:
        return False
    if state.asleep[HUSHED] != 0:
        return False
    for j in range(loose.mode.shape[0]):
        m = loose.mode[j]
        if state.p[m] != 0.0:
            return True
        if weighs(gravity, m):
            return True
    return False


@jit
def weighs(gravity, m):
    """Whether mode m has weight."""
    if gravity is None:
        return False
    return gravity.weight[m] != 0.0


@outlined
def fly(modes, spring, loss, drag, gravity, loose, state, count):
    """Let free masses fly on for so many samples."""
    if loose is not None:
        for j in range(loose.mode.shape[0]):
            m = loose.mode[j]
            lost = 0.0
            for _ in range(count):
                half, one = open_mode(modes, spring, loss, gravity, state.carry, m, state.q[m], state.p[m])
                state.q[m], state.p[m], two = close_mode(
                    modes, spring, loss, drag, gravity, state.carry, m, state.q[m], half
                )
                lost += one + two
            book(state.account, DISSIPATED, lost)


@jit
def sleeps_through(asleep, n, frame, count, ledger, trace):
    """Whether island n of the scene, of which nothing is to be recorded, sleeps for so many samples and nothing
    in it flies: then it need not even be looked at."""
    if ledger is None:
        if trace is None:
            if asleep[n, STILL] >= frame + count:
                asleep[n, SLEPT] += count
                return True
    return False


@jit
def nap(state, frame, room):
    """How many of the samples that fit the island sleeps through."""
    count = min(room, state.asleep[UNTIL] - frame)
    if count <= 0:
        return 0
    state.asleep[SLEPT] += count
    return count
