"""A Scene at a sample rate becomes a Model and a State.

Only what the scene calls for is built: an effect that no part uses, or that amounts to
absence (no loss, no stiffness), is None.
"""

import math
from typing import NamedTuple

import numpy as np

from engine import coupled, energy, solve
from engine.laws import law_of
from engine.layout import Layout, Point
from engine.model import (
    ACCELERATION,
    DISPLACEMENT,
    FORCE,
    VELOCITY,
    Contact,
    ContactLoss,
    Coupling,
    Force,
    Gravity,
    Loss,
    Model,
    Modes,
    Pickups,
    Spring,
    State,
)
from engine.modes import TABLES
from engine.scene import Scene
from engine.waveform import table

QUANTITIES = {"displacement": DISPLACEMENT, "velocity": VELOCITY, "acceleration": ACCELERATION, "force": FORCE}
TOLERANCE = 1e-15  # relative error left in a compression; a looser one saves little (DESIGN sec. 2)
CAP = 6  # rounds of a coupled solve (DESIGN sec. 3)
HIGHEST = 0.49  # of the sample rate; what vibrates faster would come out at another frequency


class BuildError(ValueError):
    """A valid scene that cannot be built as asked; `faults` lists (path, what) pairs."""

    def __init__(self, faults: list[tuple[str, str]]) -> None:
        super().__init__("\n".join(f"{path}: {what}" for path, what in faults))
        self.faults = faults


class Built(NamedTuple):
    """What `build` returns."""

    model: Model
    state: State
    layout: Layout


def build(scene: Scene, samplerate: float, scheme: str = "exact") -> Built:
    """Model, State and Layout of a scene at a sample rate (Hz), with the coefficients of a scheme.

    scheme: "exact" (free vibration at its own frequency and decay) or "fdh" (the paper's).
    Raises BuildError if a body vibrates too fast for the sample rate.
    """
    if scheme not in TABLES:
        raise ValueError(f'unknown scheme "{scheme}"; one of {", ".join(TABLES)}')
    layout = Layout(scene)
    if scheme == "exact":
        _check_rate(layout, samplerate)
    omega, sigma = layout.gather("omega"), layout.gather("sigma")
    modes = Modes(*TABLES[scheme](omega, sigma, 1.0 / samplerate))
    contact, contact_loss, coupling = _contact(layout, modes, samplerate)
    partners = [_ends(layout, k)[1] for k in layout.contact]
    model = Model(
        samplerate=float(samplerate),
        islands=layout.islands,
        modes=modes,
        spring=Spring(omega**2) if omega.any() else None,
        loss=_loss(sigma, samplerate),
        gravity=_gravity(layout),
        force=_force(layout, modes, samplerate),
        contact=contact,
        partner=layout.rows(partners, modes) if any(name is not None for name, _ in partners) else None,
        contact_loss=contact_loss,
        coupling=coupling,
        pickups=_pickups(layout, modes),
        bodies=layout.rows([(scene.body[b].name, 1.0) for b in layout.body], modes),
    )
    return Built(model, _state(layout, model), layout)


def _check_rate(layout: Layout, samplerate: float) -> None:
    """The exact table needs every frequency below the Nyquist frequency."""
    faults = []
    for i, body in enumerate(layout.modal):
        fastest = math.sqrt(max(0.0, float(np.max(body.omega**2 - body.sigma**2)))) / (2 * math.pi)
        if fastest > HIGHEST * samplerate:
            what = f"vibrates at {fastest:g} Hz, above {HIGHEST} of the sample rate of {samplerate:g} Hz"
            faults.append((f"body[{i}]", f"{what}; render with --samplerate {math.ceil(fastest / HIGHEST)} or more"))
    if faults:
        raise BuildError(faults)


def _loss(sigma: np.ndarray, samplerate: float) -> Loss | None:
    if not sigma.any():
        return None
    keep = np.exp(-sigma / samplerate)
    return Loss(keep, 0.5 * (1 - keep) * (1 + keep))  # of the rounded d: the two must agree, or the ledger drifts


def _gravity(layout: Layout) -> Gravity | None:
    if layout.scene.gravity == 0.0:
        return None
    return Gravity(-layout.scene.gravity * layout.gather("weight"))


def _ends(layout: Layout, k: int) -> tuple[Point, Point]:
    """The two points that contact k of the scene joins, with the sign of their part in its compression."""
    c = layout.scene.contact[k]
    sign = 1.0 if c.side == "above" else -1.0
    return (c.body, sign), (c.on, -sign)


def _contact(
    layout: Layout, modes: Modes, samplerate: float
) -> tuple[Contact | None, ContactLoss | None, Coupling | None]:
    if not layout.contact:
        return None, None, None
    chosen = [layout.scene.contact[k] for k in layout.contact]
    barrier = [
        (c.gap or 0.0) if c.on is not None else (1.0 if c.side == "above" else -1.0) * (c.barrier or 0.0)
        for c in chosen
    ]
    rate = np.array([c.loss for c in chosen]) * samplerate
    matrices, beneath = _compliances(layout, modes)
    contact = Contact(
        law=law_of(np.array([c.stiffness for c in chosen]), np.array([c.exponent for c in chosen])),
        rows=layout.rows([_ends(layout, k)[0] for k in layout.contact], modes),
        barrier=np.array(barrier),
        compliance=np.concatenate([np.diag(m) for m in matrices]),
        beneath=beneath,
        tolerance=TOLERANCE,
        cap=CAP,
    )
    begin = np.cumsum([0] + [m.size for m in matrices]).astype(np.int64)
    several = any(m.size > 1 for m in matrices)
    return (
        contact,
        ContactLoss(rate) if rate.any() else None,
        Coupling(begin, np.concatenate([m.ravel() for m in matrices])) if several else None,
    )


