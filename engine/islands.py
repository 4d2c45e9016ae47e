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
    Force,
    Gravity,
    Islands,
    Loss,
    Model,
    Modes,
    Pickups,
    Rows,
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
    Spring: lambda x, a, b: Spring(x.stiffness[a:b]),
    Loss: lambda x, a, b: Loss(x.keep[a:b], x.lost[a:b]),
    Gravity: lambda x, a, b: Gravity(x.weight[a:b]),
    Force: lambda x, a, b: Force(cut(x.rows, a, b), x.start[a:b], x.begin[a : b + 1], x.table, x.after[a:b]),
    Contact: lambda x, a, b: Contact(
        cut(x.law, a, b), cut(x.rows, a, b), x.barrier[a:b], x.compliance[a:b], x.beneath[a:b], x.tolerance, x.cap
    ),
    ContactLoss: lambda x, a, b: ContactLoss(x.rate[a:b]),
    Coupling: lambda x, a, b: Coupling(x.begin[a : b + 1], x.matrix[x.begin[a] : x.begin[b]]),
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


@jit
def cut_model(model, i):
    """Island i of a model."""
    of = model.islands
    m0, m1 = of.mode[i], of.mode[i + 1]
    k0, k1 = of.contact[i], of.contact[i + 1]
    return Model(
        model.samplerate,
        Islands(
            of.body[i : i + 2], of.mode[i : i + 2], of.contact[i : i + 2], of.force[i : i + 2], of.pickup[i : i + 2]
        ),
        cut(model.modes, m0, m1),
        cut(model.spring, m0, m1),
        cut(model.loss, m0, m1),
        cut(model.gravity, m0, m1),
        cut(model.force, of.force[i], of.force[i + 1]),
        cut(model.contact, k0, k1),
        cut(model.partner, k0, k1),
        cut(model.contact_loss, k0, k1),
        cut(model.coupling, i, i + 1),
        cut(model.pickups, of.pickup[i], of.pickup[i + 1]),
        cut(model.bodies, of.body[i], of.body[i + 1]),
    )


@jit
def cut_state(islands, state, i):
    """Island i of a state. The clock and the telemetry stay shared."""
    m0, m1 = islands.mode[i], islands.mode[i + 1]
    k0, k1 = islands.contact[i], islands.contact[i + 1]
    return State(
        state.frame,
        state.q[m0:m1],
        state.p[m0:m1],
        state.carry[m0:m1],
        state.compression[k0:k1],
        state.residue[k0:k1],
        state.free_move[k0:k1],
        state.contact_force[k0:k1],
        state.scratch,
        state.budget[i : i + 1],
        state.heard[islands.pickup[i] : islands.pickup[i + 1]],
        state.account[i : i + 1],
        state.touching[i : i + 1],
        state.evaluations[i : i + 1],
        state.iterations,
        state.regimes,
        state.contacts[i : i + 1],
    )
