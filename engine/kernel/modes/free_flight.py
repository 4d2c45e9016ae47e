"""Free flight: FLIGHT_FRAMES samples at once of an island on which nothing can act.

A step of a mode is then a linear map of (q, p), and so is a flight: a power of it (engine.assembly.free_flight). The
modes move once. What a pickup hears is a sum over modes of tables of FLIGHT_PART samples, times q and p at the first of
them: vectors run over time, and a mode costs two multiply-adds for eight samples.

Samples that are due in another block wait in FreeFlightState.pickup_values, so that blocks of any size give the same
bits. The motion at the begin of a flight is saved: where something acts before its end, the island goes back to it, and
single steps take it to that frame. So an event that was known beforehand, and one that was not, give the same.
"""

from engine.compiler.decorators import inline, noinline
from engine.compiler.lanes import (
    lane_sum,
    load_lanes,
    multiply_add,
    number_at,
    place_after,
    put_number,
    splat,
    store_lanes,
    zero_like,
)
from engine.kernel.data.enums import (
    FLIGHT_FRAMES,
    FLIGHT_MODES,
    FLIGHT_PART,
    EnergyTotal,
    FlightFrame,
    Ledger,
    Quantity,
)
from engine.kernel.modes.mode_step import forget_drift, free_step, motion_of
from engine.kernel.modes.ordered_sums import accumulate, fold_lanes
from engine.kernel.modes.potential import (
    add_fall,
    add_potential,
    begin_output,
    mode_loss_by_weight,
    potential_of,
    push_by_weight,
)

PARTS = FLIGHT_FRAMES // FLIGHT_PART


# --- the modes


@inline
def fly_mode(of, m, sums):
    """Take mode m to the end of a flight, and keep its motion at its begin."""
    flight, saved, q, p = of
    motion, low = flight.motion, flight.motion_low
    x, y = number_at(q, m), number_at(p, m)
    put_number(saved.q, m, x)
    put_number(saved.p, m, y)
    rest = add_fall(flight.weight, m, number_at(low.qq, m) * x + number_at(low.qp, m) * y)
    put_number(q, m, number_at(motion.qq, m) * x + (number_at(motion.qp, m) * y + rest))
    rest = number_at(low.pq, m) * x + number_at(low.pp, m) * y
    put_number(p, m, number_at(motion.pq, m) * x + (number_at(motion.pp, m) * y + rest))
    return sums


@inline
def mode_loss(loss, m, q, p):
    """Energy that mode m, or eight, loses over a flight that begins with q and p, J; but for that due to weight."""
    return (number_at(loss.qq, m) * q + number_at(loss.qp, m) * p) * q + number_at(loss.pp, m) * p * p


@inline
def add_flight_energies(of, m, sums):
    """Add the energies of mode m at the begin of a flight, with and without signs, and what it will lose in it, J."""
    potential, flight, q, p = of
    x, y, zero = number_at(q, m), number_at(p, m), zero_like(number_at(q, m))
    elastic, fallen, fallen_size = add_potential(potential, m, x, (zero, zero, zero))
    vibration = 0.5 * y * y + 0.5 * elastic
    lost = mode_loss(flight.loss, m, x, y) + mode_loss_by_weight(flight.weight, m, x, y)
    return sums[0] + (vibration - fallen), sums[1] + (vibration + fallen_size), sums[2] + lost


@inline
def flight_energies(model, state):
    """Of the modes at the begin of a flight: kinetic and potential energy, the same without signs, and what they will
    lose in it, J."""
    of, zeros = (potential_of(model), model.flight, state.q, state.p), splat(0.0)
    return lane_sum(fold_lanes(add_flight_energies, of, state.p.shape[0], (zeros, zeros, zeros)))


# --- what is heard


@inline
def find_parts(part, begin, count, q, p, parts):
    """The modes begin:begin + count at the first sample of each part, into `parts`: q of all parts, then p."""
    fold_lanes(find_parts_of_mode, (part, begin, q, p, parts), count, (splat(0.0),))


@inline
def find_parts_of_mode(of, k, sums):
    """Write mode begin + k at the first sample of each part into `parts`."""
    part, begin, q, p, parts = of
    m = place_after(k, begin)
    x, y = number_at(q, m), number_at(p, m)
    qq, qp, pq, pp = number_at(part.qq, m), number_at(part.qp, m), number_at(part.pq, m), number_at(part.pp, m)
    for j in range(PARTS):
        put_number(parts, place_after(k, j * FLIGHT_MODES), x)
        put_number(parts, place_after(k, (PARTS + j) * FLIGHT_MODES), y)
        x, y = qq * x + qp * y, pq * x + pp * y
    return sums


@inline
def mode_output(per_q, per_p, parts, k, total):
    """Return `total` with what mode number k of `parts` adds to the eight samples of a part."""
    return multiply_add(per_q, parts[k], multiply_add(per_p, parts[PARTS * FLIGHT_MODES + k], total))


