"""Notes that accompany a CSV file: NAME.csv.meta.json, a flat map of texts.

The CSV itself begins with its header line, so that every program can read it. `.npz` and `.mcap`
files store their notes inside.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from dehyst.daemon.files.outputs import notes_path, whole_file
from dehyst.models.errors import BadRecording

MOST_BYTES = 1 << 20


def write_notes(path: Path, notes: Mapping[str, str]) -> None:
    """Write the notes that accompany the recording `path`; without notes, delete an existing file.
    Raises OSError."""
    beside = notes_path(path)
    if not notes:
        beside.unlink(missing_ok=True)
        return
    flat = {key: " ".join(str(value).split()) for key, value in notes.items()}
    with whole_file(beside) as file:
        file.write((json.dumps(flat, indent=1, ensure_ascii=False) + "\n").encode())


def read_notes(path: Path) -> dict[str, str]:
    """Return the notes that accompany a recording; {} if there are none. Raises BadRecording."""
    beside = notes_path(path)
    try:
        with beside.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
        if len(raw) > MOST_BYTES:
            raise ValueError("it is too long")
        notes = json.loads(raw)
        if not isinstance(notes, dict):
            raise ValueError("it is not a map of names to texts")
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise BadRecording(
            f"{beside.name}: the notes of {path.name} cannot be read: {error}; correct or delete it"
        ) from None
    return {str(key): value for key, value in notes.items() if isinstance(value, str)}
