"""The motion of a problem of collision by Gauss collocation between its events, in extended precision.

Between events the forces are smooth. A contact that begins or ends (s = 0), one whose loss would turn its force round
(1 + loss·ds/dt = 0), and a point of friction that begins to slide or to stick (bench.ruler.rubbing), is an event: a
step ends there. While nothing presses, modes move by their closed solution; else, and where bodies stretch or rub, they
and the forces are polynomials over each step, of a degree that their
last coefficients show to be enough. s^α with α not an integer is no polynomial near s = 0: steps shrink towards it
until what is left is nothing.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bench.ruler.collocated_step import System, as_system, forces, iterate, select_contacts, stretching
from bench.ruler.collocation import Nodes, Real, gauss_nodes, integral_to, value_at
from bench.ruler.contact_ruler.problem import Problem
from bench.ruler.rubbing import Bristles, at_rest, excess_and_slope, excess_of, friction_forces, reach, stored_in, turn

EPSILON = np.finfo(Real).eps
OPEN, PRESSING, SLACK = 0, 1, 2  # a slack contact is compressed, and leaves faster than its force would follow
MAX_TRIES = 20_000  # of steps, in a sample
MAX_PHASE = 2.5  # rad, of the highest mode in a step


class Setting(NamedTuple):
    """How exactly to solve."""

    nodes: int  # of a step
    tolerance: float  # what the last coefficients of the forces may move in a step, share of the largest momentum


FINE = Setting(20, 1e-18)
COARSE = Setting(16, 1e-16)


class Step(NamedTuple):
    """A step that may be made."""

    duration: np.floating
    q: np.ndarray  # [modes], at its end
    p: np.ndarray  # [modes], at its end
    speed: np.ndarray  # ds/dt [nodes, contacts]
    slip: np.ndarray  # of surfaces that rub [nodes, points of friction], m/s
    bristles: Bristles  # at its end
    bristle_rates: tuple[np.ndarray, np.ndarray]  # of their bends and θ [nodes, points of friction]
    impulse: np.floating  # N·s, of all contacts and friction
    error: np.floating  # share of the largest momentum


class Solution(NamedTuple):
    """The motion of a problem, in extended precision."""

    displacement: np.ndarray  # [frames + 1], m
    force: np.ndarray  # [frames], N
    energy: np.ndarray  # [frames + 1], J
    events: list[tuple[float, int, int]]  # time, s; contact, or after them point of friction; what it is from then on
    steps: int


@dataclass
class Motion:
    """Where a motion is."""

    q: np.ndarray
    p: np.ndarray
    status: np.ndarray  # [contacts], OPEN, PRESSING or SLACK
    scale: np.floating  # largest √(Σ p² + ω²q²) so far
    bristles: Bristles


class Solver:
    """A problem, its arrays, and the setting it is solved with."""

    def __init__(self, problem: Problem, setting: Setting) -> None:
        self.problem, self.setting = problem, setting
        self.fine, self.rough = as_system(problem, Real), as_system(problem, np.float64)
        self.nodes = gauss_nodes(setting.nodes)
        self.rough_nodes = Nodes(*(x.astype(np.float64) for x in self.nodes))
        highest = problem.omega.max()
        self.longest = Real(MAX_PHASE / highest) if highest > 0 else Real(np.inf)
        assert (problem.sigma < np.maximum(problem.omega, 1e-300)).all() or not problem.sigma.any()
        self.free = problem.omega == 0  # modes
        self.stretches, self.rubs = len(self.fine.stretch) > 0, len(self.fine.rubbing.shapes) > 0
        omega_squared, sigma = self.fine.squared, self.fine.decay / 2
        self.damped = np.sqrt(np.where(self.free, 1, omega_squared - sigma**2))
        self.rest = np.where(self.free, 0, self.fine.weight / np.where(self.free, 1, omega_squared))
        self.sigma = sigma

    def advance_free(self, motion: Motion, h: np.floating) -> Step:
        """A step in which no contact presses: the closed solution."""
        t = (h * np.append(self.nodes.place, Real(1)))[:, None]
        q, p, free = motion.q - self.rest, motion.p, self.free
        shrink = np.exp(-self.sigma * t)
        sine, cosine = shrink * np.sin(self.damped * t) / self.damped, shrink * np.cos(self.damped * t)
        qs = self.rest + q * (cosine + self.sigma * sine) + p * sine
        ps = p * (cosine - self.sigma * sine) - self.fine.squared * q * sine
        if free.any():
            w = self.fine.weight[free]
            ps[:, free] = p[free] + w * t
            qs[:, free] = q[free] + p[free] * t + w * t * t / 2
        speed = ps[:-1] @ self.fine.shapes.T
        nothing = np.zeros((self.nodes.place.size, 0), Real)
        return Step(h, qs[-1], ps[-1], speed, nothing, motion.bristles, (nothing, nothing), Real(0), Real(0))

    def advance_forced(self, motion: Motion, pressing: np.ndarray, h: np.floating) -> Step | None:
        """A step in which contacts press, or bodies stretch or rub: by collocation, begun in double precision. None if
        that fails."""
        q, p, nodes = motion.q, motion.p, self.nodes
        system, rough = select_contacts(self.fine, pressing), select_contacts(self.rough, pressing)
        rough_q, rough_p = q.astype(np.float64), p.astype(np.float64)
        places = (h * nodes.place).astype(np.float64)[:, None]
        guess = rough_q + places * rough_p, np.repeat(rough_p[None], nodes.place.size, axis=0)
        with np.errstate(all="ignore"):
            begin = Bristles(*(x.astype(np.float64) for x in motion.bristles))
            solution = iterate(rough, self.rough_nodes, np.float64(h), rough_q, rough_p, begin, guess)
            if solution is None:
                return None
            guess = solution[0].astype(Real), solution[1].astype(Real)
            solution = iterate(system, nodes, h, q, p, motion.bristles, guess)
        if solution is None:
            return None
        qs, ps, slope, f, bent, bristle_rates = solution
        (rows, law), contacts = system.rubbing, len(system.shapes)
        moved = np.sum(system.length * np.abs(nodes.last @ f[:, :contacts]).max(axis=0))
        bristles = motion.bristles
        if self.rubs:
            # the bound counts where a point is stuck, too: it says when it slides
            of_bound = law.bristle * np.abs(nodes.last @ reach(law, bent.remembered)).max(axis=0)
            rough_forces = np.abs(nodes.last @ f[:, contacts:]).max(axis=0) + of_bound
            moved = moved + np.sum(np.sqrt(np.sum(rows**2, axis=1)) * rough_forces)
            bend, remembered = (x + h * (nodes.share @ r) for x, r in zip(bristles, bristle_rates, strict=False))
            bristles = bristles._replace(bend=bend, remembered=remembered)
        else:
            bristle_rates = (np.zeros((nodes.place.size, 0), Real),) * 2
        if self.stretches:
            moved = moved + np.sqrt(np.sum(np.abs(nodes.last @ stretching(system, qs)).max(axis=0) ** 2))
        return Step(
            duration=h,
            q=q + h * (nodes.share @ ps),
            p=p + h * (nodes.share @ slope),
            speed=ps @ self.fine.shapes.T,
            slip=ps @ rows.T - law.velocity,
            bristles=bristles,
            bristle_rates=bristle_rates,
            impulse=h * np.sum(nodes.share @ f),
            error=h * moved / motion.scale,
        )

    def try_step(self, motion: Motion, h: np.floating) -> Step | None:
        """A step of duration h, whatever happens in it; None if it cannot be solved."""
        pressing = np.flatnonzero(motion.status == PRESSING)
        if pressing.size or self.stretches or self.rubs:
            return self.advance_forced(motion, pressing, h)
        return self.advance_free(motion, h)

    def compressions(self, q: np.ndarray) -> np.ndarray:
        """s [contacts]"""
        return np.asarray(self.fine.shapes @ q - self.fine.barrier)

    def slope_of(self, motion: Motion) -> np.ndarray:
        """dp/dt [modes]"""
        pressing = np.flatnonzero(motion.status == PRESSING)
        slope = self.fine.weight - self.fine.squared * motion.q - self.fine.decay * motion.p
        if pressing.size:
            system = select_contacts(self.fine, pressing)
            f = forces(system, system.shapes @ motion.q - system.barrier, system.shapes @ motion.p)
            slope = slope - f @ system.shapes
        if self.stretches:
            slope = slope + stretching(self.fine, motion.q)
        if self.rubs:
            slope = slope - friction_forces(self.fine.rubbing.law, motion.bristles) @ self.fine.rubbing.shapes
        return np.asarray(slope)

    def accelerations(self, motion: Motion) -> np.ndarray:
        """d²s/dt² [contacts]"""
        return np.asarray(self.fine.shapes @ self.slope_of(motion))

    def excess(self, status: np.ndarray, s: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """What is above 0 when a contact has changed: [..., 2·contacts], by its compression and by its speed."""
        by_compression = np.where(status == OPEN, s, -s)
        by_speed = np.where(status == PRESSING, -1, 1) * (1 + self.fine.loss * speed)
        return np.concatenate([by_compression, np.where((status == OPEN) | (self.fine.loss == 0), -1, by_speed)], -1)

    def excess_at(self, motion: Motion, step: Step, integral: np.ndarray, value: np.ndarray) -> np.ndarray:
        """The same in a step, and then that of friction, by polynomials: [places, 2·contacts + points of friction]

        integral, value: linear maps of values at the nodes to integrals up to places, and to values there
        """
        s = self.compressions(motion.q) + step.duration * (integral @ step.speed)
        of_contacts = self.excess(motion.status, s, value @ step.speed)
        if not self.rubs:
            return of_contacts
        moves = (step.duration * (integral @ rate) for rate in step.bristle_rates)
        bend, remembered = (x + move for x, move in zip(motion.bristles, moves, strict=False))
        law, bristles = self.fine.rubbing.law, motion.bristles._replace(bend=bend, remembered=remembered)
        return np.concatenate([of_contacts, excess_of(law, bristles, value @ step.slip)], axis=-1)

    def excess_in(self, motion: Motion, step: Step, place: np.ndarray) -> np.ndarray:
        """The same at places on [0, 1] of a step."""
        count = self.setting.nodes
        return self.excess_at(motion, step, integral_to(count, place), value_at(count, place))

    def first_event(self, motion: Motion, step: Step) -> tuple[int, float] | None:
        """Which excess of a step is the first to rise above 0, and where on [0, 1]; None if none does."""
        x = self.nodes.finer
        g = self.excess_at(motion, step, self.nodes.finer_integral, self.nodes.finer_value)
        bend = 2 * g[1:-1] - g[2:] - g[:-2]
        rise = g[2:] - g[:-2]
        is_top = (bend > 0) & (np.abs(rise) <= 2 * bend) & (g[1:-1] <= 0)
        with np.errstate(all="ignore"):
            hidden = is_top & (g[1:-1] + rise**2 / (8 * bend) > 0)  # rises above 0 and falls again between places
        crossings: list[tuple[float, int]] = []
        for column in np.flatnonzero((g[1:] > 0).any(axis=0) | hidden.any(axis=0)):
            brackets = [(float(x[j]), float(x[j + 1])) for j in np.flatnonzero(g[1:, column] > 0)[:1]]
            for j in np.flatnonzero(hidden[:, column])[:1]:
                top = float(x[j + 1] + (x[1] - x[0]) * rise[j, column] / (2 * bend[j, column]))
                if self.excess_in(motion, step, np.array([top], Real))[0, column] > 0:
                    brackets.append((float(x[j]), top))
            if brackets:
                low, high = min(brackets)
                for _ in range(3):
                    places = np.linspace(low, high, 12).astype(Real)
                    is_above = self.excess_in(motion, step, places)[1:, column] > 0
                    j = int(np.argmax(is_above)) if is_above.any() else 10
                    low, high = float(places[j]), float(places[j + 1])
                crossings.append((0.5 * (low + high), int(column)))
        if not crossings:
            return None
        place, column = min(crossings)
        return column, place

    def noise_of(self, motion: Motion, column: int) -> np.floating:
        """How far an excess is from 0 by rounding."""
        contacts, p = motion.status.size, np.abs(motion.p)
        if column >= 2 * contacts:
            (rows, law), point = self.fine.rubbing, column - 2 * contacts
            far = reach(law, motion.bristles.remembered), np.abs(rows) @ p + np.abs(law.velocity)
            return 4 * EPSILON * far[0 if motion.bristles.side[point] == 0 else 1][point]
        row = np.abs(self.fine.shapes[column % contacts])
        if column >= contacts:
            return 4 * EPSILON * (1 + self.fine.loss[column - contacts] * (row @ p))
        return 4 * EPSILON * (row @ np.abs(motion.q) + np.abs(self.fine.barrier[column]))

    def measure(self, motion: Motion, column: int) -> tuple[np.floating, np.floating]:
        """An excess, and its rate."""
        contacts = motion.status.size
        if column >= 2 * contacts:
            (rows, law), point = self.fine.rubbing, column - 2 * contacts
            slip, acceleration = rows @ motion.p - law.velocity, rows @ self.slope_of(motion)
            excess, rate = excess_and_slope(law, motion.bristles, slip, acceleration)
            return excess[point], rate[point]
        contact = column % contacts
        row, status, loss = self.fine.shapes[contact], motion.status[contact], self.fine.loss[contact]
        speed = row @ motion.p
        if column >= contacts:
            sign = -1 if status == PRESSING else 1
            return sign * (1 + loss * speed), sign * loss * self.accelerations(motion)[contact]
        sign = 1 if status == OPEN else -1
        return sign * (row @ motion.q - self.fine.barrier[contact]), sign * speed

    def locate(self, motion: Motion, column: int, guess: np.floating, longest: np.floating) -> Step | None:
        """The step that ends where an excess becomes 0, by Newton's method between bounds; None if a step fails."""
        low, high, h = Real(0), longest * (1 + EPSILON), guess
        noise = self.noise_of(motion, column)
        for _ in range(60):
            step = self.try_step(motion, h)
            if step is None or step.error > self.setting.tolerance:
                return None
            g, slope = self.measure(Motion(step.q, step.p, motion.status, motion.scale, step.bristles), column)
            if abs(g) <= noise:
                return step
            low, high = (low, h) if g > 0 else (h, high)
            improved = h - g / slope if slope != 0 else (low + high) / 2
            if not low < improved < high:
                improved = (low + high) / 2
            if abs(improved - h) <= 4 * EPSILON * h:
                return step
            h = improved
        return step

    def next_step(
        self, motion: Motion, left: np.floating, length: np.floating
    ) -> tuple[Step | None, int | None, np.floating]:
        """The next step; which excess is 0 at its end, if it is an event; and how long to try next time, s.

        left: of the sample, s; length: to try now, s. The step is None if it must be tried anew.
        """
        h = min(length, left, self.longest)
        step = self.try_step(motion, h)
        if step is None:
            return None, None, h / 4
        event = self.first_event(motion, step)
        if event is not None:
            column, place = event
            located = self.locate(motion, column, place * h, h)
            if located is None:
                return None, None, place * h / 2 if place > 0 else h / 4
            return located, column, length
        if step.error == 0:
            return step, None, self.longest
        growth = Real(0.8) * (self.setting.tolerance / step.error) ** (Real(1) / self.setting.nodes)
        if step.error > self.setting.tolerance:
            return None, None, h * max(Real(0.2), growth)
        longer = h * min(Real(4), growth)
        return step, None, max(length, longer) if h < length else longer  # a sample's end says nothing of the error

    def change(self, motion: Motion, column: int) -> int:
        """Change the status of a contact, or of a point of friction. Returns the contact; after them, the point."""
        contacts = motion.status.size
        if column >= 2 * contacts:
            motion.bristles = turn(self.fine.rubbing.law, motion.bristles, column - 2 * contacts)
            return column - contacts
        contact, by_speed = column % contacts, column >= contacts
        if by_speed:
            motion.status[contact] = SLACK if motion.status[contact] == PRESSING else PRESSING
        else:
            motion.status[contact] = PRESSING if motion.status[contact] == OPEN else OPEN
        return contact

    def first_duration(self, motion: Motion, contact: int) -> np.floating:
        """Duration of the first step of a contact that begins, s."""
        if contact >= motion.status.size or motion.status[contact] != PRESSING or self.fine.is_whole[contact]:
            return self.longest
        speed, a = abs(self.fine.shapes[contact] @ motion.p), self.fine.exponent[contact]
        push = self.fine.length[contact] * self.fine.stiffness[contact] * (speed + Real(1e-30)) ** a * Real(1e-3)
        return np.asarray(self.setting.tolerance * motion.scale / push)[()] ** (1 / (a + 1))

    def raise_scale(self, motion: Motion) -> None:
        """Note the largest momentum."""
        motion.scale = max(motion.scale, np.sqrt(np.sum(motion.p**2 + self.fine.squared * motion.q**2)))

    def begin(self, q: np.ndarray, p: np.ndarray) -> Motion:
        """The motion at time 0."""
        s, speed = self.compressions(q), self.fine.shapes @ p
        status = np.where(s > 0, np.where(1 + self.fine.loss * speed > 0, PRESSING, SLACK), OPEN)
        motion = Motion(q, p, status, Real(1e-30), at_rest(self.fine.rubbing))
        self.raise_scale(motion)
        return motion

    def overdue(self, motion: Motion) -> int | None:
        """An excess that is above 0 and rises: two events at once."""
        speed = self.fine.shapes @ motion.p
        g = self.excess(motion.status, self.compressions(motion.q), speed)
        if not (g > 0).any():
            return None
        rate = self.excess(motion.status, speed, np.zeros_like(speed))[: speed.size]
        loss_rate = np.where(motion.status == PRESSING, -1, 1) * self.fine.loss * self.accelerations(motion)
        late = np.flatnonzero((g > 0) & (np.concatenate([rate, loss_rate]) > 0))
        return int(late[0]) if late.size else None


