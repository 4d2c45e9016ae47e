"""Random scenes over the whole documented ranges of a patch: half of the values within a quarter of the decades,
and some at the very ends. All of one order have the same effects and law, so that one kernel runs them."""

import math
from typing import Any, NamedTuple

import numpy as np

import engine
from engine.bodies.string import MAX_TENSION
from engine.patch.tables import max_stiffness

RATE = 44_100


def within(rng: np.random.Generator, low: float, high: float, corners: float = 0.08) -> float:
    """A value whose exponent lies within a quarter of the range low to high, or one of its ends."""
    if rng.random() < corners:
        return float(rng.choice([low, high]))
    a, b = np.log10(low) / 4, np.log10(high) / 4
    return float(10 ** rng.uniform(a, b))


def signed(rng: np.random.Generator, low: float, high: float) -> float:
    """The same of either sign, or 0."""
    return 0.0 if rng.random() < 0.3 else float(rng.choice([-1.0, 1.0])) * within(rng, low, high)


def damped(rng: np.random.Generator, low: float, high: float) -> float:
    return 0.0 if rng.random() < 0.4 else within(rng, low, high)


def scene(seed: int, order: int = 2) -> engine.Scene:
    """Two to four bodies, up to five contacts."""
    rng = np.random.default_rng(seed)
    bodies = [_body(rng, i) for i in range(rng.integers(2, 5))]
    names = [b["name"] for b in bodies]
    contacts = [_contact(rng, bodies) for _ in range(rng.integers(1, 6))]
    spare = {"body": "x", "stiffness": 1.0, "exponent": 7.7}
    contacts += [spare | {"on": "y", "gap": 1e5}, spare | {"barrier": 1e5, "loss": 1.0}]
    bodies += [  # these call for every effect, in each scene
        {"name": "x", "kind": "mass", "mass": 1.0, "damping_rate": 1.0},
        {"name": "y", "kind": "oscillator", "mass": 1.0, "frequency": 100.0, "damping_rate": 1.0},
    ]
    forces = [{"kind": "half_sine", "body": "x", "amplitude": 1e-9, "duration": 1e-3}]
    if rng.random() < 0.5:
        name = rng.choice(names)
        at = {"at": 0.3} if next(b for b in bodies if b["name"] == name)["kind"] == "string" else {}
        forces.append({"kind": "pulse", "body": name, "amplitude": signed(rng, 1e-9, 1e6), "duration": 5e-3} | at)
    return engine.Scene.model_validate(
        {
            "gravity": float(rng.choice([0.0, 9.81, within(rng, 1e-4, 1e4), -within(rng, 1e-4, 1e4)])) or 1e-9,
            "accuracy": {"order": order, "scheme": str(rng.choice(["exact", "exact", "fdh"]))},
            "body": bodies,
            "contact": contacts,
            "force": forces,
            "pickup": [{"body": "x"}, {"body": "x", "quantity": "force"}],
        }
    )


def _body(rng: np.random.Generator, i: int) -> dict:
    kind = rng.choice(["mass", "oscillator", "string"], p=[0.45, 0.35, 0.2])
    if kind == "string":
        length, mass = within(rng, 1e-4, 1e4), within(rng, 1e-9, 1e9)
        highest = np.sqrt(0.99 * MAX_TENSION / (4 * length * mass))  # Hz
        return {
            "name": f"b{i}",
            "kind": "string",
            "length": length,
            "mass": mass,
            "frequency": float(min(10 ** rng.uniform(0, 4.2), highest)),
            "modes": int(rng.integers(1, 13)),
            "sigma0": damped(rng, 1e-6, 1e6),
        }
    body = {
        "name": f"b{i}",
        "kind": str(kind),
        "mass": within(rng, 1e-12, 1e9),
        "damping_rate": damped(rng, 1e-6, 1e6),
        "displacement": signed(rng, 1e-12, 1e3),
        "velocity": signed(rng, 1e-9, 1e4),
    }
    if kind == "oscillator":
        body["frequency"] = float(
            rng.choice([0.0, within(rng, 1e-6, 2e4), 10 ** rng.uniform(1, 4.3)], p=[0.1, 0.2, 0.7])
        )
    return body


