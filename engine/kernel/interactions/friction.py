"""Friction: points at which surfaces rub, pressed together by a given force or by a contact. They are solved with the
contacts of their island, as rows of the same equations (engine.kernel.contact.friction_law).

How hard a point may push is known before each solve, so that the solve has one solution for any force and stiffness. A
point alone has its coefficient chosen by the slip of the same step before it is solved; where several points act on
each other, they are solved, their coefficients chosen by that, and so on until these stay.
"""

from engine.compiler.decorators import inline
from engine.kernel.contact.contact_law import item_or_zero
from engine.kernel.contact.friction_coefficient import choose_coefficient, coefficient_at, share_forgotten
from engine.kernel.contact.friction_law import end_of_bristle, force_of_sticking, slides, slope_of_sticking
from engine.kernel.data.enums import EventKind, Row, Sliding
from engine.kernel.modes.ordered_sums import copy_or_back

MAX_CHOICES = 20  # of the coefficients of points that act on each other, in a step
SAME_BOUND = 1e-10  # share by which the largest force of a point may differ from that of the last choice


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
    """Do this in a scene with contacts: as if points went on slipping as fast as in the last step.

    duration: of the step at each, s; or None; compliance: B_kk, m/N
    """
    if friction is not None:
        if has_friction(friction):
            for k in range(state.compression.shape[0]):
                if slides(state.friction, k):
                    point, pressed_by = state.friction[k], friction.pressed_by[k]
                    press = state.contact_force[pressed_by] if pressed_by >= 0 else point[Sliding.FORCE]
                    stiffness = point[Sliding.BRISTLE]
                    damping = stiffness * point[Sliding.DAMPING_TIME]
                    point[Sliding.SLOPE] = slope_of_sticking(stiffness, damping, compliance[k], duration[k])
                    point[Sliding.COEFFICIENT] = coefficient_at(point, point[Sliding.REMEMBERED_SPEED])[0]
                    point[Sliding.IS_CHOSEN] = 0.0
                    press_point(point, press)


@inline
def press_point(point, press):
    """Let a force (N) press the surfaces at a point together."""
    point[Sliding.PRESS] = max(0.0, press)
    point[Sliding.BOUND] = point[Sliding.PRESS] * point[Sliding.COEFFICIENT]


@inline
def choose_alone(friction, k, z, g, h):
    """Choose the coefficient of the only point of an island by the slip in the coming step. friction: State.friction or
    None; z: bend of its bristle, m; g: its slip without friction, m; h: ContactCoefficients"""
    if friction is not None:
        if slides(friction, k) and friction[k][Sliding.IS_CHOSEN] == 0.0:
            force = force_of_sticking(friction[k], z, g, h.compliance[k])
            choose_coefficient(friction[k], force, h.compliance[k], item_or_zero(h.duration, k))
            friction[k][Sliding.IS_CHOSEN] = 1.0


@inline
def choose_together(friction, h, reach, choices, state):
    """Choose the coefficients of several points by their slip in a step as it was solved, and let contacts press with
    the forces that were found for it, where friction moves none of them. Returns True if any force may now be larger or
    smaller: then the step is to be solved again.

    friction: Friction or None; h: ContactCoefficients; choices: how often this was done in the step
    """
    if friction is None:
        return False
    return has_friction(friction) and choose_each(friction, h, reach, choices, state)


@inline
def choose_each(friction, h, reach, choices, state):
    """Do this in an island with friction."""
    differs, vectors = False, state.scratch.vectors
    for k in range(reach.size):
        if slides(state.friction, k):
            point, pressed_by, before = state.friction[k], friction.pressed_by[k], state.friction[k][Sliding.BOUND]
            if pressed_by >= 0 and friction.is_apart[0] != 0:
                press_point(point, vectors[Row.FORCE, pressed_by])
            if point[Sliding.IS_CHOSEN] == 0.0:
                g = vectors[Row.STEP, k] + h.compliance[k] * vectors[Row.FORCE, k]
                force = force_of_sticking(point, reach.compression[k], g, h.compliance[k])
                choose_coefficient(point, force, h.compliance[k], h.duration[k])
            differs = differs or abs(point[Sliding.BOUND] - before) > SAME_BOUND * before
    is_last = not differs or choices + 1 >= MAX_CHOICES
    for k in range(reach.size):
        if slides(state.friction, k) and is_last:
            state.friction[k][Sliding.IS_CHOSEN] = 1.0
    return differs and choices < MAX_CHOICES


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
    before, end = state.compression[k], end_of_bristle(point, state.compression[k], eta, f)
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
