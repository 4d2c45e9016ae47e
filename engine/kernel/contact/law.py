"""The laws of contacts and of points of friction behind one door: which law a contact has is asked here, and nowhere
else. Both are rows of the same equations, with forces that never fall as the bodies move on.

laws: Laws, or the State; k: number of the contact; s: its compression, m; of friction, how far the bristle is
bent; g: how the coming drift changes it without the force, m; eta: how it changes in the step, m
"""

from typing import Any, NamedTuple

import numpy as np

from engine.compiler.decorators import inline
from engine.kernel.contact.felt_law import (
    energy_gained_by_felt,
    energy_of_felt,
    recover_all,
    relaxes,
    respond_by_felt,
    solve_felt,
    store_felt,
)
from engine.kernel.contact.friction_law import (
    bristle_energy,
    force_may_act,
    is_on_law,
    respond_by_friction,
    slides,
    solve_friction,
    store_friction,
    surface_move,
)
from engine.kernel.contact.friction_points import (
    choose_alone,
    choose_together,
    has_friction,
    largest_force_of_surface,
    prepare_friction,
    work_of_surfaces,
)
from engine.kernel.contact.power_law import (
    StepStart,
    elastic_law,
    energy_beyond_work,
    extrapolation_error,
    potential,
    power,
    respond_by_power_law,
    second_order_change,
    store_power_law,
)
from engine.kernel.contact.scalar_contact_solver import solve_power_law
from engine.kernel.data.enums import EventKind, Sliding


class Laws(NamedTuple):
    """The laws of contacts in a step."""

    elastic: Any  # Law
    loss_rate: Any  # μ/h of each contact, 1/m
    law_numbers: Any  # of the State


@inline
def laws_in_step(h, state):
    """Return the Laws of all contacts in a step. h: ContactCoefficients"""
    return Laws(elastic_law(state), h.loss_rate, state.law_numbers)


# --- before a solve


@inline
def prepare_laws(contact, settings, state):
    """Find what the laws of an island depend on in the coming step."""
    prepare_friction(contact.friction, settings.h.contact, state)
    recover_all(state, settings.frame + settings.span[0], settings.span[1] - settings.span[0])


@inline
def update_laws(state, time):
    """Bring what laws remember up to a time, frames: before a change, as a contact may be closed after it."""
    recover_all(state, time, 0.0)


@inline
def driven_move(laws, duration, k):
    """Return how far contact k closes in a step by itself, m: where a surface moves, such as that of a bow."""
    if slides(laws.law_numbers, k):
        return -surface_move(laws.law_numbers, duration, k)
    return 0.0


@inline
def add_driven_moves(contact, duration, state):
    """Add to `free_displacement` how far contacts of an island close by themselves in a step."""
    if has_friction(contact.friction):
        for k in range(state.free_displacement.shape[0]):
            state.free_displacement[k] += driven_move(state, duration, k)


@inline
def work_of_drives(contact, duration, state):
    """Return the work that surfaces which move by themselves have done in a step, J."""
    if has_friction(contact.friction):
        return work_of_surfaces(duration, state)
    return 0.0


@inline
def largest_drive(contact, k, state):
    """Return the largest force of contact k if it moves by itself, N: infinite where another contact presses it; 0 of
    all others."""
    if slides(state.law_numbers, k):
        return largest_force_of_surface(contact.friction, state.law_numbers, k)
    return 0.0


@inline
def may_act(laws, k, s, g):
    """True if contact k may have a force in a step: it is closed, or would be at the end of the step without its force;
    or surfaces are pressed."""
    if slides(laws.law_numbers, k):
        return force_may_act(laws.law_numbers, k, s)
    return s > 0.0 or s + g > 0.0


@inline
def closes(laws, k, end):
    """True if contact k, which had no force yet, closes where it ends at this compression."""
    return end > 0.0 and not slides(laws.law_numbers, k)


@inline
def free_end(laws, k, s, g):
    """Return the compression at the end of a step in which contact k has no force, m."""
    if slides(laws.law_numbers, k):
        return s
    return s + g


@inline
def follows_modes(laws, k):
    """True if the compression of contact k is that of the modes: a bristle keeps its bend."""
    return not slides(laws.law_numbers, k)


# --- in a solve; laws: Laws


@inline
def step_start(laws, k, s):
    """Return the StepStart of contact k."""
    if s <= 0.0 or slides(laws.law_numbers, k):
        return StepStart(s, 0.0)
    return StepStart(s, power(laws.elastic, k, s))


@inline
def settle_alone(laws, k, s, g, h):
    """Choose what the law of the only contact of an island depends on by the coming step. h: ContactCoefficients"""
    choose_alone(laws.law_numbers, k, s, g, h)


@inline
def settle_together(contact, h, reach, choices, state):
    """Choose what laws depend on by a step as it was solved. Returns True if the step is to be solved again.

    choices: how often this was done in the step
    """
    return choose_together(contact.friction, h, reach, choices, state)


@inline
def solve_alone(equation, near):
    """Solve a ContactEquation for the end compression b.

    near: b as far as it is known, m; zero or less if nothing is known of it

    Returns η (m), b (m), mean force f (N), slope df/dη (N/m), evaluations of the contact law, and SolveStatus (FREE,
    SEPARATION, CLOSED_FORM, NEWTON or FAILED).
    """
    laws, k, start, g, compliance, _ = equation
    if slides(laws.law_numbers, k):
        return solve_friction(laws.law_numbers, k, start.s, g, compliance)
    if relaxes(laws.law_numbers, k):
        return solve_felt(equation)
    return solve_power_law(equation, near)