def _contact(rng: np.random.Generator, bodies: list[dict]) -> dict:
    own, other = (bodies[int(n)] for n in rng.permutation(len(bodies))[:2])
    exponent = float(rng.choice([1.0, 1.0, 1.3, 1.5, 2.0, 2.5, 3.0, 5.0, 12.0]))
    contact = {
        "body": own["name"],
        "side": str(rng.choice(["above", "below"])),
        "stiffness": within(rng, 1e-6, max_stiffness(exponent)),
        "exponent": exponent,
        "loss": damped(rng, 1e-9, 1e9),
    }
    if own["kind"] == "string":
        contact["at"] = float(rng.uniform(0.05, 0.95))
    if rng.random() < 0.5:
        contact |= {"on": other["name"], "gap": signed(rng, 1e-12, 1e6)}
        if other["kind"] == "string":
            contact["on_at"] = float(rng.uniform(0.05, 0.95))
    else:
        contact["barrier"] = signed(rng, 1e-12, 1e6)
    return contact


# --- scenes whose bodies stretch, are joined and rub

Span = tuple[float, float]


class JoinedRanges(NamedTuple):
    """Ranges of the values of joined scenes, lowest and highest: the promises hold within (docs/guarantees.md)."""

    string_length: Span = 1e-2, 10.0  # m
    string_mass: Span = 4e-6, 10.0  # kg
    string_frequency: Span = 20.0, 5e3  # Hz
    string_tension: float = 1e5  # N, the highest, which limits the frequency
    sheet_side: Span = 1e-2, 10.0  # m
    area_density: Span = 1e-3, 1e3  # kg/m²
    sheet_frequency: Span = 10.0, 2e3  # Hz
    mass: Span = 4e-6, 1e3  # kg, of masses and oscillators
    frequency: Span = 1e-2, 1e4  # Hz, of oscillators
    decay_rate: Span = 1e-3, 1e5  # 1/s, of bodies and of dampers
    displacement: Span = 1e-6, 0.1  # m; of strings and sheets at most a tenth of the length
    velocity: Span = 1e-3, 10.0  # m/s
    force: Span = 1e-3, 1e3  # N
    start_force: Span = 1e-3, 10.0  # N, of springs and contacts at time 0
    axial_stiffness: Span = 1.0, 4e6  # N, of strings
    stretching_stiffness: Span = 1.0, 1.2e8  # N/m, of sheets
    slackness: float = 4e5  # the largest of these, as multiples of the tension at rest
    connection_stiffness: Span = 1e-3, 2e9  # N/m
    connection_damping: Span = 1e-6, 5e4  # kg/s
    connection_number: float = 250.0  # the largest k·h²/m and r·h/m, m the mass of the lighter body, h one sample
    contact_force_at_1_mm: Span = 1e-6, 1.3e8  # N
    loss: Span = 1e-4, 1e4  # s/m
    normal_force: Span = 1e-3, 1e3  # N, of friction
    bristle: Span = 1.0, 1e7  # N/m
    slip_speed: Span = 1e-4, 100.0  # m/s
    memory: Span = 1e-6, 1e-1  # s


JOINED = JoinedRanges()
EXTENDED = "string", "membrane", "plate"
BACKWARDS_DECAY = 1e3  # 1/s: orders 4 and 6 have steps back in time, and refuse stronger damping
BACKWARDS_DAMPING = 1e-2  # kg/s
JOINTS = 0.05  # the first position of connections; contacts are no nearer to them than 0.03 of the length


class _Drawing(NamedTuple):
    """What a joined scene is drawn with."""

    rng: np.random.Generator
    ranges: JoinedRanges
    order: int

    def value(self, span: Span, highest: float = math.inf) -> float:
        """A value whose exponent lies within a range, or one of its ends."""
        low, high = span[0], min(span[1], highest)
        return float(self.rng.choice([low, high]) if self.chance(0.1) else low * (high / low) ** self.rng.random())

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def either(self, span: Span, highest: float = math.inf) -> float:
        """The same of either sign."""
        return float(self.rng.choice([-1.0, 1.0])) * self.value(span, highest)


