"""Bodies of a material: what it gives is written into their tables before these are validated."""

from typing import Any

from engine.bodies.materials import MATERIALS
from engine.patch.positions import kind_of


def fill_in_materials(data: dict[str, Any]) -> dict[str, Any]:
    """Return a document in which each body of a material has the numbers that it does not give itself."""
    bodies = data.get("body")
    if not isinstance(bodies, list):
        return data
    return data | {"body": [_with_numbers(body) for body in bodies]}


def _with_numbers(body: Any) -> Any:
    """A body with the numbers of its material, if that is known."""
    name = body.get("material") if isinstance(body, dict) else None
    material, kind = MATERIALS.get(name) if isinstance(name, str) else None, kind_of(body) if name else None
    if material is None or kind is None:
        return body
    return body | kind.numbers_of_material(body, material)
