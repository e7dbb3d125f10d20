"""Base class of objects that a `with` block closes at its end."""

from abc import ABC, abstractmethod
from typing import Self


class Closing(ABC):
    """Base class of objects with a `close()`, which `with thing as t:` calls at its end."""

    @abstractmethod
    def close(self) -> None:
        """Close the object. Safe to call twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