def joined_scene(seed: int, order: int = 2, ranges: JoinedRanges = JOINED) -> engine.Scene:
    """Two to four bodies, of which strings, membranes and plates may stretch, with springs, dampers, rigid joints, ends
    of strings on other bodies, contacts with loss, dampers and, at order 2, friction."""
    draw = _Drawing(np.random.default_rng([seed, order]), ranges, order)
    rng = draw.rng
    bodies = [_joined_body(draw, n) for n in range(rng.integers(2, 5))]
    if not any(body["kind"] in EXTENDED for body in bodies):
        bodies[0] = _joined_body(draw, 0, "string")
    joint = _rigid_joint(draw, bodies) if draw.chance(0.4) else {}
    held = joint.get("body"), joint.get("on")
    shortest = min(side for body in bodies for side in [body.get("length", math.inf), *body.get("size", [])])
    for body in bodies:
        if body["name"] not in held:
            body |= _motion(draw, body, shortest / 10, moves=body is bodies[-1])
    connections = [_spring(draw, bodies) for _ in range(rng.integers(0, 4))]
    connections += [end for body in bodies if body["kind"] == "string" for end in _ends(draw, body, bodies)]
    connections += [joint] if joint else []
    contacts = [_joined_contact(draw, bodies, n) for n in range(rng.integers(0, 4))]
    friction = [_friction(draw, bodies, contacts) for _ in range(rng.integers(0, 3))] if order == 2 else []
    return engine.Scene.model_validate(
        {
            "gravity": float(rng.choice([0.0, 9.81])),
            "accuracy": {
                "order": order,
                "substeps": int(rng.choice([1, 1, 1, 2])),
                "least_detuning": float(rng.choice([0.0, 0.1])),
            },
            "body": bodies,
            "connection": connections,
            "contact": contacts,
            "friction": friction,
            "force": [_blow(draw, bodies)],
            "event": [_damper(draw, bodies) for _ in range(rng.integers(0, 3))],
            "pickup": [{"body": "b0"} | _position(draw, bodies[0], "at")],
        }
    )


def _joined_body(draw: _Drawing, n: int, kind: str | None = None) -> dict[str, Any]:
    rng, ranges = draw.rng, draw.ranges
    kind = kind or str(rng.choice(["mass", "oscillator", *EXTENDED], p=[0.2, 0.2, 0.35, 0.15, 0.1]))
    body: dict[str, Any] = {"name": f"b{n}", "kind": kind}
    if kind in EXTENDED:
        body["modes"] = int(rng.integers(1, 9))
        if draw.chance(0.5):
            body["sigma0"] = draw.value(ranges.decay_rate, _most_decay(draw))
    if kind == "string":
        length, mass = draw.value(ranges.string_length), draw.value(ranges.string_mass)
        highest = math.sqrt(ranges.string_tension / (4 * length * mass))  # Hz
        body |= {"length": length, "mass": mass, "frequency": draw.value(ranges.string_frequency, highest)}
        if draw.chance(0.7):
            tension = mass * length * (2 * body["frequency"]) ** 2
            body["axial_stiffness"] = draw.value(ranges.axial_stiffness, ranges.slackness * tension)
        if draw.chance(0.3):
            body |= {"polarisations": 2, "polarisation_angle": float(rng.uniform(-2, 2))}
    elif kind in EXTENDED:
        body |= {
            "size": [draw.value(ranges.sheet_side), draw.value(ranges.sheet_side)],
            "area_density": draw.value(ranges.area_density),
            "frequency": draw.value(ranges.sheet_frequency),
        }
        if draw.chance(0.7):
            waves = sum(1 / side**2 for side in body["size"])  # 1/m²; the tension of a membrane, N/m:
            tension = body["area_density"] * (2 * body["frequency"]) ** 2 / waves
            body["stretching_stiffness"] = draw.value(ranges.stretching_stiffness, ranges.slackness * tension)
    else:
        body["mass"] = draw.value(ranges.mass)
        if draw.chance(0.4):
            body["damping_rate"] = draw.value(ranges.decay_rate, _most_decay(draw))
        if kind == "oscillator":
            body["frequency"] = draw.value(ranges.frequency)
    return body


def _most_decay(draw: _Drawing) -> float:
    return math.inf if draw.order == 2 else BACKWARDS_DECAY


