"""Refinement: a sample in several stages, where contact is possible (docs/design.md, sec. 2).

A stage is a step of another length (engine.patch.accuracy). In orders 4 and 6 some stages go backwards: modes lose only
at the ends of others (engine.assembly.stage_coefficients), and contacts and dampers between stages. Each stage
conserves energy, and so does their product, whose order is that of the lengths. Out of contact the `exact` coefficients
need no stages: they are those of the exact motion, and one step of it equals the product of the stages.
"""

import math
from typing import Any

from engine.compiler.decorators import FALSE, INT64_0, TRUE, inline, noinline
from engine.compiler.overloads import overload_by_source
from engine.kernel.contact.law import follows_modes, free_end, may_act
from engine.kernel.data.axes import Axis, fields_of
from engine.kernel.data.effects import EFFECTS, FORCES
from engine.kernel.data.enums import StepKind
from engine.kernel.data.model import StepSettings
from engine.kernel.interactions.connections import damp_connections
from engine.kernel.interactions.contact_loss import choose_loss_between_stages, lose_at_contacts
from engine.kernel.interactions.contacts import (
    bound_at_contact,
    find_free_displacements,
    has_contacts,
)
from engine.kernel.interactions.external_forces import events_push, next_external_force
from engine.kernel.modes.event_dampers import damp_stage
from engine.kernel.modes.mode_step import find_drift_momenta
from engine.kernel.run.adaptive_steps import (
    accept_or_restore,
    begin_tries,
    first_kind_of_sample,
    may_try_again,
    steps_of_sample,
)
from engine.kernel.run.glides import glide_to, glides_now
from engine.kernel.run.step import SAMPLE, StepOutcome, are_modes_independent, step

# --- the coefficients of one stage


LENGTHS = {
    Axis.MODE: "modes",
    Axis.CONTACT: "contacts",
    Axis.COMPLIANCE: "contacts * contacts",
    Axis.CONNECTION: "connections",
    Axis.CONNECTION_PAIR: "connections * connections",
    Axis.CONNECTION_CONTACT: "connections * contacts",
}


def coefficients_of_stage(stages: Any, s: int, modes: int, contacts: int, connections: int) -> Any:
    """Return the StepCoefficients of stages of kind s, for an island of so many modes, contacts and coordinates of
    connections. In compiled code only."""
    raise TypeError("coefficients_of_stage is for compiled code")


def write_stage(kind: Any, value: str, names: dict[str, Any]) -> str:
    """Return the source of a record like `value`, without the row for each kind of stage in front."""
    names[kind.instance_class.__name__] = kind.instance_class
    parts = []
    for field, inner in zip(fields_of(kind.instance_class), kind.types, strict=True):
        part = f"{value}.{field.name}"
        if field.record is not None:
            part = write_stage(inner, part, names)
        else:
            length = LENGTHS.get(field.items.axis) if field.items is not None else None
            part = f"{part}[s]" if length is None else f"{part}[s][0 : {length}]"
        parts.append(part)
    return f"{kind.instance_class.__name__}({', '.join(parts)})"


def _write_stage_coefficients(
    stages: Any, s: Any, modes: Any, contacts: Any, connections: Any
) -> tuple[str, dict[str, Any]]:
    names: dict[str, Any] = {}
    return write_stage(stages, "stages", names), names


overload_by_source(coefficients_of_stage, _write_stage_coefficients)


# --- is contact possible within this sample?


@inline
def chord_deviation(omega_squared, refinement, m, q, p):
    """Return how far mode m strays from its chord within a sample, √kg·m."""
    per_amplitude, least = refinement.chord_deviation[m], refinement.gravity_deviation[m]
    stiffness = omega_squared[m]
    if stiffness == 0.0:
        return per_amplitude * abs(p[m]) + least
    return per_amplitude * math.sqrt(q[m] * q[m] + p[m] * p[m] / stiffness) + least


@noinline
def update_margins(model, refinement, state):
    """Find how far each compression may stray from its chord within a sample. This holds until something acts again."""
    bound = state.displacement_bound
    for m in range(state.p.shape[0]):
        bound[m] = chord_deviation(model.omega_squared, refinement, m, state.q, state.p)
    for k in range(state.compression.shape[0]):
        state.refinement.closing_margin[k] = bound_at_contact(model.contact, k, bound)
    state.refinement.margin_valid[0] = 1


@inline
def stays_open(state):
    """True if no contact can close within the sample whose free displacements are known."""
    for k in range(state.compression.shape[0]):
        s = state.compression[k]
        if not follows_modes(state, k):
            if may_act(state, k, s, 0.0):
                return False
        elif not max(s, s + state.free_displacement[k]) + state.refinement.closing_margin[k] < 0.0:  # NaN is refined
            return False
    return True


