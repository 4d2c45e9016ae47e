"""Free flight: FLIGHT_FRAMES samples at once of an island on which nothing can act.

A step of a mode is then a linear map of (q, p), and so is a flight: a power of it (engine.build.flight_tables). The
modes move once. What a pickup hears is a sum over modes of tables of FLIGHT_PART samples, times q and p at the first of
them: vectors run over time, and a mode costs two multiply-adds for eight samples.

Samples that are due in another block wait in FreeFlightState.pickup_values, so that blocks of any size give the same
bits. The motion at the begin of a flight is kept: where something acts before its end, the island goes back to it, and
single steps take it to that frame. So an event that was known beforehand, and one that was not, give the same.
"""

from engine.compiler.decorators import INT64_0, inline, noinline
from engine.compiler.lanes import (
    EightFrom,
    FewFrom,
    lane_sum,
    load_lanes,
    magnitude,
    multiply_add,
    number_at,
    splat,
    store_lanes,
    zero_like,
)
from engine.kernel.data.enums import (
    FLIGHT_FRAMES,
    FLIGHT_MODES,
    FLIGHT_PART,
    LANES,
    EnergyTotal,
    FlightFrame,
    Ledger,
    Quantity,
)
from engine.kernel.modes.mode_energies import accumulate, mode_potential
from engine.kernel.modes.mode_step import forget_drift, free_step, motion_of
from engine.kernel.modes.ordered_sums import lanes_of

PARTS = FLIGHT_FRAMES // FLIGHT_PART


# --- the modes


@inline
def advance_modes(motion, low, weight, kept, q, p):
    """Take all modes to the end of a flight, and keep their motion at its begin; but for what weight adds to p. low:
    what rounding cut from `motion`

    What weight adds to q is the same in every flight. Added to q by itself it would be rounded the same way every
    time, and the energy of a falling body would drift; so it is part of a sum that differs.
    """
    vectors = p.shape[0] // LANES * LANES
    for m in range(0, vectors, LANES):
        x, y = load_lanes(q, m), load_lanes(p, m)
        store_lanes(kept.q, m, x)
        store_lanes(kept.p, m, y)
        rest = load_lanes(low.qq, m) * x + load_lanes(low.qp, m) * y
        if weight is not None:
            rest = rest + load_lanes(weight.q, m)
        store_lanes(q, m, load_lanes(motion.qq, m) * x + (load_lanes(motion.qp, m) * y + rest))
        rest = load_lanes(low.pq, m) * x + load_lanes(low.pp, m) * y
        store_lanes(p, m, load_lanes(motion.pq, m) * x + (load_lanes(motion.pp, m) * y + rest))
    for m in range(vectors, p.shape[0]):
        x, y = q[m], p[m]
        kept.q[m], kept.p[m] = x, y
        rest = low.qq[m] * x + low.qp[m] * y
        if weight is not None:
            rest += weight.q[m]
        q[m] = motion.qq[m] * x + (motion.qp[m] * y + rest)
        p[m] = motion.pq[m] * x + (motion.pp[m] * y + (low.pq[m] * x + low.pp[m] * y))


@inline
def push_by_weight(weight, compensation, kept, p):
    """Add what weight gives p over a flight. As engine.kernel.modes.mode_step.kick_by_weight, it carries what rounding
    leaves of the push."""
    if weight is not None:
        for m in range(p.shape[0]):
            kept.kick_compensation[m] = compensation[m]
            push = weight.p[m] + (weight.p_low[m] - compensation[m])
            moved = p[m] + push
            compensation[m] = (moved - p[m]) - push
            p[m] = moved


@inline
def mode_loss(loss, m, q, p):
    """Energy that mode m, or eight, loses over a flight that begins with q and p, J; but for that due to weight."""
    if loss is None:
        return zero_like(q)
    return (number_at(loss.qq, m) * q + number_at(loss.qp, m) * p) * q + number_at(loss.pp, m) * p * p


@inline
def mode_loss_by_weight(weight, m, q, p):
    """The part of it that is due to weight, J."""
    if weight is None:
        return zero_like(q)
    return number_at(weight.lost_per_q, m) * q + number_at(weight.lost_per_p, m) * p + number_at(weight.lost, m)


@inline
def flight_energies_of(omega_squared, weight, flight, m, q, p):
    """Return the energies of mode m, or of eight, at the begin of a flight, and what it will lose in it, J."""
    x, y = number_at(q, m), number_at(p, m)
    elastic, fallen = mode_potential(omega_squared, weight, m, x)
    vibration = 0.5 * y * y + elastic
    lost = mode_loss(flight.loss, m, x, y) + mode_loss_by_weight(flight.weight, m, x, y)
    return vibration - fallen, vibration + magnitude(fallen), lost


@inline
def flight_energies(omega_squared, weight, flight, q, p):
    """Of the modes at the begin of a flight: kinetic and potential energy, the same without signs, and what they will
    lose in it, J."""
    lanes, a, b, c = lanes_of(p.shape[0]), splat(0.0), splat(0.0), splat(0.0)
    for m in range(INT64_0, lanes, LANES):
        parts = flight_energies_of(omega_squared, weight, flight, EightFrom(m), q, p)
        a, b, c = a + parts[0], b + parts[1], c + parts[2]
    if lanes < p.shape[0]:
        parts = flight_energies_of(omega_squared, weight, flight, FewFrom(lanes, p.shape[0] - lanes), q, p)
        a, b, c = a + parts[0], b + parts[1], c + parts[2]
    return lane_sum(a), lane_sum(b), lane_sum(c)


