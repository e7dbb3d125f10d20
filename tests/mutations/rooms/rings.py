"""What the processes share."""

from tests.mutations.change import Change, room

RING, LAYOUT = "daemon/rings/ring.py", "daemon/rings/layout.py"

CHANGES = room(
    ("tests/daemon/rings/test_ring.py",),
    Change(
        "torn-records", RING, "        if not whole.all():", "        if False:",
        "telemetry shows records that were overwritten while being read",
    ),
    Change(
        "lost-not-counted", RING, "return out, stop, stop - tail - out.size",
        "return out, stop, 0", "lost samples are not reported",
    ),
    Change(
        "any-layout", LAYOUT,
        "if words[LAYOUT_AT] != layout_of(dtype) or words[ITEM_AT] != dtype.itemsize:", "if False:",
        "a ring of another version is read as garbage",
    ),
    Change(
        "no-magic", LAYOUT, " or words[MAGIC_AT] != MAGIC:", ":",
        "any file is read as a ring",
    ),
    Change(
        "any-size", LAYOUT, " or size != size_of(dtype, capacity):", ":",
        "a truncated ring ends its reader",
        tests=("tests/daemon/rings/test_damage.py",),
    ),
    Change(
        "damage-taken", RING, "        value = (value ^ np.uint64(byte)) * _PRIME\n",
        "        value = value * _PRIME\n", "a damaged record is used as a set-point",
        tests=("tests/daemon/rings/test_damage.py",),
    ),
    Change(
        "wrap-forgotten", RING, "        self.records[: records.size - first] = records[first:]\n",
        "", "commands at the ring's end are lost",
    ),
    Change(
        "free-forgets-reader", RING,
        "return max(0, self.capacity - (self.head - self.tail))",
        "return self.capacity", "commands overwrite others that the loop has not read",
    ),
    Change(
        "stale-never", RING, "return os.stat(self.path).st_ino != self._inode",
        "return False", "the gateway continues with the rings of a dead loop",
    ),
    Change(
        "a-damaged-number-ends-the-gateway", "daemon/gateway/core_rings.py",
        "except (ProcessLookupError, OverflowError):", "except ProcessLookupError:",
        "a damaged process number in a ring ends the gateway",
        tests=("tests/daemon/gateway/test_left_over_rings.py",),
    ),
)  # fmt: skip
