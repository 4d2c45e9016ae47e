"""How near the engine is to the paper's own equations: these are solved here as they are printed, in fifty digits, for
the systems of the paper's figures, and each sample of the displacement is compared."""

import decimal
import math
from collections.abc import Iterator
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np

import engine
from bench.publish.report import ROOT, publish

RATE = 44_100
DIGITS = 50
CLOSE = Decimal(10) ** -36  # residual of F(x) = 0, relative to its terms
CASES = {  # figure: patch or (α, β), and the seconds that the figure shows; of Fig. 4, the steps of the collision
    "1, α = 2": ("barrier_quadratic", 0.15),
    "1, α = 3": ("barrier_cubic", 0.15),
    "2": ("barrier_linear", 0.15),
    "4, α = 1": ((1.0, 0.5), 40 / RATE),
    "4, α = 2.4": ((2.4, 1000.0), 40 / RATE),
    "5": ("bouncing_ball", 1.5),
    "6": ("repelled_oscillator", 0.005),
    "7": ("driven_ball", 4.0),
}


class Mass(NamedTuple):
    """A mass of one of the paper's figures, with its barrier, spring, weight, damping and force."""

    mass: Decimal
    start: Decimal  # m
    velocity: Decimal  # m/s, at time 0
    side: int  # 1 for a barrier above, -1 for a floor
    barrier: Decimal
    stiffness: Decimal
    exponent: Decimal
    spring: Decimal  # N/m
    gravity: Decimal
    damping: Decimal  # γ, 1/s
    force: Any  # a half sine of the patch, or None

    def external_force(self, frame: int) -> Decimal:
        """The external force at a sample, N."""
        if self.force is None:
            return Decimal(0)
        phase = (frame / RATE - self.force.start) / self.force.duration
        return Decimal(self.force.amplitude * math.sin(math.pi * phase) if 0.0 <= phase <= 1.0 else 0.0)


class Equation(NamedTuple):
    """F(x) = 0 of a step: A·Δ⌊s⌋^(α+1)/x + slope·x + constant, with s the compression at its start (eq. 13)."""

    side: int
    compression: Decimal
    power: Decimal  # α + 1
    factor: Decimal  # A = β/(2(α + 1))
    slope: Decimal
    constant: Decimal

    def residual(self, x: Decimal) -> tuple[Decimal, Decimal, Decimal]:
        """F(x), its derivative (eq. 17), and the size of its terms."""
        before = max(self.compression, Decimal(0))
        after = max(self.compression + self.side * x, Decimal(0))
        if x == 0:  # the limit of the same (eq. 14)
            mean = self.side * self.power * before ** (self.power - 1) if before else Decimal(0)
            curve = self.power * (self.power - 1) * before ** (self.power - 2) / 2 if before else Decimal(0)
        else:
            gained = (after**self.power if after else 0) - (before**self.power if before else 0)
            mean = gained / x
            curve = (self.side * self.power * (after ** (self.power - 1) if after else 0) - mean) / x
        terms = self.factor * mean, self.slope * x, self.constant
        return sum(terms, Decimal(0)), self.factor * curve + self.slope, sum(map(abs, terms), Decimal(0))

    def solve(self, x: Decimal) -> Decimal:
        """Its root by Newton's method from a guess. Raises ArithmeticError if it finds none."""
        for _ in range(200):
            value, slope, size = self.residual(x)
            if abs(value) <= CLOSE * size:
                return x
            x -= value / slope
        raise ArithmeticError("Newton's method does not end")


def scene_of(what: Any) -> engine.Scene:
    """The scene of a shipped patch, or of a collision of Fig. 4 by its α and β, with q₀ = 0.01 m."""
    if isinstance(what, str):
        return engine.load(ROOT / "patches" / f"{what}.toml")
    alpha, beta = what
    mass = {"name": "m", "kind": "mass", "mass": 1.0, "displacement": -0.033, "velocity": 0.01 * RATE}
    law = {"body": "m", "barrier": 0.0, "stiffness": beta * RATE**2, "exponent": alpha}
    return engine.Scene.model_validate({"body": [mass], "contact": [law], "pickup": [{"body": "m"}]})


