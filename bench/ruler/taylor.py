"""The motion of a problem of collision by Taylor series, in extended precision: a second method, which shares nothing
with bench.ruler.reference but the problem.

From every state the series of modes and forces follow term by term: dp/dt from the forces, a power s^α of a series by
its recurrence, the stretch of bodies by products of series, friction by products and quotients. The last terms give
the length of a step. The series show where a contact begins or ends, or a point of friction slides or sticks, to the
last digit, and the output in between. s^α with α not an integer has no series at
s = 0: its force is on from a compression on that is so small that it could not be told from 0.
"""

import itertools
from typing import NamedTuple

import numpy as np

from bench.ruler.contact_ruler.problem import Friction, Problem

Real = np.longdouble
OPEN, PRESSING, SLACK = 0, 1, 2  # a slack contact is compressed, and leaves faster than its force would follow
ORDER = 32
TOLERANCE = 1e-20  # the last terms of a series, and what a force could have moved before it is on: share of momentum
MAX_APPROACH = 0.6  # share of the way to s = 0 in a step
GRID = np.linspace(0, 1, 49).astype(Real)
INSTANT = 1e-12  # of a sample: events nearer to each other than this are at one instant


class Arrays(NamedTuple):
    """A problem in extended precision."""

    squared: np.ndarray  # ω² [modes]
    decay: np.ndarray  # 2σ [modes]
    weight: np.ndarray  # [modes]
    shapes: np.ndarray  # [contacts, modes]
    barrier: np.ndarray  # [contacts]
    stiffness: np.ndarray  # [contacts]
    exponent: np.ndarray  # [contacts]
    loss: np.ndarray  # [contacts]
    onset: np.ndarray  # [contacts], compression from which on the force is on, m
    stretch: np.ndarray  # [bodies that stretch, modes]
    rubbed: np.ndarray  # [points of friction, modes]
    friction: Friction


class Rub(NamedTuple):
    """Taylor coefficients of points of friction, [order + 1, points] each."""

    bend: np.ndarray  # z
    remembered: np.ndarray  # θ
    bound: np.ndarray  # N·μ(θ)/k, which |z| may reach
    ahead: np.ndarray  # speed of slip where it slides, to its side, times what is above 0


class Point(NamedTuple):
    """Where points of friction are [points]."""

    bend: np.ndarray
    remembered: np.ndarray
    side: np.ndarray  # 0 where stuck, else that on which it slides


class Series(NamedTuple):
    """Taylor coefficients of a motion in time."""

    q: np.ndarray  # [order + 1, modes]
    p: np.ndarray  # [order + 1, modes]
    force: np.ndarray  # [order + 1], of all contacts and friction
    rub: Rub


def as_arrays(problem: Problem, scale: np.floating) -> Arrays:
    """A problem in extended precision. scale: largest momentum, √kg·m/s"""
    exponent, stiffness = problem.exponent.astype(Real), problem.stiffness.astype(Real)
    rubbed = np.zeros((0, problem.omega.size)) if problem.rubbed is None else problem.rubbed
    friction = np.zeros((7, 0)) if problem.friction is None else problem.friction
    slowest = 1e-3 * scale  # a contact that begins so slowly is rare
    onset = (TOLERANCE * (exponent + 1) * slowest * scale / stiffness) ** (1 / (exponent + 1))
    return Arrays(
        squared=problem.omega.astype(Real) ** 2,
        decay=2 * problem.sigma.astype(Real),
        weight=problem.weight.astype(Real),
        shapes=problem.shapes.astype(Real),
        barrier=problem.barrier.astype(Real),
        stiffness=stiffness,
        exponent=exponent,
        loss=problem.loss.astype(Real),
        onset=np.where(exponent == np.round(exponent), 0, onset),
        stretch=(np.zeros((0, problem.omega.size)) if problem.stretch is None else problem.stretch).astype(Real),
        rubbed=rubbed.astype(Real),
        friction=Friction(*friction.astype(Real)),
    )


def next_power_term(s: np.ndarray, powers: list[np.ndarray], exponent: np.ndarray, n: int) -> np.ndarray:
    """Term n of s^α, of contacts with one kind of exponent. s: terms 0 … n [order + 1, contacts]

    powers: the terms so far of s^α, or of s, s², … s^α if α is an integer; term n is added to them.
    """
    if len(powers) == 1 and exponent[0] != 1:
        f = powers[0]
        if n == 0:
            f[0] = s[0] ** exponent
        else:
            j = np.arange(1, n + 1).astype(Real)[:, None]
            f[n] = np.sum((exponent * j - n + j) * s[1 : n + 1] * f[n - 1 :: -1][:n], axis=0) / (n * s[0])
        return f[n]
    powers[0][n] = s[n]
    for lower, higher in itertools.pairwise(powers):
        higher[n] = np.sum(s[: n + 1] * lower[n::-1], axis=0)
    return powers[-1][n]


