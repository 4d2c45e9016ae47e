"""A Scene at a sample rate becomes a Model and a State.

Only what the scene calls for is built: an effect that no part uses, or that amounts to
absence (no loss, no stiffness), is None.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from engine import coupled, energy, limits, rest, score, solve
from engine.accuracy import Accuracy
from engine.compliance import compliances
from engine.laws import law_of
from engine.layout import Layout, Point
from engine.limits import BuildError as BuildError
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
    Loose,
    Loss,
    Model,
    Modes,
    Pickups,
    Refined,
    Spring,
    State,
    aligned,
    single,
)
from engine.parts import Body, Change
from engine.save import reason
from engine.scene import Scene
from engine.spots import places
from engine.stages import loss_of, refinement
from engine.tables import MOST_BACK, TABLES, damped_table, heavily_damped
from engine.waveform import Table, table

QUANTITIES = {"displacement": DISPLACEMENT, "velocity": VELOCITY, "acceleration": ACCELERATION, "force": FORCE}
FORCE_AT_START = 1e12  # N


class Built(NamedTuple):
    """What `build` returns."""

    model: Model
    state: State
    layout: Layout


def build(
    scene: Scene,
    samplerate: float,
    accuracy: Accuracy | None = None,
    seconds: float = math.inf,
    *,
    apart: bool = False,
    room: int = 0,
    general: bool = False,
) -> Built:
    """Model, State and Layout of a scene at a sample rate (Hz).

    accuracy: the scene's own if None
    seconds:  how long it will sound; what forces do later is left out
    apart:    make each island a part of its own, however small (engine.explain measures them)
    room:     for how many events that the scene does not name to leave room (engine.player)
    general:  exponents will be changed, beyond what the score says
    Raises BuildError if a body vibrates too fast for the sample rate, if the accuracy asked for has
    steps back in time and a contact has loss, or if there is no room for so much (engine.limits).
    """
    accuracy = accuracy or scene.accuracy
    modal = limits.bodies(scene, samplerate, accuracy.scheme)
    limits.sizes(scene, modal)
    limits.forces(scene, samplerate, seconds)
    layout = Layout(scene, modal, live=room > 0)
    limits.islands(layout)
    omega, sigma = layout.gather("omega"), layout.gather("sigma")
    modes, loss, drag = _modes(omega, sigma, samplerate, accuracy)
    contact, contact_loss, coupling = _contact(layout, modes, samplerate, accuracy, general)
    if contact_loss is not None and accuracy.order > 2:
        what = f"order {accuracy.order} has steps back in time, in which contact loss would create energy"
        raise BuildError([("accuracy.order", f"{what}; order = 2, and substeps instead")])
    partners = [layout.ends(k, spot)[1] for k, spot in layout.spot]
    events, begins = score.events(layout, base(layout), samplerate, room)
    islands = layout.islands._replace(event=begins)
    if apart:
        islands = islands._replace(part=np.arange(begins.size))
    force = _force(layout, modes, samplerate, seconds)
    partner = layout.rows(partners, modes) if any(p.body is not None for p in partners) else None
    model = Model(
        samplerate=float(samplerate),
        islands=islands,
        modes=modes,
        spring=Spring(omega**2, modes.kick * omega**2) if omega.any() else None,
        loss=loss,
        drag=drag,
        gravity=_gravity(layout),
        force=force,
        contact=contact,
        partner=partner,
        contact_loss=contact_loss,
        coupling=coupling,
        refinement=refinement(layout, modes, accuracy, samplerate) if accuracy.refined else None,
        events=events,
        pickups=_pickups(layout, modes),
        bodies=layout.rows(_watched(layout), modes),
        loose=_loose(layout, omega),
        silence=10 ** (accuracy.silence / 20),
    )
    state = _state(layout, model)
    _refuse_deep(layout, model, state)
    if accuracy.precision == "float32":
        model, state = single(model), single(state)
    return Built(aligned(model), aligned(state), layout)


def _watched(layout: Layout) -> list[Point]:
    """Where each body is traced: at its first pickup, or else its first contact, or else its first force."""
    scene, found = layout.scene, dict[str, Point]()
    for pickup in scene.pickup:
        if pickup.quantity != "force" and pickup.body not in found:
            found[pickup.body] = _point(layout, pickup)
    for k, spot in layout.spot:
        for point in layout.ends(k, spot):
            if point.body is not None and point.body not in found:
                found[point.body] = Point(point.body, point.place, 1.0)
    for force in layout.forces:
        if force.body not in found:
            found[force.body] = _point(layout, force)
    nowhere = Point(None, None, 0.0)  # nothing touches it
    return [found.get(scene.body[b].name, nowhere) for b in layout.body]


def _point(layout: Layout, part: Any) -> Point:
    """Where a force acts, or a pickup listens; nowhere, if that is all contact forces of its body."""
    if getattr(part, "quantity", None) == "force":
        return Point(None, None, 0.0)
    return Point(part.body, _one(part.at, layout.scene.body[layout.number[part.body]]), 1.0)


def _one(at: Any, body: Body) -> Any:
    return places(at, body)[0]


def _loose(layout: Layout, omega: np.ndarray) -> Loose | None:
    """Free masses, counted from their island's first mode."""
    free = np.flatnonzero(omega == 0.0)
    if free.size == 0:
        return None
    begin = np.searchsorted(free, layout.islands.mode)
    heard = np.zeros(begin.size - 1, np.bool_)
    for pickup in layout.scene.pickup:
        number = layout.number[pickup.body]
        if pickup.quantity != "force" and np.any(layout.modal[number].omega == 0.0):
            heard[layout.island[number]] = True
    return Loose(free - np.repeat(layout.islands.mode[:-1], np.diff(begin)), begin, heard)


