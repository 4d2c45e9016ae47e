"""The shape of a string or bar over a few periods after it begins to move."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.assembly.build import build
from engine.bodies import String
from engine.bodies.distributed import LineBody
from engine.kernel.data.enums import FlightFrame
from engine.offline.simulation import Simulation
from engine.offline.trace import allocate_trace
from engine.patch.accuracy import Accuracy
from engine.patch.frames import frame_count
from engine.patch.scene import Scene

if TYPE_CHECKING:
    from engine.offline.render import RenderedArrays

PERIODS = 2.0  # of the lowest mode that are shown
MAX_TIMES = 400  # shapes
PLACES = 201  # along the string
MAX_BEGIN = 10.0  # s; what begins to move later is not looked for: all before it is computed again
MIN_SHARE = 0.1  # of the largest displacement that a string has which is looked at
ONSET = 0.2  # of its largest velocity: a string that has it swings freely, and is no longer only pulled aside
LEAD = 0.25  # periods that are shown before that


@dataclass(frozen=True)
class StringShape:
    """The displacement of a string or bar over time and place."""

    body: str  # its name
    time: np.ndarray  # [times], s
    places: np.ndarray  # [places], fractions of its length
    displacement: np.ndarray  # [times, places], m


def first_moving_string(scene: Scene, rendering: "RenderedArrays") -> tuple[int, int] | None:
    """The number of the string that moves first, of those that move at least a tenth as far as any, and the sample of
    the trace at which it swings; without strings, the same of the bars with a pickup. None if there is none."""
    heard = {pickup.body for pickup in scene.pickup}
    lines = [number for number, body in enumerate(scene.body) if isinstance(body, String)]
    lines = lines or [n for n, body in enumerate(scene.body) if isinstance(body, LineBody) and body.name in heard]
    if rendering.trace is None:
        return None
    lines = [number for number in lines if rendering.trace["positions"][number] != ""]
    if not lines:
        return None
    peaks = np.abs(rendering.trace["displacement"][:, lines]).max(axis=0)
    moving = np.flatnonzero((peaks > 0.0) & (peaks >= MIN_SHARE * peaks.max()))
    if moving.size == 0 or not np.isfinite(peaks).all():
        return None
    speed = np.abs(rendering.trace["velocity"][:, [lines[n] for n in moving]])
    onsets = (speed > ONSET * speed.max(axis=0)).argmax(axis=0)
    return lines[int(moving[onsets.argmin()])], int(onsets.min())


def string_shape(scene: Scene, rendering: "RenderedArrays") -> StringShape | None:
    """The shape of the string or bar that moves first in a rendering with a trace, over two periods of its lowest mode.
    The scene is computed again up to there. None if there is no such body, or it moves later than MAX_BEGIN."""
    found = first_moving_string(scene, rendering)
    stats = rendering.stats
    rate = stats.samplerate * stats.accuracy["oversample"]
    if found is None or found[1] > MAX_BEGIN * rate:
        return None
    number, onset = found
    model, state, layout = build(scene, rate, Accuracy.model_validate(stats.accuracy), stats.seconds)
    body, modes = layout.modal_bodies[number], layout.modes.of_body[number]
    places = np.linspace(0.0, 1.0, PLACES)
    shapes = np.array([body.shape(place) for place in places]).T  # [modes, places]
    vibrating = body.omega[body.omega > 0.0]
    frames = frame_count(stats.seconds, rate)
    period = 2 * math.pi / float(vibrating.min()) * rate if vibrating.size else float(frames)
    begin = max(0, onset - round(LEAD * period))
    step = max(1, math.ceil(PERIODS * period / MAX_TIMES))
    count = max(2, min(MAX_TIMES, round(PERIODS * period / step), (frames - begin) // step))
    simulation, q = Simulation(model, state, kernel=stats.kernel), np.zeros((count, modes.stop - modes.start))
    audio = np.zeros((max(begin, step), scene.channels))
    simulation.render_block(audio[:begin])
    trace, flight = allocate_trace(model, 1), state.flight.frame[layout.islands.of_body[number]]
    for row, frame in enumerate(range(begin, begin + count * step, step)):
        q[row] = state.q[modes]
        simulation.render_block(audio[:1], trace)
        if flight[FlightFrame.SAVED] == frame < flight[FlightFrame.END]:  # state.q is at the end of a free flight
            q[row] = state.flight.q[modes]
        simulation.render_block(audio[: step - 1])
    return StringShape(scene.body[number].name, (begin + step * np.arange(len(q))) / rate, places, q @ shapes)