class RubExpansion:
    """The series of points of friction, term by term.

    With m = speed/(speed + θ), the bound is b = N·(dynamic + (static - dynamic)·m)/k. Of a point that slides, with
    c = db/dθ/τ = -N·(static - dynamic)·m²/(k·τ·speed), (1 + c)·slip = side·w + c·θ is above 0.
    """

    def __init__(self, law: Friction, at: Point) -> None:
        self.law, self.at = law, at
        blank = np.zeros((ORDER + 1, at.side.size), Real)
        self.bend, self.remembered, self.bound, self.ahead = (blank.copy() for _ in range(4))
        self.share, self.shrink, self.slip = (blank.copy() for _ in range(3))  # m, c, slip
        self.bend[0], self.remembered[0] = at.bend, at.remembered

    def next_forces(self, n: int, w: np.ndarray) -> np.ndarray:
        """Term n of the forces, from that of the slip w of the surfaces; term n + 1 of z and θ follows. [points]"""
        law, side, theta, m, c = self.law, self.at.side, self.remembered, self.share, self.shrink
        begun = law.speed + theta[0]
        m[n] = ((law.speed if n == 0 else 0) - np.sum(theta[1 : n + 1] * m[n - 1 :: -1][:n], axis=0)) / begun
        weakening = law.force * (law.static - law.dynamic) / law.bristle
        self.bound[n] = weakening * m[n] + (law.force * law.dynamic / law.bristle if n == 0 else 0)
        c[n] = -weakening / (law.memory * law.speed) * np.sum(m[: n + 1] * m[n::-1], axis=0)
        self.ahead[n] = side * w + np.sum(c[: n + 1] * theta[n::-1], axis=0)
        late = np.sum(c[1 : n + 1] * self.slip[n - 1 :: -1][:n], axis=0)
        self.slip[n] = np.where(side == 0, 0, (self.ahead[n] - late) / (1 + c[0]))
        self.bend[n] = np.where(side == 0, self.bend[n], side * self.bound[n])
        if n < ORDER:
            theta[n + 1] = (self.slip[n] - theta[n]) / (law.memory * (n + 1))
            self.bend[n + 1] = w / (n + 1)
        return np.asarray(law.bristle * self.bend[n])


def expand(arrays: Arrays, status: np.ndarray, q: np.ndarray, p: np.ndarray, point: Point) -> Series:
    """The series of a motion from a state."""
    size = ORDER + 1
    qs, ps, total = np.zeros((size, q.size), Real), np.zeros((size, q.size), Real), np.zeros(size, Real)
    qs[0], ps[0] = q, p
    kinds = []  # pressing contacts by exponent: their numbers, s, ds/dt, powers, elastic force
    for exponent in sorted({float(a) for a in arrays.exponent[status == PRESSING]}):
        which = np.flatnonzero((status == PRESSING) & (arrays.exponent.astype(float) == exponent))
        blank = np.zeros((size, which.size), Real)
        powers = [blank.copy() for _ in range(int(exponent) if exponent == round(exponent) else 1)]
        kinds.append((which, arrays.shapes[which], blank.copy(), blank.copy(), powers, blank.copy()))
    stretches = np.zeros((size, len(arrays.stretch)), Real)
    rub = RubExpansion(arrays.friction, point)
    for n in range(size):
        slope = -arrays.squared * qs[n] - arrays.decay * ps[n]
        if stretches.size:  # the products of series
            stretches[n] = arrays.stretch @ np.sum(qs[: n + 1] * qs[n::-1], axis=0)
            slope = slope - np.sum((stretches[: n + 1] @ arrays.stretch) * qs[n::-1], axis=0)
        if n == 0:
            slope = slope + arrays.weight
        for which, shapes, s, speed, powers, elastic in kinds:
            speed[n] = shapes @ ps[n]
            s[n] = speed[n - 1] / n if n else shapes @ q - arrays.barrier[which]
            elastic[n] = arrays.stiffness[which] * next_power_term(s, powers, arrays.exponent[which], n)
            f = elastic[n]
            if arrays.loss[which].any():
                f = f + arrays.loss[which] * np.sum(elastic[: n + 1] * speed[n::-1], axis=0)
            slope = slope - f @ shapes
            total[n] += np.sum(f)
        if point.side.size:
            f = rub.next_forces(n, arrays.rubbed @ ps[n] - (arrays.friction.velocity if n == 0 else 0))
            slope, total[n] = slope - f @ arrays.rubbed, total[n] + np.sum(f)
        if n < ORDER:
            ps[n + 1], qs[n + 1] = slope / (n + 1), ps[n] / (n + 1)
    return Series(qs, ps, total, Rub(rub.bend, rub.remembered, rub.bound, rub.ahead))


