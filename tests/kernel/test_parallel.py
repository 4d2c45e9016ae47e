"""A block on several cores: the same samples however partitions were shared, and nobody waits for who has not begun."""

import gc
import math
import threading
import time

import numpy as np
import pytest

import engine
from bench.scenes.families import hammered
from engine.assembly.build import build
from engine.live.player import Player
from engine.offline.simulation import Simulation
from engine.runtime.helpers import Helpers
from engine.runtime.partitions import Crew

RATE = 44_100


def rendered(cores: int, sizes: list[int], frames: int = 4000) -> np.ndarray:
    """Sixteen hammered strings, in blocks of these sizes over and over."""
    model, state, _ = build(hammered(16, 20), RATE)
    simulation, out, at = Simulation(model, state, cores), np.zeros((frames, 1)), 0
    while at < frames:
        size = min(sizes[at % len(sizes)], frames - at)
        simulation.render_block(out[at : at + size])
        at += size
    assert simulation.energies().error_max <= 1e-13
    return out


@pytest.mark.parametrize("cores", [2, 3, 8])
def test_the_samples_do_not_depend_on_cores(cores):
    """Also with more cores than the machine has, in blocks of a sample and of many."""
    alone = rendered(1, [64])
    for sizes in ([64], [1, 7, 300], [4000]):
        np.testing.assert_array_equal(rendered(cores, sizes), alone)


def test_a_thousand_small_blocks_with_pauses():
    """Helpers that sleep between blocks are woken, and no partition is lost or rendered twice."""
    model, state, _ = build(hammered(8, 10), RATE)
    simulation, out = Simulation(model, state, 2, measure_energy=False), np.zeros((16, 1))
    for n in range(1000):
        simulation.render_block(out)
        if n % 50 == 0:
            time.sleep(0.002)
    assert (state.frame == 16_000).all()


def test_nobody_waits_for_a_helper_that_has_not_begun():
    """With helpers that never come, the thread that renders does all itself."""
    model, state, _ = build(hammered(8, 10), RATE)
    simulation, out = Simulation(model, state), np.zeros((64, 1))
    absent = Helpers(0)
    simulation.memory(64, 1).use_helpers(absent)
    simulation.render_block(out)
    assert (state.frame == 64).all() and out.any()


@pytest.mark.hard
def test_helpers_end_with_who_asked_for_them():
    def running() -> int:
        return sum(thread.name.startswith("fdh helper") for thread in threading.enumerate())

    before = running()
    helpers = Helpers(3)
    assert running() == before + 3
    helpers.stop()
    assert running() == before
    player = Player(hammered(8, 10), gain=1e-3, cores=2)
    assert running() == before + 1
    del player, helpers
    gc.collect()
    assert running() == before


def test_live_sound_is_the_same_on_two_cores():
    """Bit for bit, with events and in random blocks, and the energies as well."""
    played, rng = [], np.random.default_rng(1)
    sizes, strikes = rng.integers(1, 500, 100), rng.integers(0, 16, 100)
    for cores in (1, 2):
        player = Player(hammered(16, 20), gain=1e-3, seconds=math.inf, cores=cores)
        out, at = np.zeros((int(sizes.sum()), 1), np.float32), 0
        for size, string in zip(sizes.tolist(), strikes.tolist(), strict=True):
            player.strike(f"hammer{string}", 2.0)
            player.render_into(out[at : at + size])
            at += size
        played.append((out, player.meter()["energy_error"]))
    np.testing.assert_array_equal(played[0][0], played[1][0])
    assert played[0][1] == played[1][1] <= 1e-12


def test_idle_helpers_sleep():
    """They use no time while there is nothing to do."""
    helpers = Helpers(2)
    time.sleep(0.05)
    assert helpers.crew[Crew.ASLEEP] == 2
    begin = time.process_time()
    time.sleep(0.3)
    assert time.process_time() - begin < 0.03
    helpers.stop()


def test_a_scene_of_one_partition_needs_no_helper():
    before = threading.active_count()
    engine.render(hammered(1, 10), seconds=0.01, cores=2)
    assert threading.active_count() == before