@inline
def add_mode_outputs(tables, row, parts, first, count, output):
    """Add what a pickup hears of modes first:first + count of `parts`. row: of the first one in the tables"""
    a, b, c, d = load_lanes(output, 0), load_lanes(output, 8), load_lanes(output, 16), load_lanes(output, 24)
    e, f, g, h = load_lanes(output, 32), load_lanes(output, 40), load_lanes(output, 48), load_lanes(output, 56)
    for n in range(count):
        table, k = tables[row + n], first + n
        per_q, per_p = load_lanes(table, 0), load_lanes(table, FLIGHT_PART)
        a = mode_output(per_q, per_p, parts, k, a)
        b = mode_output(per_q, per_p, parts, k + FLIGHT_MODES, b)
        c = mode_output(per_q, per_p, parts, k + 2 * FLIGHT_MODES, c)
        d = mode_output(per_q, per_p, parts, k + 3 * FLIGHT_MODES, d)
        e = mode_output(per_q, per_p, parts, k + 4 * FLIGHT_MODES, e)
        f = mode_output(per_q, per_p, parts, k + 5 * FLIGHT_MODES, f)
        g = mode_output(per_q, per_p, parts, k + 6 * FLIGHT_MODES, g)
        h = mode_output(per_q, per_p, parts, k + 7 * FLIGHT_MODES, h)
    store_lanes(output, 0, a)
    store_lanes(output, 8, b)
    store_lanes(output, 16, c)
    store_lanes(output, 24, d)
    store_lanes(output, 32, e)
    store_lanes(output, 40, f)
    store_lanes(output, 48, g)
    store_lanes(output, 56, h)


@inline
def find_outputs(flight, pickups, state):
    """Find the values of each pickup in all samples of a flight."""
    rows, saved = pickups.rows, state.flight
    for n in range(pickups.quantity.shape[0]):
        begin_output(flight.weight, n, saved.pickup_values[n])
    for begin in range(0, state.p.shape[0], FLIGHT_MODES):
        end, has_parts = min(begin + FLIGHT_MODES, state.p.shape[0]), False
        for n in range(pickups.quantity.shape[0]):
            first, last = max(begin, rows.mode_begin[n]), min(end, rows.mode_end[n])
            if first < last and pickups.quantity[n] != Quantity.FORCE:
                if not has_parts:
                    find_parts(flight.part, begin, end - begin, state.q, state.p, saved.parts)
                    has_parts = True
                row = rows.offset[n] + (first - rows.mode_begin[n])
                add_mode_outputs(
                    flight.pickup_tables, row, saved.parts, first - begin, last - first, saved.pickup_values[n]
                )


# --- a flight


@inline
def begin_flight(model, state, measures_energy, frame):
    """Take an island from the begin of a flight to its end; values of pickups and energies meanwhile are saved."""
    flight, saved = model.flight, state.flight
    find_outputs(flight, model.pickups, state)
    saved.frame[FlightFrame.SAVED] = frame
    for column in range(saved.energy_totals.shape[0]):
        saved.energy_totals[column] = state.energy_totals[column]
    if measures_energy:
        measure_flight(model, state, saved)
    forget_drift(state)
    fold_lanes(fly_mode, (flight, saved, state.q, state.p), state.p.shape[0], (splat(0.0),))
    push_by_weight(flight.weight, state.kick_compensation, saved, state.p)


@inline
def measure_flight(model, state, saved):
    """Keep the energies of an island at the begin of a flight, and count what it loses in it. Its contacts are open,
    and hold none."""
    energy, absolute, lost = flight_energies(model, state)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    saved.ledger[Ledger.BALANCE], saved.ledger[Ledger.ABSOLUTE] = energy + spent, absolute
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@noinline
def step_saved_motion(h, saved, frame):
    """Take the saved motion to a frame, by single steps."""
    while saved.frame[FlightFrame.SAVED] < frame:
        lost = free_step(h, motion_of(saved))
        accumulate(saved.energy_totals, EnergyTotal.DISSIPATED, lost)
        saved.frame[FlightFrame.SAVED] += 1


@inline
def exchange(a, b):
    """Exchange the numbers of two arrays."""
    for m in range(a.shape[0]):
        a[m], b[m] = b[m], a[m]


@inline
def exchange_motion(state):
    """Put the saved motion in the place of that at the end of the flight, or back."""
    saved = state.flight
    exchange(state.q, saved.q)
    exchange(state.p, saved.p)
    exchange(state.kick_compensation, saved.kick_compensation)
    exchange(state.energy_totals, saved.energy_totals)


@inline
def end_flight(model, state, frame):
    """End a flight, if there is one: the island is at this frame then, and was taken there by single steps."""
    end = state.flight.frame[FlightFrame.END]
    if end - FLIGHT_FRAMES < frame and frame < end:
        step_saved_motion(model.step, state.flight, frame)
        exchange_motion(state)
        forget_drift(state)
    state.flight.frame[FlightFrame.END] = 0
