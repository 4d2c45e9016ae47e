"""Hours of live sound, as fast as they can be computed: memory does not grow."""

import gc
import math
import os
from pathlib import Path

import numpy as np
import pytest

import engine
from engine.live.log_file import LogFile
from engine.live.player import Player

RATE, BLOCK = 44_100, 1024
SETTLED, MOST_GROWTH = 0.1, 20.0  # of the time; MiB
STATM = Path("/proc/self/statm")


def resident_mebibytes() -> float:
    """Return the memory that this process holds."""
    gc.collect()
    return int(STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.slow_but_each(2)
@pytest.mark.hard
@pytest.mark.skipif(not STATM.exists(), reason="no /proc")
@pytest.mark.parametrize(("is_logged", "hours"), [(False, 2.0), (True, 0.5)])
def test_hours_take_no_more_memory(is_logged: bool, hours: float, tmp_path: Path) -> None:
    """A hammer strikes twice a second, a slider moves ten times, and a string is tuned now and then."""
    player = Player(engine.load("piano_c4"), RATE, math.inf, 1e-3, log=is_logged)
    log = LogFile(tmp_path / "log.json", player) if is_logged else None
    out, blocks = np.zeros((BLOCK, player.channels), np.float32), round(hours * 3600 * RATE / BLOCK)
    settled = 0.0
    for n in range(blocks):
        if n % 22 == 0:
            player.strike("hammer", 1.0 + n % 5)
        if n % 4 == 0:
            player.set("contact.felt.stiffness", 2e9 + 1e6 * (n % 100), 0.05)
        if n % 4000 == 0:
            player.set("body.string.frequency", 261.0 + n % 7, 0.05)
        player.render_into(out)
        if n % 43 == 0:
            player.meter()
            player.fetch_recording()
            if log is not None:
                log.write()
        if n == round(SETTLED * blocks):
            settled = resident_mebibytes()
    assert np.isfinite(out).all() and player.meter()["energy_error"] < 1e-9
    assert player.meter()["dropped"] == 0
    assert resident_mebibytes() - settled <= MOST_GROWTH
    if log is not None:
        log.close()
        assert log.target.stat().st_size > 1e6
