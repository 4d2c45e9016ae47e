"""What a kernel is given: an immutable `Model`, a mutable `State`.

An effect is a slot of the Model: a NamedTuple of its data, or `None`. Numba prunes
`if slot is not None` by type, so an absent effect is not compiled at all; this
works where the slot is a direct argument of the function that tests it.

Bodies are sets of modes; modes, contacts, forces and pickups of one island are
contiguous in all arrays, and indices of modes and contacts count from their island's
first. Coordinates are mass-normalised: displacement in √kg·m, momentum in √kg·m/s,
shapes in 1/√kg.
"""

from typing import Any, NamedTuple

import numpy as np

from engine.laws import Law

LINE = 64  # bytes of a cache line
DISPLACEMENT, VELOCITY, ACCELERATION, FORCE = 0, 1, 2, 3  # what a pickup hears


class Rows(NamedTuple):
    """Mode shapes at points: row r weighs modes first[r]:last[r] of its island with shape[at[r]:].

    Indices are unsigned, or every use would first be checked for a negative one.
    """

    first: np.ndarray  # uint32 [rows]
    last: np.ndarray  # uint32 [rows]
    at: np.ndarray  # uint32 [rows]
    shape: np.ndarray  # Φ, 1/√kg, all rows one after the other
    kick: np.ndarray  # t·Φ: momentum per newton in half a kick
    drift: np.ndarray  # v·Φ: displacement at the point per momentum in a drift


class Modes(NamedTuple):
    """The conservative core of each mode, as kick, drift, kick (engine.modes)."""

    kick: np.ndarray  # t [modes], s
    drift: np.ndarray  # v [modes], s


class Spring(NamedTuple):
    """Restoring force."""

    stiffness: np.ndarray  # ω² [modes], 1/s²
    pull: np.ndarray  # t·ω² [modes], 1/s: momentum per displacement in half a kick


class Loose(NamedTuple):
    """Free masses."""

    mode: np.ndarray  # int: the modes without a restoring force, by island
    begin: np.ndarray  # int [islands + 1], where those of an island begin
    heard: np.ndarray  # bool [islands]: does a pickup hear one of them?


class Loss(NamedTuple):
    """Modal loss by half-steps (paper, eq. 36)."""

    keep: np.ndarray  # d = exp(-σh) [modes]
    lost: np.ndarray  # (1 - d²)/2 [modes]


class DampedStages(NamedTuple):
    """Loss of a refined sample with heavily damped modes, which lose in each stage; the others at its ends."""

    ends: Loss
    keep: np.ndarray  # [kinds, modes], in each half-step of loss of a stage
    lost: np.ndarray
    drag_keep: np.ndarray  # [kinds, modes], in its drift
    drag_lost: np.ndarray


class Gravity(NamedTuple):
    """Weight of each mode."""

    weight: np.ndarray  # [modes], √kg·m/s²


class Force(NamedTuple):
    """External forces; each a table of its mean over each step (paper, eq. 34)."""

    rows: Rows  # where each acts
    start: np.ndarray  # int [forces], first step of its table
    begin: np.ndarray  # int [forces + 1], its slice of `table`
    table: np.ndarray  # N
    after: np.ndarray  # [forces], N, for steps past its table
    scale: np.ndarray  # [forces], factor; events change it


class Contact(NamedTuple):
    """Contacts: the law of each, and where it is on its body."""

    law: Law  # in a kernel, with the stiffness and the exponents of the State
    rows: Rows  # of the body that touches
    barrier: np.ndarray  # [contacts], m, subtracted from the projected displacement; in a kernel, the State's
    base: np.ndarray  # [contacts], N/m^α, stiffness as the patch says
    place: np.ndarray  # [contacts], m, barrier as the patch says
    compliance: np.ndarray  # B_kk [contacts], m/N
    beneath: np.ndarray  # [contacts], m/N: what rounding cut from B_kk
    tolerance: float  # relative error left in the end compression
    cap: int  # rounds of a coupled solve before it makes do


class ContactLoss(NamedTuple):
    """Hunt-Crossley loss (paper, eq. 41)."""

    rate: np.ndarray  # μ/h [contacts], 1/m


class Coupling(NamedTuple):
    """Compliance between the contacts of one island, for islands with more than one."""

    begin: np.ndarray  # int [islands + 1], where the island's matrix begins
    matrix: np.ndarray  # all matrices flat, m/N


