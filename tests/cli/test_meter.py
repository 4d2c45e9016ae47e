"""The line that shows how live sound does: it fits a terminal, and begins with what matters while one plays."""

import pytest

from engine.cli.terminal import format_meter
from engine.live.meter import MeterReading
from engine.offline.statistics import NewtonStatistics


def reading(**changes) -> MeterReading:
    fields = dict.fromkeys(MeterReading.__dataclass_fields__, 0)
    newton = NewtonStatistics(**(dict.fromkeys(NewtonStatistics.__dataclass_fields__, 0) | {"mean": 1.25, "max": 14}))
    calm = {"seconds": 12.34, "peak": 0.25, "real_time_factor": 5.2, "worst_block": 0.45, "energy_error": 2e-13}
    return MeterReading(**(fields | calm | {"awake": 3, "islands": 12, "newton": newton} | changes))


def test_a_meter_begins_with_level_load_and_dropouts():
    assert format_meter(reading(), 256, 0.012).startswith("-12.0 dB  load 45%  dropouts 0  12.3 s")
    assert format_meter(reading(peak=0.0), 256, 0.012).startswith("  silent  load 45%  dropouts 0")
    assert format_meter(reading(dropouts=3), 256, 0.012).startswith(
        "-12.0 dB  load 45%  dropouts 3 (try --block-size 512)"
    )


@pytest.mark.parametrize("columns", [30, 40, 80])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"voices": 8, "sounding": 3},
        {"dropouts": 12_345, "limited": 10**9, "quality_steps": 137, "quality": 4, "voices": 64, "sounding": 64},
        {"seconds": 1e6, "worst_block": 1234.0, "awake": 1000, "islands": 1000, "peak": 1e12},
    ],
)
def test_a_meter_fits_its_line(changes, columns):
    """However bad things are; what is left out is what matters least."""
    line = format_meter(reading(**changes), 4096, 0.012, columns)
    assert len(line) <= columns and " dB  load " in line
    assert columns < 80 or "dropouts" in line


def test_a_meter_of_80_columns_shows_iterations_energy_and_islands_while_all_is_well():
    line = format_meter(reading(), 256, 0.012, 80)
    assert len(line) <= 80
    assert all(part in line for part in ("energy 2e-13", "Newton 1.2/14", "active 3/12"))


def test_a_wide_meter_shows_the_latency_of_the_device():
    assert "  latency 12 ms" in format_meter(reading(), 256, 0.0118, 110)
    assert "latency" not in format_meter(reading(), 256, None, 110)
