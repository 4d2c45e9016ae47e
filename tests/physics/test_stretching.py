"""Bodies whose tension rises as they stretch: pitch, motion and energy, against formulas and independent integrators."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import engine

RATE, MODES = 44_100, 24
LENGTH, DENSITY, F0, AXIAL = 0.648, 4e-4, 329.6, 5e4
TENSION = DENSITY * (2 * LENGTH * F0) ** 2
NUMBER = np.arange(1.0, MODES + 1)
BETA = NUMBER * math.pi / LENGTH
OMEGA, KAPPA, STRETCH = BETA * math.sqrt(TENSION / DENSITY), BETA**2 / DENSITY, AXIAL / (2 * LENGTH)
HEARD, STRUCK = 0.11, 0.31


def shape(at):
    """Mode shapes of the string at a position, 1/√kg."""
    return math.sqrt(2 / (DENSITY * LENGTH)) * np.sin(math.pi * NUMBER * at)


def string(**more):
    return {
        "name": "string",
        "kind": "string",
        "length": LENGTH,
        "linear_density": DENSITY,
        "tension": TENSION,
        "modes": MODES,
        "residual": False,
        "axial_stiffness": AXIAL,
        **more,
    }


def bent(amplitude):
    """A smooth shape at time 0: the first mode."""
    return {"displacement": {"kind": "mode", "number": 1, "amplitude": amplitude}}


def heard(parts, seconds=0.01, **accuracy):
    """Displacement of the string, m, and the error of the energy."""
    pickup = [{"body": "string", "at": HEARD, "quantity": "displacement"}]
    scene = engine.Scene.model_validate({"pickup": pickup, **parts})
    rendering = engine.render(scene, seconds=seconds, samplerate=RATE, **accuracy)
    return rendering.audio[:, 0], rendering.stats.energy.error_max


def string_force(q):
    """Force of the string on its modes: linear, and by its tension."""
    return -(OMEGA**2) * q - STRETCH * (KAPPA @ q**2) * KAPPA * q


def first_mode(amplitude):
    q = np.zeros(MODES)
    q[0] = amplitude / math.sqrt(2 / (DENSITY * LENGTH))
    return q


def integrate(rate_of_change, start, samples):
    """Solution of an independent integrator at the samples."""
    times = np.arange(samples) / RATE
    solution = solve_ivp(
        rate_of_change, (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-15, max_step=4e-6
    )
    return solution.y.T


def slopes(parts, reference, levels, **accuracy):
    """Order of convergence, between numbers of substeps that double."""
    errors = []
    for substeps in levels:
        y, energy_error = heard(parts, len(reference) / RATE, substeps=substeps, **accuracy)
        assert energy_error < 2e-13
        errors.append(np.max(np.abs(y - reference)) / np.max(np.abs(reference)))
    print(errors)
    return [math.log2(a / b) for a, b in pairwise(errors)]


def plucked_free(amplitude=4e-3):
    rest = np.zeros(MODES)
    start = np.concatenate([first_mode(amplitude), rest])
    start[1] = 0.2 * start[0]

    def change(_, y):
        return np.concatenate([y[MODES:], string_force(y[:MODES])])

    values = 0.2 * amplitude
    parts = {"body": [string(displacement={"kind": "points", "x": list(GRID), "value": list(
        amplitude * np.sin(math.pi * GRID) + values * np.sin(2 * math.pi * GRID))})]}
    return parts, change, start


GRID = np.linspace(0, 1, 2001)
