"""Model files on disk: every read error names the file; files are written completely or not at
all."""

import os
from pathlib import Path

from dehyst.daemon.files.outputs import report_failures, whole_file
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.printable import in_utf8
from dehyst.models.errors import BadModel
from dehyst.models.model import Model
from dehyst.models.modelfile import SHIPPED, dumps, loads, shipped

LARGEST_BYTES = 2 << 20


def load_model(path: str | Path) -> Model:
    """Return the model in a TOML file, or a shipped one by name ("paper-eq12").

    A file of that name takes precedence over the shipped model. Raises BadModel naming file and
    key.
    """
    path = Path(path)
    if str(path) in SHIPPED and not path.exists():
        return shipped(str(path))
    try:
        text = read_text(path, LARGEST_BYTES)
    except NotReadable as error:
        hint = f"; shipped models: {', '.join(SHIPPED)}" if not os.path.exists(path) else ""
        raise BadModel(f"{path}: cannot be read: {error}{hint}") from None
    try:
        return loads(text)
    except BadModel as error:
        raise BadModel(f"{path}: {error}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write text so that the file appears complete or not at all; what UTF-8 has no bytes for, as
    in the name of a file, is escaped. Raises OSError."""
    with whole_file(path) as file:
        file.write(in_utf8(text).encode("utf-8"))


def save_model(model: Model, path: str | Path) -> None:
    """Write a model as TOML, atomically. Raises BadModel if the file cannot be written."""
    with report_failures(path, BadModel):
        write_text(path, dumps(model))
