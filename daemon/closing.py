"""What is closed at the end of a `with` block."""

from types import TracebackType
from typing import Self


class Closing:
    """Base of what has a `close()` that ends it: `with thing as t:` calls it at the end."""

    def close(self) -> None:
        """End it. Safe to call twice."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
