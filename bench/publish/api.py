"""docs/api.md: the Python interface, from its docstrings. Their examples are run by tests/docs/test_api.py."""

import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

from bench.publish.report import ROOT

LINE_LENGTH = 118
PAGE = ROOT / "docs" / "api.md"
INTRODUCTION = """# The Python interface

What `import fdh` offers, made of the docstrings by `uv run python -m bench api`; a test runs every example. All
numbers are in SI units. `import fdh` is quick: what a name needs is imported when the name is first used.
Whole scripts to copy are in the [examples](examples/README.md).

| to … | use |
| --- | --- |
| read a patch, list its numbers and change them | `load`, `Scene.parameters`, `Scene.replace` |
| compute a sound, its forces and its energies | `render`, `Rendering` |
| write it to a file, trimmed, at a loudness, as a loop | `Rendering.save`, `SoundForm` |
| write a patch that a script has made | `Scene.save`, `Scene.to_toml` |
| know how exact it is | `rendering.stats.energy`, `rendering.stats.trusted`, `estimate_error` |
| compute many sounds | `run_sweep_rows`, `run_sweep` |
| play in a browser, or in a notebook | `show`, `Rendering.page`, `export_page` |
| play in a program for music | `export_plugin`, `PluginForm` |
| play on an audio device | `Player.start`, `Player.strike`, `Player.set` |
| play in your own callback | `Player.render_into`, `Player.read`; [the rules](live.md#your-own-audio-callback) |
| handle errors | `PatchError` and `BuildError` are ValueErrors, and their `faults` list what is wrong |

Install it in your own environment from a checkout:

```sh
pip install .                     # renders and plays; without plots, xarray, MIDI ports and OSC
pip install ".[plot]"             # Rendering.plot draws with matplotlib
pip install ".[sweep]"            # run_sweep and read_sweep give an xarray.Dataset; run_sweep_rows needs no extra
```

`fdh` is a name of the package `engine`, in which the sources are: `fdh.Scene is engine.Scene`, and every module of the
one is that of the other. Scripts that say `import engine` go on working. Python looks in the folder of your script
first: where a file `engine.py` or a folder `engine/` of yours is found there, `import fdh` names it and stops; rename
yours. The command `fdh` works in such a folder, too; `python -m fdh` does not.
"""
PLAYING = "read", "start", "wait", "close", "stop", "cross_fade_to", "render_into", "fetch_recording"
EVENTS = "strike", "pluck", "lift", "damp", "set", "tune"
READINGS = "live_parameters", "refused", "strikers", "frame", "finished", "meter", "log"
MADE_BY_FUNCTIONS = "Scene", "Parameter", "Rendering", "TraceArrays", "ContactSummary", "ErrorEstimate", "Page"
# in the order of the page: where each name is imported from, and those of its methods and properties that are for users
NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "load": ("fdh", ()),
    "Scene": ("fdh", ("parameters", "replace", "channels", "show", "to_toml", "save")),
    "Parameter": ("fdh.patch.parameters", ()),
    "render": ("fdh", ()),
    "Rendering": ("fdh", ("contacts", "silence", "page", "plot", "save")),
    "TraceArrays": ("fdh.offline.trace", ()),
    "ContactSummary": ("fdh.analysis.contact_summaries", ()),
    "estimate_error": ("fdh", ()),
    "ErrorEstimate": ("fdh", ()),
    "features": ("fdh.analysis.features", ()),
    "run_sweep": ("fdh", ()),
    "run_sweep_rows": ("fdh", ()),
    "read_sweep": ("fdh", ()),
    "read_sweep_rows": ("fdh", ()),
    "Player": ("fdh", (*PLAYING, *EVENTS, *READINGS)),
    "AudioInput": ("fdh", ()),
    "show": ("fdh", ()),
    "export_page": ("fdh", ()),
    "export_plugin": ("fdh", ()),
    "PluginForm": ("fdh", ()),
    "Page": ("fdh", ("save",)),
    "SoundForm": ("fdh", ()),
    "PatchError": ("fdh", ()),
    "BuildError": ("fdh", ()),
    "PatchWarning": ("fdh", ()),
}
ARGUMENT = re.compile(r"([\w.]+(?:, [\w.]+)*): +(\S.*)")


def run() -> None:
    """Write the page."""
    PAGE.write_text(compose_page(), "utf-8")


def documented() -> Iterator[tuple[str, Any]]:
    """Everything on the page by its name there: names, and after each its methods and properties."""
    for name, (module, members) in NAMES.items():
        value = getattr(importlib.import_module(module), name)
        yield f"{module}.{name}", value
        for member in members:
            yield f"{name}.{member}", getattr(value, member)


def compose_page() -> str:
    """The page as Markdown."""
    parts = [INTRODUCTION]
    for name, value in documented():
        heading = "##" if name.startswith("fdh.") else "###"
        parts.append(f"{heading} {name}\n\n{signature(name, value)}{as_markdown(inspect.getdoc(value) or '')}\n")
    return "\n".join(parts)


def signature(name: str, value: Any) -> str:
    """How it is called, as a block of Python; "" of what is not called by users."""
    short = name.rpartition(".")[2]
    if isinstance(value, property) or short in MADE_BY_FUNCTIONS:
        return ""
    if inspect.isclass(value) and issubclass(value, Exception):
        return ""
    parameters = [p.replace(annotation=p.empty) for p in inspect.signature(value).parameters.values()]
    shown = inspect.Signature([p for p in parameters if p.name != "self"])
    text = f"{short}{shown}"
    if len(text) > LINE_LENGTH:
        text = "".join([f"{short}(\n", *(f"    {p},\n" for p in shown.parameters.values()), ")"])
    quoted = text.replace("'", '"')  # as the sources are formatted
    return f"```python\n{quoted}\n```\n\n"


def as_markdown(text: str) -> str:
    """A docstring as Markdown: arguments as a list, examples as blocks of Python."""
    return "\n\n".join(_as_block(block) for block in text.split("\n\n"))


def _as_block(block: str) -> str:
    """A paragraph, a list of arguments with what follows it, or an example."""
    if block.startswith(">>>"):
        return f"```python\n{block}\n```"
    if not ARGUMENT.match(block):
        return block
    items, rest = list[str](), list[str]()
    for line in block.splitlines():
        found = ARGUMENT.fullmatch(line)
        if found and not rest:
            names = "`, `".join(found[1].split(", "))
            items.append(f"- `{names}`: {found[2]}")
        elif line.startswith(" "):
            items[-1] += f" {line.strip()}"
        else:
            rest.append(line)
    wrapped = "\n".join(textwrap.fill(item, LINE_LENGTH, subsequent_indent="  ") for item in items)
    return "\n\n".join([wrapped, "\n".join(rest)]) if rest else wrapped