def duration_of(arrays: Arrays, status: np.ndarray, series: Series, scale: np.floating) -> np.floating:
    """How long a series holds, s."""
    limits = [np.inf]
    for n in range(ORDER - 5, ORDER + 1):  # from s = 0 on, all terms but each (α + 1)-th may be 0
        size = np.sqrt(np.sum(series.p[n] ** 2 + arrays.squared * series.q[n] ** 2))
        if size > 0:
            limits.append((TOLERANCE * scale / size) ** (Real(1) / n))
        size = np.max(np.abs(series.rub.remembered[n]) / arrays.friction.speed, initial=0)
        if size > 0:
            limits.append((TOLERANCE / size) ** (Real(1) / n))
    singular = np.flatnonzero((status == PRESSING) & (arrays.onset > 0))
    if singular.size:
        s = arrays.shapes[singular] @ series.q[0] - arrays.barrier[singular]
        speed = np.abs(arrays.shapes[singular] @ series.p[0])
        limits.append(MAX_APPROACH * np.min(s / (speed + Real(1e-300))))
    return min(limits)


def excesses(arrays: Arrays, status: np.ndarray, series: Series, side: np.ndarray) -> np.ndarray:
    """Series of what is above 0 when a contact has changed: [order + 1, 2·contacts + 2·points of friction], by
    compression, by speed, and by the bend of a bristle up or down. side: of points of friction"""
    s, speed = series.q @ arrays.shapes.T, series.p @ arrays.shapes.T
    s[0] -= arrays.barrier + arrays.onset
    by_speed = arrays.loss * speed
    by_speed[0] += 1
    by_speed = np.where(status == PRESSING, -by_speed, by_speed)
    never = (status == OPEN) | (arrays.loss == 0)
    by_speed[:, never] = 0
    by_speed[0, never] = -1
    rub, never = series.rub, np.zeros_like(series.rub.bound)
    never[0] = -1
    up = np.where(side == 0, rub.bend - rub.bound, -rub.ahead)
    down = np.where(side == 0, -rub.bend - rub.bound, never)
    return np.concatenate([np.where(status == OPEN, s, -s), by_speed, up, down], axis=1)


def value(terms: np.ndarray, x: np.floating) -> np.floating:
    """A polynomial at a place."""
    return np.polynomial.polynomial.polyval(x, terms)


def rising_root(terms: np.ndarray, slopes: np.ndarray, low: np.floating, high: np.floating) -> np.floating:
    """Where a polynomial, not above 0 at `low` and above it at `high`, is 0."""
    x = (low + high) / 2
    for _ in range(200):
        g, slope = value(terms, x), value(slopes, x)
        low, high = (low, x) if g > 0 else (x, high)
        improved = x - g / slope if slope > 0 else (low + high) / 2
        if not low < improved < high:
            improved = (low + high) / 2
        if improved == x or high - low <= 1e-19 * high:
            return improved
        x = improved
    return x


def first_rise(terms: np.ndarray) -> tuple[np.floating, int] | None:
    """Where on [0, 1] the first of some polynomials rises above 0, and which. terms: [order + 1, polynomials]"""
    slopes = terms[1:] * np.arange(1, terms.shape[0]).astype(Real)[:, None]
    powers = GRID[:, None] ** np.arange(terms.shape[0])
    g, rate = powers @ terms, powers[:, :-1] @ slopes
    turns = (rate[:-1] > 0) & (rate[1:] < 0)
    may_touch = turns & (g[:-1] + rate[:-1] * (GRID[1] - GRID[0]) > 0) & (g[:-1] <= 0) & (g[1:] <= 0)
    crossings = []
    for column in np.flatnonzero((g[1:] > 0).any(axis=0) | may_touch.any(axis=0)):
        one, slope = terms[:, column], slopes[:, column]
        for j in range(GRID.size - 1):
            if may_touch[j, column]:
                bend = -slope[1:] * np.arange(1, slope.size).astype(Real)
                top = rising_root(-slope, bend, GRID[j], GRID[j + 1])
                if value(one, top) > 0:
                    crossings.append((rising_root(one, slope, GRID[j], top), int(column)))
                    break
            if g[j + 1, column] > 0:
                crossings.append((rising_root(one, slope, GRID[j], GRID[j + 1]), int(column)))
                break
    return min(crossings) if crossings else None


