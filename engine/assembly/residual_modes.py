"""Residual modes (docs/design.md, "Residual modes"): a few modes, most near the Nyquist frequency, with the static
compliance at contacts of the modes that are not built.

Modes above 0.49 of the sample rate are not built, or the patch asks for fewer modes. All modes that are left out are
stiff and follow a contact force at once, with the compliance C_r = Σ Φᵢ·Φⱼ/ω² over them. A mode with Φ² = ω²·C_r has
this compliance, and is as passive as any other. A compliance added to that of the contacts alone would not be passive.

A membrane has so many modes that those of the sound end far below the Nyquist frequency, and with several steps a
sample those of other bodies end below that of the steps. What is left out up to there takes part in a blow: it stands
in bands, each with modes of its own, that lose what they take, as waves that leave the place do.
"""

import math
from collections.abc import Callable, Container, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from engine.arithmetic.elementary import sinc, square
from engine.arithmetic.linear import symmetric_eigenvectors
from engine.arithmetic.products import product
from engine.assembly.contact_points import contact_points, contact_sides
from engine.bodies.body import ModalBody
from engine.bodies.distributed import DistributedBody
from engine.bodies.tips import Compliance
from engine.patch.accuracy import Accuracy
from engine.patch.scene import Scene

FREQUENCY_SHARE = 0.45  # of the sample rate
DAMPING_SHARE = 0.045  # σ per sample rate: residual modes hardly ring, and lose as other modes do at every order
MIN_SHARE = 0.03  # of the static compliance: where less is left out, nothing is added unless the patch asks for it
MIN_SHARE_OF_WAVES = 1e-3  # … on a membrane, whose waves begin to leave from under a tip as it strikes
MAX_POINTS = 4  # of contacts on a body: with more, nothing is added unless the patch asks for it
SLOW = 20.0  # Hz
ROUNDING = 1e-12  # of the largest
MIN_PART = 1e-3  # of the largest: smaller residual modes are left out
WIDE = 1.2  # a body lacks bands if what is left out begins so far below the residual modes
BANDS = 12
MAX_DAMPING_PER_STEP = 0.08  # σ·h: orders 4 and 6 bear no more
STEPS_OF_STAGES = 1.8  # so that the damping of a step is within that
BAND_DAMPING = 0.5  # of the width of a band: what goes there leaves, as into many modes


def with_residual_modes(
    scene: Scene,
    bodies: Sequence[ModalBody],
    samplerate: float,
    steps: float = 1.0,
    fit: Container[int] = (),
    least: Sequence[float] | None = None,
) -> list[ModalBody]:
    """Return the modes of bodies, with residual modes where they help.

    samplerate: Hz
    steps:      of each sample (count_contact_steps)
    fit:        numbers of bodies that are as they should be
    least:      share of the static compliance of each body that must be left out; as the patch says if None
    """
    places, completed = _contact_places(scene), list[ModalBody]()
    for n, (body, modal) in enumerate(zip(scene.body, bodies, strict=True)):
        at = places.get(body.name, [])
        if isinstance(body, DistributedBody) and body.residual is not False and n not in fit and at:
            share = _least_share(body, at) if least is None else least[n]
            if share < math.inf:
                rate = body.residual_rate(samplerate, steps)
                modal = _with_residual(modal, at, partial(_left_out, body, modal, rate), share)
        completed.append(modal)
    return completed


def count_contact_steps(accuracy: Accuracy) -> float:
    """Return the steps of a sample in contact that residual modes can count on; those with stages count as more."""
    if accuracy.max_error is not None:
        return 1.0
    return accuracy.substeps * (1.0 if accuracy.order == 2 else STEPS_OF_STAGES)


def _least_share(body: DistributedBody, places: list[object]) -> float:
    """Return the share of the static compliance that must be left out for residual modes to help."""
    if body.residual:
        return 0.0
    if len(places) > MAX_POINTS:
        return math.inf
    return MIN_SHARE_OF_WAVES if body.GIVES_WAY_IN_BANDS else MIN_SHARE


class Band(NamedTuple):
    """Modes that are left out, between two frequencies."""

    omega: float  # rad/s: of the residual modes that stand for them …
    sigma: float  # … and their decay rate, 1/s
    compliance: Compliance  # static, of all of them


def _left_out(body: DistributedBody, modal: ModalBody, samplerate: float) -> list[Band]:
    """Return the modes of a body that are left out, in bands; of all but membranes in one."""
    begin, end = float(np.max(modal.omega)), 2 * math.pi * FREQUENCY_SHARE * samplerate
    beyond = body.compliance_beyond(begin)
    if beyond is None:
        return []
    bands, sigma = list[Band](), DAMPING_SHARE * samplerate
    if (body.GIVES_WAY_IN_BANDS or body.residual) and end > WIDE * begin:
        edges = np.linspace(begin, end, BANDS + 1).tolist()
        for low, high in pairwise(edges):
            band = body.compliance_beyond(low, high)
            assert band is not None
            leaving = min(BAND_DAMPING * (high - low), MAX_DAMPING_PER_STEP * samplerate)
            bands.append(Band(math.sqrt(low * high), leaving, band))
        beyond = body.compliance_beyond(end)
        assert beyond is not None
    return [*bands, Band(end, sigma, beyond)]


