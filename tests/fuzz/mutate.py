"""Mutations of valid inputs, for use without a coverage-guided fuzzer.

The outcome of an input (accepted, or the refusal's text without numbers) replaces coverage: an
input with a new outcome joins the corpus.
"""

import random
import re

from tests.fuzz.targets import Target

LONGEST = 1 << 16
INTERESTING = (0, 1, 0x7F, 0x80, 0xFF, 0x20, 0x30, 0x0A)
CORPUS = 4000


def signature(outcome: str) -> str:
    """Return an outcome without the parts that differ from input to input."""
    return re.sub(r"[0-9'\"]+|0x[0-9a-f]+", "", outcome)[:120]


class Mutator:
    """Makes inputs from a growing corpus."""

    def __init__(self, target: Target, seed: int) -> None:
        self.random = random.Random(seed)
        self.words = [*target.words, *target.seeds]
        self.corpus = [*target.seeds]
        self._seen: set[str] = set()

    def next(self) -> bytes:
        """Return the next input."""
        data = bytearray(self.random.choice(self.corpus))
        for _ in range(self.random.choice((1, 1, 1, 2, 4, 8, 32))):
            self._once(data)
        return bytes(data[:LONGEST])

    def saw(self, data: bytes, outcome: str) -> None:
        """Learn the outcome of an input."""
        mark = signature(outcome)
        if mark not in self._seen and len(self.corpus) < CORPUS:
            self._seen.add(mark)
            self.corpus.append(data)

    def _once(self, data: bytearray) -> None:
        r = self.random
        at = r.randrange(len(data) + 1)
        end = min(len(data), at + r.choice((1, 1, 2, 4, 8, 64)))
        match r.randrange(10):
            case 0:
                data[at:end] = bytes(r.randrange(256) for _ in range(end - at))
            case 1 if at < len(data):
                data[at] ^= 1 << r.randrange(8)
            case 2 if at < len(data):
                data[at] = r.choice(INTERESTING)
            case 3:
                del data[at:end]
            case 4:
                data[at:at] = r.choice(self.words)
            case 5:
                data[at:end] = r.choice(self.words)
            case 6:
                data[at:at] = data[at:end] * r.choice((1, 1, 2, 100))
            case 7:
                other = r.choice(self.corpus)
                data[at:] = other[r.randrange(len(other) + 1) :]
            case 8:
                del data[at:]
            case _:
                numbers = [m.span() for m in re.finditer(rb"-?\d+(\.\d+)?", bytes(data[:4096]))]
                if numbers:
                    first, last = r.choice(numbers)
                    data[first:last] = r.choice(
                        (
                            b"0",
                            b"-1",
                            b"1e308",
                            b"nan",
                            str(r.gauss(0, 10.0 ** r.randint(-9, 18))).encode(),
                        )
                    )
