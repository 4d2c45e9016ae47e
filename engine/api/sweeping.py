"""Sweeps from Python: a scene at many values, as a labelled data set."""

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.api.rendering import check_accuracy_names
from engine.argument_checks import checked_integer, checked_number
from engine.faults import Fault, PatchError
from engine.offline.trace import contact_names
from engine.patch.paths import locate
from engine.patch.reader import DOCUMENT
from engine.patch.scene import Scene, check_scene
from engine.sound.form import SoundForm
from engine.sweep.axes import MAX_GRID_POINTS, SweepAxis, parse_axis
from engine.sweep.dataset import load_xarray, read_sweep
from engine.sweep.local_workers import leave_if_imported, run_local
from engine.sweep.plan import SweepPlan, check_axes, draw_points, grid_points
from engine.sweep.rows import SweepRow, read_sweep_rows
from engine.sweep.sweep import Renderer
from engine.sweep.sweep import run_sweep as sweep_to_folder
from engine.sweep.task import RenderTask, Results, render_task

if TYPE_CHECKING:
    from xarray import Dataset


def run_sweep(
    scene: Scene,
    vary: Mapping[str, Sequence[Any] | np.ndarray | str],
    folder: str | Path | None = None,
    sounds: bool = False,
    cores: int = 1,
    **settings: Any,
) -> "Dataset":
    """Render a scene at every point of a grid, and return features and statistics as an xarray.Dataset; see
    `read_sweep`.

    vary:     values by their paths (`Scene.parameters`): a list, an array, or a range as `--vary` takes it:
              "1e7..1e10:log:4"
    folder:   where the sounds and index.csv are kept, as `fdh sweep` keeps them: what is there already is not rendered
              again. If None, they are not kept
    sounds:   put the sounds into the data set, in SI units
    cores:    processes; with more than one, a script needs `if __name__ == "__main__":` around it, or it is a
              RuntimeError
    settings: seconds, samplerate and accuracy, as of `render`; `random`, a number of points that are drawn from the
              ranges ("1e7..1e10:log", "1~0.1") with a `seed`, in place of the grid; and `contacts=True`, which measures
              each contact: columns such as `felt.peak_force`

    A point that fails is NaN, and `status` says why. Raises TypeError if an argument is of the wrong kind, PatchError
    if a path leads nowhere or a value is out of range; ImportError without xarray, which `run_sweep_rows` does without.

    >>> import fdh
    >>> scene = fdh.load("bouncing_ball").replace("seconds", 1.0)
    >>> varied = {"body.ball.mass": [0.1, 0.2], "contact.0.stiffness": "1e6..1e8:log:3"}
    >>> found = fdh.run_sweep(scene, varied)
    >>> dict(found.sizes)
    {'body.ball.mass': 2, 'contact.0.stiffness': 3}
    >>> found.peak.sel({"body.ball.mass": 0.1}).dims, found.contact.attrs["units"]
    (('contact.0.stiffness',), '1')
    """
    load_xarray()
    with _sweep_folder(folder) as place:
        _render_grid(scene, vary, place, cores, settings)
        dataset = read_sweep(place, scene, sounds)
        return dataset if folder is not None else dataset.drop_vars("file").drop_attrs(deep=False)


def run_sweep_rows(
    scene: Scene,
    vary: Mapping[str, Sequence[Any] | np.ndarray | str],
    folder: str | Path | None = None,
    cores: int = 1,
    **settings: Any,
) -> list[SweepRow]:
    """Render a scene at every point of a grid, and return a list of dicts, one per point; see `read_sweep_rows`.

    Arguments and errors are those of `run_sweep`, but it needs no xarray. Without a folder, sounds are not kept, and
    `file` is None. A point that fails has None for what was not computed, and `status` says why.

    >>> import fdh
    >>> scene = fdh.load("bouncing_ball").replace("seconds", 1.0)
    >>> rows = fdh.run_sweep_rows(scene, {"body.ball.displacement": [0.1, 0.2]})
    >>> [f"{row['body.ball.displacement']} m: {row['peak']:.2f} m/s" for row in rows]
    ['0.1 m: 1.42 m/s', '0.2 m: 1.99 m/s']
    """
    with _sweep_folder(folder) as place:
        _render_grid(scene, vary, place, cores, settings)
        rows = read_sweep_rows(place)
        return rows if folder is not None else [row | {"file": None} for row in rows]


