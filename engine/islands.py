"""One island of a Model and State, as a Model and State of its own.

Islands never couple (DESIGN sec. 3), so each is run alone. The cut is made of views, once per
piece: the kernels then count all modes and contacts from 0, which spares them the handling of
negative indices (14 → 9 ns per sample for a single oscillator).
"""

from typing import Any

from numba.core import types
from numba.extending import overload

from engine.jit import jit
from engine.model import (
    Contact,
    ContactLoss,
    Coupling,
    DampedStages,
    Events,
    Force,
    Gravity,
    Loose,
    Loss,
    Model,
    Modes,
    Pickups,
    Refined,
    Refinement,
    Rows,
    Scratch,
    Spring,
    State,
)
from engine.vector import columns, matrix, view


@jit
def whole(array):
    """All of an array."""
    return view(array, 0, array.shape[0])


# items a:b of each kind of slot; an array that is shared by all items stays whole
_CUT: dict[type, Any] = {
    Rows: lambda x, a, b: Rows(
        view(x.first, a, b), view(x.last, a, b), view(x.at, a, b), whole(x.shape), whole(x.kick), whole(x.drift)
    ),
    Modes: lambda x, a, b: Modes(view(x.kick, a, b), view(x.drift, a, b)),
    Spring: lambda x, a, b: Spring(view(x.stiffness, a, b), view(x.pull, a, b)),
    Loose: lambda x, a, b: Loose(view(x.mode, x.begin[a], x.begin[b]), view(x.begin, a, b + 1), view(x.heard, a, b)),
    Loss: lambda x, a, b: Loss(view(x.keep, a, b), view(x.lost, a, b)),
    Gravity: lambda x, a, b: Gravity(view(x.weight, a, b)),
    Force: lambda x, a, b: Force(
        cut(x.rows, a, b),
        view(x.start, a, b),
        view(x.begin, a, b + 1),
        whole(x.table),
        view(x.after, a, b),
        view(x.scale, a, b),
    ),
    ContactLoss: lambda x, a, b: ContactLoss(view(x.rate, a, b)),
    Coupling: lambda x, a, b: Coupling(view(x.begin, a, b + 1), view(x.matrix, x.begin[a], x.begin[b])),
    Events: lambda x, a, b: Events(
        view(x.kind, a, b),
        view(x.start, a, b),
        view(x.end, a, b),
        view(x.first, a, b),
        view(x.last, a, b),
        view(x.a, a, b),
        view(x.b, a, b),
    ),
    Pickups: lambda x, a, b: Pickups(
        cut(x.rows, a, b),
        view(x.quantity, a, b),
        view(x.channel, a, b),
        view(x.gain, a, b),
        view(x.begin, a, b + 1),
        whole(x.contact),
        whole(x.sign),
    ),
}


def cut(x: Any, a: int, b: int) -> Any:
    """Items a:b of a slot. None stays None, and is known to be None by its type."""
    raise TypeError("cut is for compiled code")


@overload(cut)
def _cut(x, a, b):
    if isinstance(x, types.NoneType):
        return lambda x, a, b: None
    return _CUT[x.instance_class]


def cut_contact(contact: Any, state: Any, a: int, b: int) -> Any:
    """Contacts a:b, with the stiffness, the exponents and the barriers of the state."""
    raise TypeError("cut_contact is for compiled code")


@overload(cut_contact)
def _cut_contact(contact, state, a, b):
    if isinstance(contact, types.NoneType):
        return lambda contact, state, a, b: None
    kind = contact.types[contact.fields.index("law")].instance_class

    def live(contact, state, a, b):
        return Contact(
            kind(view(state.unit, a, b), view(state.exponent, a, b)),
            cut(contact.rows, a, b),
            view(state.barrier, a, b),
            view(contact.base, a, b),
            view(contact.place, a, b),
            view(contact.compliance, a, b),
            view(contact.beneath, a, b),
            contact.tolerance,
            contact.cap,
        )

    return live


@jit
def cut_damped(x, m0, m1):
    """The loss in stages of the modes m0:m1."""
    if x is None:
        return None
    return DampedStages(
        cut(x.ends, m0, m1),
        columns(x.keep, m0),
        columns(x.lost, m0),
        columns(x.drag_keep, m0),
        columns(x.drag_lost, m0),
    )


