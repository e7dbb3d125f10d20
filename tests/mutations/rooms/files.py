"""Recordings: no row lost, nothing deleted that nobody gave up, readable elsewhere."""

from tests.mutations.change import Change, room

PIECES, RECORDER, ROWS = (f"daemon/files/{name}.py" for name in ("pieces", "recorder", "rows"))
MCAP, APPENDED = "daemon/files/mcap_file.py", "daemon/files/appended.py"

CHANGES = room(
    ("tests/daemon/files/test_recorder.py",),
    Change(
        "earlier-pieces-given-up", PIECES, "sorted(found)] if earlier else []", "sorted(found)]",
        "a limit on the disk deletes the pieces of an earlier recording",
    ),
    Change(
        "no-bound", PIECES, "while self._sizes and total > self.rotation.keep_bytes:",
        "while False:",
        "a recording of weeks fills the disk",
    ),
    Change(
        "growing-piece-not-counted", PIECES, "(1 + RESERVE_SHARE) * growing", "0 * growing",
        "the disk holds one piece more than allowed",
    ),
    Change(
        "numbers-begin-anew", PIECES, "self._number = max(found, default=0)", "self._number = 0",
        "a second long recording ends because its first piece already exists",
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
        "Foxglove cannot open the file",
    ),
    Change(
        "log-time-in-microseconds", MCAP, "np.asarray(columns[0], float) * NS",
        "np.asarray(columns[0], float) * 1e6",
        "the time axis in Foxglove is a thousand times too short",
    ),
)  # fmt: skip

OTHERS = "tests/daemon/files/test_other_programs.py"
TIMES, FOREIGN = "daemon/files/times.py", "daemon/files/foreign"
UNFINISHED = "daemon/files/unfinished.py"
CHANGES += room(
    ("tests/daemon/files/test_recorder.py",),
    Change(
        "packed-rows-held", ROWS,
        "- self._waiting_from_s >= HELD_S", "- self._waiting_from_s >= 1e9",
        "a kill costs a slow recording all of its rows",
    ),
    Change(
        "chunk-held", MCAP, "- self._held_from_s >= HELD_S", "- self._held_from_s >= 1e9",
        "a kill costs a slow recording all of its rows",
    ),
    Change(
        "deletion-unnoticed", APPENDED, "os.fstat(self._file).st_nlink == 0", "False",
        "a recording that was deleted while it was written ends as if it were complete",
    ),
    Change(
        "zero-bytes-refuse-all", UNFINISHED, 'data = data.partition(b"\\0")[0]',
        "data = data[:]", "zero bytes at its end make a whole recording unreadable",
    ),
    Change(
        "cut-line-taken", UNFINISHED, 'data = data[: data.rfind(b"\\n") + 1]', "data = data[:]",
        "a number truncated by a kill is read as a value",
    ),
)  # fmt: skip
CHANGES += room(
    ("tests/daemon/files/test_times.py",),
    Change(
        "clock-not-cut", TIMES, "back = np.flatnonzero(steps < 0.0) + 1",
        "back = np.flatnonzero(steps < -1e9) + 1",
        "two separate stretches of a recording are read as one",
    ),
    Change(
        "rounded-with-a-pause", TIMES, "0.0 < off <= OFF_THE_LINE * quantum", "0.0 < off",
        "times with a pause are spaced evenly",
    ),
    Change(
        "milliseconds-taken", TIMES, "if step > SLOW_STEP_S * (1.0 + 1e-6):", "if False:",
        "milliseconds are read as seconds, so every rate of the model is off by a factor of 1000",
    ),
)  # fmt: skip
CHANGES += room(
    (OTHERS,),
    Change(
        "unit-of-heading-lost", f"{FOREIGN}/understand.py",
        "return find_unit_key(column.unit) or split_heading(column.heading)[1]",
        "return find_unit_key(column.unit)",
        "millivolts and micrometres in a heading are not recognised",
    ),
    Change(
        "first-of-two-drives", f"{FOREIGN}/understand.py",
        "if len(found) > 1 and _all_the_same(columns, found):", "if len(found) > 1:",
        "one of two possible drive columns is guessed",
    ),
    Change(
        "displacement-unit-guessed", f"{FOREIGN}/understand.py",
        'if not unit and role == "u":', "if not unit:", "micrometres are read as volts",
    ),
    Change(
        "time-unit-guessed", f"{FOREIGN}/understand.py",
        "if not 0.0 < step < SURELY_SECONDS:", "if False:", "milliseconds are read as seconds",
    ),
    Change(
        "decimal-comma-cut", f"{FOREIGN}/text.py",
        'body = (line.replace(",", ".") for line in body)',
        'body = (line.replace(",", "") for line in body)',
        "a spreadsheet's numbers are read a thousand times too large",
    ),
    Change(
        "empty-place-refuses-all", f"{FOREIGN}/libraries.py", "if item.shape is None:", "if False:",
        "an HDF5 file with an empty dataset cannot be read",
        tests=(f"{OTHERS}::test_files_made_by_the_library",),
    ),
    Change(
        "odd-bytes-in-a-name", f"{FOREIGN}/found.py", 'return raw.decode("latin-1")',
        'return raw.decode("utf-8", "surrogateescape")',
        "a recording is read with notes that cannot be written",
        tests=(f"{OTHERS}::test_text_that_is_no_utf_8_is_kept_as_what_can_be_written",),
    ),
    Change(
        "last-words-are-the-error", f"{FOREIGN}/apart.py", "    except Exception as error:",
        "    except KeyError as error:",
        "a library's last warning is shown instead of its error",
        tests=(f"{OTHERS}::test_only_the_error_is_said_of_what_a_library_writes",),
    ),
    Change(
        "library-for-ever", f"{FOREIGN}/apart.py",
        "        system.bound_processor_time(processor_time_s(path))\n", "",
        "a damaged file of 10 KB keeps a processor busy for two minutes",
        tests=(f"{OTHERS}::test_a_small_file_does_not_keep_a_library_busy_for_long",),
    ),
    Change(
        "heading-of-several-lines", "daemon/files/loading.py",
        "column.heading, column.unit = printable(column.heading), printable(column.unit)", "pass",
        "a heading of a file breaks a message into several lines",
        tests=(f"{OTHERS}::test_a_name_of_several_lines_is_said_in_one",),
    ),
    Change(
        "name-of-several-lines", "daemon/files/loading.py",
        "        key = printable(given)\n", "        key = given\n",
        "a name in an archive breaks a message into several lines",
        tests=(f"{OTHERS}::test_a_name_of_several_lines_is_said_in_one",),
    ),
    Change(
        "line-of-a-kept-row", "daemon/files/recordings.py",
        "    missing = ~np.isfinite(loaded.columns[key])\n    if times.keep is not None:\n"
        "        missing &= times.keep\n",
        "    missing = ~np.isfinite(columns[key])\n",
        "after a duplicated row a missing target is reported with the wrong line number",
        tests=("tests/daemon/files/test_recordings.py",),
    ),
)  # fmt: skip