def _modes(
    omega: np.ndarray, sigma: np.ndarray, samplerate: float, accuracy: Accuracy
) -> tuple[Modes, Loss | None, Loss | None]:
    """The core of each mode, its loss at both ends of a step, and that of heavily damped modes in the drift."""
    h = 1.0 / samplerate
    if accuracy.order > 2 and sigma.max(initial=0.0) * h > MOST_BACK:
        what = f"order {accuracy.order} has steps back in time, in which heavy damping would create energy; "
        what += (
            f"decay rates up to {MOST_BACK * samplerate:.4g} 1/s ({sigma.max():.4g} here), or order = 2 and substeps"
        )
        raise BuildError([("accuracy.order", what)])
    heavy = heavily_damped(omega, sigma, h) & (accuracy.scheme == "exact" and accuracy.order == 2)
    kick, drift, keep, drag, dragged = np.empty((5, omega.size))
    kick[~heavy], drift[~heavy] = TABLES[accuracy.scheme](omega[~heavy], sigma[~heavy], h)
    keep[~heavy], drag[~heavy], dragged[~heavy] = np.exp(-sigma[~heavy] * h), 1.0, 0.0
    if heavy.any():
        coefficients = damped_table(omega[heavy], sigma[heavy], h)
        kick[heavy], drift[heavy], keep[heavy], drag[heavy], dragged[heavy] = coefficients
    loss = loss_of(keep) if sigma.any() else None
    return Modes(kick, drift), loss, Loss(drag, dragged) if heavy.any() else None


def _gravity(layout: Layout) -> Gravity | None:
    weight = -layout.scene.gravity * layout.gather("weight")
    return Gravity(weight) if weight.any() else None


def base(layout: Layout) -> np.ndarray:
    """Stiffness of each point of contact, N/m^α; where it is 0 at first, what an event first makes it."""
    later: dict[str | None, float] = {}
    for event in layout.scene.event:
        if isinstance(event, Change) and event.stiffness:
            later.setdefault(event.contact, event.stiffness)
    return np.array([spot.stiffness or later[layout.scene.contact[k].name] for k, spot in layout.spot])


def _contact(
    layout: Layout, modes: Modes, samplerate: float, accuracy: Accuracy, general: bool
) -> tuple[Contact | None, ContactLoss | None, Coupling | None]:
    if not layout.spot:
        return None, None, None
    chosen = [layout.scene.contact[k] for k, _ in layout.spot]
    barrier = np.array([layout.barrier(k, spot) for k, spot in layout.spot])
    rate = np.array([c.loss for c in chosen]) * samplerate
    matrices, beneath = compliances(layout, modes)
    general = general or any(isinstance(e, Change) and e.exponent is not None for e in layout.scene.event)
    law = law_of(base(layout), np.array([c.exponent for c in chosen]), general)
    contact = Contact(
        law=law,
        rows=layout.rows([layout.ends(k, spot)[0] for k, spot in layout.spot], modes),
        barrier=barrier,
        base=base(layout),
        place=barrier,
        compliance=np.concatenate([np.diag(m) for m in matrices]),
        beneath=beneath,
        tolerance=accuracy.tolerance,
        cap=accuracy.iterations,
    )
    begin = np.cumsum([0] + [m.size for m in matrices]).astype(np.int64)
    several = any(m.size > 1 for m in matrices)
    return (
        contact,
        ContactLoss(rate) if rate.any() else None,
        Coupling(begin, np.concatenate([m.ravel() for m in matrices])) if several else None,
    )


def _force(layout: Layout, modes: Modes, samplerate: float, seconds: float) -> Force | None:
    if not layout.force:
        return None
    chosen = [layout.forces[j] for j in layout.force]
    tables = [_table(layout.scene, force, samplerate, seconds) for force in chosen]
    return Force(
        rows=layout.rows([_point(layout, force) for force in chosen], modes),
        start=np.array([t.start for t in tables], dtype=np.int64),
        begin=np.cumsum([0] + [t.values.size for t in tables]).astype(np.int64),
        table=np.concatenate([t.values for t in tables]),
        after=np.array([t.after for t in tables]),
        scale=np.ones(len(tables)),
    )


