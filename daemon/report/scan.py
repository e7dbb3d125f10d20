"""Picture of a scan path in the plane."""

from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import DOWN, MODEL, UNUSED, UP, add_legend, draw_side_by_side
from dehyst.models.drive_design.scans import Scan
from dehyst.models.recording import Floats


def picture_scan(scan: Scan, x: Floats, y: Floats, axes: tuple[str, str], unit: str) -> bytes:
    """Return a PNG of the path in the plane and both targets over time. x, y: (N,) with the centre
    added."""

    def plane(a: Axes) -> str:
        a.plot(x, y, color=UNUSED, lw=0.8, label="turns, lead-in and return")
        shown = [values.copy() for values in (x, y)]
        for values in shown:
            values[~scan.image] = float("nan")
        a.plot(*shown, color=MODEL, lw=1.2, label="scan")
        a.set(
            xlabel=f"{axes[0]}, {unit}", ylabel=f"{axes[1]}, {unit}", title="path", aspect="equal"
        )
        add_legend(a)
        return f"The path in the plane: {scan.says}."

    def times(a: Axes) -> str:
        a.plot(scan.t_s, x, color=UP, lw=1, label=axes[0])
        a.plot(scan.t_s, y, color=DOWN, lw=1, label=axes[1])
        a.set(xlabel="time, s", ylabel=f"target, {unit}", title="targets")
        add_legend(a)
        return "Both targets over time."

    return draw_side_by_side([plane, times], (1.0, 1.4))