def change(status: np.ndarray, point: Point, column: int) -> None:
    """Change the status of the contact, or of the point of friction, that a column of `excesses` belongs to."""
    if column >= 2 * status.size:
        column -= 2 * status.size
        k, is_down = column % point.side.size, column >= point.side.size
        point.side[k] = (-1 if is_down else 1) if point.side[k] == 0 else 0
        return
    contact = column % status.size
    if column >= status.size:
        status[contact] = SLACK if status[contact] == PRESSING else PRESSING
    else:
        status[contact] = PRESSING if status[contact] == OPEN else OPEN


def solve_by_series(problem: Problem) -> tuple[np.ndarray, np.ndarray, int]:
    """Displacement [frames + 1], m, and force [frames], N (bench.ruler.contact_ruler.problem), and the number of events
    (EventCount)."""
    q, p = problem.q.astype(Real), problem.p.astype(Real)
    sample, frames, pickup = 1 / Real(problem.samplerate), problem.frames, problem.pickup.astype(Real)
    scale = momentum_scale(problem)
    arrays = as_arrays(problem, scale)
    s, speed = arrays.shapes @ q - arrays.barrier, arrays.shapes @ p
    status = np.where(s > arrays.onset, np.where(1 + arrays.loss * speed > 0, PRESSING, SLACK), OPEN)
    nothing = np.zeros(len(arrays.rubbed), Real)
    point = Point(nothing, nothing, np.zeros(nothing.size, int))
    displacement, impulse, events = np.empty(frames + 1, Real), np.zeros(frames + 1, Real), EventCount(sample)
    displacement[0] = pickup @ q
    frame, elapsed, idle = 0, Real(0), 0  # where the motion is: time since the frame began, s
    degree = np.arange(ORDER + 1)
    while frame < frames:
        series = expand(arrays, status, q, p, point)
        changes = excesses(arrays, status, series, point.side)
        late = np.flatnonzero((changes[0] > 0) & (changes[1] > 0))  # two events at once
        late = late[late < 2 * status.size]  # of a bristle, only rounding is above 0
        if late.size:
            events.change(status, point, int(late[0]))
            idle += 1
            assert idle < 100, f"{problem.title}: stuck in frame {frame}"
            continue
        idle = 0
        h = min(duration_of(arrays, status, series, scale), (frames - frame) * sample - elapsed + sample / 2)
        event = first_rise(changes * (h**degree)[:, None])
        h = h if event is None else event[0] * h
        begun = Real(0)  # integral of the force up to the last frame that ended
        while frame < frames and elapsed + h >= sample:
            ahead = sample - elapsed
            powers = ahead**degree
            pushed = ahead * (powers / (degree + 1)) @ series.force
            impulse[frame] += pushed - begun
            begun, frame = pushed, frame + 1
            displacement[frame] = powers @ (series.q @ pickup)
            elapsed -= sample
        powers = h**degree
        if frame < frames:
            impulse[frame] += h * (powers / (degree + 1)) @ series.force - begun
        q, p, elapsed = powers @ series.q, powers @ series.p, elapsed + h
        point = Point(powers @ series.rub.bend, powers @ series.rub.remembered, point.side)
        events.since += h
        if event is not None:
            events.change(status, point, event[1])
    return displacement, impulse[:frames] / sample, events.count


class EventCount:
    """Counts events by what they change: a contact or a point of friction that is after an instant what it was before
    has none there. Where a bristle begins to stick, rounding may let it slide and stick again at once.

    sample: s
    """

    def __init__(self, sample: np.floating) -> None:
        self.count, self.since, self.instant = 0, Real(np.inf), INSTANT * sample
        self.earlier, self.before = 0, np.empty(0)  # the count and the states before the last instant

    def change(self, status: np.ndarray, point: Point, column: int) -> None:
        """Let the event of a column of `excesses` happen, `since` s after the last one."""
        if self.since > self.instant:
            self.earlier, self.before = self.count, np.concatenate([status, point.side])
            self.since = Real(0)
        change(status, point, column)
        self.count = self.earlier + int(np.sum(np.concatenate([status, point.side]) != self.before))


def momentum_scale(problem: Problem) -> np.floating:
    """√(2·energy) that the motion has at first, or that weight gives it within its time, √kg·m/s."""
    falls = problem.weight * problem.frames / problem.samplerate
    return Real(np.sqrt(np.sum(problem.p**2 + problem.omega**2 * problem.q**2 + falls**2)))