@inline
def step_open_contacts(model, refinement, state):
    """Move the compressions of an island, on which nothing acts, to the end of a sample. Returns False if a contact may
    close within it; then nothing has moved."""
    if state.refinement.margin_valid[0] == 0:
        update_margins(model, refinement, state)
    find_drift_momenta(model.step, StepKind.SAMPLE, state)
    find_free_displacements(model.contact, model.step.contact, state)
    if not stays_open(state):
        return False
    for k in range(state.compression.shape[0]):
        state.compression[k] = free_end(state, k, state.compression[k], state.free_displacement[k])
    return True


@inline
def is_forced(force, frame, state):
    """True if an external force acts in this step."""
    if EFFECTS & FORCES:
        return events_push(state) or next_external_force(force, frame - 1) <= frame
    return False


@inline
def refined_step(model, state, frame, in_contact):
    """Do a sample in stages, or in one step where that is the same. Returns a StepOutcome.

    in_contact: True if the sample before ended in contact
    """
    refinement = model.refinement
    is_alone = are_modes_independent(state) and not is_forced(model.force, frame, state) and not glides_now(state)
    if is_alone and not in_contact and not refinement.refine_free_flight:
        if not has_contacts(state) or step_open_contacts(model, refinement, state):
            return step(model, StepSettings(model.step, StepKind.SAMPLE, TRUE, frame, SAMPLE), state)
    return accurate_step(model, refinement, state, frame)


@inline
def accurate_step(model, refinement, state, frame):
    """Do a sample in stages, of as many steps as it needs. Returns a StepOutcome."""
    begin_tries(refinement.adaptive, state)
    while True:
        outcome = composed_step(model, refinement, state, frame)
        if accept_or_restore(refinement.adaptive, model, state):
            return outcome


@inline
def composed_step(model, refinement, state, frame):
    """Do a sample in stages. Returns a StepOutcome."""
    modes, contacts, connections = state.p.shape[0], state.compression.shape[0], state.connection.extension.shape[0]
    mean_force, impulse = state.refinement.mean_force, state.refinement.loss_impulse
    state.refinement.margin_valid[0] = 0
    for k in range(contacts):
        mean_force[k] = 0.0
        impulse[k] = 0.0
    in_contact, evaluations, lost, work, end = FALSE, INT64_0, 0.0, 0.0, 0.0
    steps, first_kind = steps_of_sample(refinement, state), first_kind_of_sample(refinement, state)
    doublings, glides = refinement.adaptive.finest - state.refinement.level[0], glides_now(state)
    share = refinement.steps / steps  # of the length that the durations are for
    is_apart = choose_loss_between_stages(refinement.contact_loss, model.contact, share, model.samplerate, state)
    stages = refinement.sequence.shape[0] if is_apart else refinement.sequence_in_solve.shape[0]
    for n in range(steps * stages):
        i = n % stages
        s = first_kind + (refinement.sequence[i] if is_apart else refinement.sequence_in_solve[i])
        begin, end = end, end + refinement.length[s]
        if glides and steps * stages > 1:
            glide_to(model, state, frame + begin, frame + 0.5 * (begin + end))
        h = coefficients_of_stage(refinement.stages, s, modes, contacts, connections)
        damp_stage(refinement, (i, stages, doublings, TRUE), state)
        if is_apart:
            lost += lose_between(model, refinement, refinement.loss_before, (i, share, TRUE, n == 0), state)
        outcome = step(model, StepSettings(h, StepKind.FIRST_STAGE + s, FALSE, frame, (begin, end)), state)
        if outcome.in_contact:
            in_contact = True
            for k in range(contacts):
                mean_force[k] += refinement.length[s] * state.contact_force[k]
        else:
            for k in range(contacts):
                state.contact_force[k] = 0.0
        if is_apart:
            lost += lose_between(model, refinement, refinement.loss_after, (i, share, FALSE, FALSE), state)
        damp_stage(refinement, (i, stages, doublings, FALSE), state)
        evaluations += outcome.evaluations
        lost += outcome.dissipated
        work += outcome.supplied
    if glides and may_try_again(refinement.adaptive):
        glide_to(model, state, frame + end, frame + 0.5)  # where a next try begins
    for k in range(contacts):
        state.contact_force[k] = mean_force[k] + impulse[k] * model.samplerate
    return StepOutcome(in_contact, evaluations, lost, work)


@inline
def lose_between(model, refinement, durations, when, state):
    """Let dampers and contacts lose before a stage, or after it, in the reverse order. Returns the energy lost, J.

    durations: before each stage of a step, or after it, s; empty if there is no such loss
    when:      the number of the stage in its step, its share of a step of these durations, and whether this is before
               the stage, and before all stages of the sample
    """
    lost = 0.0
    (i, share, is_before, is_first), rate = when, model.samplerate
    if i < durations.shape[0]:
        duration = share * durations[i]
        if is_before:
            lost += damp_connections(model.connection, duration, FALSE, state)
            rate = 0.0 if is_first else rate
        lost += lose_at_contacts(refinement.contact_loss, model.contact, duration, not is_before, rate, state)
        if not is_before:
            lost += damp_connections(model.connection, duration, TRUE, state)
    return lost
