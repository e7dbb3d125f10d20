"""The tool's findings on real recordings, if they are available: a table without a bar."""

import time
from pathlib import Path
from typing import Any


def real_recordings(folder: Path) -> str:
    """Return a line for every recording, or why there are none."""
    paths = sorted((folder / "recordings").glob("*.csv"))
    if not paths:
        return f"Real recordings: none in {folder / 'recordings'} (set DEHYST_DATA)"
    return "\n".join(["Real recordings (error before and after)", *map(_one, paths)])


def _one(path: Path) -> str:
    from dehyst.daemon.files.recordings import read_recording
    from dehyst.models.diagnosis import diagnose
    from dehyst.models.errors import DehystError

    try:
        recording = read_recording(path, need_displacement=True)
        start = time.perf_counter()
        d = diagnose([recording])
    except DehystError as error:
        return f"  {path.stem:16s} {error}"
    said = ", ".join(f"{f.name} ({100 * f.share:.0f} %)" for f in d.findings) or "-"
    before, after = d.rms.get("heldout_model"), d.rms.get("heldout_augmented")
    return (
        f"  {path.stem:16s} {d.verdict:9s} {said:46s} {_number(before)} -> {_number(after)} "
        f"{d.unit}, noise {d.noise:.3g}, {time.perf_counter() - start:.0f} s"
    )


def _number(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, int | float) else "-"