def solve(problem: Problem, setting: Setting = FINE) -> Solution:
    """The motion of a problem."""
    solver = Solver(problem, setting)
    motion = solver.begin(problem.q.astype(Real), problem.p.astype(Real))
    sample, pickup, frames = 1 / Real(problem.samplerate), problem.pickup.astype(Real), problem.frames
    displacement, energy = np.empty(frames + 1, Real), np.empty(frames + 1, Real)
    force, events, steps, length = np.zeros(frames, Real), [], 0, solver.longest
    displacement[0], energy[0] = pickup @ motion.q, energy_of_motion(solver.fine, motion)
    for n in range(frames):
        elapsed, impulse, tries = Real(0), Real(0), 0
        while elapsed < sample:
            tries += 1
            if tries > MAX_TRIES:
                raise RuntimeError(f"{problem.title}: stuck in frame {n}")
            column, left = solver.overdue(motion), sample - elapsed
            if column is not None:
                contact = solver.change(motion, column)
                length = min(length, solver.first_duration(motion, contact))
            else:
                step, column, length = solver.next_step(motion, left, length)
                if step is None:
                    continue
                motion.q, motion.p, motion.bristles = step.q, step.p, step.bristles
                elapsed = sample if step.duration == left else elapsed + step.duration
                impulse, steps = impulse + step.impulse, steps + 1
                solver.raise_scale(motion)
                if column is None:
                    continue
                contact = solver.change(motion, column)
                length = solver.first_duration(motion, contact)
            states = np.concatenate([motion.status, motion.bristles.side])
            events.append((float(n * sample + elapsed), contact, int(states[contact])))
        force[n] = impulse / sample
        displacement[n + 1] = pickup @ motion.q
        energy[n + 1] = energy_of_motion(solver.fine, motion)
    return Solution(displacement, force, energy, events, steps)


def energy_of_motion(system: System, motion: Motion) -> np.floating:
    """Energy where a motion is, J."""
    q, p = motion.q, motion.p
    squeezed = np.maximum(system.shapes @ q - system.barrier, 0)
    stored = system.stiffness / (system.exponent + 1) * squeezed ** (system.exponent + 1)
    stretched, bristles = np.sum((system.stretch @ q**2) ** 2) / 4, stored_in(system.rubbing.law, motion.bristles)
    return np.sum(p**2 / 2 + system.squared * q**2 / 2 - system.weight * q) + np.sum(stored) + stretched + bristles
