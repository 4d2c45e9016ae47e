"""The ledger: stored + dissipated - supplied = constant (DESIGN sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

import numpy as np

from engine.contact import stored
from engine.jit import jit, summing

# columns of a ledger: [samples, columns], J
STORED, SPENT, HELD = 0, 1, 2  # SPENT: dissipated less supplied; HELD: all parts without their signs
COLUMNS = 3

# columns of State.account: [islands, columns], J; each sum is followed by the rounding it carries
DISSIPATED, SUPPLIED = np.int64(0), np.int64(2)
ACCOUNTS = 4

# a tally: what an audit remembers between blocks
FIRST, LAST, LAST_BALANCE, FIRST_BALANCE, LARGEST, ERROR, STEP_ERROR, COUNT = range(8)
TALLY = 8


@summing
def kinetic_and_potential(spring, gravity, q, p):
    """½p², and ½ω²q² - weight·q, summed over modes, J."""
    kinetic = 0.0
    potential = 0.0
    for m in range(p.shape[0]):
        kinetic += 0.5 * p[m] * p[m]
        if spring is not None:
            potential += 0.5 * spring.stiffness[m] * q[m] * q[m]
        if gravity is not None:
            potential -= gravity.weight[m] * q[m]
    return kinetic, potential


@jit
def book(account, column, amount):
    """Add to an island's account. Small amounts on a large sum: rounding is carried (Kahan)."""
    amount += account[column + 1]
    before = account[column]
    account[column] = before + amount
    account[column + 1] = amount - (account[column] - before)


@jit
def enter(ledger, i, count, first, model, state):
    """Write an island's energies into `count` rows of the ledger from i on; all but the first island add."""
    kinetic, potential = kinetic_and_potential(model.spring, model.gravity, state.q, state.p)
    squeezed = stored(model.contact, state)
    total = kinetic + potential + squeezed
    held = kinetic + abs(potential) + squeezed  # a falling ball holds energy, though its total may be 0
    spent = state.account[DISSIPATED] - state.account[SUPPLIED]
    for row in range(i, i + count):
        if first:
            ledger[row, STORED] = total
            ledger[row, SPENT] = spent
            ledger[row, HELD] = held
        else:
            ledger[row, STORED] += total
            ledger[row, SPENT] += spent
            ledger[row, HELD] += held


@np.errstate(all="ignore")  # energies may be infinite
def audit(ledger: np.ndarray, tally: np.ndarray) -> None:
    """Follow the balance over the rows of a ledger; `tally` keeps what to remember between blocks."""
    if len(ledger) == 0:
        return
    if tally[COUNT] == 0.0:
        tally[FIRST] = ledger[0, STORED]
        tally[FIRST_BALANCE] = tally[LAST_BALANCE] = ledger[0, STORED] + ledger[0, SPENT]
    balance = ledger[:, STORED] + ledger[:, SPENT]
    jumps = np.diff(balance, prepend=tally[LAST_BALANCE])
    # NumPy's max keeps a NaN
    tally[LARGEST] = np.maximum(tally[LARGEST], ledger[:, HELD].max())
    tally[ERROR] = np.maximum(tally[ERROR], np.abs(balance - tally[FIRST_BALANCE]).max())
    tally[STEP_ERROR] = np.maximum(tally[STEP_ERROR], np.abs(jumps).max())
    tally[COUNT] += len(ledger)
    tally[LAST], tally[LAST_BALANCE] = ledger[-1, STORED], balance[-1]


def summary(tally: np.ndarray, account: np.ndarray) -> dict[str, float]:
    """Energies in joule; errors relative to the largest energy the scene has held, kinetic and
    potential counted each without sign.

    tally: as left by `audit`; account: State.account.
    """
    largest = tally[LARGEST] if tally[LARGEST] > 0 else 1.0
    return {
        "initial": float(tally[FIRST]),
        "final": float(tally[LAST]),
        "supplied": float(account[:, SUPPLIED].sum()),
        "dissipated": float(account[:, DISSIPATED].sum()),
        "error_max": float(tally[ERROR] / largest),
        "error_per_step_max": float(tally[STEP_ERROR] / largest),
    }
