"""What a file of physics offers: its blocks, how it is recognised, the experiment that shows it.

`Physics` is the entry that the folder's listing finds. A `Specimen` gives the blocks that stand
for an effect in simulations, the typical one first, further strengths behind it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dehyst.models.model import Block
from dehyst.models.physics.candidate import Candidate
from dehyst.models.physics.kind import Kind
from dehyst.models.signals.joined import Data

TEMPERATURE, OTHER_AXIS = "temp_c", "u2_v"  # channels that the simulated experiments have


@dataclass(frozen=True)
class Scales:
    """What an experiment offers: drive range [drive unit], steepest rate [drive unit / s], sampling
    period and length [s], the stage's stroke [displacement unit], and the units."""

    drive_min: float
    drive_max: float
    rate_max: float
    period_s: float
    seconds: float
    stroke: float
    drive_unit: str
    unit: str

    @property
    def span(self) -> float:
        """Width of the drive's range."""
        return self.drive_max - self.drive_min


@dataclass(frozen=True)
class Specimen:
    """variants: blocks for these conditions, the typical one first; hint: what else to record;
    in_base: a base of hysteresis of any shape would take it whole."""

    variants: Callable[[Scales], list[Block]]
    hint: str = ""
    in_base: bool = False


@dataclass(frozen=True)
class Physics:
    """One file's physics.

    name: word of the diagnosis' vocabulary; kinds: blocks of the model file; candidates(data): what
    the diagnosis may find in these recordings; changes(data): what is inside the base of a
    diagnosis, and shows only about a model that was right before; specimens: by the name that
    `dehyst excite --separate` takes; distinguished_by: name of a rival -> the drive that
    separates the two, in words; looks: of a loop of another shape than the model's, what it would
    look like -> its rank among those that look so.
    """

    name: str
    kinds: tuple[Kind, ...]
    candidates: Callable[[Data], list[Candidate]]
    specimens: Mapping[str, Specimen]
    distinguished_by: Mapping[str, str] = field(default_factory=dict)
    looks: Mapping[str, int] = field(default_factory=dict)
    changes: Callable[[Data], list[Candidate]] = lambda data: []
