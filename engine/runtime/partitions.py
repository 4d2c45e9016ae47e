"""Render a block of all partitions of a scene, on one core or on several, and add them.

The thread that renders a block shares the work with helpers (engine.runtime.helpers): each takes the next partition
that nobody has begun, until there is none. The thread takes part itself, and at last waits only for partitions that a
helper is at work on. Partitions are added in one order, so that the sum is the same however they ran.

One number decides which partition is taken: generation · 2^16 + the next partition. It only grows, so that a number
that a helper read long ago is never taken for one of a later block.
"""

from engine.compiler.decorators import INT64_0, inline, kernel
from engine.compiler.intrinsics import (
    atomic_add,
    atomic_exchange,
    call_address,
    float64_view,
    int64_view,
    load_acquire,
    monotonic_seconds,
    store_release,
)
from engine.kernel.data.enums import BALANCE_SIZE, Ledger
from engine.runtime.energy_balance import follow_energies
from engine.runtime.jobs import Crew, Job

GENERATION = 1 << 16  # more than there are partitions
# Tried: a job for each core in a pool of Python's threads. To hand one over takes 50 µs, most of a block of 64 frames.
SPIN_SECONDS = 50e-6  # s that a helper looks for work before it sleeps
LEDGER_ROWS, NUMBER_BYTES = len(Ledger), 8


JOB_SLOTS, CREW_SLOTS = len(Job), len(Crew)


@inline
def render_one(job, partition):
    """Render one partition of a block."""
    output = int64_view(job[Job.OUTPUTS], job[Job.PARTITIONS])[partition]
    call_address(job[Job.RENDER_BLOCK], (job[Job.MODEL], job[Job.STATE], output, partition, job[Job.FRAMES]))


@inline
def take_partitions(crew):
    """Render partitions that nobody has begun, until there is none."""
    while True:
        number = atomic_add(crew, Crew.NEXT, 1)
        work = load_acquire(crew, Crew.RANGE)
        first = work // GENERATION * GENERATION
        if number < first or number >= work:
            return
        render_one(int64_view(crew[Crew.JOB], JOB_SLOTS), number - first)
        atomic_add(crew, Crew.DONE, 1)


@inline
def is_work_left(crew):
    """True if a partition is probably left; only `take_partitions` decides."""
    return load_acquire(crew, Crew.NEXT) < load_acquire(crew, Crew.RANGE)


@inline
def share_partitions(job, address):
    """Render all partitions of a block together with the helpers. address: of the job"""
    crew, count = int64_view(job[Job.CREW], CREW_SLOTS), job[Job.PARTITIONS]
    first = (crew[Crew.RANGE] // GENERATION + 1) * GENERATION
    crew[Crew.JOB] = address
    store_release(crew, Crew.DONE, INT64_0)
    store_release(crew, Crew.RANGE, first + count)
    atomic_exchange(crew, Crew.NEXT, first)
    for _ in range(min(atomic_add(crew, Crew.ASLEEP, 0), count - 1)):
        call_address(crew[Crew.POST], (crew[Crew.SEMAPHORE], 1, 0))
    take_partitions(crew)
    while load_acquire(crew, Crew.DONE) < count:
        pass


@inline
def sum_partitions(job):
    """Add the outputs of all partitions. The output of a single partition is the sum already."""
    parts, frames = job[Job.PARTITIONS], job[Job.FRAMES]
    if parts > 1:
        add_arrays(int64_view(job[Job.AUDIOS], parts), job[Job.AUDIO], INT64_0, frames * job[Job.CHANNELS])
        if job[Job.LEDGER] != 0:
            for row in range(LEDGER_ROWS):
                offset = row * job[Job.CAPACITY]
                add_arrays(int64_view(job[Job.LEDGERS], parts), job[Job.LEDGER], offset, frames)


@inline
def follow_balance(job):
    """Update the energy balance by the energies of a block, where they are measured."""
    if job[Job.LEDGER] != 0:
        row, frames = NUMBER_BYTES * job[Job.CAPACITY], job[Job.FRAMES]
        balances = float64_view(job[Job.LEDGER] + Ledger.BALANCE * row, frames)
        absolutes = float64_view(job[Job.LEDGER] + Ledger.ABSOLUTE * row, frames)
        follow_energies(float64_view(job[Job.BALANCE], BALANCE_SIZE), balances, absolutes, frames)


@inline
def add_arrays(sources, target, offset, count):
    """Write the sum of arrays, at addresses, to another array: `count` numbers from number `offset` on."""
    total = float64_view(target + NUMBER_BYTES * offset, count)
    for part in range(sources.shape[0]):
        values = float64_view(sources[part] + NUMBER_BYTES * offset, count)
        if part == 0:
            for i in range(count):
                total[i] = values[i]
        else:
            for i in range(count):
                total[i] += values[i]


@inline
def render_partitions(address, frames):
    """Render the next frames of all partitions of the job at an address, add them, and update the energy balance."""
    job = int64_view(address, JOB_SLOTS)
    job[Job.FRAMES] = frames
    if job[Job.CREW] == 0:
        for partition in range(job[Job.PARTITIONS]):
            render_one(job, partition)
    else:
        share_partitions(job, address)
    sum_partitions(job)
    follow_balance(job)


@kernel
def render_job(address, frames):
    """Render the next frames of all partitions of the job at an address, from Python."""
    render_partitions(address, frames)


@kernel
def help_crew(address):
    """Run a helper until Crew.STOP is set: look for work, and sleep if there has been none for a while."""
    crew = int64_view(address, CREW_SLOTS)
    while load_acquire(crew, Crew.STOP) == 0:
        take_partitions(crew)
        idle_since = monotonic_seconds(crew[Crew.CLOCK])
        while not is_work_left(crew) and load_acquire(crew, Crew.STOP) == 0:
            if monotonic_seconds(crew[Crew.CLOCK]) - idle_since > SPIN_SECONDS:
                atomic_add(crew, Crew.ASLEEP, 1)
                if not is_work_left(crew) and load_acquire(crew, Crew.STOP) == 0:
                    call_address(crew[Crew.WAIT], (crew[Crew.SEMAPHORE], -1))
                atomic_add(crew, Crew.ASLEEP, -1)
                idle_since = monotonic_seconds(crew[Crew.CLOCK])
