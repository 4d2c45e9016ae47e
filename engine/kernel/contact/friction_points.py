"""Friction: points at which surfaces rub, pressed together by a given force or by a contact. They are solved with the
contacts of their island, as rows of the same equations (engine.kernel.contact.friction_law).

How hard a point may push is known before each solve, so that the solve has one solution for any force and stiffness. A
point alone has its coefficient chosen by the slip of the same step before it is solved; where several points act on
each other, they are solved, their coefficients chosen by that, and so on until these stay.
"""

import math

from engine.compiler.decorators import inline
from engine.kernel.contact.friction_coefficient import choose_coefficient, coefficient_at
from engine.kernel.contact.friction_law import force_of_sticking, slides, slope_of_sticking, surface_move
from engine.kernel.data.effects import EFFECTS, FRICTION
from engine.kernel.data.enums import Row, Sliding

MAX_CHOICES = 20  # of the coefficients of points that act on each other, in a step
SAME_BOUND = 1e-10  # share by which the largest force of a point may differ from that of the last choice


@inline
def has_friction(friction):
    """True if the island has points of friction. friction: Friction"""
    if EFFECTS & FRICTION:
        return friction.is_present[0] != 0
    return False


@inline
def prepare_friction(friction, h, state):
    """Find how hard each point of friction may push in the coming step: as if points went on slipping as fast as in the
    last one. friction: Friction; h: ContactCoefficients"""
    if has_friction(friction):
        for k in range(state.compression.shape[0]):
            if slides(state.law_numbers, k):
                point, pressed_by = state.law_numbers[k], friction.pressed_by[k]
                press = state.contact_force[pressed_by] if pressed_by >= 0 else point[Sliding.FORCE]
                stiffness = point[Sliding.BRISTLE]
                damping = stiffness * point[Sliding.DAMPING_TIME]
                point[Sliding.SLOPE] = slope_of_sticking(stiffness, damping, h.compliance[k], h.duration[k])
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
    """Choose the coefficient of the only point of an island by the slip in the coming step. friction: State.friction;
    z: bend of its bristle, m; g: its slip without friction, m; h: ContactCoefficients"""
    if slides(friction, k):
        if friction[k][Sliding.IS_CHOSEN] == 0.0:
            force = force_of_sticking(friction[k], z, g, h.compliance[k])
            choose_coefficient(friction[k], force, h.compliance[k], h.duration[k])
            friction[k][Sliding.IS_CHOSEN] = 1.0


@inline
def choose_together(friction, h, reach, choices, state):
    """Choose the coefficients of several points by their slip in a step as it was solved, and let contacts press with
    the forces that were found for it, where friction moves none of them. Returns True if any force may now be larger or
    smaller: then the step is to be solved again.

    friction: Friction; h: ContactCoefficients; choices: how often this was done in the step
    """
    if has_friction(friction):
        return choose_each(friction, h, reach, choices, state)
    return False


@inline
def choose_each(friction, h, reach, choices, state):
    """Do this in an island with friction."""
    differs, vectors = False, state.scratch.vectors
    for k in range(reach.size):
        if slides(state.law_numbers, k):
            point, pressed_by, before = (
                state.law_numbers[k],
                friction.pressed_by[k],
                state.law_numbers[k][Sliding.BOUND],
            )
            if pressed_by >= 0 and friction.is_apart[0] != 0:
                press_point(point, vectors[Row.FORCE, pressed_by])
            if point[Sliding.IS_CHOSEN] == 0.0:
                g = vectors[Row.STEP, k] + h.compliance[k] * vectors[Row.FORCE, k]
                force = force_of_sticking(point, reach.compression[k], g, h.compliance[k])
                choose_coefficient(point, force, h.compliance[k], h.duration[k])
            differs = differs or abs(point[Sliding.BOUND] - before) > SAME_BOUND * before
    is_last = not differs or choices + 1 >= MAX_CHOICES
    for k in range(reach.size):
        if slides(state.law_numbers, k) and is_last:
            state.law_numbers[k][Sliding.IS_CHOSEN] = 1.0
    return differs and choices < MAX_CHOICES


@inline
def work_of_surfaces(duration, state):
    """Return the work that moving surfaces of an island have done in a step, J."""
    work = 0.0
    for k in range(state.contact_force.shape[0]):
        work -= state.contact_force[k] * surface_move(state.law_numbers, duration, k)
    return work


@inline
def largest_force_of_surface(friction, numbers, k):
    """Return the largest force of point k if its surface moves by itself, N; infinite where a contact presses it.
    friction: Friction"""
    point = numbers[k]
    if point[Sliding.VELOCITY] == 0.0:
        return 0.0
    if friction.pressed_by[k] >= 0:
        return math.inf
    return point[Sliding.FORCE] * max(point[Sliding.STATIC], point[Sliding.DYNAMIC])
