"""The playing range of a bowed string, beside Schelleng's and Friedlander's formulas.

A D4 on a violin's string starts in Helmholtz motion and goes on for a second, for bow forces about those of the
formulas. It is played where it slips once a period, and its pitch is within 50 cents; its range ends where two forces
in a row do not play it.
"""

import math
from typing import NamedTuple

import numpy as np

import engine
from bench.publish.report import figure, publish
from engine.analysis.bowing import friedlander_force, schelleng_forces

SAMPLERATE = 44_100  # Hz
PITCH, LENGTH, TENSION, MODES = 293.66, 0.325, 43.0, 73  # Hz, m, N
DENSITY = TENSION / (2 * LENGTH * PITCH) ** 2  # kg/m
IMPEDANCE = math.sqrt(TENSION * DENSITY)  # kg/s
RESISTANCE = 100 * IMPEDANCE  # kg/s, of the string's end, which its loss stands for
STATIC, DYNAMIC, SPEED, BRISTLE, VELOCITY = 0.8, 0.3, 0.1, 1e5, 0.1
POSITIONS = 0.0437, 0.0731, 0.107, 0.151, 0.193  # of the bow, fractions of the length
FORCES = 28  # of each position, from a quarter of Schelleng's lowest to three times his highest
SECONDS, LAST = 1.0, 0.3  # of a sound, and of what is judged at its end
MIN_SLIP = 0.05  # of the bow's speed: less is rounding of a corner, not slip
GAP, SHORTEST = 2, 3  # samples: gaps in a slip that do not end it, and slips that are none


class Bowing(NamedTuple):
    """Motion of a string under a bow, from the end of a sound."""

    slips: float  # a period
    slip_share: float  # of the time
    slip_speed: float  # m/s, mean while it slips
    cents: float  # of its pitch; NaN if it has none

    @property
    def is_helmholtz(self) -> bool:
        """True if it slips once a period, at the pitch of the string."""
        return abs(self.slips - 1.0) < 0.04 and abs(self.cents) < 50.0


def bowed_string(position: float, force: float, seconds: float = SECONDS, **friction: float) -> engine.Scene:
    """Return a scene of a string in Helmholtz motion, and a bow of this force (N) at a position. friction: other keys
    of the bow"""
    corner = -VELOCITY / position  # m/s: the slip of Helmholtz motion, at the string's end
    decay = {"kind": "chaigne_askenfelt", "b1": 2 * PITCH * IMPEDANCE / RESISTANCE, "b3": 2e-9}
    string = {"name": "string", "kind": "string", "length": LENGTH, "tension": TENSION, "linear_density": DENSITY}
    string |= {"modes": MODES, "decay": decay}
    string["velocity"] = {"kind": "points", "x": [0.0, 1e-6, 1.0], "value": [0.0, corner, 0.0]}
    bow = {"name": "bow", "body": "string", "at": position, "velocity": VELOCITY, "force": force}
    bow |= {"static": STATIC, "dynamic": DYNAMIC, "speed": SPEED, "bristle": BRISTLE} | friction
    under = {"body": "string", "at": position}
    pickups = [under | {"quantity": "displacement"}, under | {"quantity": "velocity", "channel": 2}]
    return engine.load({"seconds": seconds, "body": [string], "friction": [bow], "pickup": pickups})


def describe(rendering: engine.Rendering) -> Bowing:
    """Describe how a string moves under a bow at the end of a rendering of `bowed_string`."""
    slip = rendering.trace["slip"][-round(LAST * SAMPLERATE) :, 0]
    slides = np.abs(slip) > MIN_SLIP * VELOCITY
    bounds = np.flatnonzero(np.diff(np.concatenate([[0], slides.astype(int), [0]])))
    phases: list[tuple[int, int]] = []
    for begin, end in zip(bounds[::2], bounds[1::2], strict=True):
        if phases and begin - phases[-1][1] <= GAP:
            phases[-1] = phases[-1][0], end
        else:
            phases.append((begin, end))
    count = sum(end - begin >= SHORTEST for begin, end in phases)
    speed = float(np.abs(slip[slides]).mean()) if slides.any() else 0.0
    return Bowing(count / (LAST * PITCH), float(slides.mean()), speed, cents_of(slip))


