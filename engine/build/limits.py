"""What stands against building a scene, by the paths of its patch: numbers that cannot be computed with, and sizes for
which there is neither the memory nor the time."""

import math
from collections.abc import Iterator

import numpy as np

from engine.bodies import Body, String
from engine.bodies.body import ModalBody, TooManyModes
from engine.bodies.distributed import TooDamped
from engine.build.contact_points import count_points
from engine.build.force_table import count_steps
from engine.build.layout import Layout
from engine.output_files import error_reason
from engine.patch.scene import Scene
from engine.patch.tables import Force, PluckEvent

HIGHEST = 0.49  # of the sample rate; what vibrates faster would come out at another frequency
DECAY = 1e9  # 1/s; what decays faster has lost all in a thousandth of a step
MOST_MODES = 250_000  # of all bodies
MOST_POINTS = 20_000  # of all contacts
MOST_CONTACTS = 512  # in an island; its coupled solve takes time of their third power
MOST_SHAPES = 1 << 24  # numbers: a mode's shape at a place that something acts at or listens to
MOST_STEPS = 1 << 28  # of the tables of all forces: 2 GB
LIGHTEST = 1e-12  # kg, as of masses


class BuildError(ValueError):
    """A valid scene that cannot be built as asked; `faults` lists (path, what) pairs."""

    def __init__(self, faults: list[tuple[str, str]]) -> None:
        super().__init__("\n".join(f"{path}: {what}" for path, what in faults))
        self.faults = faults


def build_modal_bodies(scene: Scene, samplerate: float, scheme: str) -> list[ModalBody]:
    """The modes of all bodies. Raises BuildError, which names each body that has none that can be built."""
    found: list[ModalBody] = []
    faults: list[tuple[str, str]] = []
    total = 0
    for i, body in enumerate(scene.body):
        path = f"body[{i}]"
        try:
            own = body.modal_body(HIGHEST * samplerate)
        except TooManyModes as error:
            faults.append((path, f"{error}; give modes = the number to build"))
            continue
        except TooDamped as error:
            faults.append((f"{path}.support", f"{error}; less of it, or decay rates of the body (sigma0, t60)"))
            continue
        except (ArithmeticError, ValueError):
            faults.append((path, "its numbers are too large or too small to compute with; nearer to those of a body"))
            continue
        what = _unfit(body, own, samplerate, scheme)
        faults += [(path, what)] if what else []
        if isinstance(body, String) and not faults and body.tension_and_bending()[0] <= 0.0:
            what = f"its bending stiffness alone makes it vibrate faster than {body.frequency:g} Hz"
            faults.append((f"{path}.frequency", f"{what}; a higher frequency, or less bending"))
        found.append(own)
        total += own.omega.size
        if total > MOST_MODES:
            faults.append((path, f"with it the bodies have over {MOST_MODES} modes; give fewer modes, or fewer bodies"))
            break
    if faults:
        raise BuildError(faults)
    return found


def _unfit(body: Body, own: ModalBody, samplerate: float, scheme: str) -> str:
    """What is wrong with the modes of a body; nothing if they can be built."""
    highest, fastest = HIGHEST * samplerate, float(np.max(own.omega, initial=0.0))
    if own.omega.size == 0:
        what = f"has no mode below {highest:g} Hz, {HIGHEST} of the sample rate"
        return f"{what}; a lower frequency, or a higher --samplerate"
    if not body.total_mass() >= LIGHTEST:
        return f"weighs {body.total_mass():.3g} kg; at least {LIGHTEST:g}"
    if not np.all(own.sigma >= 0.0):
        return "a mode of it would grow, or its decay is not a number; other decay rates"
    worst = float(np.max(own.sigma))
    if worst > DECAY:
        return f"a mode of it decays at {worst:.3g} 1/s; at most {DECAY:g}: less loss, or fewer modes"
    fastest = math.sqrt(max(0.0, float(np.max(own.omega**2 - own.sigma**2)))) / (2 * math.pi)
    if scheme == "exact" and fastest > highest:
        what = f"vibrates at {fastest:g} Hz, above {HIGHEST} of the sample rate of {samplerate:g} Hz"
        return f"{what}; render with --samplerate {math.ceil(fastest / HIGHEST)} or more"
    return ""


def check_sizes(scene: Scene, modal: list[ModalBody]) -> None:
    """Raises BuildError if contacts, forces and pickups need more room than there is."""
    modes = {body.name: own.omega.size for body, own in zip(scene.body, modal, strict=True)}
    points = shapes = 0
    for k, contact in enumerate(scene.contact):
        own = count_points(contact)
        points += own
        shapes += own * (modes[contact.body] + (modes[contact.on] if contact.on is not None else 0))
        if points > MOST_POINTS:
            raise BuildError([(f"contact[{k}]", f"with it there are over {MOST_POINTS} points of contact; fewer")])
        _roomy(f"contact[{k}]", shapes)
    heard = [(f"pickup[{i}]", pickup.body) for i, pickup in enumerate(scene.pickup)]
    for path, name in [*heard, *((path, force.body) for path, force in _pushes(scene))]:
        shapes += modes[name]
        _roomy(path, shapes)


def check_forces(scene: Scene, samplerate: float, seconds: float) -> None:
    """Raises BuildError if there is no room for the tables of all forces."""
    length = 0.0
    for path, force in _pushes(scene):
        length += _length(path, force, samplerate, seconds)
        if length > MOST_STEPS:
            what = f"with it the forces last over {MOST_STEPS / samplerate:.0f} s in all"
            raise BuildError([(path, f"{what}; fewer seconds, or shorter ones")])


def _pushes(scene: Scene) -> Iterator[tuple[str, Force | PluckEvent]]:
    """Forces and plucks of the score, with their paths."""
    yield from ((f"force[{i}]", force) for i, force in enumerate(scene.force))
    yield from ((f"event[{i}]", event) for i, event in enumerate(scene.event) if isinstance(event, PluckEvent))


def _length(path: str, force: Force | PluckEvent, samplerate: float, seconds: float) -> float:
    try:
        return count_steps(force, samplerate, seconds)
    except (OSError, RuntimeError, TypeError) as error:  # its file was there when the patch was read
        what = f"cannot be read as audio ({error_reason(error)}); a WAV, FLAC or OGG file"
        raise BuildError([(f"{path}.file", what)]) from None


def _roomy(path: str, shapes: int) -> None:
    if shapes > MOST_SHAPES:
        what = f"with it, modes times the places that are touched, pushed or heard are over {MOST_SHAPES}"
        raise BuildError([(path, f"{what}; fewer modes, or fewer places")])


def check_islands(layout: Layout) -> None:
    """Raises BuildError if an island has more points of contact than can be solved together."""
    scene, contacts, modes = layout.scene, np.diff(layout.islands.contact), np.diff(layout.islands.mode)
    n = int(np.argmax(contacts))
    names = [b.name for b in scene.body if layout.island_of_body[layout.body_index[b.name]] == n]
    what = f"{contacts[n]} points of contact join {', '.join(names[:4])}{' …' if len(names) > 4 else ''}"
    if contacts[n] > MOST_CONTACTS:
        raise BuildError([("contact", f"{what}; at most {MOST_CONTACTS} in an island")])
    if int(np.max(contacts * modes)) > MOST_SHAPES:
        n = int(np.argmax(contacts * modes))
        what = f"{contacts[n]} points of contact join bodies of {modes[n]} modes"
        raise BuildError([("contact", f"{what}; both multiplied, at most {MOST_SHAPES} in an island")])
