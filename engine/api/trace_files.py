"""Traces for other programs: NumPy, xarray and NetCDF, MATLAB and Octave, and tables of text."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from engine.offline.trace import COLUMNS, ENERGIES, LISTS_OF_NAMES, TraceArrays
from engine.output_files import atomic_write, save_trace
from engine.provenance import ENGINE, version_of
from engine.sweep.dataset import load_xarray

if TYPE_CHECKING:
    from xarray import Dataset

OF_TIME = *ENERGIES, "iterations"
MAX_MATLAB_NAME = 31  # characters, of a variable


def make_dataset(trace: TraceArrays, about: Mapping[str, str]) -> "Dataset":
    """Return a trace as a data set: time, and by name what moves, with units. about: its
    attributes. Raises ImportError without xarray."""
    arrays, units = cast(dict[str, np.ndarray], trace), dict(trace["units"].tolist())
    data: dict[str, Any] = {}
    for name in OF_TIME:
        data[name] = ("time",), arrays[name], {"units": units.get(name, "1")}
    for name, (dim, _) in COLUMNS.items():
        if name in arrays:
            values = arrays[name].astype(np.int8) if arrays[name].dtype == bool else arrays[name]
            data[name] = ("time", dim), values, {"units": units.get(name, "1")}
    for name in [name for name in arrays if name.startswith("shape.")]:
        places = [f"{name}.{axis}" for axis in "yx"[-(arrays[name].ndim - 1) :]]
        data[name] = ("shape_time", *places), arrays[name], {"units": "m"}
    names = {dim: arrays[listed].tolist() for name, (dim, listed) in COLUMNS.items() if name in arrays}
    coordinates = {"time": ("time", arrays["time"], {"units": "s"}), **names}
    if "shape_time" in arrays:
        coordinates["shape_time"] = "shape_time", arrays["shape_time"], {"units": "s"}
    attributes = {"samplerate": float(trace["samplerate"]), "fdh_version": version_of(ENGINE), **about}
    dataset: Dataset = load_xarray().Dataset(data, coords=coordinates, attrs=attributes)
    return dataset


def write_trace(path: Path, trace: TraceArrays, about: Mapping[str, str]) -> None:
    """Write a trace in the format of its name: .npz; .nc, NetCDF; .mat, of MATLAB; .csv, a row for each sample.

    about: what the file says of it: patch, accuracy

    Raises OSError; ImportError without xarray, for .nc.
    """
    arrays = cast(dict[str, np.ndarray], trace)
    about = {"fdh_version": version_of(ENGINE), **about}
    if path.suffix == ".nc":
        dataset = make_dataset(trace, about)
        with atomic_write(path) as part:
            dataset.to_netcdf(part, engine="scipy")
    elif path.suffix == ".mat":
        from scipy.io import savemat

        named = {name.replace(".", "_")[:MAX_MATLAB_NAME]: array for name, array in arrays.items()}
        for name in LISTS_OF_NAMES:
            if name in named:
                named[name] = named[name].astype(object)
        with atomic_write(path) as part, part.open("wb") as file:
            savemat(file, {**named, **about}, long_field_names=True)
    elif path.suffix == ".csv":
        _write_table(path, arrays)
    else:
        save_trace(path, arrays | {name: np.array(text) for name, text in about.items()})


def _write_table(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a row for each sample: time, energies, and what moves, with units in the header."""
    units = dict(arrays["units"].tolist())
    header, columns = [f"time [{units.get('time', 's')}]"], [arrays["time"]]
    for name in OF_TIME:
        header.append(f"{name} [{units.get(name, '1')}]")
        columns.append(arrays[name])
    for name, (_, listed) in COLUMNS.items():
        for n, label in enumerate(arrays[listed].tolist() if name in arrays else []):
            header.append(f"{name} of {label} [{units.get(name, '1')}]")
            columns.append(arrays[name][:, n])
    table = np.column_stack([column.astype(float) for column in columns])
    quoted = ",".join('"' + text.replace('"', '""') + '"' for text in header)
    with atomic_write(path) as part, part.open("w", encoding="utf-8") as file:
        np.savetxt(file, table, fmt="%.17g", delimiter=",", header=quoted, comments="")
