"""The ledger: stored + dissipated - supplied = constant (DESIGN sec. 1).

It is measured from the state exactly as for the continuous system (paper, sec. 2.4),
and never changes the scheme.
"""

import numpy as np

from engine.contact import stored
from engine.jit import jit

# columns of a ledger: [frames, columns], J
KINETIC, POTENTIAL, CONTACT, DISSIPATED, SUPPLIED = range(5)
COLUMNS = 5

# a tally: what an audit remembers between blocks
FIRST, LAST, LAST_BALANCE, FIRST_BALANCE, LARGEST, ERROR, STEP_ERROR, COUNT = range(8)


@jit
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
def enter(ledger, i, first, model, state):
    """Write an island's energies into row i of the ledger; all but the first island add."""
    if ledger is not None:
        kinetic, potential = kinetic_and_potential(model.spring, model.gravity, state.q, state.p)
        contact = stored(model.contact, state)
        if first:
            ledger[i, KINETIC] = kinetic
            ledger[i, POTENTIAL] = potential
            ledger[i, CONTACT] = contact
            ledger[i, DISSIPATED] = state.account[0, 0]
            ledger[i, SUPPLIED] = state.account[0, 1]
        else:
            ledger[i, KINETIC] += kinetic
            ledger[i, POTENTIAL] += potential
            ledger[i, CONTACT] += contact
            ledger[i, DISSIPATED] += state.account[0, 0]
            ledger[i, SUPPLIED] += state.account[0, 1]


@jit
def audit(ledger, tally):
    """Follow the balance of the ledger; `tally` keeps what to remember between blocks."""
    frames = ledger.shape[0]
    if frames == 0:
        return
    if tally[COUNT] == 0.0:
        total = ledger[0, KINETIC] + ledger[0, POTENTIAL] + ledger[0, CONTACT]
        tally[FIRST] = total
        tally[FIRST_BALANCE] = tally[LAST_BALANCE] = total + ledger[0, DISSIPATED] - ledger[0, SUPPLIED]
    tally[COUNT] += frames
    first, last = tally[FIRST_BALANCE], tally[LAST_BALANCE]
    largest, error, step = tally[LARGEST], tally[ERROR], tally[STEP_ERROR]
    for i in range(frames):
        total = ledger[i, KINETIC] + ledger[i, POTENTIAL] + ledger[i, CONTACT]
        balance = total + ledger[i, DISSIPATED] - ledger[i, SUPPLIED]
        largest = max(largest, abs(total))
        # written so that NaN is kept, not hidden
        off, jump = abs(balance - first), abs(balance - last)
        error = error if off <= error else off
        step = step if jump <= step else jump
        last = balance
        tally[LAST] = total
    tally[LAST_BALANCE], tally[LARGEST], tally[ERROR], tally[STEP_ERROR] = last, largest, error, step


def summary(ledger_end: np.ndarray, tally: np.ndarray) -> dict[str, float]:
    """Energies in joule; errors relative to the largest energy the scene has held."""
    largest = tally[LARGEST] if tally[LARGEST] > 0 else 1.0
    return {
        "initial": float(tally[FIRST]),
        "final": float(tally[LAST]),
        "supplied": float(ledger_end[SUPPLIED]),
        "dissipated": float(ledger_end[DISSIPATED]),
        "error_max": float(tally[ERROR] / largest),
        "error_per_step_max": float(tally[STEP_ERROR] / largest),
    }
