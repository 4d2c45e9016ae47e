"""Checks that a scene can be built. They refuse numbers that cannot be computed with and sizes that need too much
memory or time, and name the paths in the patch."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from engine.arithmetic.elementary import square
from engine.assembly.contact_points import count_points
from engine.assembly.external_forces import count_steps
from engine.assembly.islands import Islands
from engine.bodies import Body, String
from engine.bodies.body import ModalBody, TooManyModes, UnfitBody
from engine.bodies.distributed import DistributedBody
from engine.faults import BuildError, Fault
from engine.output_files import error_reason
from engine.patch.friction import Friction
from engine.patch.scene import Scene
from engine.patch.tables import Contact, Force, PluckEvent, SineForce

MAX_FREQUENCY_SHARE = 0.49  # of the sample rate; what vibrates faster would come out at another frequency
MAX_DECAY_RATE = 1e9  # 1/s; what decays faster has lost all in a thousandth of a step
MAX_SCENE_MODES = 250_000  # of all bodies
MAX_SCENE_CONTACT_POINTS = 20_000  # of all contacts
MAX_ISLAND_CONTACTS = 512  # in an island; its coupled solve takes time of their third power
MAX_SHAPES = 1 << 24  # mode-shape values: one for each mode at each contact, connection, force or pickup
MAX_FORCE_STEPS = 1 << 28  # of the tables of all forces: 2 GB
MIN_BODY_MASS = 1e-12  # kg, as of masses


def build_modal_bodies(
    scene: Scene, samplerate: float, scheme: str, known: Mapping[int, ModalBody] | None = None
) -> list[ModalBody]:
    """Return the modes of all bodies. Raises BuildError, which names each body that cannot be built.

    known: bodies that are built already, by their numbers
    """
    bodies: list[ModalBody] = []
    faults: list[Fault] = []
    total = 0
    for i, body in enumerate(scene.body):
        path = f"body[{i}]"
        try:
            modal = (known or {}).get(i) or build_modal_body(body, path, samplerate, scheme)
        except BuildError as error:
            faults += error.faults
            continue
        bodies.append(modal)
        total += modal.omega.size
        if total > MAX_SCENE_MODES:
            message = f"with this one, the bodies have more than {MAX_SCENE_MODES} modes; use fewer modes or bodies"
            faults.append(Fault(path, message))
            break
    if faults:
        raise BuildError(*faults)
    return bodies


def build_modal_body(body: Body, path: str, samplerate: float, scheme: str) -> ModalBody:
    """Return the modes of a body. Raises BuildError if it cannot be built. path: of the body"""
    try:
        modal = body.modal_body(MAX_FREQUENCY_SHARE * samplerate)
    except TooManyModes as error:
        raise BuildError(Fault(path, f"{error}; give modes = the number to build")) from None
    except UnfitBody as error:
        raise BuildError(Fault(path, str(error))) from None
    except (ArithmeticError, ValueError):
        message = "its numbers are too large or too small to compute with; give values nearer to those of real bodies"
        raise BuildError(Fault(path, message)) from None
    if message := _explain_unfit(body, modal, samplerate, scheme):
        raise BuildError(Fault(path, message))
    if isinstance(body, String) and body.tension_and_bending()[0] <= 0.0:
        message = f"its bending stiffness alone makes it vibrate faster than {body.frequency:g} Hz"
        raise BuildError(Fault(f"{path}.frequency", f"{message}; give a higher frequency, or less bending_stiffness"))
    return modal


def _explain_unfit(body: Body, modal: ModalBody, samplerate: float, scheme: str) -> str:
    """Explain why the modes of a body cannot be built; return an empty text if they can."""
    highest = MAX_FREQUENCY_SHARE * samplerate
    if modal.omega.size == 0:
        message = f"has no mode below {highest:g} Hz, {MAX_FREQUENCY_SHARE} of the sample rate"
        return f"{message}; give a lower frequency, or render with a higher --samplerate"
    if not body.total_mass() >= MIN_BODY_MASS:
        return f"has a mass of {body.total_mass():.3g} kg; give at least {MIN_BODY_MASS:g} kg"
    if not np.all(modal.sigma >= 0.0):
        return "one of its modes has a decay rate that is negative or not a number; give other losses"
    worst = float(np.max(modal.sigma))
    if worst > MAX_DECAY_RATE:
        message = f"one of its modes has a decay rate of {worst:.3g} 1/s, and the limit is {MAX_DECAY_RATE:g}"
        return f"{message}; give less loss, or fewer modes"
    fastest = math.sqrt(max(0.0, float(np.max(square(modal.omega) - square(modal.sigma))))) / (2 * math.pi)
    if scheme == "exact" and fastest > highest:
        message = f"vibrates at {fastest:g} Hz, above {MAX_FREQUENCY_SHARE} of the sample rate of {samplerate:g} Hz"
        return f"{message}; render with --samplerate {math.ceil(fastest / MAX_FREQUENCY_SHARE)} or more"
    return ""


def check_sizes(scene: Scene, modal_bodies: list[ModalBody]) -> None:
    """Raise BuildError if contacts, connections, forces and pickups need more memory than is allowed."""
    points = shapes = 0
    for path, contact in _touching(scene):
        points += count_points(contact)
        if points > MAX_SCENE_CONTACT_POINTS:
            message = f"with this one, there are more than {MAX_SCENE_CONTACT_POINTS} contact points; use fewer"
            raise BuildError(Fault(path, message))
    modes: dict[str | None, int] = {None: 0}
    modes |= {body.name: modal.omega.size for body, modal in zip(scene.body, modal_bodies, strict=True)}
    for path, name, count in _places(scene):
        shapes += count * modes[name]
        if shapes > MAX_SHAPES:
            message = f"with this one, the scene needs more than {MAX_SHAPES} mode-shape values (modes × points)"
            raise BuildError(Fault(path, f"{message}; use fewer modes, contacts, forces or pickups"))


def _touching(scene: Scene) -> Iterator[tuple[str, Contact | Friction]]:
    """Yield contacts and friction, each with its path."""
    yield from ((f"contact[{k}]", contact) for k, contact in enumerate(scene.contact))
    yield from ((f"friction[{k}]", friction) for k, friction in enumerate(scene.friction))


def _places(scene: Scene) -> Iterator[tuple[str, str | None, int]]:
    """Yield the bodies on which something acts, and at how many points: path of what acts, name of the body (None for
    the ground), points."""
    for path, contact in _touching(scene):
        for name in (contact.body, contact.on):
            yield path, name, count_points(contact)
    for k, connection in enumerate(scene.connection):
        for name in (connection.body, connection.on):
            yield f"connection[{k}]", name, 1
    for b, body in enumerate(scene.body):
        supports = body.support if isinstance(body, DistributedBody) else []
        yield f"body[{b}]", body.name, sum(len(body.split_positions(support.at)) for support in supports)
    yield from ((f"pickup[{i}]", pickup.body, 1) for i, pickup in enumerate(scene.pickup))
    yield from ((path, force.body, 1) for path, force in _external_forces(scene))
    plucks = {repr((e.body, e.at, e.angle)): (i, e) for i, e in enumerate(scene.event) if isinstance(e, PluckEvent)}
    yield from ((f"event[{i}]", event.body, 1) for i, event in plucks.values())


def check_forces(scene: Scene, samplerate: float, seconds: float) -> None:
    """Raise BuildError if the tables of all forces are too large, or a force is too fast for the sample rate."""
    steps = 0.0
    for path, force in _external_forces(scene):
        if isinstance(force, SineForce) and force.frequency >= samplerate / 2:
            message = f"{force.frequency:g} Hz is not below half of the sample rate; give less than {samplerate / 2:g}"
            raise BuildError(Fault(f"{path}.frequency", message))
    for path, force in _external_forces(scene):
        try:
            steps += count_steps(force, samplerate, seconds)
        except (OSError, RuntimeError, TypeError) as error:
            raise unreadable_file(path, error) from None
        if steps > MAX_FORCE_STEPS:
            message = f"with this one, the forces last more than {MAX_FORCE_STEPS / samplerate:.0f} s in total"
            raise BuildError(Fault(path, f"{message}; give fewer seconds, or shorter forces"))


def _external_forces(scene: Scene) -> Iterator[tuple[str, Force]]:
    """Yield the forces, with their paths."""
    yield from ((f"force[{i}]", force) for i, force in enumerate(scene.force))


def unreadable_file(path: str, error: Exception) -> BuildError:
    """Return the fault of a force whose file was there when the patch was read. path: of the force"""
    message = f"cannot be read as audio ({error_reason(error)}); give a WAV, FLAC or OGG file"
    return BuildError(Fault(f"{path}.file", message))


def check_islands(scene: Scene, islands: Islands) -> None:
    """Raise BuildError if an island has more contact points than can be solved together."""
    contacts, modes = np.diff(islands.contact_begins), islands.mode_counts
    n = int(np.argmax(contacts))
    names = [scene.body[b].name for b in islands.bodies[n]]
    message = f"{contacts[n]} contact points join {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
    if contacts[n] > MAX_ISLAND_CONTACTS:
        raise BuildError(Fault("contact", f"{message}; an island may have {MAX_ISLAND_CONTACTS}"))
    if int(np.max(contacts * modes)) > MAX_SHAPES:
        n = int(np.argmax(contacts * modes))
        message = f"{contacts[n]} contact points join bodies with {modes[n]} modes in total"
        raise BuildError(Fault("contact", f"{message}; the product may be {MAX_SHAPES} in an island"))
