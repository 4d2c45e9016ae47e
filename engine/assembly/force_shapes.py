"""External forces as functions of time (engine.kernel.interactions.force_shapes), for samples in stages."""

import math
from typing import NamedTuple

import numpy as np

from engine.assembly.array_memory import ABSENT
from engine.assembly.external_forces import PluckPoint, force_ends, raise_sine
from engine.assembly.islands import begins_of
from engine.assembly.one_way_drive import DriveForce
from engine.kernel.data.enums import ForceKind
from engine.kernel.data.model import ForceShapes
from engine.patch.accuracy import Accuracy
from engine.patch.tables import (
    ConstantForce,
    Force,
    HalfSineForce,
    NoiseForce,
    PluckForce,
    PulseForce,
    SampledForce,
    SineForce,
)


class ForceShape(NamedTuple):
    """An external force as a function of time."""

    kind: ForceKind
    numbers: list[float]  # engine.kernel.data.enums.ForceNumber
    envelope: list[list[float]]  # frames after the start, and factor
    line: np.ndarray  # N, at each frame, of LINES


TABLE = ForceShape(ForceKind.TABLE, [0.0] * 6, [], np.zeros(0))


def force_shapes(
    forces: list[Force | PluckPoint | DriveForce], samplerate: float, seconds: float, accuracy: Accuracy
) -> ForceShapes:
    """Return the forces of a layout as functions of time; ABSENT without any. seconds: of the sound"""
    if not forces:
        return ABSENT
    shapes = [force_shape(force, samplerate, seconds, accuracy) for force in forces]
    envelopes = begins_of([len(shape.envelope) for shape in shapes])
    points = np.array([point for shape in shapes for point in shape.envelope]).reshape(-1, 2)
    return ForceShapes(
        kind=np.array([shape.kind for shape in shapes], np.int64),
        number=np.array([shape.numbers for shape in shapes]),
        envelope_begin=envelopes[:-1],
        envelope_end=envelopes[1:],
        envelope_time=points[:, 0].copy(),
        envelope_factor=points[:, 1].copy(),
        line_begin=begins_of([shape.line.size for shape in shapes])[:-1],
        line=np.concatenate([shape.line for shape in shapes]),
    )


def force_shape(
    force: Force | PluckPoint | DriveForce, samplerate: float, seconds: float, accuracy: Accuracy
) -> ForceShape:
    """Return a force as a function of time, if it is one."""
    if isinstance(force, DriveForce | PluckPoint):
        return TABLE
    if isinstance(force, NoiseForce | SampledForce):
        return ForceShape(ForceKind.LINES, TABLE.numbers, [], force_ends(force, samplerate, seconds))
    start, amplitude = force.start * samplerate, force.amplitude
    envelope = getattr(force, "envelope", None) or []
    points = [[time * samplerate, factor] for time, factor in envelope]
    if isinstance(force, ConstantForce):
        return ForceShape(ForceKind.LEVEL, [start, math.inf, amplitude, 0.0, 0.0, 0.0], points, TABLE.line)
    duration = force.duration * samplerate
    if isinstance(force, PulseForce):
        return ForceShape(ForceKind.LEVEL, [start, duration, amplitude, 0.0, 0.0, 0.0], points, TABLE.line)
    if isinstance(force, HalfSineForce):
        return ForceShape(ForceKind.HALF_SINE, [start, duration, amplitude, 0.0, 0.0, 0.0], points, TABLE.line)
    if isinstance(force, PluckForce):
        fall = force.release * samplerate
        return ForceShape(ForceKind.PLUCK, [start, duration, amplitude, 0.0, 0.0, fall], points, TABLE.line)
    assert isinstance(force, SineForce)
    frequency, phase = force.frequency / samplerate, force.phase / (2 * math.pi)
    if accuracy.scheme == "exact" and accuracy.order == 2 and accuracy.max_error is None:
        amplitude *= raise_sine(frequency / accuracy.substeps)  # steps of other lengths need no such help, or another
    numbers = [start, duration, amplitude, frequency, phase, force.fade * samplerate]
    return ForceShape(ForceKind.SINE, numbers, points, TABLE.line)
