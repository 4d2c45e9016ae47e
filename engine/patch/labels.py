"""Names of live parameters for people, in `[labels]` of a patch."""

from typing import Annotated, Any

from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from engine.patch.control_rules import paths_of_keys
from engine.patch.live_parameters import LivePath, explain_unknown, live_paths

MAX_LETTERS = 60
EXAMPLE = '"contact.felt.stiffness" = "hardness of the felt"'


def _check_label(label: Any) -> Any:
    """Return a label. Raises PydanticCustomError if it is none."""
    if isinstance(label, str) and 0 < len(label) <= MAX_LETTERS:
        return label
    raise PydanticCustomError("scene", f"no text of 1 to {MAX_LETTERS} letters; write the path in quotes: {EXAMPLE}")


Label = Annotated[str, BeforeValidator(_check_label)]


def labels_of(scene: Any, paths: dict[str, LivePath]) -> dict[str, str]:
    """Return the labels of those live parameters that have one. A label of an instrument's tables is that of each key,
    with the name of the key."""
    labels = dict[str, str]()
    for parameter, label in scene.labels.items():
        for path in paths_of_keys(paths, parameter):
            key = paths[path].name
            name = "" if path == parameter or key is None else key.partition("_")[0]  # such as Cs4
            labels[path] = f"{label}, {name.replace('s', '#')}" if name else label
    return labels


def find_unused_labels(scene: Any) -> list[str]:
    """Say which labels are those of no live parameter. They do no harm: a contact that is left out, or has no
    stiffness, may have one. What an instrument has of each key may belong to keys that are not played."""
    paths, of_keys = live_paths(scene) if scene.labels else {}, (scene.instrument or {}).get("key") or {}
    unplayed = {(section, table.get("name")) for section, tables in of_keys.items() for table in tables}
    return [
        f"a label names {explain_unknown(parameter, list(paths))}"
        for parameter in scene.labels
        if not paths_of_keys(paths, parameter) and tuple(parameter.split(".")[:2]) not in unplayed
    ]
