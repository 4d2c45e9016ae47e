"""Paths of values in a patch: `contact.felt.stiffness`, `event.0.time`; as `fdh params` lists them."""

import re
import typing
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from engine.argument_checks import plain_value
from engine.bodies.table import KeyPath
from engine.faults import Fault, PatchError
from engine.instrument.expansion import is_instrument
from engine.patch.error_messages import suggestion
from engine.patch.parameters import list_parameters
from engine.patch.precision_key import PATH
from engine.patch.reader import DOCUMENT, S, validate_document
from engine.patch.scene_tables import SceneTables

NUMBER = re.compile(r"\[(\d+)\]")  # of a table, in the paths of faults


def replace_values(scene: S, values: Mapping[str, Any]) -> S:
    """A scene with other values by their paths. Raises PatchError, which lists every fault; TypeError if a path is no
    text."""
    data = scene.document
    faults = []
    for path, value in values.items():
        if not isinstance(path, str):
            raise TypeError(f"{path!r} is not a path; give text, such as {_example(scene)}")
        try:
            key_path = PATH if path == ".".join(PATH) else locate(path, scene, data)[0]  # which is read with a note
        except ValueError as error:
            faults.append(Fault(path, str(error).removeprefix(f"{path}: "), DOCUMENT))
            continue
        set_value(data, key_path, plain_value(value))
    if faults:
        raise PatchError(faults)
    return validate_document(type(scene), data, scene.folder, DOCUMENT, "")


def _example(scene: SceneTables) -> str:
    """A path that the scene has."""
    return next((f'"{parameter.path}"' for parameter in list_parameters(scene)), '"seconds"')


def set_value(data: dict[str, Any], key_path: KeyPath, value: Any) -> None:
    """Write a value into a document, in place. key_path: of a value that `locate` has found."""
    node: Any = data
    for key in key_path[:-1]:
        node = node.setdefault(key, {}) if isinstance(node, dict) else node[key]
    node[key_path[-1]] = value


def locate(path: str, scene: SceneTables, data: dict[str, Any]) -> tuple[KeyPath, bool]:
    """Find the keys in the document that a path such as contact.glass.loss leads to, and whether integers belong there.

    body[0].length, as faults have it, is body.0.length. Raises ValueError, which says what is not there, and what is.
    """
    node: Any = scene
    key_path: KeyPath = ()
    integer, prefix, dotted = False, "", NUMBER.sub(r".\1", path)
    for part in dotted.split("."):
        integer, suffix = False, dotted[len(prefix + part) :]
        if isinstance(node, BaseModel):
            fields = type(node).model_fields
            if part not in fields:
                remedy = suggestion(part, list(fields), prefix, suffix)
                raise ValueError(f"{path}: {_describe_missing(path, prefix + part)}; {remedy}")
            key_path, node, integer = (*key_path, part), getattr(node, part), _takes_integers(fields[part].annotation)
        elif isinstance(node, list):
            index = _item_index(part, node, prefix, path)
            key_path, node = (*key_path, index), node[index]
        elif isinstance(node, dict) and part in node:
            key_path, node = (*key_path, part), node[part]
        elif isinstance(node, dict):
            remedy = suggestion(part, list(node), prefix, suffix)
            raise ValueError(f"{path}: {_describe_missing(path, prefix + part)}; {remedy}")
        else:
            fault = "is not in the patch; write it there" if node is None else "has no parts; leave out what follows it"
            raise ValueError(f"{path}: {prefix[:-1]} {fault}")
        prefix += f"{part}."
    _refuse_table(path, node)
    key_path = _path_of_bow(data, key_path)
    _check_in_document(data, key_path, path)
    return key_path, integer


def _path_of_bow(data: dict[str, Any], key_path: KeyPath) -> KeyPath:
    """A path of a value of friction, or, if the document has a bow in its place (engine.patch.bow), that of the bow."""
    if key_path[0] != "friction" or is_instrument(data):
        return key_path
    _, number, *keys = key_path
    plain = len(data.get("friction") or [])
    if not isinstance(number, int) or not plain <= number < plain + len(data.get("bow") or []):
        return key_path
    return ("bow", number - plain, *keys)


def _refuse_table(path: str, node: Any) -> None:
    """Raise ValueError, which lists its keys, if a path leads to a table and not to a value."""
    is_array = isinstance(node, list)
    if not isinstance(node, BaseModel | dict) and not (is_array and any(isinstance(i, BaseModel) for i in node)):
        return
    inner = type(node[0] if is_array else node)
    keys = list(inner.model_fields) if issubclass(inner, BaseModel) else list(node)
    table = f"{path}.0" if is_array else path
    raise ValueError(f"{path}: a table; give one of its keys: {', '.join(f'{table}.{key}' for key in keys)}")


def _item_index(part: str, items: list[Any], prefix: str, path: str) -> int:
    """Index of the item of a list that a part of a path names: by its index, or as the only one of that name, or on
    that body. Raises ValueError."""
    section = prefix[:-1]
    if part.isdecimal() and int(part) < len(items):
        return int(part)
    names = [getattr(item, "name", None) for item in items]
    if section in ("pickup", "force"):  # contacts without a name have an index only
        names = [name or item.body for name, item in zip(names, items, strict=True)]
    indices = [n for n, name in enumerate(names) if name == part]
    if len(indices) == 1:
        return indices[0]
    if indices:
        choices = " or ".join(f"{prefix}{n}" for n in indices)
        raise ValueError(f'{path}: {len(indices)} of {section} are on "{part}"; {choices}')
    if not items:
        raise ValueError(f"{path}: the patch has no {section}; write it there")
    known = [name for name in names if name] if not part.isdecimal() else []
    remedy = f"{prefix}0" + (f" to {prefix}{len(items) - 1}" if len(items) > 1 else "")
    remedy = suggestion(part, known, prefix, path[len(prefix + part) :]) if known else remedy
    raise ValueError(f"{path}: {_describe_missing(path, prefix + part)}; {remedy}")


def _describe_missing(path: str, missing: str) -> str:
    """Say what is missing: the value of a path, or a part of it."""
    return "there is no such value" if missing == path else f'there is no "{missing}"'


def _takes_integers(annotation: Any) -> bool:
    """True if the values of a field are integers only."""
    inner = typing.get_args(annotation)
    return annotation is int or isinstance(annotation, int) or (float not in inner and any(map(_takes_integers, inner)))


def _check_in_document(data: dict[str, Any], key_path: KeyPath, path: str) -> None:
    """Raise ValueError unless all but the last key of a path stand in the document; [accuracy] may be missing."""
    node: Any = data
    for n, key in enumerate(key_path[:-1]):
        if isinstance(node, dict) and key not in node:
            if key_path[:1] == ("accuracy",):
                return
            fault = "its modes come from a file" if "file" in node else "it is not in the patch"
            raise ValueError(f"{path}: {fault}; write {'.'.join(map(str, key_path[: n + 1]))} there")
        if isinstance(node, list) and isinstance(key, int) and key >= len(node):
            remedy = "what is under key or keyboard.values" if is_instrument(data) else "the bow"
            raise ValueError(
                f"{path}: it is written out for a {'key' if is_instrument(data) else 'bow'}; change {remedy}"
            )
        node = node[key]
