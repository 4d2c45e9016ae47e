"""A scene as an ordinary differential equation of its modes in continuous time: a reference for the motion.

Bodies have their textbook modes, with modal mass 1; joints, contacts, friction and forces act on these as the guides
say. SciPy's DOP853 solves the equation from one kink to the next: where an event or a piece of a force begins or ends,
and where friction begins to stick or to slip. Nothing here comes from the engine.

Bodies: mass, oscillator, modes, string (also stretching, Kirchhoff-Carrier), supported rectangular plate (also Berger).
Connections: springs and dampers, rigid joints, ends of strings. Contacts: points and frets, with and without loss.
Friction: pressed by a force, with a memory unless its coefficient is constant.
"""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy

RATE = 44_100  # Hz, at which events fall on frames
MAX_PHASE_OF_STEP = 3.0  # rad, of the fastest vibration: DOP853 is stable
MAX_STEP_OF_CONTACTS = 2e-5  # s: none begins and ends within a step
SAME_TIME = 1e-12  # s, between two moments that are one


# --- numbers that glide


class Parameter:
    """A number of a scene, and its glides, which go as ½(1 - cos)."""

    def __init__(self, value: float) -> None:
        self.value, self.glides = value, list[tuple[float, float, float]]()  # begin and end, s; value at the end

    def course(self, t: float) -> tuple[float, float]:
        """Return the value at a time, and its rate of change, 1/s. A glide ends where the next one begins."""
        value, rate = self.value, 0.0
        for n, (begin, end, target) in enumerate(self.glides):
            if t < begin:
                break
            until = min(t, self.glides[n + 1][0]) if n + 1 < len(self.glides) else t
            share, way = min((until - begin) / (end - begin), 1.0), target - value
            rate = way * 0.5 * math.pi / (end - begin) * math.sin(math.pi * share)
            value += way * 0.5 * (1.0 - math.cos(math.pi * share))
        return value, rate

    def at(self, t: float) -> float:
        """Return the value at a time."""
        return self.course(t)[0] if self.glides else self.value


# --- bodies


class Modes(NamedTuple):
    """Modes of a body: of modal mass 1."""

    omega: np.ndarray  # rad/s [modes]
    sigma: np.ndarray  # 1/s
    shape: Callable[[Any], np.ndarray]  # at a position, 1/√kg
    q: np.ndarray  # at time 0
    p: np.ndarray
    stiffness: float = 0.0  # K of the energy ¼·K·s² of its stretch s = Σ κ·q²
    kappa: np.ndarray = np.zeros(0)


def lumped_modes(body: dict) -> Modes:
    """Return the mode of a mass or an oscillator."""
    root = math.sqrt(body["mass"])
    omega = 2.0 * math.pi * body.get("frequency", 0.0) or math.sqrt(body.get("stiffness", 0.0)) / root
    q, p = root * body.get("displacement", 0.0), root * body.get("velocity", 0.0)
    sigma = 0.5 * body.get("damping_rate", 0.0)
    return Modes(*(np.array([x]) for x in (omega, sigma)), lambda _: np.array([1.0 / root]), *np.array([[q], [p]]))


def measured_modes(body: dict) -> Modes:
    """Return modes that are given."""
    rest = np.zeros(len(body["frequency"]))
    points = {name: np.array(row) for name, row in body["points"].items()}
    return Modes(2.0 * math.pi * np.array(body["frequency"]), np.array(body["sigma"]), points.__getitem__, rest, rest)


def string_modes(body: dict) -> Modes:
    """Return the modes of a string: μ·ω² = T·β² + EI·β⁴, shapes √(2/μL)·sin βx, K = EA/(2L), κ = β²/μ."""
    length, density = body["length"], body["linear_density"]
    number = np.arange(1.0, body["modes"] + 1.0)
    beta = number * math.pi / length
    omega = np.sqrt((body["tension"] * beta**2 + body.get("bending_stiffness", 0.0) * beta**4) / density)
    scale = math.sqrt(2.0 / (density * length))
    stiffness = body.get("axial_stiffness", 0.0) / (2.0 * length)
    shape = lambda at: scale * np.sin(math.pi * number * at)
    return Modes(
        omega, decay_rates(body, omega, beta), shape, *initial_modes(body, scale), stiffness, beta**2 / density
    )


