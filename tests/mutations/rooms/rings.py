"""What the processes share."""

from tests.mutations.change import Change, room

RING = "daemon/rings/ring.py"

CHANGES = room(
    ("tests/daemon/rings/test_ring.py",),
    Change(
        "torn-records", RING, "if safe > start and start < stop:", "if False:",
        "telemetry shows records that were overwritten while they were read",
    ),
    Change(
        "lost-not-counted", RING, "return out, stop, start - tail", "return out, stop, 0",
        "lost samples are not told",
    ),
    Change(
        "any-layout", RING, " or words[_LAYOUT] != _layout(dtype):", ":",
        "a ring of another version is read as garbage",
    ),
    Change(
        "no-magic", RING, "words[_MAGIC] != MAGIC or ", "",
        "any file is read as a ring",
    ),
    Change(
        "wrap-forgotten", RING, "        self.records[: records.size - first] = records[first:]\n",
        "", "commands at the ring's end are lost",
    ),
    Change(
        "free-forgets-reader", RING,
        "return self.capacity - (self.head - int(load(self.words, TAIL)))",
        "return self.capacity", "commands overwrite others that the loop has not read",
    ),
    Change(
        "stale-never", RING, "return os.stat(self.path).st_ino != int(self.words[_EPOCH])",
        "return False", "the gateway goes on with the rings of a loop that has died",
    ),
)  # fmt: skip
