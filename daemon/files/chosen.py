"""Which model the loop is to run: the configured one, or one that was accepted in its place.

An accepted model lies in the run folder, with the digest of the configured model that it takes the
place of. Whoever changes the configured file means that one: the accepted model counts no more.
The configured file itself is never touched.
"""

from pathlib import Path

import msgspec

from dehyst.daemon.config import Config
from dehyst.daemon.files.cases import OfferTest
from dehyst.daemon.files.models import load_model, write_text
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.daemon.rings.records import model_digest
from dehyst.models.errors import BadModel
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps, loads

FILE = "accepted.json"
LARGEST_BYTES = 4 << 20


class Accepted(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """offer: its number; instead_of: digest of the configured model; model: TOML; before: the
    accepted model that it took the place of, "" where that was the configured one; trial: not
    proven yet; model_error, tracking_error, target_steps: rms before, None where nothing moved;
    begun_wall_ns: when the trial began, 0: not known; tested: what the test promised."""

    offer: int
    case: str
    instead_of: str
    model: str
    before: str = ""
    trial: bool = True
    model_error: float | None = None
    tracking_error: float | None = None
    target_steps: float | None = None
    begun_wall_ns: int = 0
    tested: OfferTest | None = None


resolve_classes(Accepted)


def read_accepted(directory: Path) -> Accepted | None:
    """What was accepted; None: nothing, or nothing that can be read."""
    try:
        return msgspec.json.decode(read_text(directory / FILE, LARGEST_BYTES), type=Accepted)
    except (NotReadable, msgspec.MsgspecError):
        return None


def write_accepted(directory: Path, accepted: Accepted) -> None:
    """Let this model be the one from the next reload on. Raises OSError."""
    write_text(directory / FILE, msgspec.json.encode(accepted).decode())


def forget_accepted(directory: Path) -> None:
    """The configured model again, from the next reload on. Raises OSError."""
    (directory / FILE).unlink(missing_ok=True)


def choose_model(config: Config) -> tuple[Model, bool, str]:
    """(the model to run, whether it is an accepted one, what is to be said of that). Raises
    BadModel where the configured one cannot be read."""
    configured = load_model(config.model.file)
    accepted = read_accepted(config.directory)
    if accepted is None:
        return configured, False, ""
    if accepted.instead_of != model_digest(dumps(configured)):
        gone = f"the configured model has changed and replaces that accepted for {accepted.case}"
        return configured, False, gone
    try:
        return loads(accepted.model), True, f"the model accepted for {accepted.case}"
    except BadModel as error:
        return (
            configured,
            False,
            f"the accepted model cannot be used, so the configured one is: {error}",
        )
