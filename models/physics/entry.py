"""The interface of a file of physics: its blocks, its candidates, the experiment that reveals it.

`Physics` is the entry that the registry finds in each file of the folder. A `Specimen` provides the
blocks that represent an effect in simulations: the typical one first, then other strengths.
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
    """Scales of an experiment: drive range [drive unit], highest rate [drive unit / s], sampling
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
        """Width of the drive range."""
        return self.drive_max - self.drive_min


@dataclass(frozen=True)
class Specimen:
    """variants: returns the blocks for given scales, the typical one first; hint: what else to
    record; in_base: a base that represents hysteresis of any shape would absorb the effect."""

    variants: Callable[[Scales], list[Block]]
    hint: str = ""
    in_base: bool = False


@dataclass(frozen=True)
class Physics:
    """One file's physics.

    name: word of the diagnosis' vocabulary; kinds: blocks of the model file; candidates(data): the
    effects that the diagnosis may find in these recordings; changes(data): effects that the base of
    a diagnosis absorbs, so that they are found only as a change from a model that was right before;
    specimens: by the name that `dehyst excite --separate` takes; distinguished_by: name of a rival
    -> the drive that separates the two, in words; looks: a look of a loop whose shape differs from
    the model's -> the rank of this physics among the causes of that look.
    """

    name: str
    kinds: tuple[Kind, ...]
    candidates: Callable[[Data], list[Candidate]]
    specimens: Mapping[str, Specimen]
    distinguished_by: Mapping[str, str] = field(default_factory=dict)
    looks: Mapping[str, int] = field(default_factory=dict)
    changes: Callable[[Data], list[Candidate]] = lambda data: []
