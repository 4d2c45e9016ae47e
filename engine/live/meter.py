"""The reading of a meter of live sound."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from engine.offline.statistics import NewtonStatistics
from engine.offline.statistics_base import Statistics


@dataclass(frozen=True)
class MeterReading(Statistics):
    """Live sound up to now; the names of `fdh play --json`."""

    seconds: float
    peak: float  # since the last reading
    real_time_factor: float
    worst_block: float  # time it took, as a share of its deadline
    dropouts: int
    limited: int  # samples held back by the limiter
    capped: int  # samples that would have needed more steps than live sound allows, to keep `max_error`
    not_finite: int  # samples that were no numbers, and silenced
    dropped: int  # events, of which there were too many at once
    lost: int  # samples of the recording
    newton: NewtonStatistics
    energy_error: float  # relative to the largest energy held
    quality_steps: int
    quality: int  # 0 is full
    awake: int  # islands that move
    islands: int
    voices: int
    sounding: int  # voices with an island that moves
    kernel: str  # special or general (engine.runtime.kernel_choice)
    table_digest: str  # of the tables that it began with (engine.assembly.table_digest)


SUMS = "seconds", "dropouts", "limited", "capped", "not_finite", "dropped", "lost", "quality_steps"
LARGEST = "worst_block", "energy_error"


def join_readings(before: Sequence[MeterReading], now: MeterReading) -> MeterReading:
    """Return the reading of a session whose players took over from each other. before: of those that are over"""
    readings = [*before, now]
    sums = {name: sum(getattr(one, name) for one in readings) for name in SUMS}
    return replace(now, **sums, **{name: max(getattr(one, name) for one in readings) for name in LARGEST})
