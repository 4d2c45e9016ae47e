"""One island of a Model and State, as a Model and State of its own.

Islands never couple (DESIGN sec. 3), so each is run alone. The cut is made of views, once per
block: the kernels then count all modes and contacts from 0, which spares them the handling of
negative indices (14 → 9 ns per sample for a single oscillator).
"""

from numba.extending import overload

from engine.jit import jit
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


@jit
def cut_array(a, start, stop):
    """a[start:stop], or None."""
    if a is None:
        return None
    return a[start:stop]


@jit
def cut_rows(rows, start, stop):
    """Some of the rows; their modes are already counted from the island's first."""
    return Rows(rows.first[start:stop], rows.last[start:stop], rows.at[start:stop], rows.shape, rows.kick, rows.drift)


@jit
def cut_partner(partner, start, stop):
    """The rows of contacts start:stop on the bodies they touch, or None."""
    if partner is None:
        return None
    return cut_rows(partner, start, stop)


@jit
def cut_spring(spring, m0, m1):
    """The restoring forces of modes m0:m1, or None."""
    if spring is None:
        return None
    return Spring(spring.stiffness[m0:m1])


@jit
def cut_loss(loss, m0, m1):
    """The losses of modes m0:m1, or None."""
    if loss is None:
        return None
    return Loss(loss.keep[m0:m1], loss.lost[m0:m1])


@jit
def cut_gravity(gravity, m0, m1):
    """The weights of modes m0:m1, or None."""
    if gravity is None:
        return None
    return Gravity(gravity.weight[m0:m1])


@jit
def cut_force(force, j0, j1):
    """The external forces j0:j1, or None."""
    if force is None:
        return None
    return Force(
        cut_rows(force.rows, j0, j1), force.start[j0:j1], force.begin[j0 : j1 + 1], force.table, force.after[j0:j1]
    )


def cut_law(law, k0, k1):
    """The laws of contacts k0:k1."""
    return type(law)(law.unit[k0:k1], law.exponent[k0:k1])


@overload(cut_law)
def _cut_law(law, k0, k1):
    kind = law.instance_class

    def cut(law, k0, k1):
        return kind(law.unit[k0:k1], law.exponent[k0:k1])

    return cut


@jit
def cut_contact(contact, k0, k1):
    """The contacts k0:k1, or None."""
    if contact is None:
        return None
    return Contact(
        cut_law(contact.law, k0, k1),
        cut_rows(contact.rows, k0, k1),
        contact.barrier[k0:k1],
        contact.compliance[k0:k1],
        contact.beneath[k0:k1],
        contact.tolerance,
    )


@jit
def cut_contact_loss(damping, k0, k1):
    """The losses of contacts k0:k1, or None."""
    if damping is None:
        return None
    return ContactLoss(damping.rate[k0:k1])


@jit
def cut_coupling(coupling, island):
    """The compliances of one island, or None."""
    if coupling is None:
        return None
    b0, b1 = coupling.begin[island], coupling.begin[island + 1]
    return Coupling(coupling.begin[island : island + 1], coupling.matrix[b0:b1])


@jit
def cut_pickups(pickups, p0, p1):
    """The pickups p0:p1."""
    return Pickups(
        cut_rows(pickups.rows, p0, p1),
        pickups.quantity[p0:p1],
        pickups.channel[p0:p1],
        pickups.gain[p0:p1],
        pickups.begin[p0 : p1 + 1],
        pickups.contact,
        pickups.sign,
    )


@jit
def cut_model(model, i):
    """Island i of a model."""
    of = model.islands
    b0, b1 = of.body[i], of.body[i + 1]
    m0, m1 = of.mode[i], of.mode[i + 1]
    k0, k1 = of.contact[i], of.contact[i + 1]
    return Model(
        model.samplerate,
        Islands(
            of.body[i : i + 2], of.mode[i : i + 2], of.contact[i : i + 2], of.force[i : i + 2], of.pickup[i : i + 2]
        ),
        Modes(model.modes.kick[m0:m1], model.modes.drift[m0:m1]),
        cut_spring(model.spring, m0, m1),
        cut_loss(model.loss, m0, m1),
        cut_gravity(model.gravity, m0, m1),
        cut_force(model.force, of.force[i], of.force[i + 1]),
        cut_contact(model.contact, k0, k1),
        cut_partner(model.partner, k0, k1),
        cut_contact_loss(model.contact_loss, k0, k1),
        cut_coupling(model.coupling, i),
        cut_pickups(model.pickups, of.pickup[i], of.pickup[i + 1]),
        cut_rows(model.bodies, b0, b1),
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
        cut_array(state.carry, m0, m1),
        state.compression[k0:k1],
        state.residue[k0:k1],
        state.free_move[k0:k1],
        state.contact_force[k0:k1],
        state.scratch,
        state.heard[islands.pickup[i] : islands.pickup[i + 1]],
        state.account[i : i + 1],
        state.touching[i : i + 1],
        state.evaluations[i : i + 1],
        state.iterations,
        state.regimes,
        state.contacts[i : i + 1],
    )