def mass_of(scene: engine.Scene) -> Mass:
    """The one mass of a scene, each number to the bit as the engine has it."""
    body, contact = scene.body[0], scene.contact[0]
    frequency, damping = getattr(body, "frequency", None) or 0.0, getattr(body, "damping_rate", None) or 0.0
    spring = (2 * math.pi * frequency) ** 2 * body.mass
    numbers = [body.mass, body.displacement, body.velocity]
    law = [contact.barrier, contact.stiffness, contact.exponent, spring, scene.gravity, damping]
    side = 1 if contact.side == "above" else -1
    force = scene.force[0] if scene.force else None
    return Mass(*map(Decimal, numbers), side, *map(Decimal, law), force)


def follow(body: Mass, frames: int) -> Iterator[tuple[Decimal, Decimal]]:
    """Displacement and energy (eq. 28, with weight) at each sample, by eq. 13, 27, 29 and 38 in one."""
    step = Decimal(1) / RATE
    loss = (body.damping * step / 2).exp()  # r of eq. 36
    weight = step**2 * body.gravity / 2
    spring = step**2 * body.spring / (4 * body.mass)
    power = body.exponent + 1
    factor = step**2 * body.stiffness / body.mass / (2 * power)
    y, q = body.start, body.velocity * step
    x = q
    yield y, energy(body, y, q / step)
    for frame in range(frames):
        push = step**2 * (body.external_force(frame) + body.external_force(frame + 1)) / (4 * body.mass)
        constant = 2 * spring * y - q / loss + weight - push
        depth = body.side * (y - body.barrier)
        x = Equation(body.side, depth, power, factor, 1 + spring, constant).solve(x)
        y, q = y + x, (2 * x - q / loss) / loss
        yield y, energy(body, y, q / step)


def energy(body: Mass, y: Decimal, velocity: Decimal) -> Decimal:
    """Kinetic and potential energy, J."""
    depth = max(body.side * (y - body.barrier), Decimal(0))
    contact = body.stiffness * depth ** (body.exponent + 1) / (body.exponent + 1) if depth else Decimal(0)
    return body.mass * velocity**2 / 2 + contact + body.spring * y**2 / 2 + body.mass * body.gravity * y


def compare(what: Any, seconds: float) -> tuple[float, float, float]:
    """The largest difference in displacement between engine and equations, relative to the largest displacement; the
    energy error of the engine, and that of the equations (eq. 20), which is 0 without loss and force."""
    scene = scene_of(what)
    frames = round(seconds * RATE)
    with decimal.localcontext(decimal.Context(prec=DIGITS)):
        followed = list(follow(mass_of(scene), frames))
        exact = np.array([float(y) for y, _ in followed])
        largest = max(abs(total) for _, total in followed)
        drift = float(max(abs(total - followed[0][1]) for _, total in followed) / largest)
    rendering = engine.render(scene, seconds=seconds, samplerate=RATE, scheme="fdh", trace=True)
    ours = rendering.trace["displacement"][: frames + 1, 0]
    difference = np.abs(ours - exact[: len(ours)]).max() / np.abs(exact).max()
    return float(difference), rendering.stats.energy.error_max, drift


def run() -> None:
    """Compare and publish."""
    rows = []
    for figure, (what, seconds) in CASES.items():
        difference, error, drift = compare(what, seconds)
        conserves = not scene_of(what).force
        theirs = f"{drift:.0e}" if conserves else "driven and damped"
        rows.append([figure, f"{round(seconds * RATE)}", f"{difference:.0e}", f"{error:.0e}", theirs])
    header = ["figure", "steps", "displacement, ours less the equations'", "energy error, ours"]
    publish("equations", [*header, f"energy error of the equations in {DIGITS} digits"], rows)