class Refinement(NamedTuple):
    """A sample in stages (engine.refine). Stages of one length are of one kind, and each kind has tables of its
    own, as the slots of those names have for a whole step."""

    sequence: np.ndarray  # int [stages], the kind of each
    length: np.ndarray  # [kinds], share of a sample
    always: bool  # also out of contact
    kick: np.ndarray  # [kinds, modes]
    drift: np.ndarray
    pull: np.ndarray
    touch_kick: np.ndarray  # [kinds, shapes of Contact.rows]
    touch_drift: np.ndarray
    partner_kick: np.ndarray
    partner_drift: np.ndarray
    force_kick: np.ndarray
    force_drift: np.ndarray
    compliance: np.ndarray  # [kinds, contacts]
    beneath: np.ndarray
    rate: np.ndarray
    matrix: np.ndarray  # [kinds, all matrices flat]
    begin: np.ndarray  # int [islands], where the island's matrix begins
    curve: np.ndarray  # [modes]: how far a mode strays from its chord within a sample, per amplitude
    sag: np.ndarray  # [modes], √kg·m: and how far by its weight
    damped: DampedStages | None


class Events(NamedTuple):
    """The score, sorted by island and start (engine.events)."""

    kind: np.ndarray  # int [events]
    start: np.ndarray  # int [events], the step it begins with
    end: np.ndarray  # int [events], the step after its last
    first: np.ndarray  # int [events], the modes or contacts it acts on
    last: np.ndarray  # int [events]
    a: np.ndarray  # [events]
    b: np.ndarray  # [events]


class Pickups(NamedTuple):
    """What is heard."""

    rows: Rows
    quantity: np.ndarray  # int [pickups]
    channel: np.ndarray  # int [pickups]
    gain: np.ndarray  # [pickups]
    begin: np.ndarray  # int [pickups + 1], its slice of `contact` and `sign`; quantity FORCE only
    contact: np.ndarray  # int
    sign: np.ndarray


class Islands(NamedTuple):
    """Slices of bodies, modes, contacts, forces, events and pickups per island: [islands + 1] each.

    `part` cuts the islands in parts, each of which may run on a core of its own: [parts + 1].
    """

    body: np.ndarray
    mode: np.ndarray
    contact: np.ndarray
    force: np.ndarray
    event: np.ndarray
    pickup: np.ndarray
    part: np.ndarray


class Model(NamedTuple):
    """Everything that stays."""

    samplerate: float
    islands: Islands  # of the whole scene; the model of one island, in a kernel, has None
    modes: Modes
    spring: Spring | None
    loss: Loss | None
    drag: Loss | None  # in the drift, of heavily damped modes (engine.modes.damped_table)
    gravity: Gravity | None
    force: Force | None
    contact: Contact | None
    partner: Rows | None  # of the body that contact k touches, empty for a barrier; None without any
    contact_loss: ContactLoss | None
    coupling: Coupling | None
    refinement: Refinement | None
    events: Events | None
    pickups: Pickups
    bodies: Rows  # where each body is traced
    loose: Loose | None  # what flies on while the rest sleeps
    silence: float  # share of its peak below which an island sleeps; engine.rest


class Scratch(NamedTuple):
    """Room for the coupled contact solve, for each part of the scene; in a kernel, that of its part.
    K is the largest number of contacts in an island."""

    vectors: np.ndarray  # [parts, rows, K]
    near: np.ndarray  # [parts, K, K]: B of the set
    factor: np.ndarray  # [parts, K, K]: what is factorised
    contacts: np.ndarray  # int [parts, K]: those of the set
    hot: np.ndarray  # int [parts, K]: which of the set have a slope
    member: np.ndarray  # int [parts, K]: whether a contact is in the set


class Refined(NamedTuple):
    """What moves with refinement."""

    before: np.ndarray  # [modes]: momenta before a first half-step that may be taken back
    carried: np.ndarray  # [modes]: and what was carried
    margin: np.ndarray  # [contacts], m: how far a compression may stray within a sample
    known: np.ndarray  # int [islands]: whether the margin still holds
    impulse: np.ndarray  # [contacts], N: mean force over the stages so far


