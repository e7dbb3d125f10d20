"""Blocks of the cascade around the hysteresis (placeholder registry, filled by its modules)."""

from dehyst.models.model import Block


def check_block(block: Block) -> None:
    """Raise BadModel where the block's kind, place or parameters are wrong."""
