"""Contact loss by the coefficient of restitution: a mass that meets a barrier at a speed leaves it at a share of that.

With the force k·x^α·(1 + μ·ẋ), m·v·dv/(1 + μ·v) = -k·x^α·dx, whose integrals on the way in and out are alike:
d·(1 + e) = ln((1 + d)/(1 - e·d)), with d = μ·v at the speed v of the approach, whatever m, k and α are. (Solved for e,
it is e = (1 + W(-(1 + d)·exp(-1 - d)))/d, with Lambert's W.)
"""

from collections.abc import Iterator
from typing import Any

from pydantic import Field
from pydantic_core import InitErrorDetails

from engine.arithmetic.elementary import log1p
from engine.bodies.table import KeyPath, Table, is_given, is_number, make_fault

MIN_RESTITUTION = 0.01
HALVINGS = 100  # of the interval that holds d


class Restitution(Table):
    """A coefficient of restitution, at a speed of approach."""

    e: float = Field(ge=MIN_RESTITUTION, le=1.0, description="share of its speed that the mass keeps")
    speed: float = Field(gt=0.0, le=1e4, description="speed at which it meets the barrier, m/s")


def loss_of_restitution(e: float, speed: float) -> float:
    """Return the Hunt-Crossley damping μ of a coefficient of restitution at a speed (m/s), s/m."""
    low, high = 0.0, 1.0 / e  # d = μ·v
    for _ in range(HALVINGS):
        d = (low + high) / 2
        if e * d < 1.0 and log1p(d) - log1p(-e * d) < (1 + e) * d:
            low = d
        else:
            high = d
    return float(low / speed) if e < 1.0 else 0.0


def check_restitution(
    path: KeyPath, contact: dict[str, Any], body: dict[str, Any] | None
) -> Iterator[InitErrorDetails]:
    """A contact has a coefficient of restitution where a mass meets what does not move, and no other loss."""
    if not is_given(contact, "restitution"):
        return
    path, value = (*path, "restitution"), contact["restitution"]
    if is_given(contact, "on"):
        message = "restitution is of a mass and a barrier, and the other body moves too"
        yield make_fault(path, value, message, "give a loss, in s/m")
    elif body is not None and body.get("kind") != "mass":
        message = f"restitution is of a mass and a barrier, and the body is of kind {body.get('kind')}"
        yield make_fault(path, value, message, "give a loss, in s/m")
    e, speed = (value.get("e"), value.get("speed")) if isinstance(value, dict) else (None, None)
    if is_given(contact, "loss") and not (
        (is_number(e) and is_number(speed) and MIN_RESTITUTION <= e <= 1.0 and speed > 0.0)
        and contact["loss"] == loss_of_restitution(e, speed)  # as in a scene that was loaded
    ):
        message = "loss and restitution are both given"
        yield make_fault((*path[:-1], "loss"), contact["loss"], message, "give one of them")
