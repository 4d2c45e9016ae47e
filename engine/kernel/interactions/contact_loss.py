"""Contact loss apart from the contact solve, in samples of order 4 and 6 (docs/design.md, "Contact loss apart").

With the compression held, Hunt-Crossley loss is a damper c = μ·f(s) between the bodies: a relative velocity u falls as
e^(-c·W·t), W = Φ·Φᵀ, whatever t. It acts between the stages of a sample, for a sixth to a third of it each time. The
stages, some of which go back in time, have no loss. Where the loss is not small, it stays in the solve, at order 2.
"""

import math

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.compiler.elementary import expm1_of
from engine.kernel.contact.power_law import elastic_force, elastic_law
from engine.kernel.data.effects import CONTACT_LOSS, EFFECTS, TWO_BODIES
from engine.kernel.modes.mode_step import forget_drift
from engine.kernel.modes.point_rows import project, push_at_row

MAX_LOSS_LEAVING = 0.5  # μ·|u|, share of the elastic force that loss takes while bodies part: beyond, it might pull
MIN_SHARE_LEFT = 0.5  # of a compression: where less is left at the end of a sample, loss might pull


@inline
def relative_velocity(contact, k, p):
    """Velocity at which contact k closes, m/s."""
    velocity = project(contact.rows, k, p)
    if EFFECTS & TWO_BODIES:
        velocity += project(contact.other_rows, k, p)
    return velocity


@inline
def push_apart(contact, k, impulse, p):
    """Push the bodies of contact k apart by an impulse, N·s."""
    push_at_row(contact.rows, contact.rows.phi, k, -impulse, p)
    if EFFECTS & TWO_BODIES:
        push_at_row(contact.other_rows, contact.other_rows.phi, k, -impulse, p)


@inline
def choose_loss_between_stages(contact_loss, contact, share, samplerate, state):
    """Choose whether contact loss acts between the stages of the coming sample. Returns True if it does: it is small.

    share: length of a step over that which the loss was judged for
    """
    if EFFECTS & CONTACT_LOSS:
        return judge_loss_at_contacts(contact_loss, contact, share, samplerate, state)
    return TRUE


@noinline
def judge_loss_at_contacts(contact_loss, contact, share, samplerate, state):
    """Find whether the loss of all contacts in the coming sample is small enough to act between its stages. Samples in
    which it is too strong are counted."""
    total, is_pushing, law = 0.0, TRUE, elastic_law(state)
    for k in range(state.compression.shape[0]):
        if contact_loss.loss[k] > 0.0:
            s = state.compression[k]
            velocity = relative_velocity(contact, k, state.p)
            end = s + velocity / samplerate
            total += contact_loss.saturation[k] * elastic_force(law, k, max(s, end))
            if s > 0.0:
                gained = speed_gained(contact_loss.mobility[k], elastic_force(law, k, s), s, samplerate)
                if end < MIN_SHARE_LEFT * s or (gained - velocity) * contact_loss.loss[k] > MAX_LOSS_LEAVING:
                    is_pushing = False
    if not total * share <= 1.0:  # NaN is left to the solve
        state.refinement.samples_of_strong_loss[0] += 1
        return FALSE
    return is_pushing


@inline
def speed_gained(mobility, force, s, samplerate):
    """Return how fast the elastic force of a contact may drive two bodies apart within a sample, m/s: no faster than it
    pushes now, and than its energy, which is less than f·s, allows.

    mobility: W, 1/kg; force: N; s: compression, m
    """
    return min(mobility * force / samplerate, math.sqrt(2.0 * mobility * force * s))


@inline
def lose_at_contacts(contact_loss, contact, duration, is_backwards, rate, state):
    """Let the loss of all contacts act for a duration, s, one after the other; if backwards, in the reverse order.
    Returns the energy lost, J.

    rate: sample rate, 1/s; 0 before the first stage, when no contact has pushed as yet
    """
    if EFFECTS & CONTACT_LOSS:
        if duration != 0.0:
            return lose_at_each(contact_loss, contact, duration, is_backwards, rate, state)
    return 0.0


@noinline
def lose_at_each(contact_loss, contact, duration, is_backwards, rate, state):
    """Let the loss of each closed contact act for a duration, s, one after the other. Returns the energy lost, J."""
    lost, count = 0.0, state.compression.shape[0]
    for n in range(INT64_0, count):
        k = count - 1 - n if is_backwards else n
        if contact_loss.loss[k] > 0.0 and state.compression[k] > 0.0:
            lost += lose_at_contact(contact_loss, contact, duration, k, rate, state)
    return lost


@inline
def lose_at_contact(contact_loss, contact, duration, k, rate, state):
    """Let the loss of contact k act for a duration, s. Returns the energy lost, J."""
    f, mobility = elastic_force(elastic_law(state), k, state.compression[k]), contact_loss.mobility[k]
    velocity = relative_velocity(contact, k, state.p)
    impulse = -velocity * expm1_of(-contact_loss.loss[k] * f * mobility * duration) / mobility
    impulse = max(impulse, -f * duration)  # it never takes more than the elastic force gives
    if impulse < 0.0 and rate > 0.0:  # nor more than what the contact has pushed in this sample
        pushed = state.refinement.mean_force[k] / rate + state.refinement.loss_impulse[k]
        impulse = max(impulse, -max(pushed, 0.0))
    push_apart(contact, k, impulse, state.p)
    forget_drift(state)
    state.refinement.loss_impulse[k] += impulse
    return impulse * (velocity - 0.5 * mobility * impulse)
