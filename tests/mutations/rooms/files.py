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
        "first-of-two-drives", f"{FOREIGN}/choose.py",
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

NUMBERS = "tests/daemon/files/test_foreign_text_numbers.py"
TABLE, GRID, TEXT = "daemon/files/csv_table.py", f"{FOREIGN}/grid.py", f"{FOREIGN}/text.py"
CHANGES += room(
    (NUMBERS,),
    Change(
        "nought-is-a-group", f"{FOREIGN}/fields.py",
        're.compile(r"[+-]?[1-9]\\d{0,2}(,',
        're.compile(r"[+-]?\\d{1,3}(,',
        "decimal commas with three decimals are read a thousand times too large",
    ),
    Change(
        "open-decimal-guessed", GRID, "    if layout.unclear:", "    if False:",
        "a decimal comma or thousands: one of the two is guessed",
    ),
    Change(
        "german-habit-forgotten", TEXT, 'habit="," if separator == ";" else ""', 'habit=""',
        "a German file of whole milliseconds is refused",
    ),
    Change(
        "thousands-points-are-decimal", TEXT,
        'decimal == "," and ("." in line or', 'decimal == "," and (',
        "1.453 nm of a German file is read as 1.453, not 1453",
    ),
    Change(
        "comment-inside-a-number", TABLE, 're.compile(r"(?m)(?:^|(?<=[ \\t]))#.*")',
        're.compile(r"#.*")', "1.#IND, which is no number, is read as 1",
    ),
    Change(
        "further-field-passed-over", TEXT, "if size > layout.most or marked", "if marked",
        "a row with a field too many is shifted, and of two joined rows one is lost",
    ),
    Change(
        "other-headings-passed-over", GRID,
        "    if known > 1 or (measured > 1 and 2 * measured > len(cells)):", "    if False:",
        "from a second line of headings on drive and displacement are exchanged",
    ),
    Change(
        "rate-in-any-unit", f"{FOREIGN}/stated_step.py",
        "return factor if kind == TIME else 0.0", "return factor",
        "an increment of 5 V is taken as a sampling period of 5 s",
    ),
    Change(
        "megahertz-lost", f"{FOREIGN}/stated_step.py", '"m": 1e6, "g": 1e9', '"m": 1.0, "g": 1e9',
        "a stated rate in MHz is a million times too low",
    ),
    Change(
        "packed-in-capitals", TABLE,
        '    opener = gzip.open if path.suffix.lower() == ".gz" else open\n    try:',
        '    opener = gzip.open if path.suffix == ".gz" else open\n    try:',
        "RUN.CSV.GZ is refused as no text",
    ),
)  # fmt: skip
CHANGES += room(
    ("tests/daemon/files/test_foreign_units.py",),
    Change(
        "unknown-unit-is-volts", f"{FOREIGN}/understand.py", "if stated and not given:",
        'if stated and not given and role != "u":', "decivolts, bars and kV/mm are read as volts",
    ),
    Change(
        "mega-is-milli", f"{FOREIGN}/units.py",
        '(plain == "mv" or not given.isupper()):', "not given.isupper():",
        "megavolts are read as millivolts",
    ),
    Change(
        "factor-in-brackets", f"{FOREIGN}/units.py",
        "if factor := next((word for word in (*others, rest) if _FACTOR.search(word)), \"\"):",
        'if factor := "":', "a drive in units of 100 V is read in volts",
    ),
    Change(
        "quotient-is-its-last-unit", f"{FOREIGN}/units.py",
        'quotient = "/" in mark and before and unit and find_unit_key(over)', 'quotient = ""',
        "a strain in um/m is read in metres",
    ),
    Change(
        "suffix-hides-a-unit", f"{FOREIGN}/units.py", 'plain = _REPEATED.sub("", text)',
        "plain = text", "the second column in mV of one name is read in volts",
    ),
    Change(
        "attribute-in-a-list", f"{FOREIGN}/libraries.py",
        "if isinstance(value, np.ndarray) and value.size == 1:", "if False:",
        "a unit that an HDF5 file holds as a list of one text is not recognised",
    ),
    Change(
        "named-channel-deleted", f"{FOREIGN}/understand.py",
        "        out[name] = np.asarray(column.values, dtype=np.float64)\n", "",
        "a channel that --columns names is missing from the recording",
    ),
    Change(
        "drive-renamed-away", f"{FOREIGN}/choose.py",
        "if channel not in NAMES and role and sure >= BY_WORD and free:", "if False:",
        "--columns makes a further channel of the only drive, without a word",
    ),
    Change(
        "two-columns-named", f"{FOREIGN}/choose.py",
        "if free and not any(columns[i].heading", "if not any(columns[i].heading",
        "a file with its own period and two columns is refused once both are named",
    ),
    Change(
        "days-are-seconds", f"{FOREIGN}/understand.py",
        "if dated or step < LEAST_STEP_S:", "if step < 0.0:",
        "times in days are read as seconds, so every rate is off by a factor of 86400",
    ),
    Change(
        "seconds-of-a-day-are-dates", f"{FOREIGN}/understand.py",
        "dated = step < DATE_STEP and any(", "dated = any(",
        "times in seconds since midnight are taken for dates",
    ),
    Change(
        "unit-of-time-passed-over", f"{FOREIGN}/understand.py",
        "if not reading.time_unit and not column.clock and (stated := _stated(column)):",
        'if stated := "":', "times in a unit that is not known are read as seconds",
    ),
    Change(
        "option-overrules-heading", f"{FOREIGN}/understand.py",
        "if usable and own != unit and (in_heading or UNITS[own][0] == UNITS[unit][0]):",
        "if False:", "a displacement in nm is written down in um with the same numbers",
    ),
    Change(
        "measured-voltage-moves", f"{FOREIGN}/choose.py",
        'roles[i] == ("y", BY_WORD) and may_be_drive(', "False and may_be_drive(",
        "the measured voltage is read as the displacement, although a column in um is there",
    ),
    Change(
        "advice-mixes-runs", f"{FOREIGN}/choose.py",
        "if all(0 < len(inside[role]) < len(of) for role, of in several.items()):", "if False:",
        "the drive of one run is advised with the displacement of another",
    ),
    Change(
        "last-columns-option-wins", f"{FOREIGN}/reading.py",
        'parse_columns(",".join(given("columns") or []))',
        'parse_columns((given("columns") or [""])[-1])',
        "of several --columns options all but the last are passed over",
    ),
)  # fmt: skip
