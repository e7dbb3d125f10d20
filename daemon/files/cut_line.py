"""Find a last line that ends inside its last number, because a logger was killed or a disk full."""

from collections.abc import Sequence

LEAST_OTHERS, MOST_OTHERS = 20, 2000
AS_SHORT = 0.02
"""Largest share of the other numbers of a column with as few digits as a number that was cut:
programs that write no zeros at the end write one of a hundred numbers two digits shorter."""


def ends_inside_number(last: str, others: Sequence[str], decimal: str) -> bool:
    """Return whether the last field of a file without an end of its last line has fewer digits
    than nearly all others of its column: behind the decimal mark where most have one."""
    marked = 2 * sum(decimal in other for other in others) > len(others)

    def size(field: str) -> int:
        text = field.strip().lstrip("+-")
        return len(text.partition(decimal)[2]) if marked else len(text)

    as_short = sum(size(other) <= size(last) for other in others)
    is_number = any(map(str.isdigit, last))
    return is_number and len(others) >= LEAST_OTHERS and as_short <= AS_SHORT * len(others)