# --- what is heard


@inline
def find_parts(part, begin, count, q, p, parts):
    """The modes begin:begin + count at the first sample of each part, into `parts`: q of all parts, then p."""
    vectors = count // LANES * LANES
    for k in range(0, vectors, LANES):
        x, y = load_lanes(q, begin + k), load_lanes(p, begin + k)
        qq, qp = load_lanes(part.qq, begin + k), load_lanes(part.qp, begin + k)
        pq, pp = load_lanes(part.pq, begin + k), load_lanes(part.pp, begin + k)
        for j in range(PARTS):
            store_lanes(parts, j * FLIGHT_MODES + k, x)
            store_lanes(parts, (PARTS + j) * FLIGHT_MODES + k, y)
            x, y = qq * x + qp * y, pq * x + pp * y
    for k in range(vectors, count):
        m = begin + k
        x, y = q[m], p[m]
        for j in range(PARTS):
            parts[j * FLIGHT_MODES + k], parts[(PARTS + j) * FLIGHT_MODES + k] = x, y
            x, y = part.qq[m] * x + part.qp[m] * y, part.pq[m] * x + part.pp[m] * y


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
def begin_output(weight, n, output):
    """Begin the samples of pickup n with those of bodies that fall: the rest is added to it."""
    if weight is None:
        for i in range(0, FLIGHT_FRAMES, LANES):
            store_lanes(output, i, splat(0.0))
    else:
        for i in range(0, FLIGHT_FRAMES, LANES):
            store_lanes(output, i, load_lanes(weight.pickup_values[n], i))


@inline
def find_outputs(flight, pickups, state):
    """Find the values of each pickup in all samples of a flight."""
    rows, kept = pickups.rows, state.flight
    for n in range(pickups.quantity.shape[0]):
        begin_output(flight.weight, n, kept.pickup_values[n])
    for begin in range(0, state.p.shape[0], FLIGHT_MODES):
        end, has_parts = min(begin + FLIGHT_MODES, state.p.shape[0]), False
        for n in range(pickups.quantity.shape[0]):
            first, last = max(begin, rows.mode_begin[n]), min(end, rows.mode_end[n])
            if first < last and pickups.quantity[n] != Quantity.CONTACT_FORCE:
                if not has_parts:
                    find_parts(flight.part, begin, end - begin, state.q, state.p, kept.parts)
                    has_parts = True
                row = rows.offset[n] + (first - rows.mode_begin[n])
                add_mode_outputs(
                    flight.pickup_tables, row, kept.parts, first - begin, last - first, kept.pickup_values[n]
                )


# --- a flight


@inline
def begin_flight(model, state, measures_energy, frame):
    """Take an island from the begin of a flight to its end; values of pickups and energies meanwhile are kept."""
    flight, kept = model.flight, state.flight
    find_outputs(flight, model.pickups, state)
    kept.frame[FlightFrame.SAVED] = frame
    for column in range(kept.energy_totals.shape[0]):
        kept.energy_totals[column] = state.energy_totals[column]
    if measures_energy:
        measure_flight(model, state, kept)
    forget_drift(state)
    advance_modes(flight.motion, flight.motion_low, flight.weight, kept, state.q, state.p)
    push_by_weight(flight.weight, state.kick_compensation, kept, state.p)


@inline
def measure_flight(model, state, kept):
    """Keep the energies of an island at the begin of a flight, and count what it loses in it. Its contacts are open,
    and hold none."""
    energy, absolute, lost = flight_energies(model.omega_squared, model.weight, model.flight, state.q, state.p)
    spent = state.energy_totals[EnergyTotal.DISSIPATED] - state.energy_totals[EnergyTotal.SUPPLIED]
    kept.ledger[Ledger.BALANCE], kept.ledger[Ledger.ABSOLUTE] = energy + spent, absolute
    accumulate(state.energy_totals, EnergyTotal.DISSIPATED, lost)


@noinline
def step_saved_motion(h, kept, frame):
    """Take the saved motion to a frame, by single steps."""
    while kept.frame[FlightFrame.SAVED] < frame:
        lost = free_step(h, motion_of(kept))
        accumulate(kept.energy_totals, EnergyTotal.DISSIPATED, lost)
        kept.frame[FlightFrame.SAVED] += 1


@inline
def exchange(a, b):
    """Exchange the numbers of two arrays."""
    for m in range(a.shape[0]):
        a[m], b[m] = b[m], a[m]


@inline
def exchange_motion(state):
    """Put the saved motion in the place of that at the end of the flight, or back."""
    kept = state.flight
    exchange(state.q, kept.q)
    exchange(state.p, kept.p)
    exchange(state.kick_compensation, kept.kick_compensation)
    exchange(state.energy_totals, kept.energy_totals)


@inline
def end_flight(model, state, frame):
    """End a flight, if there is one: the island is at this frame then, and was taken there by single steps."""
    end = state.flight.frame[FlightFrame.END]
    if end - FLIGHT_FRAMES < frame and frame < end:
        step_saved_motion(model.step, state.flight, frame)
        exchange_motion(state)
        forget_drift(state)
    state.flight.frame[FlightFrame.END] = 0