def cents_of(slip: np.ndarray) -> float:
    """Return how far the pitch of a slip is from that of the string, cents, by its autocorrelation; NaN if there is no
    clear one."""
    centred, n = slip - slip.mean(), slip.size
    products = np.fft.irfft(np.abs(np.fft.rfft(centred, 4 * n)) ** 2)[: n // 2]
    if not products[0] > 0.0:
        return math.nan
    products /= products[0] * (1 - np.arange(n // 2) / n)
    low, high = round(0.8 * SAMPLERATE / PITCH), round(1.3 * SAMPLERATE / PITCH) + 2
    k = low + int(np.argmax(products[low:high]))
    before, here, after = products[k - 1 : k + 2]
    if here <= 0.5:
        return math.nan
    period = k + 0.5 * (before - after) / (before - 2 * here + after)
    return 1200 * math.log2(SAMPLERATE / period / PITCH)


def sawtooth_correlation(rendering: engine.Rendering, position: float) -> float:
    """Return the correlation of the displacement under the bow with the ideal sawtooth of Helmholtz motion, in the best
    phase."""
    tail = rendering.audio[-round(LAST * SAMPLERATE) :, 0]
    displacement = tail - tail.mean()
    period = SAMPLERATE / (PITCH * 2 ** (describe(rendering).cents / 1200))
    best = 0.0
    for phase in np.arange(0.0, 1.0, 0.01):
        moment = (np.arange(tail.size) / period + phase) % 1.0
        rises = moment < 1 - position
        ideal = np.where(rises, moment, (1 - position) * (1 - moment) / position)
        ideal -= ideal.mean()
        norm = math.sqrt(float(ideal @ ideal) * float(displacement @ displacement))
        best = max(best, float(ideal @ displacement) / norm)
    return best


def playing_range(position: float, forces: np.ndarray, substeps: int | None = None) -> list[Bowing]:
    """Describe the motion of the string for each of these bow forces."""
    scenes = (bowed_string(position, float(force)) for force in forces)
    return [describe(engine.render(scene, trace=True, substeps=substeps)) for scene in scenes]


def find_range(motions: list[Bowing]) -> tuple[int, int]:
    """Return the first and the last force of the range in which the string is played. Raises ValueError if it never
    is."""
    played = [motion.is_helmholtz for motion in motions]
    first = last = played.index(True)
    for n in range(first, len(played)):
        if not any(played[n : n + 2]):
            break
        last = n if played[n] else last
    return first, last


def run() -> None:
    """Measure, publish and draw."""
    rows, edges, difference = list[list[str]](), list[tuple[float, ...]](), STATIC - DYNAMIC
    grids = []
    for position in POSITIONS:
        lowest, highest = schelleng_forces(position, VELOCITY, IMPEDANCE, RESISTANCE, difference)
        several = friedlander_force(SPEED, difference, IMPEDANCE)
        forces = np.geomspace(lowest / 4, 3 * highest, FORCES)
        motions = playing_range(position, forces)
        first, last = find_range(motions)
        middle = (first + last) // 2
        scene = bowed_string(position, float(forces[middle]))
        rendering = engine.render(scene, trace=True)
        motion = motions[middle]
        rows.append(
            [
                f"{position:g}",
                f"{forces[first] / lowest:.2f}",
                f"{forces[last] / highest:.2f}",
                f"{motions[first].cents:.1f} / {motion.cents:.1f} / {motions[last].cents:.1f}",
                f"{sawtooth_correlation(rendering, position):.4f}",
                f"{motion.slip_share:.3f}",
                f"{motion.slip_share * motion.slip_speed / VELOCITY:.4f}",
                f"{rendering.stats.energy.error_max:.0e}",
            ]
        )
        edges.append((position, lowest, highest, several))
        grids.append((position, forces, np.array([m.is_helmholtz for m in motions])))
    head = ["bow at", "lowest force, of Schelleng's", "highest, of Schelleng's", "cents there and between"]
    head += ["correlation with the sawtooth", "share of slip", "slip share × speed / bow", "energy error"]
    publish("bowing", head, rows)
    with figure("bowing", 6, 4.5) as plot:
        for position, forces, played in grids:
            plot.loglog(np.full(forces.size, position)[played], forces[played], "o", color="C0", markersize=4)
            plot.loglog(np.full(forces.size, position)[~played], forces[~played], "x", color="0.7", markersize=4)
        at, lowest_forces, highest_forces, several_forces = np.array(edges).T
        plot.loglog(at, lowest_forces, "C1-", label="Schelleng, lowest")
        plot.loglog(at, highest_forces, "C3-", label="Schelleng, highest")
        plot.loglog(at, several_forces, "k:", label="Friedlander")
        plot.set(xlabel="position of the bow, of the length", ylabel="bow force, N")
        plot.legend()
