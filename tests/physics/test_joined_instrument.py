"""A hammer on a string that is joined to a board, against an independent integrator of the same equations."""

import math

import numpy as np
import pytest
import scipy

import engine
from bench.scenes.choirs import BOARD_MASS, BOARD_RIGIDITY, BOARD_SIZE, LOSS_FACTOR, board

pytestmark = pytest.mark.hard
SECONDS, SAMPLERATE = 6e-3, 44_100
LENGTH, MASS, PITCH, MODES, DAMPING = 0.62, 3.93e-3, 261.6, 12, 0.5  # of the string; its loss in 1/s
STRUCK_AT, JOINED_AT, BRIDGE = 0.12, 0.93, (0.42, 0.37)
HAMMER, VELOCITY, GAP = 8e-3, 2.5, 1e-4  # kg, m/s, m
FELT = {"stiffness": 4.5e8, "exponent": 2.5, "loss": 0.3}  # N/m^2.5, -, s/m
SPRING, DAMPER = 2e5, 0.4  # N/m, kg/s
BOARD_MODES = 10


def scene() -> engine.Scene:
    """The instrument as a patch has it."""
    string = {"name": "string", "kind": "string", "length": LENGTH, "mass": MASS, "frequency": PITCH, "modes": MODES}
    string |= {"sigma0": DAMPING, "residual": False}
    hammer = {"name": "hammer", "kind": "mass", "mass": HAMMER, "displacement": -GAP, "velocity": VELOCITY}
    joint = {"body": "string", "at": JOINED_AT, "on": "board", "on_at": "bridge", "stiffness": SPRING}
    return engine.Scene.model_validate(
        {
            "body": [
                string,
                hammer,
                board({"bridge": BRIDGE}, modes=BOARD_MODES),
            ],
            "connection": [joint | {"damping_coefficient": DAMPER}],
            "contact": [{"name": "felt", "body": "hammer", "on": "string", "on_at": STRUCK_AT, **FELT}],
            "pickup": [
                {"body": "string", "at": STRUCK_AT, "quantity": "displacement"},
                {"body": "board", "at": "bridge", "channel": 2, "quantity": "displacement"},
            ],
        }
    )


def board_modes() -> tuple[np.ndarray, np.ndarray]:
    """Angular frequencies of a plate with supported edges, and its mode shapes at the bridge, 1/√kg."""
    a, b = BOARD_SIZE
    found = []
    for m in range(1, 40):
        for n in range(1, 40):
            omega = ((math.pi * m / a) ** 2 + (math.pi * n / b) ** 2) * math.sqrt(BOARD_RIGIDITY * a * b / BOARD_MASS)
            shape = 2 / math.sqrt(BOARD_MASS) * math.sin(m * math.pi * BRIDGE[0]) * math.sin(n * math.pi * BRIDGE[1])
            found.append((omega, shape))
    omega, shape = zip(*sorted(found)[:BOARD_MODES], strict=True)
    return np.array(omega), np.array(shape)


def independent_motion(times: np.ndarray) -> np.ndarray:
    """Displacement of the string where it is struck and of the board at the bridge [2, times], m; by modes, with the
    contact law of Hunt and Crossley, and an explicit Runge-Kutta method of order 8."""
    n = np.arange(1, MODES + 1)
    plate, at_bridge = board_modes()
    omega = np.concatenate([2 * math.pi * PITCH * n, [0.0], plate])
    sigma = np.concatenate([np.full(MODES, DAMPING), [0.0], LOSS_FACTOR * plate / 2])

    def shape_of_string(at: float) -> np.ndarray:
        return np.concatenate([math.sqrt(2 / MASS) * np.sin(n * math.pi * at), np.zeros(1 + BOARD_MODES)])

    ear, joined = shape_of_string(STRUCK_AT), shape_of_string(JOINED_AT)
    bridge = np.concatenate([np.zeros(MODES + 1), at_bridge])
    hammer = np.zeros_like(omega)
    hammer[MODES] = 1 / math.sqrt(HAMMER)
    squeeze, stretch = hammer - ear, joined - bridge

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        q, p = np.split(y, 2)
        compression, speed = squeeze @ q, squeeze @ p
        force = 0.0
        if compression > 0.0:
            force = FELT["stiffness"] * compression ** FELT["exponent"] * (1.0 + FELT["loss"] * speed)
        pull = SPRING * (stretch @ q) + DAMPER * (stretch @ p)
        # a mode's decay rate σ and frequency ω, as a patch counts them
        return np.concatenate([p, -(omega**2) * q - 2 * sigma * p - squeeze * force - stretch * pull])

    start = np.zeros(2 * omega.size)
    start[MODES], start[omega.size + MODES] = -GAP * math.sqrt(HAMMER), VELOCITY * math.sqrt(HAMMER)
    found = scipy.integrate.solve_ivp(
        slope, (0.0, times[-1]), start, "DOP853", times, rtol=1e-11, atol=1e-16, max_step=2e-6
    )
    return np.array([ear @ found.y[: omega.size], bridge @ found.y[: omega.size]])


@pytest.fixture(scope="module")
def exact():
    return independent_motion(np.arange(round(SECONDS * SAMPLERATE)) / SAMPLERATE)


def error(exact: np.ndarray, substeps: int) -> float:
    """Return the largest difference over either peak."""
    rendering = engine.render(scene(), seconds=SECONDS, substeps=substeps, trace=True)
    assert rendering.contacts["felt"].touches >= 1
    peak = np.abs(exact).max(axis=1)
    return float(np.max(np.abs(rendering.audio.T - exact) / peak[:, None]))


def test_the_motion_converges_to_that_of_an_independent_integrator(exact):
    """With the square of the step, from one step per sample on."""
    errors = [error(exact, substeps) for substeps in (1, 4, 16)]
    assert errors[0] < 5e-4
    assert errors[1] < errors[0] / 10 and errors[2] < errors[1] / 10
