"""Bodies of a material, or of a density: what it gives is written into their tables before these are validated."""

from typing import Any

from engine.bodies.materials import MATERIALS
from engine.bodies.sheet import TunedSheet
from engine.patch.positions import kind_of


def fill_in_materials(data: dict[str, Any]) -> dict[str, Any]:
    """Return a document in which each body of a material, or of a density, has the numbers that it does not give."""
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data
    return data | {"body": [_with_numbers(body) for body in bodies]}


def _with_numbers(body: Any) -> Any:
    """A body with the numbers of its density, and of its material, if that is known."""
    kind = kind_of(body) if isinstance(body, dict) and ("material" in body or "density" in body) else None
    if kind is None:
        return body
    if issubclass(kind, TunedSheet):
        body = kind.numbers_of_density(body)
    name = body.get("material")
    material = MATERIALS.get(name) if isinstance(name, str) else None
    return body if material is None else body | kind.numbers_of_material(body, material)
