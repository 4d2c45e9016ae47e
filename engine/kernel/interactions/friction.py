"""Friction: points at which surfaces rub, pressed together by a given force or by a contact. They are solved with the
contacts of their island, as rows of the same equations (engine.kernel.contact.friction_law).

The coefficient of friction falls with the speed of slip: μ = μ_d + (μ_s - μ_d)·v0/(v0 + θ), where θ follows the speed
with a memory τ. It is known before the step, so that the step has one solution for any force and stiffness.
"""

from engine.compiler.decorators import inline
from engine.compiler.elementary import expm1_of
from engine.kernel.contact.friction_law import end_of_bristle, share_of_move, slides
from engine.kernel.data.enums import EventKind, Sliding
from engine.kernel.modes.ordered_sums import copy_or_back


@inline
def has_friction(friction):
    """True if the island has points of friction. friction: Friction or None"""
    if friction is None:
        return False
    return friction.is_present[0] != 0


@inline
def prepare_friction(contact, h, state):
    """Find how hard each point of friction may push in the coming step. h: ContactCoefficients or None"""
    if contact is not None:
        bound_friction(contact.friction, h.duration, h.compliance, state)


@inline
def bound_friction(friction, duration, compliance, state):
    """Do this in a scene with contacts. duration: of the step at each, s; or None; compliance: B_kk, m/N"""
    if friction is not None:
        if has_friction(friction):
            for k in range(state.compression.shape[0]):
                if slides(state.friction, k):
                    point, pressed_by = state.friction[k], friction.pressed_by[k]
                    press = state.contact_force[pressed_by] if pressed_by >= 0 else point[Sliding.FORCE]
                    point[Sliding.SHARE] = share_of_move(point[Sliding.BRISTLE], compliance[k])
                    point[Sliding.COEFFICIENT] = coefficient(point, duration[k])
                    press_point(point, press)


@inline
def press_point(point, press):
    """Let a force (N) press the surfaces at a point together."""
    point[Sliding.PRESS] = max(0.0, press)
    point[Sliding.BOUND] = point[Sliding.PRESS] * point[Sliding.COEFFICIENT]


@inline
def is_pressed_anew(friction, forces, state):
    """Let the contact forces that were found for this step press, in place of those of the step before, where friction
    moves no contact. Returns True if any differs: then friction is to be found again. forces: of all contacts, N"""
    if friction is None:
        return False
    differs = False
    if friction.is_apart[0] != 0:
        for k in range(state.compression.shape[0]):
            pressed_by = friction.pressed_by[k]
            if pressed_by >= 0:
                point, press = state.friction[k], max(0.0, forces[pressed_by])
                differs = differs or press != point[Sliding.PRESS]
                press_point(point, press)
    return differs


@inline
def coefficient(point, duration):
    """Return the coefficient of friction in the middle of a step."""
    remembered = point[Sliding.REMEMBERED_SPEED]
    remembered += (abs(point[Sliding.SLIP]) - remembered) * share_forgotten(point[Sliding.MEMORY], 0.5 * duration)
    speed = point[Sliding.SPEED]
    return point[Sliding.DYNAMIC] + (point[Sliding.STATIC] - point[Sliding.DYNAMIC]) * (speed / (speed + remembered))


@inline
def share_forgotten(memory, duration):
    """Return how much of the way to the present speed of slip the remembered one goes in a duration, 0 to 1."""
    if memory <= 0.0:
        return 1.0
    return -expm1_of(-duration / memory)


@inline
def surface_move(friction, duration, k):
    """Return how far the surface of point k moves by itself in a step, m: that of a bow; 0 of a contact."""
    if friction is None:
        return 0.0
    if not slides(friction, k):
        return 0.0
    return friction[k][Sliding.VELOCITY] * duration[k]


@inline
def subtract_surface_moves(friction, duration, state):
    """Take from the moves of all points what surfaces move by themselves. friction: Friction or None"""
    if friction is not None:
        if has_friction(friction):
            for k in range(state.free_displacement.shape[0]):
                state.free_displacement[k] -= surface_move(state.friction, duration, k)


@inline
def store_friction(friction, state, k, duration, solution, residual):
    """Store the bristle, slip and force of point k after a step. Returns the energy lost, J.

    solution: slip (m) and force (N); residual: how much further the surfaces slipped, m
    """
    if friction is None:
        return 0.0
    point, (eta, f) = friction[k], solution
    before, end = state.compression[k], end_of_bristle(point, state.compression[k] + eta)
    bent = eta if end == before + eta else end - before
    slip = (eta - bent) + residual  # what the bristle gave way
    state.compression[k], state.compression_compensation[k], state.contact_force[k] = end, 0.0, f
    speed = slip / duration if end != before + eta else 0.0
    remembered = point[Sliding.REMEMBERED_SPEED]
    remembered += (abs(speed) - remembered) * share_forgotten(point[Sliding.MEMORY], duration)
    point[Sliding.SLIP], point[Sliding.REMEMBERED_SPEED] = speed, remembered
    return f * slip + bent * (f - point[Sliding.BRISTLE] * (before + 0.5 * bent))


@inline
def slip_at(friction, k):
    """Return the slip of point k, m/s. friction: State.friction or None"""
    if friction is None:
        return 0.0
    return friction[k][Sliding.SLIP]


@inline
def work_of_surfaces(contact, h, state):
    """Return the work that moving surfaces have done in a step, J. h: ContactCoefficients or None"""
    work = 0.0
    if contact is not None:
        work = work_of_each(contact.friction, h.duration, state)
    return work


@inline
def work_of_each(friction, duration, state):
    """Do this in a scene with contacts."""
    work = 0.0
    if friction is not None:
        if has_friction(friction):
            for k in range(state.contact_force.shape[0]):
                work -= state.contact_force[k] * surface_move(state.friction, duration, k)
    return work


@inline
def copy_friction(friction, saved, count, is_back):
    """Copy the numbers of all points to a SavedMotion, or back. friction: State.friction or None"""
    if friction is not None:
        for k in range(count):
            copy_or_back(friction[k], saved[k], is_back)


# --- events


@inline
def is_of_friction(kind):
    """True if events of a kind change a number of friction."""
    return kind >= EventKind.FRICTION_VELOCITY and kind <= EventKind.FRICTION_BRISTLE


@inline
def friction_parameter(friction, kind, k):
    """Return what an event of a kind changes of point k. friction: State.friction or None"""
    if friction is None:
        return 0.0
    return friction[k][kind - EventKind.FRICTION_VELOCITY]


@inline
def set_friction_parameter(friction, kind, span, value):
    """Set this parameter of points. span: the first, and the last + 1"""
    if friction is not None:
        for k in range(span[0], span[1]):
            friction[k][kind - EventKind.FRICTION_VELOCITY] = value
