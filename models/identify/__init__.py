"""Identify an invertible model from recordings, and estimate its error."""

from dehyst.models.cascade.figures import Figures, describe
from dehyst.models.identify.identification import identify_alone
from dehyst.models.identify.identified import Identification, Options
from dehyst.models.identify.several_axes import identify

__all__ = ["Figures", "Identification", "Options", "describe", "identify", "identify_alone"]