class State(NamedTuple):
    """Everything that moves. A field is None where no effect needs it."""

    frame: np.ndarray  # int [parts], samples rendered so far
    q: np.ndarray  # [modes], √kg·m, displacement
    p: np.ndarray  # [modes], √kg·m/s, momentum
    carry: np.ndarray  # [modes]: rounding carried from kick to kick; for gravity
    reach: np.ndarray  # [modes], √kg·m: room to bound how far each can move
    unit: np.ndarray  # [contacts]: stiffness, as the law counts it; events change it
    exponent: np.ndarray  # [contacts]; events change that of a general law
    barrier: np.ndarray  # [contacts], m; events move it
    compression: np.ndarray  # [contacts], m
    residue: np.ndarray  # [contacts], m: what is too small to add to the compression yet
    free_move: np.ndarray  # [contacts], m: g, the change of compression without contact force
    contact_force: np.ndarray  # [contacts], N, mean over the last step
    scratch: Scratch | None  # for coupled contacts
    refined: Refined | None
    budget: np.ndarray  # int [islands]: line searches left to capped solves
    debt: np.ndarray  # [islands], J: what capped solves created and the motion could not pay for yet
    heard: np.ndarray  # [pickups], velocity one sample ago
    account: np.ndarray  # [islands, 4], J: energy dissipated and work supplied (engine.energy)
    clear: np.ndarray  # int [islands]: before this frame, nothing can act on the island
    next_event: np.ndarray  # int [islands, 2]: the first event not over yet, and the next to begin
    event_from: np.ndarray  # [events]: what a gliding value was at first
    rest: np.ndarray  # [islands, 3]: what an island has been like, to tell when it may sleep (engine.rest)
    asleep: np.ndarray  # int [islands, 4]: when it wakes, and flies on; samples slept; whether it was put to sleep
    touching: np.ndarray  # int [islands]: 1 if the last step had a contact in reach
    evaluations: np.ndarray  # int [islands]: of the contact laws, in the last step
    iterations: np.ndarray  # int [islands, evaluations]: histogram of evaluations per Newton solve
    regimes: np.ndarray  # int [islands, 6]: solves by separation, closed form, Newton, failed, capped; 0 unused
    contacts: np.ndarray  # int [islands]: samples with a contact in reach


def aligned(slots: Any) -> Any:
    """The same Model, State or slot, each array where a cache line begins: vector loads that cross none are
    faster (24 free modes: 19 → 14 ns), and times are the same in every run."""
    if isinstance(slots, tuple) and hasattr(slots, "_fields"):
        return type(slots)(*map(aligned, slots))
    if not isinstance(slots, np.ndarray):
        return slots
    room = np.empty(slots.nbytes + LINE, np.uint8)
    begin = -room.ctypes.data % LINE
    moved = room[begin : begin + slots.nbytes].view(slots.dtype).reshape(slots.shape)
    moved[...] = slots
    return moved


# what of a Model and State is counted per mode, and may be of single precision
PER_MODE = (Modes, Spring, Loss, Gravity, Rows, Refinement)
PER_CONTACT = ("length", "compliance", "beneath", "rate", "matrix")  # of a Refinement
MODAL_STATE = ("q", "p", "carry", "reach", "before", "carried")


def single(slots: Any, inside: bool = False) -> Any:
    """The same Model or State with modes of single precision; contacts and energies stay double."""
    if isinstance(slots, tuple) and hasattr(slots, "_fields"):
        inside = inside or isinstance(slots, PER_MODE)
        items = zip(slots._fields, slots, strict=True)
        return type(slots)(
            *(single(x, (inside and name not in PER_CONTACT) or name in MODAL_STATE) for name, x in items)
        )
    if inside and isinstance(slots, np.ndarray) and slots.dtype == np.float64:
        return slots.astype(np.float32)
    return slots


class Trace(NamedTuple):
    """What every sample was like; arrays of [frames, …] that a block fills.

    `force` is the mean over the step that ends at the sample, so it is 0 at sample 0; `iterations`
    are those of that step.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    compression: np.ndarray
    force: np.ndarray
    iterations: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    contact: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray


class Room(NamedTuple):
    """Where a block of one part goes; each of [frames, …]."""

    out: np.ndarray  # [frames, channels], overwritten
    ledger: np.ndarray | None  # [frames, engine.energy.COLUMNS], overwritten; or None: energy is not measured
    trace: Trace | None  # zeroed, to be added to; or None
