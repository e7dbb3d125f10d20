"""Write the images as HDF5 with NeXus names: an NXdata group for each, the learned one as default.

Names and attributes: NeXus International Advisory Committee, base classes NXroot, NXentry, NXdata,
NXsample, NXpositioner and NXprocess. Needs h5py.
"""

import io
from typing import Any

import numpy as np

from dehyst import __version__
from dehyst.daemon.imaging.experiment import CENTRE_UM, PERIOD_S, Imaged, Picture
from dehyst.daemon.imaging.microscope import PITCH_UM
from dehyst.daemon.imaging.report import PIXELS, distortion_percent


def to_hdf5(imaged: Imaged) -> bytes:
    """Return the whole file. Raises ImportError if h5py is not installed."""
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file.attrs["NX_class"] = "NXroot"
        file.attrs["creator"] = "dehyst"
        file.attrs["default"] = "entry"
        entry = _group(file, "entry", "NXentry")
        entry.attrs["default"] = imaged.pictures[-1].name
        entry["title"] = "Calibration grid, imaged by a virtual scanning microscope"
        process = _group(entry, "process", "NXprocess")
        process["program"], process["version"] = "dehyst image", __version__
        sample = _group(entry, "sample", "NXsample")
        sample["name"] = "calibration grid, simulated"
        _field(sample, "pitch", PITCH_UM, "um")
        instrument = _group(entry, "instrument", "NXinstrument")
        for one in imaged.pictures:
            _add_picture(entry, one)
            _add_stage(instrument, one)
    return out.getvalue()


def _add_picture(entry: Any, one: Picture) -> None:
    """Add heights over target positions."""
    frame = one.frame
    data = _group(entry, one.name, "NXdata")
    data.attrs["signal"] = "height"
    data.attrs["axes"] = ["y", "x"]
    data.attrs["x_indices"], data.attrs["y_indices"] = 1, 0
    data["title"] = f"{one.name}: {one.says}"
    height = _field(data, "height", frame.picture(PIXELS), "nm")
    height.attrs["long_name"] = "height"
    for axis, centre, at in (
        ("x", CENTRE_UM[0], (np.arange(PIXELS) + 0.5) / PIXELS - 0.5),
        ("y", CENTRE_UM[1], np.linspace(-0.5, 0.5, frame.lines)),
    ):
        _field(data, axis, centre + frame.size_um * at, "um")
    _field(data, "distortion", frame.distortion_nm, "nm")
    _field(data, "distortion_of_width", distortion_percent(one), "percent")
    _field(data, "seam", frame.seam_nm, "nm")


def _add_stage(instrument: Any, one: Picture) -> None:
    """Add target position, reading, true position and voltage of each axis over time."""
    scan, followed = one.frame.scan, one.followed
    for axis, wanted, centre in (("x", scan.x, CENTRE_UM[0]), ("y", scan.y, CENTRE_UM[1])):
        stage = _group(instrument, f"{one.name}_{axis}", "NXpositioner")
        stage["name"] = f"axis {axis}"
        _field(stage, "time", np.arange(wanted.size) * PERIOD_S, "s")
        _field(stage, "target_value", wanted + centre, "um")
        _field(stage, "value", followed.shown[axis], "um")
        _field(stage, "true_value", followed.true[axis], "um")
        _field(stage, "raw_value", followed.volts[axis], "V")


def _group(parent: Any, name: str, kind: str) -> Any:
    group = parent.create_group(name)
    group.attrs["NX_class"] = kind
    return group


def _field(group: Any, name: str, value: Any, unit: str) -> Any:
    more = {"compression": "gzip"} if np.ndim(value) else {}
    field = group.create_dataset(name, data=value, **more)
    field.attrs["units"] = unit
    return field
