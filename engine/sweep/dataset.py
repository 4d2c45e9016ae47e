"""A sweep as a labelled data set: features and statistics over the values that varied (xarray)."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from engine.analysis.contact_summaries import UNITS
from engine.output_files import soundfile_path
from engine.patch.scene import Scene
from engine.sweep.common_gain import sound_path
from engine.sweep.index_csv import IndexRow, contact_columns
from engine.sweep.rows import MEASURE_NAMES, WORD_NAMES, is_number, read_index_rows, varied_paths

if TYPE_CHECKING:
    from xarray import Dataset

NO_XARRAY = (
    'a data set needs xarray; pip install "fdh-engine[sweep]", or uv sync --extra sweep; '
    "run_sweep_rows and read_sweep_rows give rows without it"
)
MAX_SOUND_NUMBERS = 1 << 26  # of all sounds together: 256 MB
MEASURES = {  # unit, and what it is
    "peak": ("SI unit of the pickups", "largest sample"),
    "rms": ("SI unit of the pickups", "root mean square"),
    "silent": ("1", "1 if nothing can be heard"),
    "fundamental_hz": ("Hz", "lowest partial within 20 dB of the strongest"),
    "strongest_hz": ("Hz", "partial with the most energy"),
    "centroid_hz": ("Hz", "mean frequency, weighted by the power of the whole sound"),
    "t60_s": ("s", "time to fall by 60 dB, from -5 to -25 dB"),
    "gain_db": ("dB", "gain of the file on SI units"),
    "contact": ("1", "share of samples in contact"),
    "newton_mean": ("1", "mean evaluations of the contact law in an iterative solve"),
    "newton_max": ("1", "most evaluations in a solve"),
    "unconverged": ("1", "contact solves that did not converge"),
    "capped": ("1", "those of them that reached the iteration limit"),
    "trusted": ("1", "1 if nothing speaks against the rendering, 0 if the reasons do"),
    "energy_error": ("1", "largest error of the energy balance, relative to the maximum stored energy"),
}


def read_sweep(folder: str | Path, scene: Scene | None = None, sounds: bool = False) -> "Dataset":
    """Read the folder of a sweep as an xarray.Dataset.

    folder: that `fdh sweep` or `run_sweep` has written, done or not
    scene:  the patch that was swept, for the units of the values that varied; they have none without it
    sounds: read the sounds too, into `audio` [..., frame, channel], single precision, in the SI units of the pickups

    Each value that varied is a dimension with its path as the name; points at random lie along `point` instead, with
    the values as coordinates. Variables are the features and statistics of index.csv, with `units` and `long_name`;
    `file`, `status`, `reasons` and `t60_reason` too. What was not rendered, or is not defined, is NaN.

    Raises ImportError without xarray, which `read_sweep_rows` does without; ValueError if the folder is none of a
    sweep, or its sounds are over 256 MB.

    >>> import fdh
    >>> scene = fdh.load("bouncing_ball")
    >>> done = fdh.run_sweep(scene, {"body.ball.mass": [0.1, 0.2]}, "balls", seconds=0.5)
    >>> again = fdh.read_sweep("balls", scene)
    >>> again.sizes["body.ball.mass"], again["body.ball.mass"].attrs["units"]
    (2, 'kg')
    """
    xarray = load_xarray()
    rows = read_index_rows(folder)
    folder, paths = Path(folder), varied_paths(rows)
    values = {path: _values([row[path] for row in rows]) for path in paths}
    dims, coordinates, place = arrange(values, len(rows))
    shape = tuple(len(coordinates[dim]) for dim in dims)

    def over_points(cells: list[Any], fill: Any, dtype: Any) -> np.ndarray:
        array = np.full(shape, fill, dtype)
        for at, cell in zip(place, cells, strict=True):
            array[at] = cell
        return array

    data: dict[str, Any] = {}
    for name in MEASURE_NAMES:
        cells = [float(row[name]) if row[name] else math.nan for row in rows]
        units, meaning = MEASURES[name]
        data[name] = dims, over_points(cells, math.nan, float), {"units": units, "long_name": meaning}
    for name in contact_columns(rows[0]):
        cells = [float(row[name]) if row.get(name) else math.nan for row in rows]
        contact, _, measure = name.rpartition(".")
        attributes = {"units": UNITS.get(measure, "1"), "long_name": f"{measure.replace('_', ' ')} of {contact}"}
        data[name] = dims, over_points(cells, math.nan, float), attributes
    for name in ("file", "status", *WORD_NAMES):
        data[name] = dims, over_points([row[name] for row in rows], "", object)
    given = {p.path: p for p in scene.parameters()} if scene is not None else {}
    labels = {path: ("point" if dims == ("point",) else path, array) for path, array in coordinates.items()}
    dataset = xarray.Dataset(data, coords=labels, attrs={"folder": str(folder)})
    for path in paths:
        if path in given:
            dataset[path].attrs |= {"units": given[path].unit or "1", "long_name": given[path].meaning}
    return _with_sounds(dataset, folder, rows, place) if sounds else dataset


def arrange(
    values: dict[str, np.ndarray], count: int
) -> tuple[tuple[str, ...], dict[str, np.ndarray], list[tuple[int, ...]]]:
    """The dimensions of a data set, its coordinates, and the place of each row: a grid if more than half of one is
    there, else a list of points."""
    axes = {path: list(dict.fromkeys(array.tolist())) for path, array in values.items()}
    place = list(zip(*([axes[path].index(v) for v in array.tolist()] for path, array in values.items()), strict=True))
    if len(set(place)) == count and math.prod(map(len, axes.values())) < 2 * count:
        return tuple(axes), {path: np.array(axis) for path, axis in axes.items()}, place
    return ("point",), {"point": np.arange(1, count + 1), **values}, [(n,) for n in range(count)]


def _values(cells: list[str]) -> np.ndarray:
    """The values of an axis: numbers if all are."""
    return np.array([float(cell) for cell in cells] if all(map(is_number, cells)) else cells)


def _with_sounds(dataset: "Dataset", folder: Path, rows: list[IndexRow], place: list[tuple[int, ...]]) -> "Dataset":
    """The data set with the sounds, too. Raises ValueError if they are too many."""
    import soundfile

    done = [(at, row) for at, row in zip(place, rows, strict=True) if row["status"] == "done"]
    infos = [soundfile.info(soundfile_path(sound_path(folder, row))) for _, row in done]
    frames, channels = (max((getattr(i, name) for i in infos), default=0) for name in ("frames", "channels"))
    shape = (*dataset["status"].shape, frames, channels)
    if math.prod(shape) > MAX_SOUND_NUMBERS:
        size = f"{math.prod(shape) * 4 / 1e6:.0f} MB"
        raise ValueError(
            f"{folder}: its sounds are {size}, more than 256 MB; read them one by one, with the names in dataset.file"
        )
    audio = np.full(shape, math.nan, np.float32)
    for at, row in done:
        sound, _ = soundfile.read(soundfile_path(sound_path(folder, row)), dtype="float64", always_2d=True)
        audio[at][: len(sound)] = sound / 10 ** (float(row["gain_db"] or 0.0) / 20)
    attributes = {"units": "SI unit of the pickups", "long_name": "sound"}
    dataset = dataset.assign(audio=((*dataset["status"].dims, "frame", "channel"), audio, attributes))
    rate = infos[0].samplerate if infos else 1
    return dataset.assign_coords(time=("frame", np.arange(frames) / rate, {"units": "s"}))


def load_xarray() -> Any:
    """The module xarray. Raises ImportError, which says how to get it."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError(NO_XARRAY) from error
    return xarray