def plate_modes(body: dict) -> Modes:
    """Return the modes of a simply supported plate: ρ·ω² = D·β⁴, β² = (mπ/a)² + (nπ/b)², shapes 2/√(ρab)·sin·sin."""
    (a, b), density, count = body["size"], body["area_density"], body["modes"]
    pairs = np.array([[m, n] for m in range(1, count + 1) for n in range(1, count // m + 1)])
    squared = (pairs[:, 0] * math.pi / a) ** 2 + (pairs[:, 1] * math.pi / b) ** 2
    lowest = np.argsort(squared, kind="stable")[:count]
    pairs, squared = pairs[lowest], squared[lowest]
    if "frequency" in body:
        omega = 2.0 * math.pi * body["frequency"] * squared / squared[0]
    else:
        omega = math.sqrt(body["flexural_rigidity"] / density) * squared
    scale = 2.0 / math.sqrt(density * a * b)
    stiffness = body.get("stretching_stiffness", 0.0) / (2.0 * a * b)
    shape = lambda at: scale * np.prod(np.sin(math.pi * pairs * at), axis=1)
    sigma = decay_rates(body, omega, np.sqrt(squared))
    return Modes(omega, sigma, shape, *initial_modes(body, scale), stiffness, squared / density)


def decay_rates(body: dict, omega: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Return σ = σ0 + σβ·β + b3·ω² [modes]."""
    return np.asarray(body.get("sigma0", 0.0) + body.get("sigma_beta", 0.0) * beta + body.get("b3", 0.0) * omega**2)


def initial_modes(body: dict, scale: float) -> np.ndarray:
    """Return q and p of a body that begins in the shape of a mode [2, modes]. scale: maximum of a mode shape"""
    state = np.zeros((2, body["modes"]))
    for row, key in zip(state, ("displacement", "velocity"), strict=True):
        if key in body:
            assert body[key]["kind"] == "mode"
            row[body[key]["number"] - 1] = body[key]["amplitude"] / scale
    return state


MODES_OF_KIND = {
    "mass": lumped_modes,
    "oscillator": lumped_modes,
    "modes": measured_modes,
    "string": string_modes,
    "plate": plate_modes,
}


# --- forces


class Piece(NamedTuple):
    """A force within an interval of time, in which it is smooth."""

    begin: float  # s
    end: float
    value: Callable[[float], float]  # N, at a time


def rise(share: float) -> float:
    """Return ½(1 - cos) of a share of a glide."""
    return 0.5 * (1.0 - math.cos(math.pi * share))


def force_pieces(force: dict) -> Iterator[Piece]:
    """Yield the pieces of a force or of a pluck."""
    start, size, kind = force.get("start", 0.0), force["amplitude"], force["kind"]
    length = force.get("duration", math.inf)
    end = start + length
    if kind == "constant":
        times, factors = np.array(force.get("envelope", [[0.0, 1.0]])).T
        moments = [start, *(start + x for x in times if x > 0.0), math.inf]
        for a, b in pairwise(moments):
            yield Piece(a, b, lambda t: size * float(np.interp(t - start, times, factors)))
    elif kind == "pulse":
        yield Piece(start, end, lambda t: size)
    elif kind == "half_sine":
        yield Piece(start, end, lambda t: size * math.sin(math.pi * (t - start) / length))
    elif kind == "sine":
        fade = force.get("fade", 0.0)
        moments = sorted({start, start + fade, end - fade, end})

        def sine(t: float) -> float:
            share = min(t - start, end - t) / fade if fade else 1.0
            return (
                size
                * math.sin(math.tau * force["frequency"] * (t - start) + force.get("phase", 0.0))
                * (rise(share) if 0.0 <= share < 1.0 else 1.0)
            )

        for a, b in pairwise(moments):
            yield Piece(a, b, sine)
    elif kind == "pluck":
        release = force.get("release", 0.0)
        yield Piece(start, end, lambda t: size * rise((t - start) / length))
        if release:
            yield Piece(end, end + release, lambda t: size * rise(1.0 - (t - end) / release))
    else:
        raise ValueError(kind)


# --- what acts between bodies


class Spring(NamedTuple):
    """A spring and a damper."""

    row: np.ndarray  # of its extension, in modes
    stiffness: Parameter
    damping_coefficient: Parameter
    rest: Parameter

    @property
    def is_constant(self) -> bool:
        """True if no event changes it."""
        return not any(parameter.glides for parameter in self[1:])


class Contact(NamedTuple):
    """A contact at a point."""

    row: np.ndarray  # of its compression, in modes
    offset: Parameter
    stiffness: Parameter
    exponent: Parameter
    loss: float


class Friction(NamedTuple):
    """Friction at a point: a bristle of stiffness k holds up to N·μ(θ)."""

    row: np.ndarray
    velocity: Parameter
    force: Parameter
    static: float
    dynamic: float
    speed: float
    memory: float
    bristle: float

    def coefficient(self, remembered: float) -> tuple[float, float]:
        """Return μ at a remembered speed of slip θ, and dμ/dθ."""
        fall, reach = self.static - self.dynamic, self.speed + max(remembered, 0.0)
        return self.dynamic + fall * self.speed / reach, -fall * self.speed / reach**2

    def bound(self, t: float, remembered: float) -> float:
        """Return how far the bristle bends before it gives way, m."""
        return self.force.at(t) * self.coefficient(remembered)[0] / self.bristle

    def slip(self, t: float, speed: float, remembered: float) -> float:
        """Return the speed at which the bristle gives way, where surfaces pass each other at a speed, both in the
        direction in which it is bent, m/s. The bristle follows its bound z = N·μ(θ)/k: W = speed - z', θ' = (W - θ)/τ.
        """
        (press, rate), (mu, fall) = self.force.course(t), self.coefficient(remembered)
        if self.memory == 0.0:
            assert fall == 0.0
            return speed - rate * mu / self.bristle
        share = press * fall / (self.bristle * self.memory)
        return (speed - rate * mu / self.bristle + share * remembered) / (1.0 + share)


# --- the equation


class Motion(NamedTuple):
    """Motion of a scene."""

    q: np.ndarray  # [times, modes]
    p: np.ndarray
    friction: np.ndarray  # on the body of each point [times, points], N


class ModalOde:
    """The equation of a scene, and its solution."""

    def __init__(self, scene: dict, rate: float = RATE) -> None:
        self.scene, self.rate, self.parts, self.modes = scene, rate, dict[str, slice](), dict[str, Modes]()
        self.count = 0
        for body in scene["body"]:
            modes = self.modes[body["name"]] = MODES_OF_KIND[body["kind"]](body)
            self.parts[body["name"]] = slice(self.count, self.count + modes.omega.size)
            self.count += modes.omega.size
        together = lambda key: np.concatenate([getattr(modes, key) for modes in self.modes.values()])
        self.omega, self.sigma, self.q, self.p = map(together, ("omega", "sigma", "q", "p"))
        self.times = set[float]()  # kinks
        self.springs, self.rigid = list[Spring](), list[np.ndarray]()
        self.contacts, self.frictions = list[Contact](), list[Friction]()
        self.named = dict[tuple[str, str], list[Any]]()  # what events change
        self._join()
        self._touch()
        forces = [*scene.get("force", [])]
        for event in scene.get("event", []):
            self._schedule(event)
            if event["kind"] == "pluck":
                forces.append(event | {"start": self._moment(event["time"])})
        rows = [(self.row(force["body"], force.get("at")), force) for force in forces]
        self.pieces = [(row, piece) for row, force in rows for piece in force_pieces(force)]
        self.times |= {t for _, piece in self.pieces for t in piece[:2]}
        self._assemble()

    def row(self, body: str, at: Any) -> np.ndarray:
        """Return the row of the displacement of a body at a position, in the modes of all bodies [modes], 1/√kg."""
        row = np.zeros(self.count)
        row[self.parts[body]] = self.modes[body].shape(at)
        return row

    def _relative(self, table: dict, at: Any = None, on_at: Any = None) -> np.ndarray:
        row = self.row(table["body"], at)
        return row - self.row(table["on"], on_at) if "on" in table else row

    def _moment(self, seconds: float) -> float:
        """Return the frame nearest to a time, s."""
        return math.floor(seconds * self.rate + 0.5) / self.rate

    def _name(self, kind: str, table: dict, item: Any) -> None:
        self.named.setdefault((kind, table.get("name", "")), []).append(item)

    def _join(self) -> None:
        """Read connections."""
        self.ends: dict[str, list[tuple[int, np.ndarray]]] = {}
        for table in self.scene.get("connection", []):
            if table["kind"] == "end":
                follows = table.get("share", 1.0) * self.row(table["on"], table.get("on_at"))
                self.ends.setdefault(table["body"], []).append((table["at"], follows))
                continue
            row = self._relative(table, table.get("at"), table.get("on_at"))
            if table.get("rigid"):
                self.rigid.append(row)
                continue
            numbers = (Parameter(table.get(key, 0.0)) for key in ("stiffness", "damping_coefficient", "rest"))
            self.springs.append(Spring(row, *numbers))
            self._name("connection", table, self.springs[-1])

    def _touch(self) -> None:
        """Read contacts and friction."""
        for table in self.scene.get("contact", []):
            frets = table.get("frets")
            positions = frets["at"] if frets else [table.get("at")]
            sign = 1.0 if table.get("side", "below" if frets else "above") == "above" else -1.0
            offset = table.get("gap", 0.0) if "on" in table else sign * (frets or {}).get("height", 0.0)
            if "barrier" in table:
                offset = sign * table["barrier"]
            for at in positions:
                numbers = (Parameter(x) for x in (offset, table["stiffness"], table["exponent"]))
                row = sign * self._relative(table, at, table.get("on_at"))
                self.contacts.append(Contact(row, *numbers, table.get("loss", 0.0)))
                self._name("contact", table, (self.contacts[-1], sign))
        for table in self.scene.get("friction", []):
            numbers = [table.get("static", 0.8), table.get("dynamic", 0.3), table.get("speed", 0.1)]
            numbers += [table.get("memory", 0.0), table.get("bristle", 1e5)]
            moves = Parameter(table.get("velocity", 0.0)), Parameter(table["force"])
            row = self._relative(table, table.get("at"), table.get("on_at"))
            self.frictions.append(Friction(row, *moves, *numbers))
            self._name("friction", table, self.frictions[-1])

    def _schedule(self, event: dict) -> None:
        """Let an event change what it names."""
        begin = self._moment(event["time"])
        self.times.add(begin)
        if event["kind"] == "damp" and "duration" in event:
            self.times.add(begin + self._moment(event["duration"]))
        if event["kind"] != "change":
            return
        end = begin + max(1.0 / self.rate, self._moment(event.get("duration", 0.005)))
        self.times.add(end)

        def glide(parameter: Parameter, target: float) -> None:
            parameter.glides.append((begin, end, target))
            parameter.glides.sort(key=lambda item: item[0])

        for kind, keys in (("connection", Spring._fields), ("friction", Friction._fields)):
            for item in self.named[kind, event[kind]] if kind in event else ():
                for key in set(keys) & event.keys():
                    glide(getattr(item, key), event[key])
        for item, sign in self.named["contact", event["contact"]] if "contact" in event else ():
            for key in {"stiffness", "exponent"} & event.keys():
                glide(getattr(item, key), event[key])
            if "barrier" in event or "gap" in event:
                glide(item.offset, event["gap"] if "gap" in event else sign * event["barrier"])

    def _assemble(self) -> None:
        """Form the matrices, in coordinates that fulfil rigid joints."""
        stiffness = np.diag(self.omega**2)
        self.stretches: list[tuple[float, np.ndarray]] = []  # K and the matrix of s
        for name, modes in self.modes.items():
            part, table = self.parts[name], next(b for b in self.scene["body"] if b["name"] == name)
            stretch = np.zeros((self.count, self.count))
            if name in self.ends:
                relative, apart = self._string_between_ends(name)
                stiffness[part, part] = 0.0
                stiffness += relative.T @ (modes.omega[:, None] ** 2 * relative)
                stiffness += table["tension"] / table["length"] * np.outer(apart, apart)
                stretch = relative.T @ (modes.kappa[:, None] * relative) + np.outer(apart, apart) / table["length"]
            elif modes.stiffness:
                stretch[part, part] = np.diag(modes.kappa)
            if modes.stiffness:
                self.stretches.append((modes.stiffness, stretch))
        damping, push = np.zeros_like(stiffness), np.zeros(self.count)
        for spring in self.springs:
            if spring.is_constant:
                stiffness += spring.stiffness.value * np.outer(spring.row, spring.row)
                damping += spring.damping_coefficient.value * np.outer(spring.row, spring.row)
                push += spring.stiffness.value * spring.rest.value * spring.row
        self.basis = null_space(np.array(self.rigid).reshape(-1, self.count))
        self.stiffness, self.damping = (self.basis.T @ matrix @ self.basis for matrix in (stiffness, damping))
        self.push = push @ self.basis
        self.stretches = [(k, self.basis.T @ matrix @ self.basis) for k, matrix in self.stretches]
        self.gliding = [
            spring._replace(row=spring.row @ self.basis) for spring in self.springs if not spring.is_constant
        ]
        self.pieces = [(row @ self.basis, piece) for row, piece in self.pieces]
        self.contact_rows = np.array([c.row @ self.basis for c in self.contacts]).reshape(-1, self.basis.shape[1])
        self.friction_rows = np.array([f.row @ self.basis for f in self.frictions]).reshape(-1, self.basis.shape[1])

    def _string_between_ends(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the modes of a string beside the line between its ends [modes, all modes], and of the
        distance between its ends. The line y0·(1 - x/L) + y1·x/L has the coefficients ∫ μ·φ·y dx."""
        table, part = next(b for b in self.scene["body"] if b["name"] == name), self.parts[name]
        number = np.arange(1.0, part.stop - part.start + 1.0)
        scale = math.sqrt(2.0 / (table["linear_density"] * table["length"]))
        share = scale * table["linear_density"] * table["length"] / (math.pi * number)
        relative, apart = np.zeros((number.size, self.count)), np.zeros(self.count)
        relative[:, part] = np.eye(number.size)
        for end, follows in self.ends[name]:
            relative -= np.outer(share if end == 0 else -share * (-1.0) ** number, follows)
            apart += follows if end == 1 else -follows
        return relative, apart

    def damp_rates(self, t: float) -> np.ndarray:
        """Return σ of all modes with the dampers that are down at a time; of two on a body the newer counts."""
        more, begun = np.zeros(self.count), np.full(self.count, -math.inf)
        for event in self.scene.get("event", []):
            if event["kind"] == "damp":
                begin, part = self._moment(event["time"]), self.parts[event["body"]]
                end = begin + self._moment(event["duration"]) if "duration" in event else math.inf
                if begin <= t < end and begin >= begun[part][0]:
                    more[part], begun[part] = event["sigma"], begin
        return self.sigma + more

    def solve(self, times: np.ndarray, tolerance: float = 1e-11) -> Motion:
        """Solve the equation at some times, the first of which is 0."""
        return Solution(self, times, tolerance).run()


def null_space(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of what all rows map to 0, as columns."""
    if not rows.size:
        return np.eye(rows.shape[1])
    _, values, vectors = np.linalg.svd(rows)
    return np.asarray(vectors[np.count_nonzero(values > 1e-12 * values[0]) :].T)


class Solution:
    """A solution of an equation, from kink to kink. State: coordinates, velocities, bristles, remembered speeds."""

    def __init__(self, ode: ModalOde, times: np.ndarray, tolerance: float) -> None:
        self.ode, self.times, self.tolerance = ode, times, tolerance
        self.size, points = ode.basis.shape[1], len(ode.frictions)
        self.way = [0] * points  # of the slip at each point of friction: 1, -1; 0 where it sticks
        self.y = np.concatenate([ode.q @ ode.basis, ode.p @ ode.basis, np.zeros(2 * points)])
        self.states, self.friction = np.zeros((times.size, self.y.size)), np.zeros((times.size, points))

    def run(self) -> Motion:
        """Integrate up to the last time."""
        ode, last = self.ode, float(self.times[-1])
        edges = [0.0]
        for t in sorted({*(t for t in ode.times if 0.0 < t < last), last}):
            if t - edges[-1] > SAME_TIME:
                edges.append(t)
        self.states[0] = self.y
        for begin, end in pairwise(edges):
            self._strike(begin)
            middle = 0.5 * (begin + end)
            self.pushes = [(row, piece.value) for row, piece in ode.pieces if piece.begin < middle < piece.end]
            sigma = ode.damp_rates(middle)
            self.damping = ode.damping + ode.basis.T @ (2.0 * sigma[:, None] * ode.basis)
            self._integrate(begin, end)
        q, v = self.states[:, : self.size], self.states[:, self.size : 2 * self.size]
        return Motion(q @ ode.basis.T, v @ ode.basis.T, self.friction)

    def _strike(self, t: float) -> None:
        """Launch the bodies that are struck at a time."""
        ode = self.ode
        for event in ode.scene.get("event", []):
            if event["kind"] == "strike" and abs(ode._moment(event["time"]) - t) < SAME_TIME:
                body = next(b for b in ode.scene["body"] if b["name"] == event["body"])
                q, p = (self.y[a : a + self.size] @ ode.basis.T for a in (0, self.size))
                root, part = math.sqrt(body["mass"]), ode.parts[event["body"]]
                q[part] = root * event.get("displacement", body.get("displacement", 0.0))
                p[part] = root * event["velocity"]
                self.y[: 2 * self.size] = np.concatenate([q @ ode.basis, p @ ode.basis])

    def _integrate(self, begin: float, end: float) -> None:
        """Integrate between two kinks, in which friction may stick and slip."""
        t = begin
        self.settle(t)
        inside = self.times[(self.times > begin + SAME_TIME) & (self.times <= end + SAME_TIME)]
        highest = math.sqrt(max(np.linalg.eigvalsh(self.ode.stiffness)[-1], 1.0))
        max_step = min(MAX_PHASE_OF_STEP / highest, MAX_STEP_OF_CONTACTS if self.ode.contacts else math.inf)
        while t < end:
            wanted = np.unique(np.minimum([*inside[inside > t + SAME_TIME], end], end))
            events = [self._switch(k) for k in range(len(self.way))]
            found = scipy.integrate.solve_ivp(
                *(self._rate, (t, end), self.y, "DOP853", wanted),
                rtol=self.tolerance,
                atol=1e-4 * self.tolerance,
                max_step=max_step,
                events=events or None,
            )
            assert found.status >= 0, found.message
            for moment, y in zip(found.t, np.reshape(found.y, (self.y.size, -1)).T, strict=True):
                n = int(np.searchsorted(self.times, moment - SAME_TIME))
                if n < self.times.size and abs(self.times[n] - moment) <= SAME_TIME:
                    self.states[n] = y
                    self.friction[n] = [self._friction(k, moment, y) for k in range(len(self.way))]
            if found.status == 1:
                k = next(k for k, at in enumerate(found.t_events) if at.size)
                t, self.y = float(found.t_events[k][0]), found.y_events[k][0].copy()
                self._turn(k, t)
            else:
                t, self.y = end, found.y[:, -1].copy()
                self._bend(t)

    # --- friction

    def _point(self, k: int, y: np.ndarray) -> tuple[float, float]:
        """Return the bristle and the remembered speed of a point."""
        place = 2 * self.size + k
        return y[place], y[place + len(self.way)]

    def _speed(self, k: int, t: float, y: np.ndarray) -> float:
        """Return how fast the body passes the surface at a point, m/s."""
        moves = self.ode.friction_rows[k] @ y[self.size : 2 * self.size]
        return float(moves - self.ode.frictions[k].velocity.at(t))

    def _switch(self, k: int) -> Callable[[float, np.ndarray], float]:
        """Return a function that falls to 0 where a point begins to slip, or to stick."""
        point, way = self.ode.frictions[k], self.way[k]

        def reserve(t: float, y: np.ndarray) -> float:
            bristle, remembered = self._point(k, y)
            if not way:
                return point.bound(t, remembered) - abs(bristle)
            return point.slip(t, way * self._speed(k, t, y), remembered)

        reserve.terminal, reserve.direction = True, -1.0  # type: ignore[attr-defined]
        return reserve

    def _turn(self, k: int, t: float) -> None:
        """Let a point slip that has stuck, or stick that has slipped."""
        bristle, remembered = self._point(k, self.y)
        bound = self.ode.frictions[k].bound(t, remembered)
        if self.way[k]:
            way, self.way[k] = self.way[k], 0
            self.y[2 * self.size + k] = way * bound * (1.0 - 1e-12)
            if bound == 0.0:  # nothing presses: it slips the other way
                self.way[k] = -way
        else:
            self.way[k] = 1 if bristle > 0.0 else -1

    def _bend(self, t: float) -> None:
        """Let the bristles of points that slip be at their bounds."""
        for k, way in enumerate(self.way):
            if way:
                self.y[2 * self.size + k] = way * self.ode.frictions[k].bound(t, self._point(k, self.y)[1])

    def settle(self, t: float) -> None:
        """Find which points slip, after a kink."""
        for k, point in enumerate(self.ode.frictions):
            (bristle, remembered), speed = self._point(k, self.y), self._speed(k, t, self.y)
            bound = point.bound(t, remembered)
            way = int(np.sign(bristle) or np.sign(speed))
            slips = abs(bristle) >= bound * (1.0 - 1e-11) and point.slip(t, way * speed, remembered) > 0.0
            self.way[k] = way if slips else 0
        self._bend(t)

    def _friction(self, k: int, t: float, y: np.ndarray) -> float:
        """Return the force of friction on the body of a point, N."""
        point, (bristle, remembered) = self.ode.frictions[k], self._point(k, y)
        bent = self.way[k] * point.bound(t, remembered) if self.way[k] else bristle
        return -point.bristle * bent

    # --- the rate of change

    def _rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the rate of change of the state."""
        ode, size = self.ode, self.size
        x, v = y[:size], y[size : 2 * size]
        change = np.zeros_like(y)
        force = ode.push - ode.stiffness @ x - self.damping @ v
        for stiffness, matrix in ode.stretches:
            side = matrix @ x
            force -= stiffness * (x @ side) * side
        for row, stiffness, damping, rest in ode.gliding:
            force -= row * (stiffness.at(t) * (row @ x - rest.at(t)) + damping.at(t) * (row @ v))
        for row, value in self.pushes:
            force += row * value(t)
        if ode.contacts:
            force -= ode.contact_rows.T @ self._contact_forces(t, x, v)
        for k, point in enumerate(ode.frictions):
            place, way = 2 * size + k, self.way[k]
            speed, remembered = self._speed(k, t, y), y[place + len(self.way)]
            force += ode.friction_rows[k] * self._friction(k, t, y)
            slip = point.slip(t, way * speed, remembered) if way else 0.0
            change[place] = 0.0 if way else speed
            change[place + len(self.way)] = (slip - remembered) / point.memory if point.memory else 0.0
        change[:size], change[size : 2 * size] = v, force
        return change

    def _contact_forces(self, t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return k·s^α·max(0, 1 + μ·s') of all contacts, N."""
        compressions, speeds = self.ode.contact_rows @ x, self.ode.contact_rows @ v
        forces = np.zeros(len(self.ode.contacts))
        for k, (_, offset, stiffness, exponent, loss) in enumerate(self.ode.contacts):
            s = compressions[k] - offset.at(t)
            if s > 0.0:
                forces[k] = stiffness.at(t) * s ** exponent.at(t) * max(0.0, 1.0 + loss * speeds[k])
        return forces


def solve_pickups(scene: dict, frames: int, rate: float = RATE, tolerance: float = 1e-11) -> np.ndarray:
    """Return the displacements at all pickups of a scene [frames, pickups], m."""
    ode = ModalOde(scene, rate)
    motion = ode.solve(np.arange(frames) / rate, tolerance)
    rows = [ode.row(pickup["body"], pickup.get("at")) for pickup in scene["pickup"]]
    return np.asarray(motion.q @ np.array(rows).T)
