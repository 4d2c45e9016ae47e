"""Columns of State.law_numbers of felt with memory (engine.kernel.contact.felt_law)."""

from enum import IntEnum

from engine.kernel.data.enums import Sliding


class FeltNumber(IntEnum):
    """Columns of State.law_numbers of felt with memory, behind those of friction."""

    SHARE = len(Sliding)  # ε, of the stiffness that relaxes; 0 of all other contacts
    RATE = SHARE + 1  # 1/T, per frame
    CREPT = SHARE + 2  # z, m
    TIME = SHARE + 3  # at which z is valid, frames
    LENGTH = SHARE + 4  # of the present step, frames
    LAST = SHARE + 5  # ζ of the last step, m
