"""The child that examines one case: its bounds first, then everything that computes."""

from pathlib import Path


def examine_case(folder: str, memory_gb: float) -> None:
    """The child's whole life."""
    from dehyst.daemon.tools.bounded import take_bounds

    take_bounds(round(memory_gb * (1 << 30)))
    from dehyst.daemon.doctor.examination import examine
    from dehyst.daemon.files import cases
    from dehyst.daemon.files.cases import Examined
    from dehyst.models.errors import DehystError

    place = Path(folder)
    try:
        found = examine(place)
    except DehystError as error:
        says = f"The recording could not be diagnosed: {error}"
        found = Examined(failed=True, says=says[:2000])
    except MemoryError:
        says = f"The recording could not be diagnosed: it takes more than {memory_gb:g} GB."
        found = Examined(failed=True, says=says)
    cases.put_record(place, cases.EXAMINED, found)