def _motion(draw: _Drawing, body: dict[str, Any], farthest: float, moves: bool) -> dict[str, Any]:
    """Displacement and velocity of a body at time 0. farthest: displacement, m; moves: whether it has a velocity in any
    case"""
    ranges, is_extended = draw.ranges, body["kind"] in EXTENDED
    motion: dict[str, Any] = {}
    if draw.chance(0.6):
        motion["displacement"] = draw.either(ranges.displacement, farthest)
    if moves or draw.chance(0.5):
        motion["velocity"] = draw.either(ranges.velocity)
    return {k: {"kind": "mode", "number": 1, "amplitude": v} if is_extended else v for k, v in motion.items()}


def _position(draw: _Drawing, body: dict[str, Any], key: str, first: float = 0.1) -> dict[str, Any]:
    """A position on a body, where it has several: near one of nine, 0.1 apart from the first one on."""
    if body["kind"] not in EXTENDED:
        return {}
    count = 1 if body["kind"] == "string" else 2
    place = [first + 0.1 * int(draw.rng.integers(9)) + float(draw.rng.uniform(-0.01, 0.01)) for _ in range(count)]
    return {key: place[0] if len(place) == 1 else place}


def _sides(draw: _Drawing, bodies: list[dict[str, Any]], share: float, first: float = 0.1) -> dict[str, Any]:
    """A body, and in a share of the cases another one on the other side. first: see _position"""
    one, other = (bodies[int(n)] for n in draw.rng.permutation(len(bodies))[:2])
    sides = {"body": one["name"]} | _position(draw, one, "at", first)
    return sides | {"on": other["name"]} | _position(draw, other, "on_at", first) if draw.chance(share) else sides


def _place(body: dict[str, Any], at: Any) -> float:
    """Where a body begins at a position, m."""
    displacement = body.get("displacement", 0.0)
    if not isinstance(displacement, dict):
        return float(displacement)
    return float(displacement["amplitude"] * np.prod(np.sin(np.pi * np.atleast_1d(at))))


def _distance(sides: dict[str, Any], bodies: list[dict[str, Any]]) -> float:
    """Where the first side begins, seen from the other one, m."""
    named = {body["name"]: body for body in bodies}
    other = _place(named[sides["on"]], sides.get("on_at")) if "on" in sides else 0.0
    return _place(named[sides["body"]], sides.get("at")) - other


def _mass(body: dict[str, Any]) -> float:
    return float(body["area_density"] * np.prod(body["size"]) if "size" in body else body["mass"])


