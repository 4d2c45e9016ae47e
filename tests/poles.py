"""The poles of a linear scene: those that the engine's own step has, and those of the same modes in continuous time."""

import numpy as np

from engine.assembly.build import build
from engine.kernel.data.enums import StepKind
from engine.offline.simulation import Simulation

SAMPLERATE = 44_100


def step_map(scene, samplerate=SAMPLERATE, **accuracy):
    """The linear map [2 modes, 2 modes] of (q, p) that one sample is: the kernel's own, column by column."""
    model, state, layout = build(scene, samplerate, scene.accuracy.replace(silence=-np.inf, **accuracy))
    rows, modes = layout.points.coordinate_rows[0], state.q.size
    simulation, audio = Simulation(model, state, kernel="general"), np.zeros((1, 1))
    columns = []
    for i in range(2 * modes):
        start = np.zeros(2 * modes)
        start[i] = 1.0
        state.q[:], state.p[:] = start[:modes], start[modes:]
        state.frame[:] = 2
        for changed in (state.sleep, state.sleep_monitor, state.contact_free_until, state.kick_compensation):
            changed[:] = 0
        state.drift_kind[:], state.connection.is_move_known[:] = StepKind.UNKNOWN, 0
        state.connection.extension[:], state.connection.extension_compensation[:] = rows @ start[:modes], 0.0
        simulation.render_block(audio)
        columns.append(np.concatenate([state.q, state.p]))
    return np.array(columns).T


def engine_poles(scene, samplerate=SAMPLERATE, **accuracy):
    """Poles -σ + iω of the engine's step, those with ω > 0, by ω."""
    values = np.linalg.eigvals(step_map(scene, samplerate, **accuracy))
    return sorted_poles(np.log(values.astype(complex)) * samplerate)


def exact_poles(scene, samplerate=SAMPLERATE):
    """Poles of q'' + 2σq' + ω²q = -Rᵀ(K·R·q + C·R·q'), R the rows of the connections."""
    _, _, layout = build(scene, samplerate, scene.accuracy.replace(scheme="fdh"))  # its rows are those of the bodies
    omega, sigma = layout.modes.omega, layout.modes.sigma
    rows, items = layout.points.coordinate_rows[0], layout.islands.coordinates[0]
    stiffness = items.coupling + np.diag([item.stiffness for item in items.items])
    damping = np.diag([item.damping for item in items.items])
    return state_space_poles(omega, sigma, rows, stiffness, damping, np.array([i.is_rigid for i in items.items]))


def state_space_poles(omega, sigma, rows, stiffness, damping, is_rigid=None):
    """The same of given modes; rigid coordinates are eliminated, by what they leave free."""
    size = omega.size
    k = np.diag(omega**2) + rows.T @ stiffness @ rows
    c = np.diag(2 * sigma) + rows.T @ damping @ rows
    if is_rigid is not None and is_rigid.any():
        _, _, basis = np.linalg.svd(rows[is_rigid])
        free = basis[int(is_rigid.sum()) :].T
        k, c = free.T @ k @ free, free.T @ c @ free
        size = free.shape[1]
    a = np.block([[np.zeros((size, size)), np.eye(size)], [-k, -c]])
    return sorted_poles(np.linalg.eigvals(a))


def sorted_poles(poles):
    moving = poles[poles.imag > 1.0]
    return moving[np.argsort(moving.imag)]


def cents(poles, exact):
    return 1200 * np.log2(poles.imag / exact.imag)


def nearest(poles, wanted):
    """The poles nearest to those wanted."""
    return np.array([poles[np.argmin(np.abs(poles - pole))] for pole in wanted])


def errors(scene, count=18, **accuracy):
    """Of the lowest poles: error of pitch, cents, and of decay, as a share."""
    exact = exact_poles(scene)[:count]
    found = nearest(engine_poles(scene, **accuracy), exact)
    return np.abs(cents(found, exact)), np.abs(found.real / exact.real - 1)
