"""Model files on disk: read with the file named in every error, written whole or not at all."""

import os
from pathlib import Path

from dehyst.models.errors import BadModel
from dehyst.models.model import Model
from dehyst.models.modelfile import SHIPPED, dumps, loads, shipped

LARGEST_BYTES = 16 << 20


def load_model(path: str | Path) -> Model:
    """The model in a TOML file, or a shipped one by name ("paper-eq12").

    A file of that name wins over the shipped model. Raises BadModel naming file and key.
    """
    path = Path(path)
    if str(path) in SHIPPED and not path.exists():
        return shipped(str(path))
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise BadModel(f"{path}: {path.stat().st_size} bytes is too large for a model")
        text = path.read_text("utf-8")
    except OSError as error:
        hint = f"; shipped models: {', '.join(SHIPPED)}" if not path.exists() else ""
        raise BadModel(f"{path}: cannot be read: {error.strerror or error}{hint}") from None
    except UnicodeDecodeError:
        raise BadModel(f"{path}: not a text file") from None
    try:
        return loads(text)
    except BadModel as error:
        raise BadModel(f"{path}: {error}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write text so that the file appears complete or not at all. Raises OSError."""
    path = Path(path)
    part = path.with_name(path.name + ".part")
    try:
        with open(part, "w", encoding="utf-8", newline="\n") as handle:
            handle.write(text)
            handle.flush()
            os.fsync(handle.fileno())
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def save_model(model: Model, path: str | Path) -> None:
    """Write a model as TOML, atomically. Raises BadModel when the place cannot be written."""
    try:
        write_text(path, dumps(model))
    except OSError as error:
        raise BadModel(f"{path}: cannot be written: {error.strerror or error}") from None