def _spring(draw: _Drawing, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    """A spring that begins relaxed or a little strained, or a damper, or both."""
    spring = _sides(draw, bodies, 0.75, JOINTS)
    lightest = min(_mass(body) for body in bodies if body["name"] in (spring["body"], spring.get("on")))
    most = draw.ranges.connection_number * lightest * RATE  # kg/s
    if draw.chance(0.8):
        stiffness = draw.value(draw.ranges.connection_stiffness, most * RATE)
        strain = min(draw.value(draw.ranges.start_force) / stiffness, 1e-2) if draw.chance(0.5) else 0.0
        spring |= {"stiffness": stiffness, "rest": _distance(spring, bodies) + strain}
    if "stiffness" not in spring or draw.chance(0.5):
        highest = most if draw.order == 2 else BACKWARDS_DAMPING
        spring["damping_coefficient"] = draw.value(draw.ranges.connection_damping, highest)
    return spring


def _rigid_joint(draw: _Drawing, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    """A rigid joint of the first body with the ground, or with the second one if that has several modes, too, or is
    heavier; none if the first has one mode, which would all be held. Its sides begin at rest."""
    one, other = bodies[:2]
    if one.get("modes", 1) == 1:
        return {}
    joint = {"body": one["name"], "rigid": True} | _position(draw, one, "at", JOINTS)
    moves = other["modes"] > 1 if other["kind"] in EXTENDED else _mass(other) >= _mass(one)
    if len(bodies) > 2 and moves and draw.chance(0.5):
        return joint | {"on": other["name"]} | _position(draw, other, "on_at", JOINTS)
    return joint


def _ends(draw: _Drawing, string: dict[str, Any], bodies: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Ends of a string on a body that is no string: neither, one or both."""
    others = [body for body in bodies if body["kind"] != "string"]
    ends: list[dict[str, Any]] = []
    for at in (0.0, 1.0):
        if others and draw.chance(0.25):
            other = others[int(draw.rng.integers(len(others)))]
            share = {"share": float(draw.rng.uniform(-1, 1))} if draw.chance(0.3) else {}
            end = {"kind": "end", "body": string["name"], "at": at, "on": other["name"]}
            ends.append(end | _position(draw, other, "on_at", JOINTS) | share)
    return ends


def _joined_contact(draw: _Drawing, bodies: list[dict[str, Any]], n: int) -> dict[str, Any]:
    """A contact that begins open, or a little compressed."""
    rng = draw.rng
    contact = _sides(draw, bodies, 0.7)
    exponent = float(rng.choice([1.0, 1.5, 2.0, 2.5, 3.0, rng.uniform(1, 12)]))
    stiffness = draw.value(draw.ranges.contact_force_at_1_mm) * 1e3**exponent
    compression = (draw.value(draw.ranges.start_force) / stiffness) ** (1 / exponent)
    room = float(rng.choice([0.0, rng.uniform(0.0, 3e-3), -min(compression, 1e-2)]))
    side = 1.0 if draw.chance(0.5) else -1.0
    distance = _distance(contact, bodies)
    return contact | {
        "name": f"c{n}",
        **({"gap": side * distance + room} if "on" in contact else {"barrier": distance + side * room}),
        "side": "above" if side > 0.0 else "below",
        "stiffness": stiffness,
        "exponent": exponent,
        "loss": draw.value(draw.ranges.loss) if draw.chance(0.6) else 0.0,
    }


def _friction(draw: _Drawing, bodies: list[dict[str, Any]], contacts: list[dict[str, Any]]) -> dict[str, Any]:
    rng, ranges = draw.rng, draw.ranges
    friction = _sides(draw, bodies, 0.4)
    static = float(rng.uniform(0, 10)) if draw.chance(0.2) else float(rng.uniform(0, 1.5))
    friction |= {
        "static": static,
        "dynamic": float(rng.uniform(0, 1)) * static,
        "speed": draw.value(ranges.slip_speed),
        "memory": draw.value(ranges.memory) if draw.chance(0.5) else 0.0,
        "bristle": draw.value(ranges.bristle),
    }
    friction |= _law_of_friction(rng.spawn(1)[0], friction["bristle"])
    if "on" not in friction:
        friction["velocity"] = draw.either(ranges.velocity)
    if contacts and draw.chance(0.4):
        return friction | {"contact": str(rng.choice([contact["name"] for contact in contacts]))}
    return friction | {"force": draw.value(ranges.normal_force)}


def _law_of_friction(rng: np.random.Generator, bristle: float) -> dict[str, Any]:
    """Draw what else friction has, by numbers of its own, so that scenes stay as they were."""
    law: dict[str, Any] = {"curve": str(rng.choice(["hyperbolic", "exponential"]))}
    if rng.uniform() < 0.5:
        law["bristle_damping"] = bristle * float(rng.choice([0.0, 10.0 ** rng.uniform(-7, -3)]))
    if rng.uniform() < 0.3:
        law["viscous"] = float(10.0 ** rng.uniform(-3, 1))
    return law


def _blow(draw: _Drawing, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    body = bodies[int(draw.rng.integers(len(bodies)))]
    blow = {"kind": "half_sine", "body": body["name"]} | _position(draw, body, "at")
    return blow | {"amplitude": draw.either(draw.ranges.force), "duration": draw.value((1e-4, 1e-2))}


def _damper(draw: _Drawing, bodies: list[dict[str, Any]]) -> dict[str, Any]:
    body = bodies[int(draw.rng.integers(len(bodies)))]["name"]
    sigma, times = draw.value(draw.ranges.decay_rate, _most_decay(draw)), draw.rng.uniform(1e-4, 0.03, 2)
    return {"kind": "damp", "body": body, "time": float(times[0]), "sigma": sigma, "duration": float(times[1])}
