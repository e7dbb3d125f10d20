"""The child process that examines one case: it sets its limits first, then imports and computes."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from dehyst.daemon.files.cases import Examined


def examine_case(folder: str, memory_gb: float) -> None:
    """Run the child process."""
    from dehyst.daemon.service.bounded import take_bounds

    take_bounds(round(memory_gb * (1 << 30)))
    from dehyst.daemon.doctor.examination import examine
    from dehyst.daemon.files import cases

    place = Path(folder)
    cases.put_record(place, cases.EXAMINED, examine_or_explain(place, memory_gb, examine))


def examine_or_explain(
    place: Path, memory_gb: float, examine: "Callable[[Path], Examined]"
) -> "Examined":
    """Return the result of the examination, or the reason why it failed."""
    from dehyst.daemon.files.cases import Examined
    from dehyst.models.errors import DehystError

    try:
        return examine(place)
    except DehystError as error:
        why = f"The recording could not be diagnosed: {error}"
    except MemoryError:
        why = f"The recording could not be diagnosed: it takes more than {memory_gb:g} GB."
    except Exception as error:  # an error in dehyst: the case names it, the log holds the traceback
        logging.getLogger(__name__).exception("%s", place.name)
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        why = f"The examination failed through an error in dehyst, not in the stage: {what}"
    return Examined(failed=True, says=why[:2000])
