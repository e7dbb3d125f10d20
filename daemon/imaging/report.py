"""Output of `dehyst image`: a table, figures for programs, and three images side by side."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.imaging.experiment import (
    CENTRE_UM,
    COMPENSATED_LEAST,
    LEARNED_LEAST,
    Imaged,
    Picture,
)
from dehyst.daemon.imaging.microscope import HEIGHT_NM
from dehyst.daemon.report.plotting import BEFORE, MODEL, add_legend, draw_rows

PIXELS = 192  # along a line: a tip-rounded edge is about one pixel wide
HEAD = ("picture", "distortion, nm", "of the width, %", "worst, nm", "seam, nm", "less than raw")
LEAST = {"raw": 0.0, "compensated": COMPENSATED_LEAST, "learned": LEARNED_LEAST}


def pictures_to_json(imaged: Imaged) -> dict[str, Any]:
    """Return the figures by image."""
    pictures = {}
    for one in imaged.pictures:
        frame = one.frame
        pictures[one.name] = {
            "says": one.says,
            "distortion_nm": frame.distortion_nm,
            "distortion_percent": distortion_percent(one),
            "distortion_with_scale_nm": frame.uncalibrated_nm,
            "worst_nm": frame.worst_nm,
            "seam_nm": frame.seam_nm,
            "times_less_than_raw": imaged.better(one.name),
            "at_least": LEAST[one.name],
        }
    return {"pictures": pictures, "reached": imaged.reached}


def distortion_percent(one: Picture) -> float:
    """Return the distortion as a percentage of the image width."""
    return 0.1 * one.frame.distortion_nm / one.frame.size_um


def picture_table(imaged: Imaged) -> str:
    """Return the figures as a table for a terminal."""
    lines = [HEAD]
    for one in imaged.pictures:
        frame = one.frame
        least = LEAST[one.name]
        bar = f" (at least {least:g})" if least else ""
        lines.append(
            (
                one.name,
                f"{frame.distortion_nm:.1f}",
                f"{distortion_percent(one):.3f}",
                f"{frame.worst_nm:.1f}",
                f"{frame.seam_nm:.1f}",
                f"{imaged.better(one.name):.1f} times{bar}",
            )
        )
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(x, widths, strict=True)).rstrip() for x in lines
    )


def draw_pictures(imaged: Imaged) -> bytes:
    """Return a PNG of the three images, with the error along a line below each."""
    most = 1.3 * max(np.abs(errors).max() for errors in _along_lines(imaged.pictures[0]))
    return draw_rows(
        [
            [partial(draw_image, one) for one in imaged.pictures],
            [partial(draw_lines, one, most) for one in imaged.pictures],
        ]
    )


def draw_image(one: Picture, axes: Axes) -> str:
    """Draw the image as the microscope shows it."""
    half, (x, y) = 0.5 * one.frame.size_um, CENTRE_UM
    axes.imshow(
        one.frame.picture(PIXELS),
        cmap="gray",
        origin="lower",
        extent=(x - half, x + half, y - half, y + half),
        vmin=-HEIGHT_NM,
        vmax=0.0,
        interpolation="nearest",
    )
    axes.grid(False)
    title = f"{one.name}: {one.frame.distortion_nm:.3g} nm rms, {distortion_percent(one):.2g} %"
    axes.set(xlabel="target x, um", ylabel="target y, um", title=title)
    return (
        f"The grid as it is imaged, {one.name}: {one.says}; distortion "
        f"{one.frame.distortion_nm:.1f} nm rms, seam {one.frame.seam_nm:.1f} nm."
    )


def draw_lines(one: Picture, most_nm: float, axes: Axes) -> str:
    """Draw true minus target x along the lines, for trace and retrace. most_nm: end of the
    scale."""
    trace, retrace = _along_lines(one)
    half = 0.5 * one.frame.size_um
    at = CENTRE_UM[0] + half * (2.0 * (np.arange(trace.size) + 0.5) / trace.size - 1.0)
    axes.plot(at, trace, color=MODEL, lw=1.4, label="trace")
    axes.plot(at, retrace, color=BEFORE, lw=1.4, label="retrace")
    axes.set_ylim(-most_nm, most_nm)
    add_legend(axes, 0.1)
    title = f"{one.name}: seam {one.frame.seam_nm:.3g} nm rms"
    axes.set(xlabel="target x, um", ylabel="true - target x, nm", title=title)
    return f"True minus target x along a line, trace and retrace, {one.name}."


def _along_lines(one: Picture) -> tuple[Any, Any]:
    """Return true minus target x [nm], averaged over the traces and over the retraces; their common
    mean is removed."""
    trace, retrace = one.frame.along_lines
    at = (np.arange(trace.size) + 0.5) / trace.size * one.frame.size_um
    both = 0.5 * (trace + retrace) - at
    return 1e3 * (trace - at - both.mean()), 1e3 * (retrace - at - both.mean())
