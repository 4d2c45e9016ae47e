"""Options of a player."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from engine.argument_checks import checked_integer
from engine.patch.error_messages import suggestion


@dataclass(frozen=True)
class PlayerOptions:
    """Options of a player, beside its length and its gain.

    voices:  play so many copies of the scene, each of which can be tuned; none if 0
    lowest:  ratio of the lowest pitch they will be tuned to
    general: exponents of contacts can be changed
    cores:   how many share the work, at audio priority where that is allowed; the samples are the same
    kernel:  general or special (engine.runtime.kernel_choice); the samples are the same
    waiting: forces of limited duration wait until `pluck` starts them, as those of voices do
    log:     what is done is kept for `log`; else it is only counted
    """

    voices: int = 0
    lowest: float = 1.0
    general: bool = False
    cores: int = 1
    kernel: str | None = None
    waiting: bool = False
    log: bool = True


def checked_options(options: Mapping[str, Any]) -> PlayerOptions:
    """Return options by name as a record. Raises TypeError for one that is unknown or of the wrong kind,
    ValueError if one is out of range."""
    names = [field.name for field in fields(PlayerOptions)]
    for name in options:
        if name not in names:
            raise TypeError(f"Player has no argument {name!r}; {suggestion(name, names)}")
    checked = PlayerOptions(**options)
    voices, cores = checked_integer("voices", checked.voices), checked_integer("cores", checked.cores)
    if voices < 0:
        raise ValueError(f"voices = {voices} is out of range; 0 or more")
    if cores < 1:
        raise ValueError(f"cores = {cores} is out of range; at least 1")
    return replace(checked, voices=voices, cores=cores, waiting=checked.waiting or voices > 0)
