"""Count the files that one effect passes through in a diagnosis, and the names that it has there.

    python -m tests.benchmarks.models.rooms_of_an_effect

Creep is put into a stage with a Bouc-Wen loop. A file counts once one of its functions returns
while a local variable holds the candidate, an effect, a trial or a finding of creep.
"""

import sys
from collections import defaultdict
from pathlib import Path
from types import FrameType
from typing import Any

from tests.models.diagnosis.test_names import recordings

import dehyst.models
from dehyst.models.diagnosis import diagnose
from dehyst.models.diagnosis.result import Finding
from dehyst.models.physics.candidate import Candidate

EFFECT = "creep"
MODELS = Path(dehyst.models.__file__).parent


def holds_the_effect(value: Any) -> bool:
    """Return whether a local variable is the effect, in one of its forms."""
    one = value if isinstance(value, Candidate | Finding) else getattr(value, "candidate", None)
    return isinstance(one, Candidate | Finding) and one.name == EFFECT


def main() -> int:
    """Print the files with the number of functions, and the counts."""
    rooms, names = defaultdict(set), set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "return" and frame.f_code.co_filename.startswith(str(MODELS)):
            for name, value in frame.f_locals.items():
                if holds_the_effect(value):
                    rooms[frame.f_code.co_filename].add(frame.f_code.co_name)
                    names.add(name)

    sys.setprofile(note)
    found = diagnose(recordings(EFFECT), with_limits=False)
    sys.setprofile(None)
    assert EFFECT in {f.name for f in found.findings}
    for path in sorted(rooms):
        print(f"{Path(path).relative_to(MODELS)}: {len(rooms[path])} functions")
    inside = sum(Path(path).is_relative_to(MODELS / "diagnosis") for path in rooms)
    print(f"files: {len(rooms)}, of these in models/diagnosis {inside}; names: {len(names)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
