"""A patch as a Scene: read, looked at, and changed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from engine.argument_checks import values_by_path
from engine.instrument.expansion import Expansion
from engine.instrument.key_frequencies import pitch_of_a4
from engine.output_files import write_text
from engine.patch.parameters import Parameter, list_parameters
from engine.patch.paths import replace_values
from engine.patch.reader import DOCUMENT, read_document, validate_document, validate_expansion
from engine.patch.rig import Rig, is_rig, join_parts, read_rig
from engine.patch.scene_tables import SceneTables
from engine.patch.tuning_files import read_tuning, with_frequencies
from engine.wording import to_one_line

if TYPE_CHECKING:
    from engine.api.page import Page, Picture

MAX_SHOWN_CHARACTERS = 60  # of what is not a scene


class Scene(SceneTables):
    """A patch, validated. All is in SI units; bodies are at rest at 0 unless the patch says otherwise."""

    def parameters(self) -> list[Parameter]:
        """Every number that the patch gives, in its order: path, value, unit, range, meaning, and whether it can be
        changed while it sounds. `fdh params` prints the same.

        >>> import fdh
        >>> scene = fdh.load("piano_c4")
        >>> felt = next(p for p in scene.parameters() if p.path == "contact.felt.stiffness")
        >>> felt.value, felt.unit, felt.live
        (4500000000.0, 'N/m^exponent', True)
        """
        return list_parameters(self)

    def replace(self, path: str | Mapping[str, Any] | None = None, value: Any = None, /, **values: Any) -> "Scene":
        """A new scene with other values; this one stays as it is.

        path:   of a value, as `parameters` and `fdh params` name it: a key that the patch leaves at its default, too
        value:  in SI units
        values: several at once, by their paths; or give a dict of them instead of a path

        Raises PatchError (a ValueError), which lists every fault at once: paths that lead nowhere, values out of range;
        ValueError if a value is given beside a dict.

        >>> import fdh
        >>> scene = fdh.load("piano_c4")
        >>> hard = scene.replace("contact.felt.stiffness", 1e10)
        >>> both = scene.replace({"contact.felt.stiffness": 1e10, "body.hammer.velocity": 2.0})
        >>> both.body[1].velocity, scene.body[1].velocity
        (2.0, 2.5)
        >>> scene.replace("contact.fellt.stiffness", 1e10)
        Traceback (most recent call last):
        engine.faults.PatchError: scene contact.fellt.stiffness: there is no "contact.fellt"; did you mean ...
        """
        given = {} if path is None and value is None else values_by_path(path, value)
        return replace_values(self, given | values)

    def to_toml(self, folder: str | Path | None = None) -> str:
        """Return the patch as text, with units as comments; it is read as the same scene.

        folder: to which the files that it names are relative; they are absolute if it is None

        Raises ValueError, which names what cannot be written.

        >>> import fdh
        >>> ball = {"name": "ball", "kind": "mass", "mass": 0.1, "velocity": 1.0}
        >>> print(fdh.load({"body": [ball], "pickup": [{"body": "ball"}]}).to_toml())
        [[body]]
        name = "ball"
        kind = "mass"
        mass = 0.1 # kg
        velocity = 1.0 # m/s
        <BLANKLINE>
        [[pickup]]
        body = "ball"
        quantity = "velocity"
        <BLANKLINE>
        """
        from engine.patch.toml_text import write_toml

        return write_toml(self, None if folder is None else Path(folder))

    def save(self, path: str | Path) -> None:
        """Write the patch to a file, which `load` reads as the same scene: TOML, or JSON if its name ends in .json.
        Files that it names stay where they are, and are named by their paths from there. Raises ValueError, which names
        what cannot be written; OSError."""
        path = Path(path)
        folder = path.absolute().parent
        if path.suffix.lower() == ".json":
            from engine.patch.toml_text import write_json

            write_text(path, write_json(self, folder))
        else:
            write_text(path, self.to_toml(folder))

    def show(self) -> "Page | Picture":
        """Return what a notebook shows of the patch: see `fdh.show`.

        >>> import fdh
        >>> type(fdh.load("bouncing_ball").show()).__name__
        'Page'
        """
        import engine

        return engine.show(self)

    def with_tuning(self, scale: str | Path | None, keyboard_map: str | Path | None = None) -> "Scene":
        """Return the instrument with the frequencies of Scala files: of a scale (.scl), and of the degrees of its keys
        (.kbm), which may leave keys out. Raises ValueError if it is no instrument, or a file cannot be used.

        >>> import fdh
        >>> fdh.load("tanpura").with_tuning("slendro.scl")
        Traceback (most recent call last):
        ValueError: the patch has no keys to tune; an instrument has a [keyboard]
        """
        if self.rig is not None:
            tuned = self.rig.replace_scenes([m.scene.with_tuning(scale, keyboard_map) for m in self.rig.members])
            return join_scenes(tuned, [member.scene for member in tuned.members])
        if self._document is None:
            raise ValueError("the patch has no keys to tune; an instrument has a [keyboard]")
        keyboard = self._document["keyboard"]
        files = [None if name is None else str(name) for name in (scale, keyboard_map)]
        found = read_tuning(files[0], files[1], Path(), pitch_of_a4(keyboard))
        document = self._document | {"keyboard": with_frequencies(keyboard, found)}
        return scene_of_document(document, self._folder).model_copy(update={"accuracy": self.accuracy})

    @property
    def has_keys(self) -> bool:
        """True if keys play it: of an instrument, or of the parts of a rig."""
        return self._document is not None or self._rig is not None

    @property
    def rig(self) -> Rig | None:
        """The rig that this scene is; None of a single patch."""
        return cast(Rig | None, self._rig)

    def with_expansion(self, expansion: Expansion) -> "Scene":
        """Another scene of the same instrument: of other keys, or another score. Raises PatchError, with paths of the
        patch."""
        return validate_expansion(Scene, self._document, self._folder, expansion)


def load(path: str | Path | dict[str, Any]) -> Scene:
    """Read a patch: a file, a shipped one by its name, or a document, which is a dict as TOML readers give it.

    Raises PatchError (a ValueError), which lists every fault at once; TypeError if `path` is none of these.

    >>> import fdh
    >>> fdh.load("tanpura").title
    'Tanpura string, C3'
    >>> fdh.load("tanpra")
    Traceback (most recent call last):
    engine.faults.PatchError: tanpra: no such file or shipped patch; did you mean tanpura?
    >>> ball = {"name": "ball", "kind": "mass", "mass": 0.1, "velocity": 1.0}
    >>> fdh.load({"body": [ball], "pickup": [{"body": "ball"}]}).seconds
    2.0
    """
    document = read_document(path)
    if is_rig(document.data):
        rig = read_rig(document, load)
        return join_scenes(rig, [member.scene for member in rig.members])
    return validate_document(Scene, *document)


def join_scenes(rig: Rig, scenes: Sequence[Scene]) -> Scene:
    """Return the scene of a rig, in which each part plays the score of its own scene. Raises PatchError."""
    joined = Scene.model_validate(join_parts(rig, scenes))
    joined._rig = rig
    return joined


def scene_of_document(data: dict[str, Any], folder: Path, file: str = DOCUMENT, text: str = "") -> Scene:
    """Make a Scene of a document. Raises PatchError. Arguments are those of `validate_document`."""
    return validate_document(Scene, data, folder, file, text)


def check_scene(scene: Any) -> None:
    """Raise TypeError, which says how to come by one, if something is no Scene."""
    if isinstance(scene, Scene):
        return
    shown = to_one_line(repr(scene), MAX_SHOWN_CHARACTERS)
    if isinstance(scene, str | Path):
        raise TypeError(f"{shown} is the name of a patch, not a scene; give fdh.load({shown})")
    if isinstance(scene, dict):
        raise TypeError(f"{shown} is a document, not a scene; give fdh.load of it")
    raise TypeError(f'{shown} is not a scene; give one, such as fdh.load("tanpura")')


def connected_bodies(scene: Scene, name: str) -> set[str]:
    """The names of a body and of all bodies that contacts and connections join with it, directly or through others."""
    names, size = {name}, 0
    while size < len(names):
        size = len(names)
        for joined in [*scene.contact, *scene.connection, *scene.friction]:
            if joined.on is not None and names & {joined.body, joined.on}:
                names |= {joined.body, joined.on}
    return names