@contextmanager
def _sweep_folder(folder: str | Path | None) -> Iterator[Path]:
    """The folder of a sweep, or a temporary one."""
    if folder is not None:
        yield Path(folder)
        return
    with tempfile.TemporaryDirectory() as place:
        yield Path(place)


def _render_grid(scene: Scene, vary: Any, folder: Path, cores: int, settings: dict[str, Any]) -> None:
    """Render a scene at every point of a grid into a folder. Raises TypeError, PatchError, RuntimeError."""
    leave_if_imported()
    check_scene(scene)
    cores, rate = checked_integer("cores", cores), checked_integer("samplerate", settings.pop("samplerate", 44_100))
    seconds = settings.pop("seconds", None)
    count, seed = settings.pop("random", None), checked_integer("seed", settings.pop("seed", 0))
    measured = bool(settings.pop("contacts", False))
    options = {"seconds": None if seconds is None else checked_number("seconds", seconds), "samplerate": rate}
    check_accuracy_names(settings, "a sweep")
    options |= scene.accuracy.replace(**settings).model_dump(include={*settings})
    renderer: Renderer = render_here if cores == 1 else partial(run_local, cores=cores)
    plan = plan_grid(scene, vary, None if count is None else checked_integer("random", count), seed)
    plan = replace(plan, contacts=tuple(contact_names(scene)) if measured else ())
    sweep_to_folder(plan, folder, renderer, options, SoundForm(fade=False))


def plan_grid(scene: Scene, vary: Any, count: int | None = None, seed: int = 0) -> SweepPlan:
    """The grid of a scene at some values, or so many random points. Raises TypeError, PatchError."""
    if not isinstance(vary, Mapping) or not vary:
        example = '{"contact.felt.stiffness": [1e8, 1e9]}'
        raise TypeError(f"vary = {vary!r} is not a dict of values by their paths; give one, such as {example}")
    data, axes, faults = scene.document, list[SweepAxis](), list[Fault]()
    for path, values in vary.items():
        try:
            axes.append(_axis(path, values, scene, data, count is not None))
        except ValueError as error:
            faults.append(Fault(path, str(error).removeprefix(f"{path}: "), DOCUMENT))
    size = math.prod(axis.count or len(axis.bounds) for axis in axes) if count is None else count
    if not faults and not 1 <= size <= MAX_GRID_POINTS:
        faults.append(Fault("", f"{size} points; give 1 to {MAX_GRID_POINTS}", DOCUMENT))
    if not faults:
        points = grid_points(axes) if count is None else list(islice(draw_points(axes, seed), count))
        plan = SweepPlan(str(scene.folder / "scene.toml"), data, axes, points)
        faults = [Fault("", fault.message, DOCUMENT) for fault in check_axes(plan)]
    if faults:
        raise PatchError(faults)
    return plan


def _axis(path: str, values: Any, scene: Scene, data: dict[str, Any], is_random: bool) -> SweepAxis:
    """The axis of some values. Raises ValueError, TypeError."""
    if isinstance(values, str):
        return parse_axis(f"{path}={values}", scene, data, is_random)
    try:
        listed = np.asarray(values).tolist() if isinstance(values, np.ndarray) else list(values)
    except TypeError:
        raise TypeError(f'{path}: {values!r} is not a list of values; give one, or a range such as "1..2:5"') from None
    if not listed:
        raise ValueError(f"{path}: no values; give at least one")
    return SweepAxis(path, locate(path, scene, data)[0], tuple(listed))


def render_here(tasks: list[RenderTask]) -> Results:
    """Results of this process, one after the other."""
    for task in tasks:
        yield task.number, render_task(task)
