"""One island of a Model and State, as a Model and State of its own.

Islands never couple (DESIGN sec. 3), so each is run alone. The cut is made of views, once per
piece: the kernels then count all modes and contacts from 0, which spares them the handling of
negative indices (14 → 9 ns per sample for a single oscillator).
"""

from typing import Any

from numba.core import types
from numba.extending import overload

from engine.jit import jit
from engine.laws import Cubic, Felt, Hertz, Linear, Power, Quadratic
from engine.model import (
    Contact,
    ContactLoss,
    Coupling,
    Events,
    Force,
    Gravity,
    Islands,
    Loose,
    Loss,
    Model,
    Modes,
    Pickups,
    Rows,
    Scratch,
    Spring,
    State,
)

# items a:b of each kind of slot; an array that is shared by all items stays whole
_CUT: dict[type, Any] = {
    Linear: lambda x, a, b: Linear(x.unit[a:b], x.exponent[a:b]),
    Hertz: lambda x, a, b: Hertz(x.unit[a:b], x.exponent[a:b]),
    Quadratic: lambda x, a, b: Quadratic(x.unit[a:b], x.exponent[a:b]),
    Felt: lambda x, a, b: Felt(x.unit[a:b], x.exponent[a:b]),
    Cubic: lambda x, a, b: Cubic(x.unit[a:b], x.exponent[a:b]),
    Power: lambda x, a, b: Power(x.unit[a:b], x.exponent[a:b]),
    Rows: lambda x, a, b: Rows(x.first[a:b], x.last[a:b], x.at[a:b], x.shape, x.kick, x.drift),
    Modes: lambda x, a, b: Modes(x.kick[a:b], x.drift[a:b]),
    Spring: lambda x, a, b: Spring(x.stiffness[a:b], x.pull[a:b]),
    Loose: lambda x, a, b: Loose(x.mode[x.begin[a] : x.begin[b]], x.begin[a : b + 1], x.heard[a:b]),
    Loss: lambda x, a, b: Loss(x.keep[a:b], x.lost[a:b]),
    Gravity: lambda x, a, b: Gravity(x.weight[a:b]),
    Force: lambda x, a, b: Force(cut(x.rows, a, b), x.start[a:b], x.begin[a : b + 1], x.table, x.after[a:b]),
    ContactLoss: lambda x, a, b: ContactLoss(x.rate[a:b]),
    Coupling: lambda x, a, b: Coupling(x.begin[a : b + 1], x.matrix[x.begin[a] : x.begin[b]]),
    Events: lambda x, a, b: Events(
        x.kind[a:b], x.start[a:b], x.end[a:b], x.first[a:b], x.last[a:b], x.a[a:b], x.b[a:b]
    ),
    Pickups: lambda x, a, b: Pickups(
        cut(x.rows, a, b), x.quantity[a:b], x.channel[a:b], x.gain[a:b], x.begin[a : b + 1], x.contact, x.sign
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
    """Contacts a:b, with the stiffness and the barriers of the state."""
    raise TypeError("cut_contact is for compiled code")


@overload(cut_contact)
def _cut_contact(contact, state, a, b):
    if isinstance(contact, types.NoneType):
        return lambda contact, state, a, b: None
    kind = contact.types[contact.fields.index("law")].instance_class

    def live(contact, state, a, b):
        return Contact(
            kind(state.unit[a:b], contact.law.exponent[a:b]),
            cut(contact.rows, a, b),
            state.barrier[a:b],
            contact.base[a:b],
            contact.place[a:b],
            contact.compliance[a:b],
            contact.beneath[a:b],
            contact.tolerance,
            contact.cap,
        )

    return live


@jit
def cut_model(model, state, i):
    """Island i of a model, in which events may have changed the contacts."""
    of = model.islands
    m0, m1 = of.mode[i], of.mode[i + 1]
    k0, k1 = of.contact[i], of.contact[i + 1]
    return Model(
        model.samplerate,
        Islands(
            of.body[i : i + 2],
            of.mode[i : i + 2],
            of.contact[i : i + 2],
            of.force[i : i + 2],
            of.event[i : i + 2],
            of.pickup[i : i + 2],
            of.part,
        ),
        cut(model.modes, m0, m1),
        cut(model.spring, m0, m1),
        cut(model.loss, m0, m1),
        cut(model.gravity, m0, m1),
        cut(model.force, of.force[i], of.force[i + 1]),
        cut_contact(model.contact, state, k0, k1),
        cut(model.partner, k0, k1),
        cut(model.contact_loss, k0, k1),
        cut(model.coupling, i, i + 1),
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
    return lambda scratch, part: Scratch(scratch.vectors[part], scratch.matrix[part], scratch.order[part])


@jit
def cut_state(islands, state, part, i):
    """Island i of a state, which is in that part of the scene. The clock is the part's."""
    m0, m1 = islands.mode[i], islands.mode[i + 1]
    k0, k1 = islands.contact[i], islands.contact[i + 1]
    return State(
        state.frame[part : part + 1],
        state.q[m0:m1],
        state.p[m0:m1],
        state.carry[m0:m1],
        state.reach[m0:m1],
        state.unit[k0:k1],
        state.barrier[k0:k1],
        state.compression[k0:k1],
        state.residue[k0:k1],
        state.free_move[k0:k1],
        state.contact_force[k0:k1],
        cut_scratch(state.scratch, part),
        state.budget[i : i + 1],
        state.debt[i : i + 1],
        state.heard[islands.pickup[i] : islands.pickup[i + 1]],
        state.account[i : i + 1],
        state.clear[i : i + 1],
        state.next_event[i],
        state.event_from[islands.event[i] : islands.event[i + 1]],
        state.rest[i],
        state.asleep[i],
        state.touching[i : i + 1],
        state.evaluations[i : i + 1],
        state.iterations[i],
        state.regimes[i],
        state.contacts[i : i + 1],
    )
