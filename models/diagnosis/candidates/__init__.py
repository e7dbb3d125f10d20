"""The library of candidate physics: one file for each, found by listing this package.

A file defines `candidates(data) -> list[Candidate]`: the instances that these recordings allow
(a coupling for each further channel, for instance). Adding physics means adding a file.
"""

import importlib
import pkgutil

from dehyst.models.diagnosis.candidates.interface import Candidate
from dehyst.models.diagnosis.data import Data


def library(data: Data) -> list[Candidate]:
    """Every candidate that these recordings allow, in the order of their place in the cascade."""
    found: list[Candidate] = []
    for entry in pkgutil.iter_modules(__path__):
        if entry.name == "interface":
            continue
        module = importlib.import_module(f"{__name__}.{entry.name}")
        found.extend(module.candidates(data))
    return sorted(found, key=lambda c: c.order)
