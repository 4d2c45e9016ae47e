"""One-way drive: ends of strings push bodies that do not act back on them.

Pickups on the strings write their forces to a ring of samples, and external forces on the bodies read them. In each
chunk of samples the strings run first (engine.assembly.one_way_drive). The force of a step is the mean of the two
samples before its end, one sample late. Its work counts as supplied, as that of any external force.
"""

from engine.compiler.decorators import inline
from engine.kernel.data.effects import DRIVE, EFFECTS
from engine.kernel.data.enums import DRIVE_FRAMES

LAST = DRIVE_FRAMES - 1  # frame & LAST is frame modulo DRIVE_FRAMES


@inline
def clear_drive(drive, ring, islands, frame, count):
    """Set the forces that drive bodies of some islands to zero, for `count` samples from `frame` on.

    islands: the first, and the last + 1
    """
    if EFFECTS & DRIVE:
        for n in range(drive.island.shape[0]):
            if islands[0] <= drive.island[n] < islands[1]:
                for k in range(frame, frame + count):
                    ring[n, k & LAST] = 0.0


@inline
def put_sample(ring, row, channel, frame, value):
    """Add the value of a pickup to a row of the audio; or, if its channel is negative, to the force that drives a body
    at this frame."""
    if EFFECTS & DRIVE:
        if channel < 0:
            ring[-1 - channel, frame & LAST] += value
            return
    row[channel] += value


@inline
def driven_force(ring, n, frame):
    """Return the force at driven point n over the step that begins at this frame, N."""
    return 0.5 * (ring[n, (frame - 1) & LAST] + ring[n, frame & LAST])