def _table(scene: Scene, force: Any, samplerate: float, seconds: float) -> Table:
    """The table of a force. Raises BuildError if its file cannot be read to its end."""
    try:
        return table(force, samplerate, seconds)
    except (OSError, RuntimeError, TypeError, ValueError) as error:  # it was there when the patch was read
        path = f"force[{scene.force.index(force)}].file"
        raise BuildError([(path, f"cannot be read as audio ({reason(error)}); a WAV, FLAC or OGG file")]) from None


def _pickups(layout: Layout, modes: Modes) -> Pickups:
    """A pickup of quantity force lists the contacts of its body, with the sign of their push on it."""
    chosen = [layout.scene.pickup[p] for p in layout.pickup]
    begin, contact, sign = [0], [], []
    for pickup in chosen:
        island = layout.island[layout.number[pickup.body]]
        own = slice(*layout.islands.contact[island : island + 2]) if pickup.quantity == "force" else slice(0)
        for place, (k, spot) in enumerate(layout.spot[own]):
            for point in layout.ends(k, spot):
                if point.body == pickup.body:
                    contact.append(place)
                    sign.append(-point.factor)
        begin.append(len(contact))
    return Pickups(
        rows=layout.rows([_point(layout, pickup) for pickup in chosen], modes),
        quantity=np.array([QUANTITIES[pickup.quantity] for pickup in chosen], dtype=np.int64),
        channel=np.array([pickup.channel - 1 for pickup in chosen], dtype=np.int64),
        gain=np.array([pickup.gain for pickup in chosen]),
        begin=np.array(begin, dtype=np.int64),
        contact=np.array(contact, dtype=np.int64),
        sign=np.array(sign, dtype=float),
    )


def _state(layout: Layout, model: Model) -> State:
    """The state at time 0."""
    scene, islands = layout.scene, model.islands
    q, p = layout.gather("q"), layout.gather("p")
    count = islands.mode.size - 1
    contacts = len(layout.spot)
    largest = int(np.diff(islands.contact).max())
    compression, barrier, unit, exponent = (np.zeros(contacts) for _ in range(4))
    for place, (k, spot) in enumerate(layout.spot):
        island = layout.island[layout.number[scene.contact[k].body]]
        own = q[islands.mode[island] : islands.mode[island + 1]]
        a, b = layout.ends(k, spot)
        compression[place] = layout.spread(a, island) @ own + layout.spread(b, island) @ own
    if model.contact is not None:
        barrier, exponent = model.contact.place.copy(), model.contact.law.exponent.copy()
        compression -= barrier
        unit = np.where([spot.stiffness > 0.0 for _, spot in layout.spot], model.contact.law.unit, 0.0)
    parts = islands.part.size - 1
    heard = [getattr(scene.body[layout.number[scene.pickup[i].body]], "velocity", 0.0) for i in layout.pickup]
    return State(
        frame=np.zeros(parts, np.int64),
        q=q,
        p=p,
        carry=np.zeros(q.size),
        reach=np.zeros(q.size),
        unit=unit,
        exponent=exponent,
        barrier=barrier,
        compression=compression,
        residue=np.zeros(contacts),
        free_move=np.zeros(contacts),
        contact_force=np.zeros(contacts),
        scratch=coupled.room(parts, largest) if model.coupling is not None else None,
        refined=_refined(q.size, contacts, count) if model.refinement is not None else None,
        budget=np.zeros(count, np.int64),
        debt=np.zeros(count),
        rest=np.zeros((count, rest.KEPT)),
        asleep=np.zeros((count, rest.NAPS), np.int64),
        heard=np.array(heard),
        account=np.zeros((count, energy.ACCOUNTS)),
        clear=np.zeros(count, np.int64),
        next_event=np.zeros((count, 2), np.int64),
        event_from=np.zeros(0 if model.events is None else model.events.kind.size),
        touching=np.zeros(count, np.int64),
        evaluations=np.zeros(count, np.int64),
        iterations=np.zeros((count, max(solve.LIMIT, coupled.LIMIT) + 1), np.int64),
        regimes=np.zeros((count, 6), np.int64),
        contacts=np.zeros(count, np.int64),
    )


def _refuse_deep(layout: Layout, model: Model, state: State) -> None:
    """Refuse contacts that begin deeper than any force could have brought them."""
    if model.contact is None:
        return
    faults = []
    for place, (k, _) in enumerate(layout.spot):
        depth, exponent = float(state.compression[place]), float(state.exponent[place])
        with np.errstate(over="ignore"):
            force = float(state.unit[place]) * (exponent + 1) * np.float64(max(depth, 0.0)) ** exponent
        if force > FORCE_AT_START:
            what = f"begins {depth:.3g} m deep, where it pushes with {force:.1e} N"
            faults.append((f"contact[{k}]", f"{what}; at most {FORCE_AT_START:g} N; mind the signs of gap and side"))
    if faults:
        raise BuildError(faults[:1] if len({f for f, _ in faults}) == 1 else faults)


def _refined(modes: int, contacts: int, islands: int) -> Refined:
    return Refined(
        before=np.zeros(modes),
        carried=np.zeros(modes),
        margin=np.zeros(contacts),
        known=np.zeros(islands, np.int64),
        impulse=np.zeros(contacts),
    )
