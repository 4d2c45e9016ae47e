"""FDH engine under a name of its own: `fdh.X` is `engine.X`.

import fdh
rendering = fdh.render(fdh.load("tanpura"), seconds=2.0)

So is every module: `fdh.analysis.features` is `engine.analysis.features`, not a second copy of it.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from engine import *  # noqa: F403

    __version__: str

_found = find_spec("engine")
if _found is None or _found.origin is None or Path(_found.origin).parents[1] != Path(__file__).parents[1]:
    _what = f"{_found.origin or 'a folder engine'} hides it; rename that" if _found else "it is not beside fdh"
    raise ImportError(f"fdh needs its package engine: {_what}")

import engine  # noqa: E402
from engine import __all__ as __all__  # noqa: E402

if not TYPE_CHECKING:  # so that a checker finds a misspelt name

    def __getattr__(name: str) -> Any:
        try:
            if not name.startswith("__") or name == "__version__":  # __path__ and the like are its own
                return getattr(engine, name)
        except AttributeError:
            pass
        raise AttributeError(f"module 'fdh' has no attribute '{name}'")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _SameModules(MetaPathFinder, Loader):
    """Finds `fdh.a.b`: it is the module `engine.a.b`."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return where a module of fdh comes from; None if it is of another package, or if engine has none such."""
        original = name.replace("fdh", "engine", 1)
        if not name.startswith("fdh.") or name == "fdh.__main__" or find_spec(original) is None:
            return None
        return ModuleSpec(name, self, loader_state=original)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Import the module of engine."""
        module = import_module(spec.loader_state)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Give the module its own spec back: the machinery of imports has replaced it."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


sys.meta_path.insert(0, _SameModules())  # before files are looked for: a package of engine has a path of its own
