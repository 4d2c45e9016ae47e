"""Data for the kernels that render a block, and for the threads that do so together: integers and addresses."""

from enum import IntEnum


class Job(IntEnum):
    """Integers and addresses that describe a block of a scene."""

    RENDER_BLOCK = 0  # address of the kernel
    MODEL = 1
    STATE = 2
    PARTITIONS = 3
    CHANNELS = 4
    OUTPUTS = 5  # address of addresses: of the BlockOutput of each partition
    AUDIOS = 6  # address of addresses: of the audio of each partition
    LEDGERS = 7  # address of addresses: of the ledger of each partition
    AUDIO = 8  # address of the sum of the audio [frames, channels]
    LEDGER = 9  # address of the sum of the ledgers [rows, CAPACITY]; 0: energies are not measured
    CAPACITY = 10  # frames that a block may have
    BALANCE = 11  # address of the Balance
    CREW = 12  # address of what the helpers share; 0: there are none
    FRAMES = 13  # of the block


class Crew(IntEnum):
    """Integers and addresses that the rendering thread and its helpers share."""

    JOB = 0  # address of the Job
    RANGE = 1  # generation · 2^16 + the number of partitions
    NEXT = 2  # generation · 2^16 + the next partition that nobody has begun
    DONE = 3  # partitions that are finished
    ASLEEP = 4  # helpers that wait to be woken
    STOP = 5  # 1: helpers are to end
    SEMAPHORE = 6
    WAIT = 7  # address of the function that waits on it
    POST = 8  # address of the function that posts it
    CLOCK = 9  # address of a Clock
