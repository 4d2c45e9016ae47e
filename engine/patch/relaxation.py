"""Felt with memory: a share of the stiffness of a contact relaxes while it is pressed."""

from pydantic import Field

from engine.bodies.table import Table


class Relaxation(Table):
    """A share of the stiffness of a contact that relaxes, as that of felt does."""

    share: float = Field(
        gt=0.0, lt=1.0, description="share of the stiffness that a fast blow finds and a slow one does not"
    )
    time: float = Field(ge=1e-6, le=10.0, description="time in which the force of this share falls to 1/e, s")
