"""How long the blocks of a scene take, with the engine that is imported: one of the two versions of bench pairs.

Run with that version's folder as the first of the Python path. Each line of the input is a request and each line of the
output the reply, both in JSON.
"""

import json
import os
import sys
import time
from typing import Any

import numpy as np

import engine
from engine.assembly.build import build
from engine.kernel.data.axes import arrays_of
from engine.offline.simulation import Simulation
from engine.offline.statistics import newton_statistics

RATE = 44_100
TURN = 0.05  # s that the renders of a turn take together, at least


class Performance:
    """A scene that is rendered again and again from its beginning.

    document: the scene, as tables of a patch
    seconds:  how much of it
    """

    def __init__(self, document: dict[str, Any], seconds: float) -> None:
        scene = engine.Scene.model_validate(document)
        self.model, self.state, _ = build(scene, RATE)
        self.simulation = Simulation(self.model, self.state)
        self.audio = np.zeros((round(seconds * RATE), scene.channels))
        self.simulation.render_block(self.audio[:0])  # compiles
        arrays = [*arrays_of(self.state), *arrays_of(self.model)]  # a score is part of a model, and notes what was done
        self.saved = [(array, array.copy()) for array in arrays]

    def render(self, frames: int) -> list[float]:
        """Render from the beginning. Return the processor time of each block of so many frames, s."""
        for array, copy in self.saved:
            array[...] = copy
        times = []
        for begin in range(0, len(self.audio), frames):
            block = self.audio[begin : begin + frames]
            start = time.thread_time()
            self.simulation.render_block(block)
            times.append(time.thread_time() - start)
        return times

    def take_turn(self, frames: int) -> dict[str, Any]:
        """Render once, and then as often as a turn allows.

        Return the least time of each block, and of the first render the energy error and the number of solves that
        were ended early.
        """
        self.render(frames)
        outcomes = newton_statistics(self.model, self.state)["regimes"]
        reply = {"error": self.simulation.energies().error_max, "capped": outcomes["capped"]}
        least, spent = np.inf, 0.0
        while spent < TURN:
            times = self.render(frames)
            least, spent = np.minimum(least, times), spent + sum(times)
        return reply | {"times": np.asarray(least).tolist()}


def main() -> None:
    """Reply to the requests of the input until it ends."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = Performance(request["document"], request["seconds"]).take_turn(request["frames"])
        except ValueError as error:  # such as a key that an older version has not
            reply = {"refused": " ".join(str(error).split())}
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main()