@jit
def cut_refinement(x, i, m0, m1, k0):
    """The refinement of island i, whose modes and contacts begin at m0 and k0."""
    if x is None:
        return None
    return Refinement(
        whole(x.sequence),
        whole(x.length),
        x.always,
        columns(x.kick, m0),
        columns(x.drift, m0),
        columns(x.pull, m0),
        columns(x.touch_kick, 0),
        columns(x.touch_drift, 0),
        columns(x.partner_kick, 0),
        columns(x.partner_drift, 0),
        columns(x.force_kick, 0),
        columns(x.force_drift, 0),
        columns(x.compliance, k0),
        columns(x.beneath, k0),
        columns(x.rate, k0),
        columns(x.matrix, x.begin[i]),
        view(x.begin, i, i + 1),
        view(x.curve, m0, m1),
        view(x.sag, m0, m1),
        cut_damped(x.damped, m0, m1),
    )


@jit
def cut_refined(x, i, m0, m1, k0, k1):
    """What moves with the refinement of island i."""
    if x is None:
        return None
    return Refined(
        view(x.before, m0, m1),
        view(x.carried, m0, m1),
        view(x.margin, k0, k1),
        view(x.known, i, i + 1),
        view(x.impulse, k0, k1),
    )


@jit
def cut_model(model, state, i):
    """Island i of a model, in which events may have changed the contacts."""
    of = model.islands
    m0, m1 = of.mode[i], of.mode[i + 1]
    k0, k1 = of.contact[i], of.contact[i + 1]
    return Model(
        model.samplerate,
        None,
        cut(model.modes, m0, m1),
        cut(model.spring, m0, m1),
        cut(model.loss, m0, m1),
        cut(model.drag, m0, m1),
        cut(model.gravity, m0, m1),
        cut(model.force, of.force[i], of.force[i + 1]),
        cut_contact(model.contact, state, k0, k1),
        cut(model.partner, k0, k1),
        cut(model.contact_loss, k0, k1),
        cut(model.coupling, i, i + 1),
        cut_refinement(model.refinement, i, m0, m1, k0),
        cut(model.events, of.event[i], of.event[i + 1]),
        cut(model.pickups, of.pickup[i], of.pickup[i + 1]),
        cut(model.bodies, of.body[i], of.body[i + 1]),
        cut(model.loose, i, i + 1),
        model.silence,
    )


def cut_scratch(scratch: Any, part: int) -> Any:
    """The scratch of a part of the scene."""
    raise TypeError("cut_scratch is for compiled code")


@overload(cut_scratch)
def _cut_scratch(scratch, part):
    if isinstance(scratch, types.NoneType):
        return lambda scratch, part: None
    return lambda scratch, part: Scratch(
        matrix(scratch.vectors, part),
        matrix(scratch.near, part),
        matrix(scratch.factor, part),
        whole(scratch.contacts[part]),
        whole(scratch.hot[part]),
        whole(scratch.member[part]),
    )


@jit
def cut_state(islands, state, part, i):
    """Island i of a state, which is in that part of the scene. The clock is the part's."""
    m0, m1 = islands.mode[i], islands.mode[i + 1]
    k0, k1 = islands.contact[i], islands.contact[i + 1]
    return State(
        view(state.frame, part, part + 1),
        view(state.q, m0, m1),
        view(state.p, m0, m1),
        view(state.carry, m0, m1),
        view(state.reach, m0, m1),
        view(state.unit, k0, k1),
        view(state.exponent, k0, k1),
        view(state.barrier, k0, k1),
        view(state.compression, k0, k1),
        view(state.residue, k0, k1),
        view(state.free_move, k0, k1),
        view(state.contact_force, k0, k1),
        cut_scratch(state.scratch, part),
        cut_refined(state.refined, i, m0, m1, k0, k1),
        view(state.budget, i, i + 1),
        view(state.debt, i, i + 1),
        view(state.heard, islands.pickup[i], islands.pickup[i + 1]),
        whole(state.account[i]),
        view(state.clear, i, i + 1),
        whole(state.next_event[i]),
        view(state.event_from, islands.event[i], islands.event[i + 1]),
        whole(state.rest[i]),
        whole(state.asleep[i]),
        view(state.touching, i, i + 1),
        view(state.evaluations, i, i + 1),
        whole(state.iterations[i]),
        whole(state.regimes[i]),
        view(state.contacts, i, i + 1),
    )