@inline
def respond(laws, k, s, eta):
    """Return the mean force and slope df/dη of contact k for a step η."""
    if slides(laws.law_numbers, k):
        return respond_by_friction(laws.law_numbers, k, s, eta)
    if relaxes(laws.law_numbers, k):
        return respond_by_felt(laws, k, s, eta)
    return respond_by_power_law(laws, k, s, eta)


@inline
def errors_of_move(laws, k, s, estimate, move, push):
    """Return by how much the force of contact k would be off its law after a small further move, to first order and to
    second, relative to it: after a move along its tangent, friction is still on its law, or is not.

    estimate: ForceEstimate before the move; push: change of the force, N
    """
    if slides(laws.law_numbers, k):
        none = 0.0 if is_on_law(laws.law_numbers, k, s, estimate.eta + move, estimate.force + push) else np.inf
        return none, none
    if relaxes(laws.law_numbers, k):
        after = respond_by_felt(laws, k, s, estimate.eta + move)[0]
        none = abs(after - (estimate.force + push)) / after if after > 0.0 else np.inf
        return none, none
    if estimate.slope > 0.0:
        return extrapolation_error(laws.elastic, k, s, estimate, move)
    none = 0.0 if respond_by_power_law(laws, k, s, estimate.eta + move)[0] <= 0.0 else np.inf
    return none, none


@inline
def bend(laws, k, start, estimate, move):
    """Return the change of the force of contact k of second order in a small move, N; 0 of friction and of felt."""
    if estimate.slope > 0.0 and not slides(laws.law_numbers, k) and not relaxes(laws.law_numbers, k):
        return second_order_change(laws, k, start, estimate, move)
    return 0.0


# --- after a solve


@inline
def takes_part(laws, k, s, b, f):
    """True if contact k has a force or energy in this step."""
    return f != 0.0 or s > 0.0 or b > 0.0 or slides(laws.law_numbers, k)


@inline
def store_solution(h, state, k, solution, residual):
    """Store the new compression and force of contact k. Returns the energy lost, J.

    solution: η (m), end compression b (m), force f (N), the force of the contact law (N), from which f differs where a
              solve was capped, and the elastic force at b (N) if there is contact loss
    residual: how far the bodies moved at the contact beyond η, m
    """
    residual -= h.compliance_low[k] * solution[2]
    if slides(state.law_numbers, k):
        return store_friction(state, k, h.duration[k], solution, residual)
    if relaxes(state.law_numbers, k):
        return store_felt(laws_in_step(h, state), state, k, solution, residual)
    return store_power_law(laws_in_step(h, state), state, k, solution, residual)


@inline
def energy_created(state, k, s, lost, f):
    """Energy that contact k has gained since its compression was s, and lost, beyond the work of the bodies against its
    force f, J. At a point of friction, what is lost holds that."""
    if slides(state.law_numbers, k):
        return 0.0
    if relaxes(state.law_numbers, k):
        return energy_gained_by_felt(state, k, s) + lost - f * state.free_displacement[k]
    return energy_beyond_work(state, k, s, lost, f)


# --- energy, trace and events


@inline
def energy_of_contact(state, k):
    """Return the energy that contact k holds, J."""
    s = state.compression[k]
    if slides(state.law_numbers, k):
        return bristle_energy(state.law_numbers, k, s)
    if relaxes(state.law_numbers, k):
        return energy_of_felt(state, k)
    return potential(elastic_law(state), k, s)


@inline
def traced_compression(state, k):
    """Return what a trace has for compression k where it does not follow the modes: of friction, the slip, m/s."""
    return state.law_numbers[k][Sliding.SLIP]


@inline
def is_of_friction(kind):
    """True if events of a kind change a number of friction."""
    return kind >= EventKind.FRICTION_VELOCITY and kind <= EventKind.FRICTION_BRISTLE


@inline
def contact_parameter(contact, kind, k, state):
    """Return what an event of a kind changes of contact k: its stiffness as a share of that of the patch, its exponent,
    how far its barrier is beyond that of the patch, m; or a number of friction."""
    if is_of_friction(kind):
        return state.law_numbers[k][kind - EventKind.FRICTION_VELOCITY]
    if kind == EventKind.STIFFNESS:
        return state.potential_coefficient[k] / nominal_coefficient(contact, state, k)
    if kind == EventKind.EXPONENT:
        return state.exponent[k]
    return state.barrier[k] - contact.nominal_barrier[k]


@inline
def nominal_coefficient(contact, state, k):
    """Stiffness of contact k as the patch says, in units of its law."""
    return contact.nominal_stiffness[k] / (state.exponent[k] + 1.0)


@inline
def set_contact_parameter(contact, kind, span, value, state):
    """Set this parameter of contacts. span: the first, and the last + 1"""
    for k in range(span[0], span[1]):
        if is_of_friction(kind):
            state.law_numbers[k][kind - EventKind.FRICTION_VELOCITY] = value
        elif kind == EventKind.STIFFNESS:
            state.potential_coefficient[k] = value * nominal_coefficient(contact, state, k)
        elif kind == EventKind.EXPONENT:  # kc stays, and the law counts in kc/(α+1)
            state.potential_coefficient[k] *= (state.exponent[k] + 1.0) / (value + 1.0)
            state.exponent[k] = value
        else:
            moved = contact.nominal_barrier[k] + value
            state.compression[k] -= moved - state.barrier[k]
            state.barrier[k] = moved