def _with_residual(
    modal: ModalBody, places: list[object], left_out: Callable[[], list[Band]], least: float
) -> ModalBody:
    """Return the modes of a body with its residual modes, whose shapes are combinations of static deflections; if more
    than a least share of the static compliance is left out."""
    bands = left_out()
    if all(not np.any(band.compliance(places[0], places)) for band in bands[:-1]):
        bands = bands[-1:]  # no mode of the body lies in a band
    compliances = [np.array([band.compliance(place, places) for place in places]) for band in bands]
    whole = np.sum(compliances, axis=0)  # static, between places, m/N
    if not (bands and np.all(np.isfinite(whole)) and np.max(_share_left_out(modal, places, whole)) > least):
        return modal
    values, vectors = symmetric_eigenvectors(np.array(compliances))
    most = np.max(values, axis=1, keepdims=True)
    kept = values > (MIN_PART * most if len(bands) == 1 else -1.0)  # of bands all, at any pitch
    values = np.maximum(values, ROUNDING * np.where(most > 0.0, most, np.max(most)))
    mixtures = [  # Φ = ω·C_r(x, places)·V·Λ^(-1/2)
        band.omega * vector[:, some] / np.sqrt(value[some])
        for band, value, vector, some in zip(bands, values, vectors, kept, strict=True)
    ]
    rows_at_places = np.concatenate(
        [product(c, mixture) for c, mixture in zip(compliances, mixtures, strict=True)], axis=1
    )

    def shape(position: object) -> np.ndarray:
        if not isinstance(position, np.ndarray) and position in places:
            row = rows_at_places[places.index(position)]
        else:  # computed again: 20 000 modes of each string of a piano would take 70 MB
            pairs = zip(left_out()[-len(bands) :], mixtures, strict=True)
            rows = [product(band.compliance(position, places), mixture) for band, mixture in pairs]
            row = np.concatenate(rows, axis=-1)
        return np.concatenate([modal.shape(position), row], axis=-1)

    counts = np.sum(kept, axis=1)
    omega = np.append(modal.omega, np.repeat([band.omega for band in bands], counts))
    sigma = np.append(modal.sigma, np.repeat([band.sigma for band in bands], counts))
    more = int(np.sum(counts))
    q, p, participation = (np.append(row, np.zeros(more)) for row in (modal.q, modal.p, modal.gravity_participation))
    return ModalBody(omega, sigma, shape, q, p, participation, more)


def shares_left_out(scene: Scene, bodies: Sequence[ModalBody], samplerate: float) -> dict[str, float]:
    """Return the largest share that the modes of bodies lack of what they give way at a contact within a sample, 0 to
    1, by the name of each body where it is known; 0 where residual modes stand for what is left out.

    A constant force moves a place by Σ Φ²·(1 - cos ωh)/ω² in a time h.
    """
    places, shares = _contact_places(scene), dict[str, float]()
    for body, modal in zip(scene.body, bodies, strict=True):
        at = places.get(body.name, [])
        if not at or not isinstance(body, DistributedBody):
            continue
        beyond, shares[body.name] = body.compliance_beyond(float(np.max(modal.omega))), 0.0
        if beyond is None or modal.residual:
            continue
        half = sinc(modal.omega / samplerate / 2 / math.pi)  # (1 - cos ωh)/ω² = ½·(h·sinc(ωh/2))²
        for place in at:
            lacks, moves = float(beyond(place, [place])[0]), float(np.sum(square(modal.shape(place) * half)))
            share = 1.0 if math.isinf(lacks) else lacks / (lacks + 0.5 * moves / square(samplerate))
            shares[body.name] = max(shares[body.name], share)
    return shares


def _share_left_out(modal: ModalBody, places: list[object], left_out: np.ndarray) -> np.ndarray:
    """Return the share of the static compliance at places that is left out [places]. left_out: m/N, between places"""
    moving = modal.omega > 2 * math.pi * SLOW  # slower modes act as masses on a contact
    shapes = np.array([modal.shape(place) for place in places])[:, moving] / modal.omega[moving]
    return np.asarray(np.diag(left_out) / np.maximum(np.diag(left_out) + np.sum(square(shapes), axis=1), 1e-300))


def _contact_places(scene: Scene) -> dict[str, list[object]]:
    """Return the positions and tips of each body that contacts touch, each once."""
    bodies = {body.name: body for body in scene.body}
    places: dict[str, list[object]] = {}
    for contact in scene.contact:
        on = None if contact.on is None else bodies[contact.on]
        for point in contact_points(contact, bodies[contact.body], on):
            for side in contact_sides(contact, point):
                if side.body is not None and side.position not in places.setdefault(side.body, []):
                    places[side.body].append(side.position)
    return places
