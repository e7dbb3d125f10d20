"""Choose the model that the loop runs: the configured one, or an accepted one in its place.

An accepted model is stored in the run folder, with the digest of the configured model that it
replaces. If the configured file changes, the accepted model is no longer used. The configured file
itself is never modified.
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
    accepted model that it replaced, "" if that was the configured one; trial: not yet confirmed;
    model_error, tracking_error, target_steps: rms before acceptance, None if nothing moved;
    begun_wall_ns: when the trial began, 0: not known; tested: result of the offer's test."""

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
    """Return the accepted model; None if there is none or it cannot be read."""
    try:
        return msgspec.json.decode(read_text(directory / FILE, LARGEST_BYTES), type=Accepted)
    except (NotReadable, msgspec.MsgspecError):
        return None


def write_accepted(directory: Path, accepted: Accepted) -> None:
    """Use this model from the next reload on. Raises OSError."""
    write_text(directory / FILE, msgspec.json.encode(accepted).decode())


def forget_accepted(directory: Path) -> None:
    """Use the configured model again from the next reload on. Raises OSError."""
    (directory / FILE).unlink(missing_ok=True)


def choose_model(config: Config) -> tuple[Model, bool, str]:
    """Return (the model to run, whether it is an accepted one, a remark on that). Raises BadModel
    if the configured model cannot be read."""
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
