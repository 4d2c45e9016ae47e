"""Render all partitions of a scene, for programs without Python, which have neither jobs nor helpers."""

from typing import NamedTuple

import numpy as np

from engine.compiler.decorators import INT64_0, inline, kernel
from engine.compiler.struct_types import load_struct
from engine.kernel.data.enums import Ledger
from engine.kernel.run.render_block import output_view, render_partition
from engine.runtime.energy_balance import follow_energies
from engine.runtime.partitions import LEDGER_ROWS


class Whole(NamedTuple):
    """The sums of a block of a scene."""

    audio: np.ndarray  # [frames, channels], of all partitions
    ledger: np.ndarray  # [rows (engine.kernel.data.enums.Ledger), frames]
    balance: np.ndarray  # engine.runtime.energy_balance.Balance


@kernel
def render_whole(model, state, output, whole, frames):
    """Render the next samples of a scene.

    model, state, output, whole: addresses of a Model, of a State, of the BlockOutput of a partition, and of a Whole
    frames: number of samples; they fill the first rows of the whole
    """
    scene, moving, total = load_struct(model), load_struct(state), load_struct(whole)
    part = output_view(load_struct(output))
    for partition in range(scene.islands.partition.shape[0] - 1):
        render_partition(scene, moving, part, partition, frames)
        add_rows(part.audio, total.audio, frames, partition == 0)
        for row in range(LEDGER_ROWS):
            add_row(part.ledger[row], total.ledger[row], frames, partition == 0)
    follow_energies(total.balance, total.ledger[Ledger.BALANCE], total.ledger[Ledger.ABSOLUTE], frames)


@inline
def add_rows(part, total, frames, is_first):
    """Add rows of audio to those of the whole; the first partition sets them."""
    for i in range(frames):
        add_row(part[i], total[i], total.shape[1], is_first)


@inline
def add_row(part, total, count, is_first):
    """Add numbers to a row of the whole; the first partition sets it."""
    for k in range(INT64_0, count):
        total[k] = part[k] if is_first else total[k] + part[k]