def _compliances(layout: Layout, modes: Modes) -> tuple[list[np.ndarray], np.ndarray]:
    """B = Φ diag(e) Φᵀ of each island, with e = v·t (DESIGN sec. 1), m/N; and what rounding cut
    from its diagonal, which is the sum of the products of kick and drift that the kernel uses."""
    islands = layout.islands
    matrices, beneath = [], []
    for n in range(islands.mode.size - 1):
        part = slice(islands.mode[n], islands.mode[n + 1])
        ends = [_ends(layout, k) for k in layout.contact[islands.contact[n] : islands.contact[n + 1]]]
        shapes = np.array([layout.spread(a, n) + layout.spread(b, n) for a, b in ends]).reshape(
            -1, part.stop - part.start
        )
        kick, drift = shapes * modes.kick[part], shapes * modes.drift[part]
        matrix = kick @ drift.T
        for k in range(len(ends)):
            product, cut = exact_product(kick[k], drift[k])
            matrix[k, k] = math.fsum([*product, *cut])
            beneath.append(math.fsum([*product, *cut, -matrix[k, k]]))
        matrices.append(matrix)
    return matrices, np.array(beneath)


def exact_product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Products and their rounding errors (Dekker): a·b = product + error exactly."""

    def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        big = 134217729.0 * x
        high = big - (big - x)
        return high, x - high

    (ah, al), (bh, bl) = halves(a), halves(b)
    product = a * b
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


def _force(layout: Layout, modes: Modes, samplerate: float) -> Force | None:
    if not layout.force:
        return None
    chosen = [layout.scene.force[j] for j in layout.force]
    tables = [table(force, samplerate) for force in chosen]
    return Force(
        rows=layout.rows([(force.body, 1.0) for force in chosen], modes),
        start=np.array([t.start for t in tables], dtype=np.int64),
        begin=np.cumsum([0] + [t.values.size for t in tables]).astype(np.int64),
        table=np.concatenate([t.values for t in tables]),
        after=np.array([t.after for t in tables]),
    )


def _pickups(layout: Layout, modes: Modes) -> Pickups:
    """A pickup of quantity force lists the contacts of its body, with the sign of their push on it."""
    chosen = [layout.scene.pickup[p] for p in layout.pickup]
    begin, contact, sign = [0], [], []
    for pickup in chosen:
        first = int(layout.islands.contact[layout.island[layout.number[pickup.body]]])
        for place, k in enumerate(layout.contact):
            for name, part in _ends(layout, k):
                if pickup.quantity == "force" and name == pickup.body:
                    contact.append(place - first)
                    sign.append(-part)
        begin.append(len(contact))
    return Pickups(
        rows=layout.rows([(pickup.body, 1.0) for pickup in chosen], modes),
        quantity=np.array([QUANTITIES[pickup.quantity] for pickup in chosen], dtype=np.int64),
        channel=np.array([pickup.channel - 1 for pickup in chosen], dtype=np.int64),
        gain=np.array([pickup.gain for pickup in chosen]),
        begin=np.array(begin, dtype=np.int64),
        contact=np.array(contact, dtype=np.int64),
        sign=np.array(sign, dtype=float),
    )


def _state(layout: Layout, model: Model) -> State:
    """The state at time 0."""
    scene, islands = layout.scene, layout.islands
    q, p = layout.gather("q"), layout.gather("p")
    count = islands.mode.size - 1
    contacts = len(layout.contact)
    largest = int(np.diff(islands.contact).max())
    compression = np.zeros(contacts)
    for place, k in enumerate(layout.contact):
        island = layout.island[layout.number[scene.contact[k].body]]
        own = q[islands.mode[island] : islands.mode[island + 1]]
        a, b = _ends(layout, k)
        compression[place] = layout.spread(a, island) @ own + layout.spread(b, island) @ own
    if model.contact is not None:
        compression -= model.contact.barrier
    return State(
        frame=np.zeros(1, np.int64),
        q=q,
        p=p,
        carry=np.zeros(q.size),
        compression=compression,
        residue=np.zeros(contacts),
        free_move=np.zeros(contacts),
        contact_force=np.zeros(contacts),
        scratch=coupled.room(largest) if model.coupling is not None else None,
        budget=np.zeros(count, np.int64),
        heard=np.array([scene.body[layout.number[scene.pickup[i].body]].velocity for i in layout.pickup]),
        account=np.zeros((count, energy.ACCOUNTS)),
        touching=np.zeros(count, np.int64),
        evaluations=np.zeros(count, np.int64),
        iterations=np.zeros(max(solve.LIMIT, coupled.LIMIT) + 1, np.int64),
        regimes=np.zeros(6, np.int64),
        contacts=np.zeros(count, np.int64),
    )
