"""Recordings: no row lost, nothing deleted that nobody gave up, readable elsewhere."""

from tests.mutations.change import Change, room

PIECES, RECORDER, ROWS = (f"daemon/files/{name}.py" for name in ("pieces", "recorder", "rows"))
MCAP, APPENDED = "daemon/files/mcap_file.py", "daemon/files/appended.py"

CHANGES = room(
    ("tests/daemon/files/test_recorder.py",),
    Change(
        "earlier-pieces-given-up", PIECES, "sorted(found)] if earlier else []", "sorted(found)]",
        "a bound on the disk deletes the pieces of an earlier recording",
    ),
    Change(
        "no-bound", PIECES, "while self._sizes and total > self.rotation.keep_bytes:",
        "while False:",
        "a recording of weeks fills the disk",
    ),
    Change(
        "growing-piece-not-counted", PIECES, "(1 + RESERVE_SHARE) * growing", "0 * growing",
        "the disk holds a piece more than it may",
    ),
    Change(
        "numbers-begin-anew", PIECES, "self._number = max(found, default=0)", "self._number = 0",
        "a second recording of weeks ends because its first piece is there already",
    ),
    Change(
        "rest-of-a-batch-dropped", RECORDER, "columns = [column[cut:] for column in columns]",
        "columns = [column[cut + 1 :] for column in columns]",
        "the first sample of each piece is lost",
    ),
    Change(
        "drive-forgotten-between-batches", RECORDER, "self._before = samples[-1].copy()",
        "self._before = None", "the drive of the first row of each batch is missing",
    ),
    Change(
        "missed-is-another-flag", RECORDER, "int(Flag.MISSED)", "int(Flag.RANGE)",
        "missed deadlines are not in the recording",
    ),
    Change(
        "broken-line-kept", APPENDED, "os.ftruncate(self._file, self.size)", "pass",
        "a full disk leaves half a line at the end",
    ),
    Change(
        "packed-rest-not-written", ROWS,
        "            if not self._failed:\n                self._pack()",
        "            if not self._failed:\n                pass",
        "the last minutes of a .csv.gz are lost",
    ),
    Change(
        "schema-with-null", MCAP, '{"type": "number", "description": name}',
        '{"type": ["number", "null"], "description": name}',
        "Foxglove does not open the file",
    ),
    Change(
        "log-time-in-microseconds", MCAP, "np.asarray(columns[0], float) * NS",
        "np.asarray(columns[0], float) * 1e6", "the time axis in Foxglove is a thousandth",
    ),
)  # fmt: skip
