"""Modules that are read when a test first uses them, so that collecting the tests does not wait for them."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType


def import_later(name: str) -> ModuleType:
    """Return the module of that name; it is read at the first use of what is in it."""
    if name in sys.modules:
        return sys.modules[name]
    spec = find_spec(name)
    assert spec is not None and spec.loader is not None, f"no module {name}"
    spec.loader = LazyLoader(spec.loader)
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
