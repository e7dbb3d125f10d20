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
CHOOSE, ADVISED = f"{FOREIGN}/choice/choose.py", f"{FOREIGN}/choice/advice.py"
TABLE_ROLES = f"{FOREIGN}/choice/table_roles.py"
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
        "no-time-at-all", TIMES, "if part.size == t_s.size and not np.any(rising):", "if False:",
        "for a file without times a line is named, and the rate is not asked for",
    ),
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
        "unit-of-heading-lost", f"{FOREIGN}/roles.py",
        "return find_unit_key(column.unit) or split_heading(column.heading)[1]",
        "return find_unit_key(column.unit)",
        "millivolts and micrometres in a heading are not recognised",
    ),
    Change(
        "first-of-two-drives", CHOOSE,
        "if len(found) > 1 and all_the_same(columns, found):", "if len(found) > 1:",
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
        "empty-place-refuses-all", f"{FOREIGN}/containers/libraries.py", "if item.shape is None:",
        "if False:",
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
        "words-of-a-library-are-said", f"{FOREIGN}/containers/apart.py",
        'if isinstance(error, OSError) and error.errno else ""', "or error",
        "of a damaged file an exception of a library is shown",
        tests=(f"{OTHERS}::test_nothing_is_said_of_what_a_library_writes",),
    ),
    Change(
        "library-for-ever", f"{FOREIGN}/containers/apart.py",
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

ROLES = "tests/daemon/files/test_foreign_roles.py"
CHANGES += room(
    (ROLES,),
    Change(
        "y-before-x-and-z", TABLE_ROLES, 'if "y" not in axes.values() or', "if True or",
        "of the axes x, y, z a file is read with y, whichever was driven",
    ),
    Change(
        "word-without-a-unit-wins", TABLE_ROLES,
        "if any(roles[i][0] == role and kinds[i] for i in free):", "if False:",
        "a column 'Input' of zeros is the drive, taken as volts, although another is in volts",
    ),
    Change(
        "input-of-the-instrument-drives", f"{FOREIGN}/roles.py",
        "    if side or kind == VOLTAGE:", "    if False:",
        "the sensor's voltage at the analog input is read as the drive",
    ),
    Change(
        "advice-of-another-axis", ADVISED,
        'other = others.get("y" if role == "u" else "u")', "other = None",
        "the drive of one axis is advised with the displacement of another",
    ),
    Change(
        "structures-are-one-run", CHOOSE,
        "return [*path[:-1], *fields[:-1]]", "return path[:-1]",
        "it is not said that a MATLAB file holds several runs",
    ),
    Change(
        "one-channel-for-both", CHOOSE,
        ' or (both and len(run["u"]) < 2):', ":",
        "one channel is advised as drive and as displacement, which is then refused",
    ),
    Change(
        "numbers-without-texts", CHOOSE, "column.number == wanted", "i == wanted",
        "after a column of text each number names the next column",
    ),
    Change(
        "letters-are-units", f"{FOREIGN}/units.py",
        "return after is not None and not (", "return False and not (",
        "channels A and C are amperes and degrees",
    ),
    Change(
        "two-units-one-taken", f"{FOREIGN}/understand.py",
        "if two and find_unit_key(given) not in two:", "if False:",
        "of two units that a file states for one column one is guessed",
    ),
    Change(
        "sensor-voltage-moves", "daemon/files/recordings.py",
        'if letter == "u" else MEASURED_FIRST', "if letter else MEASURED_FIRST",
        "the sensor's voltage is read as the displacement, although y_um is there",
    ),
    Change(
        "nanometres-are-micrometres", "daemon/api/functions.py",
        "None if y is None else y * factor", "y",
        "a recording in nm is compared with a model in um a thousand times too large",
        tests=("tests/daemon/commands/test_validate.py",),
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
        "further-field-passed-over", TEXT, "if size > most or marked", "if marked",
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
        "attribute-in-a-list", f"{FOREIGN}/containers/attributes.py",
        "one = isinstance(value, np.ndarray) and value.size == 1", "one = False",
        "a unit that an HDF5 file holds as a list of one text is not recognised",
    ),
    Change(
        "named-channel-deleted", f"{FOREIGN}/understand.py",
        "        draft.columns[name] = np.asarray(column.values, dtype=np.float64)\n", "",
        "a channel that --columns names is missing from the recording",
    ),
    Change(
        "drive-renamed-away", CHOOSE,
        "if channel not in NAMES and role and sure >= BY_WORD and free:", "if False:",
        "--columns makes a further channel of the only drive, without a word",
    ),
    Change(
        "two-columns-named", CHOOSE,
        "if free and not any(columns[i].heading", "if not any(columns[i].heading",
        "a file with its own period and two columns is refused once both are named",
    ),
    Change(
        "days-are-seconds", f"{FOREIGN}/understand.py",
        "if dated or (step < LEAST_STEP_S and not confirmed):", "if step < 0.0:",
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
        "measured-voltage-moves", TABLE_ROLES,
        'roles[i] == ("y", BY_WORD) and may_be_drive(', "False and may_be_drive(",
        "the measured voltage is read as the displacement, although a column in um is there",
    ),
    Change(
        "advice-mixes-runs", CHOOSE,
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

NUMPY_FILE = "daemon/files/foreign/containers/numpy_file.py"
ALSO = "daemon/files/loading.py"
CHANGES += room(
    ("tests/daemon/files/test_foreign_layouts.py",),
    Change(
        "resolution-without-its-unit", GRID, '"Sample interval", *here[1:2], *units, *here[2:]]',
        '"Sample interval", *here[1:]]', "times of an oscilloscope in ms are read as seconds",
    ),
    Change(
        "resolution-with-two-units", GRID,
        'if here[:1] == ["HResolution"] and len(units) == 1:', 'if here[:1] == ["HResolution"]:',
        "one of two contradicting units of time is used",
    ),
    Change(
        "resolution-of-one-channel", GRID, "*here[1:2], *units, *here[2:]]",
        "*here[1:2], *units]", "the times of a faster channel are those of the slowest",
    ),
    Change(
        "log-is-no-text", ALSO, '".ecsv", ".log")', '".ecsv")',
        "a log of a terminal program must be renamed before it is read",
    ),
) + room(
    ("tests/daemon/files/test_own_names.py",),
    Change(
        "heading-beside-own-time", ALSO,
        "role and role not in found and not _is_channel(name, sure)", "False and role",
        "a file with t_s and a drive in kV is converted without a word, and stays in kV",
    ),
    Change(
        "channel-is-a-drive", ALSO, "return is_axis_column(name) or (plain and (",
        "return False and (plain and (",
        "the voltage of a neighbouring axis becomes the drive",
    ),
) + room(
    ("tests/daemon/files/test_left_out_parts.py",),
    Change(
        "most-common-length", f"{FOREIGN}/containers/arrays.py",
        'return {"t", "u"} <= roles[n], len(roles[n]), counts[n] > 1, n', "return n",
        "a longer spectrum is kept, and time, drive and displacement are left out",
    ),
    Change(
        "summary-refuses-all", f"{FOREIGN}/containers/libraries.py",
        "            refused.append(error)\n            continue\n", "            raise error\n",
        "a workbook is refused because of a second sheet with a word in it",
    ),
    Change(
        "left-out-in-silence", NUMPY_FILE, "left.append(key)\n", "pass\n",
        "an array that is not read is not named",
    ),
) + room(
    ("tests/daemon/commands/test_outputs.py",),
    Change(
        "only-recordings-are-kept", "daemon/files/outputs.py",
        "if not force and path.exists() and not _is_result(path):",
        "if not force and path.exists() and path.name.endswith((\".csv\", \".npz\")):",
        "identify replaces a configuration, or the record of a set-up, without a word",
    ),
    Change(
        "notes-replaced", "daemon/files/outputs.py",
        "if not force and notes.exists() and path.name.lower().endswith(WITH_NOTES):", "if False:",
        "the notes of another recording are overwritten or deleted",
    ),
    Change(
        "results-refused-late", "daemon/commands/diagnose.py",
        "[*args.recordings, args.model], args.force)", "[*args.recordings, args.model], True)",
        "a diagnosis runs for minutes before it refuses to replace a file of another program",
    ),
    Change(
        "named-picture-is-replaced", "daemon/commands/play.py",
        "args.force or not args.picture", "True",
        "play draws its picture over a recording",
    ),
    Change(
        "results-are-kept", "daemon/files/outputs.py",
        "return MODEL_TABLE in file.read(HEAD_BYTES)", "return False",
        "identify refuses to write the model again that an earlier run wrote",
    ),
) + room(
    ("tests/daemon/commands/test_printed_commands.py",),
    Change(
        "next-command-has-blanks", "daemon/api/identification_summary.py",
        "NEXT.format(shlex.quote(str(output)))", "NEXT.format(output)",
        "the printed command cannot be typed where the model's path contains a blank",
    ),
    Change(
        "set-up-prints-blanks", "daemon/setup/steps.py",
        "return shlex.quote(str(path))", "return str(path)",
        "the commands after a set-up cannot be typed where its folder's name contains a blank",
    ),
    Change(
        "bench-command-has-blanks", "daemon/bench/emulated.py",
        'shlex.join(["dehyst", "emulate", *arguments, "--dir", str(folder)])',
        '" ".join(["dehyst", "emulate", *arguments, "--dir", str(folder)])',
        "the printed command of a bench cannot be typed where its folder contains a blank",
    ),
    Change(
        "recovery-has-blanks", "daemon/files/csv_table.py",
        'f"{shlex.quote(name)} whole.csv keeps', 'f"{name} whole.csv keeps',
        "the command that recovers a recording cannot be typed where its name contains a blank",
    ),
    Change(
        "screen-without-umlauts", "daemon/main.py",
        'stream.reconfigure(errors="backslashreplace")', 'stream.reconfigure(errors="strict")',
        "a path with an umlaut ends a command with a traceback on a screen of another encoding",
    ),
) + room(
    ("tests/daemon/commands/test_other_files.py",),
    Change(
        "gaps-unsaid", "daemon/files/given_recordings.py",
        "    say_read(recording.defects())\n    return", "    return",
        "missing values are simulated over without a word",
    ),
) + room(
    ("tests/daemon/commands/test_validate.py",),
    Change(
        "nan-in-json", "daemon/json_text.py",
        "msgspec.json.encode(value, enc_hook=_number)", "str(__import__('json').dumps(value))",
        "validate --json prints NaN, which is not JSON, or ends with a traceback",
    ),
    Change(
        "every-gauge-is-noisier", "daemon/report/validation.py",
        "v.rms > CLAIM * v.claim and not v.worse", "v.noisier > 0.0",
        "noise is said to be subtracted where it decides nothing",
    ),
) + room(
    ("tests/daemon/commands/test_simulate.py",),
    Change(
        "zero-of-the-gauge-is-error", "daemon/api/prediction.py", "float(np.std(error[known]))",
        "float(np.sqrt(np.mean(np.square(error[known]))))",
        "no figure of simulate agrees with diagnosis.json after a gauge was zeroed",
    ),
) + room(
    ("tests/models/test_modelfile.py",),
    Change(
        "missing-key-is-zero", "models/modelfile.py", "_number, ... if whole else 0.0)",
        "_number, 0.0)", "a model without its drive offset is read as one without an offset",
    ),
)  # fmt: skip

LAYOUTS = "tests/daemon/files/test_foreign_layouts.py"
LOST = "tests/daemon/files/test_lab_exports_more.py"
RUNS, HEADINGS = f"{FOREIGN}/runs.py", f"{FOREIGN}/headings.py"
CHANGES += room(
    (LAYOUTS,),
    Change(
        "bracket-is-a-name", HEADINGS, "_BLANKS.split(line))", "plain)",
        "'Time (s) u_v y_um temp_c' over four numbers is asked for, though it is plain",
    ),
    Change(
        "names-cut-to-fit", HEADINGS, "if len(cells) == size]", "if len(cells) >= size]",
        "names with blanks shift all columns by one",
    ),
    Change(
        "units-only-directly-above", HEADINGS, "LINES_ABOVE = 4", "LINES_ABOVE = 1",
        "a line of units above a line of comments is lost, and millivolts are taken as volts",
    ),
    Change(
        "preamble-is-units", HEADINGS,
        "(k == len(near) - 1 or _are_units([in_front]))", "True",
        "the units in an oscilloscope's preamble are taken for those of the columns",
    ),
    Change(
        "sparse-is-empty", GRID, "if texts[j] else 0)", "if True else 0)",
        "a displacement that is there in one of twenty rows is left out",
    ),
    Change(
        "late-is-empty", GRID, "late[j] or numbers[j] >", "numbers[j] >",
        "a displacement that begins after 2000 rows is left out",
    ),
    Change(
        "late-remark-refuses", GRID, "if value is None and layout.late[j]:", "if False:",
        "a remark in row 3000 makes a file of LabVIEW unreadable",
    ),
    Change(
        "short-rows-are-notes", RUNS, "        first -= 1\n", "        break\n",
        "rows without the last field are left out as notes",
    ),
    Change(
        "clock-with-a-comma-decides", RUNS,
        "        unclear = _unclear_point(rows[first:], width)  # a clock's comma does not decide\n"
        '        habit = ""\n',
        "        pass\n", "50.123 next to 12:00:01,250 is taken as one of two numbers",
    ),
    Change(
        "comma-elsewhere-decides", RUNS,
        'return ",", _unclear_point(rows[other[1] :], other[2])', 'return ",", ""',
        "50.123 next to 0,005 is read as 50123 V",
    ),
    Change(
        "rate-cut-by-the-separator", f"{FOREIGN}/stated_step.py",
        "if further and _REST_OF_A_NUMBER.fullmatch(further[0]):", "if False:",
        "a rate of 1,000 Hz is read as 1 Hz",
    ),
    Change(
        "first-of-two-steps", f"{FOREIGN}/stated_step.py",
        "any(value != first for value in numbers)", "False",
        "of two stated steps the first is taken",
    ),
    Change(
        "count-takes-a-heading", HEADINGS,
        'if numbers.counts and len(cells) == numbers.width - 1:\n        return ["", *cells]',
        'if numbers.counts and len(cells) == numbers.width - 1:\n        return [*cells, ""]',
        "the row numbers of R are read as the times",
    ),
    Change(
        "parameter-is-a-heading", HEADINGS, "v is None or math.isnan(v) or short for", "True for",
        "'Samples,400' names two columns",
    ),
    Change(
        "other-channels-joined", f"{FOREIGN}/lvm.py",
        "        if [(c.heading, c.unit) for c in part.columns] != [",
        "        if False and [] != [",
        "the second segment of a LabVIEW file is read with drive and displacement exchanged",
    ),
    Change(
        "segments-begin-at-0", f"{FOREIGN}/lvm.py", "times = begin + step * number_rows(",
        "times = step * number_rows(", "each segment of a LabVIEW file is a recording from 0 s",
    ),
    Change(
        "empty-rows-close-up", f"{FOREIGN}/counted.py",
        'rows + np.searchsorted(found.empty, rows, side="right")', "rows",
        "after a row of empty fields all times of a file with a stated rate are too early",
        tests=(LOST,),
    ),
    Change(
        "amperes-are-volts", f"{FOREIGN}/choice/doubts.py",
        "_text_with(_OTHER_VOLTS, notes) or _units_of_channels(notes)",
        "_text_with(_OTHER_VOLTS, notes)",
        "the current of a probe, whose unit stands above the channels, is read as volts",
        tests=(LOST,),
    ),
    Change(
        "stress-is-a-voltage", f"{FOREIGN}/roles.py",
        "electrical = [word for word in words if not _STRESS.fullmatch(word)]",
        "electrical = [*words]",
        "the tensile stress of a testing machine is read as the drive in volts",
        tests=(LOST,),
    ),
    Change(
        "a-stated-period-says-nothing", f"{FOREIGN}/understand.py",
        "confirmed = abs(step - found.step_s) <= SAME_STEP * step", "confirmed = False",
        "quick times of an oscilloscope are asked about though the file states their period",
        tests=(LOST,),
    ),
    Change(
        "afternoon-is-morning", f"{FOREIGN}/fields.py", "+ 12 * (half[4] in 'pP')", "",
        "at noon the clock of a US file goes back by half a day",
    ),
    Change(
        "epoch-as-a-float", f"{FOREIGN}/epochs.py",
        "float(int(text) - first.setdefault(j, int(text)))",
        "float(text) - float(first.setdefault(j, int(text)))",
        "times in nanoseconds since 1970 are rounded to 256 ns",
    ),
    Change(
        "damage-is-a-time", GRID, "if not is_rising(columns[j]):", "if False:",
        "damaged numbers of 16 digits are read as values",
    ),
)  # fmt: skip

BESIDE = "tests/daemon/files/test_stated_beside.py"
ADVICE, WORDS = (f"tests/daemon/files/test_foreign_{name}.py" for name in ("advice", "words"))
LIBRARIES = f"{FOREIGN}/containers/libraries.py"
ATTRIBUTES = f"{FOREIGN}/containers/attributes.py"
UNDERSTAND, FIELDS = f"{FOREIGN}/understand.py", f"{FOREIGN}/fields.py"
CHANGES += room(
    (BESIDE,),
    Change(
        "unit-over-a-column-lost", f"{FOREIGN}/lvm.py",
        'named = [(c, above.get(c.number, "")) for c in channels]', "named = []",
        "the units in LabVIEW's header are asked for where each channel has its own times",
    ),
    Change(
        "unit-beside-lost", f"{FOREIGN}/containers/arrays.py",
        "column.unit = column.unit or unit_beside(column.heading, kept)", "pass",
        "millivolts that a structure states beside its numbers are not those of the column",
    ),
    Change(
        "millivolts-elsewhere-are-volts", UNDERSTAND,
        "        if elsewhere:\n", "        if False:\n",
        "a drive in mV is read as volts, although the file says mV",
    ),
    Change(
        "packed-is-plain", ATTRIBUTES,
        "values = values * (1.0 if factor is None else factor) + (offset or 0.0)",
        "values = values * 1.0", "the counts of a packed HDF5 file are read as micrometres",
    ),
    Change(
        "fill-value-is-measured", ATTRIBUTES, "lost = np.isin(values, known)",
        "lost = np.isin(values, [])", "-9999, which stands for no value, is read as a displacement",
    ),
    Change(
        "other-factor-passed-over", f"{FOREIGN}/beside.py",
        "if (factor, offset) == (1.0, 0.0):", "if True:",
        "numbers that a scaling factor belongs to are read without it and without a word",
    ),
    Change(
        "milliseconds-of-tdms", ATTRIBUTES, "+ later, factor * float(step)",
        "+ later, float(step)", "a period of 5 ms is read as 5 s",
    ),
    Change(
        "micrometres-are-a-period", ATTRIBUTES,
        "if kind != TIME or not isinstance", "if not isinstance",
        "the increment along a path is taken as the sampling period",
    ),
    Change(
        "longest-run-taken", f"{FOREIGN}/containers/arrays.py",
        "if len(runs) > 1 and not of_wanted:", "if False:",
        "of two runs the longer is read without a word",
    ),
    Change(
        "name-of-a-list-counts", f"{FOREIGN}/roles.py", '(?=[A-Z])", " ", single)',
        '(?=[A-Z])", " ", name)', "the drive in a list named Y may be the displacement",
    ),
)  # fmt: skip
CHANGES += room(
    (ADVICE,),
    Change(
        "measuring-amplifier-drives", f"{FOREIGN}/roles.py", "if words & _MEASURES else words",
        "if False else words", "the charge amplifier of the sensor is read as the drive",
    ),
    Change(
        "times-advised-as-drive", CHOOSE,
        "steady = [i for i in free if _may_be_time(columns[i], roles[i])]", "steady = []",
        "the column of times is advised as the drive",
    ),
    Change(
        "axis-never-rises", CHOOSE, "return (not role[0] or axis) and rises_evenly(",
        "return not role[0] and rises_evenly(", "a time with the name x is advised as the drive",
    ),
    Change(
        "row-numbers-advised-as-times", ADVISED,
        "rising = [i for i in steady if not counts_up(columns[i].values)]", "rising = list(steady)",
        "row numbers are advised as the times",
    ),
    Change(
        "drive-advised-as-times", ADVISED, "times = rising[:1] if", "times = list(free[:1]) if",
        "the first column is advised as the times, whatever it holds",
    ),
    Change(
        "one-column-advised-twice", CHOOSE,
        "others = [i for i in found if i not in advised.values()]", "others = list(found)",
        "one column is advised as drive and as displacement, which is then refused",
    ),
    Change(
        "drive-in-percent-unnamed", ADVISED, "roles[i][0]] or may or named",
        "roles[i][0]] or may", "the only drive of a file is not named in the advice",
    ),
    Change(
        "newest-first-cut", TIMES, "if back.size > REVERSED * steps.size:", "if False:",
        "it is not said that the rows of a file are in reverse order",
    ),
    Change(
        "unsorted-cut", TIMES, "if back.size > UNSORTED * steps.size:", "if False:",
        "rows in no order are cut into recordings of two rows",
    ),
    Change(
        "labels-far-above-lost", HEADINGS,
        "return [*(further if numbers.first_empty else []), *rows[-LINES_ABOVE:]]",
        "return [*rows[-LINES_ABOVE:]]", "the date in a file of Yokogawa becomes a heading",
    ),
    Change(
        "preamble-beside-loses-rows", RUNS, "k == TEXT and not noted[j] and j + 1 in sure",
        "k == TEXT and not noted[j]", "the first rows beside a preamble are lost",
    ),
)  # fmt: skip
CHANGES += room(
    (WORDS,),
    Change(
        "over-range-refuses", TABLE, '"over", "overflow",', '"overflow",',
        "a file with a value beyond the range cannot be read",
    ),
    Change(
        "scpi-nothing-is-a-value", TABLE, "|9[.,]91?0*e\\+?37)", ")",
        "9.91E+37, which stands for no value, makes a file unreadable",
        tests=("tests/daemon/files/test_recordings.py",),
    ),
    Change(
        "infinity-refuses", ALSO, "        column.values = _finite(column.values)\n", "",
        "a division by zero in a file of another program makes it unreadable",
    ),
    Change(
        "thousands-are-fields", TEXT,
        'and not (best[1] == "\\t" and not one and _only_groups(best_rows))', "",
        "7 875.4 between tabs is read as 7",
    ),
    Change(
        "exponent-of-fortran", FIELDS, "([ed][+-]?\\d+)?", "(e[+-]?\\d+)?",
        "a file of Fortran cannot be read",
    ),
    Change(
        "typographic-minus", FIELDS, "[-+\\u2212", "[-+",
        "negative numbers of a word processor make a file unreadable",
    ),
    Change(
        "angstroms-are-nanometres", f"{FOREIGN}/units.py", '"angstrom": (LENGTH, "nm", 0.1)',
        '"angstrom": (LENGTH, "nm", 1.0)', "a displacement in angstroms is ten times too large",
    ),
    Change(
        "month-is-13", FIELDS, "key=lambda n: n > 12", "key=lambda n: False",
        "dates with the day in front are no times",
    ),
    Change(
        "pause-of-a-month", UNDERSTAND, "if column.clock and np.any(jumps > LONGEST_PAUSE_S):",
        "if False:", "at midnight of 5 March a file pauses until 6 March read as 3 June",
    ),
    Change(
        "increment-in-volts-is-a-period", f"{FOREIGN}/stated_step.py",
        'if step and not units and (value >= SURELY_SECONDS or name.lower() == "increment"):',
        "if False:", "the increment of a sweep in volts is the sampling period",
    ),
    Change(
        "first-of-two-periods", GRID,
        "max(stated) <= (1.0 + SAME_STEP) * min(stated)", "True",
        "of two periods that contradict each other the first is taken",
    ),
    Change(
        "marked-rows-uncounted", TEXT, "marked.append(i)", "pass",
        "rows behind a comment mark are left out without a word",
    ),
    Change(
        "suffix-unsaid", ALSO, "if right and kind in TEXTS:", "if False:",
        "a spreadsheet that is named .csv is refused as damaged text",
    ),
)  # fmt: skip
NAMED, ODD = (f"tests/daemon/files/test_{name}.py" for name in ("named_beside", "odd_habits"))
BESIDE_ARRAYS, EPOCHS, STATED = (
    f"{FOREIGN}/{name}.py" for name in ("beside", "epochs", "stated_step")
)
CHANGES += room(
    (NAMED,),
    Change(
        "any-list-names-the-columns", BESIDE_ARRAYS,
        "return best[0] if best and all(texts == best[0] for texts in best) else ()",
        "return best[0] if best else ()",
        "of two lists of names one is taken, though neither belongs to the array",
    ),
    Change(
        "list-of-units-lost", BESIDE_ARRAYS,
        "for column, unit in zip(columns, units, strict=False):",
        "for column, unit in zip(columns, (), strict=False):",
        "millivolts in a list of units beside a matrix are taken for volts",
    ),
    Change(
        "any-list-is-one-of-names", BESIDE_ARRAYS, "if _LISTS_NAMES.match(k) and", "if",
        "a list of plots in another order names the columns",
    ),
    Change(
        "label-over-a-name", BESIDE_ARRAYS, '    if role_of(heading, "")[0]:\n', "    if False:\n",
        "a displacement with a remark on the drive is the drive",
    ),
    Change(
        "list-of-another-block", BESIDE_ARRAYS,
        "if alike[key] == max(alike.values())]", "]",
        "a table of pandas with two blocks is asked for by number",
    ),
    Change(
        "units-by-name-lost", BESIDE_ARRAYS, 'if unit := notes.get(group + name, ""):', "if False:",
        "millivolts that 'drive_unit' states are read as volts",
    ),
    Change(
        "remarks-of-attributes-lost", LIBRARIES,
        "notes.update(remarks(f\"{name}{'/' if whole else '.'}\", item.attrs))", "pass",
        "a drive is read as volts, although its own comment says mV",
    ),
    Change(
        "port-is-the-name", BESIDE_ARRAYS, "if part and not _PORT.fullmatch(part)]", "if part]",
        "the signals of a block diagram are all named Out1",
    ),
    Change(
        "first-of-two-rates", BESIDE_ARRAYS,
        "if steps and max(steps) <= (1.0 + SAME_STEP) * min(steps)", "if steps",
        "of two rates that contradict each other the first is taken",
    ),
    Change(
        "objects-are-numbers", LIBRARIES,
        'if "MATLAB_object_decode" in item.attrs and kind not in ("", "function_handle"):',
        "if False:", "the inner numbers of a timeseries are read as a recording of six rows",
    ),
    Change(
        "references-left-out", LIBRARIES,
        "if item.size <= MOST_WIDE and deep < MOST_DEEP:", "if False:",
        "cells and arrays of structures of MATLAB 7.3 are left out without a word",
    ),
    Change(
        "unit-of-a-field-lost", LIBRARIES, "yield Given(name, values, unit_in(beside))",
        "yield Given(name, values)", "millivolts in the metadata of a table are taken for volts",
    ),
    Change(
        "rate-in-a-comment-unread", STATED, "if mark else 0.0)", "if False else 0.0)",
        "'# fs = 200 Hz' is not the rate of the rows",
    ),
    Change(
        "second-line-of-a-preamble-lost", f"{FOREIGN}/runs.py",
        " if key in notes else key]", " if False else key]",
        "of two comments that begin alike the first is lost, and with it the unit in it",
    ),
)  # fmt: skip
CHANGES += room(
    (ODD,),
    Change(
        "inner-name-said", ALSO, ".replace(inner.name, path.name)", "",
        "what is wrong in a packed file is said of a file that nobody knows",
    ),
    Change(
        "bomb-unpacked", f"{FOREIGN}/containers/packed.py", "            if left < 0:\n",
        "            if False:\n", "a small file fills the disk",
    ),
    Change(
        "midnight-cuts", EPOCHS, "(TURNS_S if clock else ())", "()",
        "a recording over midnight is two recordings",
    ),
    Change(
        "overflow-cuts", EPOCHS, "(TURNS if whole and not clock else ())", "()",
        "a recording in which a counter overflows is two recordings",
    ),
    Change(
        "recordings-of-65536-rows-joined", EPOCHS,
        " and not np.any(values[back + 1] == values[0])", "",
        "two recordings of 65536 rows are one",
    ),
    Change(
        "any-fall-continued", EPOCHS, "(across >= 0.0) & (across <= longest)", "across >= 0.0",
        "a recorder that was started again is continued as if nothing had been lost",
    ),
    Change(
        "cut-line-is-a-row", TEXT,
        "if before and _is_cut(split(lines[-1]), [*map(split, before)], decimal) else 0",
        "if False else 0", "a file whose last line was cut is refused",
    ),
    Change(
        "nines-measured", f"{FOREIGN}/no_value.py",
        "if number in ENDS or NINES.fullmatch(repr(number)):",
        "if False:", "-9999, which stands for no value, is a displacement",
    ),
    Change(
        "end-of-range-is-none", f"{FOREIGN}/no_value.py", "> APART * span", "> 0.0",
        "a gauge at the end of its range has no values there",
    ),
    Change(
        "own-numbers-replaced", ALSO, "loaded.said = \"; \".join(remarks)",
        "loaded.columns = {k: np.where(_no_values(k, v)[0], np.nan, v) "
        "for k, v in loaded.columns.items()}",
        "a recording of dehyst's own does not come back to the bit",
    ),
    Change(
        "affixes-differ", f"{FOREIGN}/affixes.py", "if len(alike) > 1 or (plain", "if (plain",
        "nanometres among micrometres are read as micrometres",
    ),
    Change(
        "rates-of-their-own", f"{FOREIGN}/containers/arrays.py",
        "if len({c.values.size for c in needed}) > 1 and (named or not runs):", "if False:",
        "it is advised to name a column that is of another rate",
    ),
    Change(
        "one-channel-asked-for-twice", ADVISED,
        "if len(left) - len(counters) >= len(roles):", "if True:",
        "it is advised to name a displacement in a file that holds none",
    ),
    Change(
        "times-apart-unsaid", CHOOSE, 'if role == "t" else ""', 'if False else ""',
        "drive and displacement of different times are paired row by row",
    ),
    Change(
        "constant-advised-as-drive", ADVISED,
        "may = [i for i in may if moves(columns[i])] or may",
        "pass", "a column that stands still is advised as the drive",
    ),
    Change(
        "long-heading-takes-seconds", f"{FOREIGN}/roles.py",
        "[: LONGEST_HEADING + 1]  # matching takes its square", "",
        "a damaged file of 7 KB keeps a command busy for 8 s",
    ),
    Change(
        "cut-row-is-all", TEXT, "cut if before and _is_cut", "cut if cut and _is_cut",
        "a file of one row that was cut ends a command with a traceback",
    ),
    Change(
        "large-number-ends-the-reader", f"{FOREIGN}/containers/arrays.py",
        "except (TypeError, ValueError, OverflowError):", "except (TypeError, ValueError):",
        "a serial number of 400 digits makes a file unreadable",
    ),
    Change(
        "unit-of-each-row-lost", GRID, "found.units[j - 1] = found.units[j - 1] or unit", "pass",
        "millivolts that stand behind each value are read as volts",
    ),
    Change(
        "unit-changes-unseen", GRID, "if j < size and str(row[j]).strip() != unit:", "if False:",
        "values of an instrument that changed its range are off by a thousand",
    ),
    Change(
        "units-of-matlab-unread", f"{FOREIGN}/units.py", 'plain = plain.rstrip("_.") or plain',
        "pass", "'Voltage_mV_' is read as volts",
    ),
    Change(
        "announced-units-unread", HEADINGS,
        'return [_ANNOUNCED.sub("", cell) for cell in cells[:1]] + cells[1:]', "return cells",
        "'# units: s,mV,um' is not read",
    ),
    Change(
        "unclosed-quote-joins", TEXT,
        "if sum(line.count('\"') for line in lines[i : i + MOST_BROKEN]) % 2:", "if False:",
        "a quote that nothing closes makes one line of the first rows",
    ),
    Change(
        "title-is-names", TEXT,
        'return [form for form in forms if sum(bool(role_of(cell, "")[0]) for cell in form) > 1]',
        "return forms", "a title with two commas names three columns",
    ),
    Change(
        "kinds-are-names", HEADINGS, "(labelled(k), of[k], k)", "(labelled(k), k)",
        "a line of kinds below the names is taken for them, and millivolts for volts",
    ),
    Change(
        "remark-behind-refuses", TEXT, '" #" in lines[i].strip():', "False:",
        "a remark behind the numbers of one line makes a file unreadable",
    ),
    Change(
        "kilovolts-of-counts", UNDERSTAND, "if highest > MOST_VOLTS:", "if False:",
        "millivolts or counts under no unit are read as up to 90000 V",
    ),
    Change(
        "velocity-drives", TABLE_ROLES,
        "    roles |= dict.fromkeys(_velocities(columns, free), (\"\", 0))\n", "",
        "the velocity of 't, x, v' is read as volts",
    ),
    Change(
        "falling-time", TABLE_ROLES,
        'roles |= dict.fromkeys(falling, ("", 0))', "pass",
        "the displacement s cannot be named, as it is taken for seconds",
    ),
    Change(
        "set-point-never-drives", CHOOSE, "if role in wants or role in reading.columns}", "}",
        "of a set-point and a position it is said that a column is missing",
    ),
    Change(
        "units-beside-an-empty-column-lost", HEADINGS,
        "if numbers.first_empty and cells[0] and _are_units(cells[1:])",
        "if numbers.first_empty and _are_units(cells[1:])",
        "the units of a table that begins in column C are lost, and its millivolts are volts",
    ),
)  # fmt: skip
CHANGES += [
    *room(
        ("tests/daemon/files/test_axis_columns.py",),
        Change(
            "axis-alone-keeps-its-unit", "daemon/api/functions.py",
            "    if factor in (None, 1.0):\n",
            "    if factor in (None, 1.0) or one.displacement is None:\n",
            "an axis in um moves a model in nm by a thousandth",
        ),
    ),
    *room(
        ("tests/daemon/api/test_functions.py",),
        Change(
            "model-in-use-gets-other-recordings", "daemon/api/results.py",
            "        if model.provenance.created and model == self.details.base_model:\n",
            "        if False:\n",
            "a model states recordings that it was never fitted to",
        ),
    ),
]  # fmt: skip
SCALES = "tests/daemon/files/test_stated_scales.py"
UNDERSTAND, STEP = f"{FOREIGN}/understand.py", f"{FOREIGN}/stated_step.py"
CHANGES += room(
    (SCALES,),
    Change(
        "clock-in-the-unit-of-its-heading", UNDERSTAND,
        "    if column.clock:  # converted", "    if column.clock and not unit:  # converted",
        "a clock under `Time (min)` makes every rate of the model wrong by 60",
    ),
    Change(
        "columns-of-a-clock-apart", UNDERSTAND,
        "        columns = join_clocks(columns)", "        pass",
        "hours, minutes and seconds in columns of their own are no time, whatever is named",
    ),
    Change(
        "one-time-in-two-units-is-added", f"{FOREIGN}/epochs.py",
        "if not (whole and np.all((v >= 0.0) & (v < most))):", "if False:",
        "seconds and the same in milliseconds add to twice the time",
    ),
    Change(
        "packed-clock-taken", f"{FOREIGN}/epochs.py", "return bool(in_turn and short and",
        "return bool(False and", "140759 is followed by a pause of 40 seconds at each minute",
    ),
    Change(
        "unit-beside-a-rate-lost", f"{FOREIGN}/beside.py",
        "value, *filter(None, [_own_unit(name, notes)])]", "value]",
        "a rate of 1 kHz is read as 1 Hz",
    ),
    Change(
        "unit-below-a-rate-lost", f"{FOREIGN}/grid.py", "            here.append(below[1])",
        "            pass", "a rate of 1 kHz in a preamble is read as 1 Hz",
    ),
    Change(
        "lines-of-a-microscope-are-rows", STEP,
        'if rate and name.lower().startswith("scan") and scaled * SURELY_SECONDS < 1.0:',
        "if False:", "a line rate of 1 Hz is read as the rate of the rows",
    ),
    Change(
        "time-unit-without-times-taken", f"{FOREIGN}/counted.py",
        "elif reading.time_unit and step_s > 0.0:", "elif False:",
        "--time-unit is accepted and does nothing",
    ),
    Change(
        "factor-in-a-name-lost", f"{FOREIGN}/units.py",
        "if factor := _factor_beside(plain):", "if factor := None:",
        "U/10 V is read as volts, and the gain is wrong by ten",
    ),
    Change(
        "factor-beside-numbers-lost", f"{FOREIGN}/containers/arrays.py",
        'column.unit = f"{column.unit}{factor}".strip()', "pass",
        "volts at a monitor are read as those of the stage",
    ),
    Change(
        "monitor-drives", f"{FOREIGN}/roles.py",
        "if words & _MONITOR and (driven or voltage) and not sensed:", "if False:",
        "a monitor's fifteenth is taken for the voltage, and the gain is wrong by 15",
    ),
    Change(
        "rows-written-twice-are-rows", TIMES,
        "if all(same_row(begin + int(row)) for row in repeated):", "if repeated.size < 9:",
        "a logger that writes each row twice doubles every rate",
    ),
    Change(
        "unit-of-a-signal-on-its-times", f"{FOREIGN}/beside.py",
        'if role_of(heading[len(group_of(heading)) :], "")[0] == "t":', "if False:",
        "the times of a MATLAB timeseries are volts",
    ),
)  # fmt: skip

EXPORTS = "tests/daemon/files/test_lab_exports_more.py"
CHANGES += room(
    (EXPORTS,),
    Change(
        "remarks-between-numbers-lost", GRID, "keep_note(layout.remarks, row, place)", "pass",
        "a gain or a unit that stands below the numbers is passed over",
    ),
    Change(
        "notes-below-a-sheet-lost", LIBRARIES, "layout.remarks = notes", "pass",
        "a gain below the numbers of a spreadsheet is passed over",
    ),
    Change(
        "factor-in-own-words-lost", f"{FOREIGN}/beside.py",
        "if not found and not _REPEATED.search(text):", "if False:",
        "the input of an amplifier of 15 is read as its output",
    ),
    Change(
        "stroke-is-a-factor", f"{FOREIGN}/beside.py", r"(?:10|\d)(?:\.\d+)? ?", r"\d+(?:\.\d+)? ?",
        "a file that states the stroke of its stage is refused",
    ),
    Change(
        "factor-before-the-name", f"{FOREIGN}/beside.py",
        "names_signal(text[: behind.start()])", "names_signal(text)",
        "a file that states the microscope's objective is refused",
    ),
    Change(
        "line-of-factors-is-a-note", f"{FOREIGN}/beside.py",
        "(?:[\\s,;]+|\\Z))+\\Z", "(?:[\\s,;]+|\\Z))+(?!)",
        "factors between the names and the numbers are passed over",
    ),
    Change(
        "repetitions-are-factors", f"{FOREIGN}/beside.py", " and not _REPEATED.search(text):", ":",
        "each file that says how often it was averaged is asked about",
    ),
    Change(
        "gain-in-a-heading-lost", f"{FOREIGN}/units.py", "(?:gain|factor)[", "(?!)[",
        "a gain of 15 in a heading is passed over",
    ),
    Change(
        "table-of-words-refused", TEXT, "                if emptied is not None:".strip(),
        "if False:", "a table with a status beside each channel holds no numbers",
    ),
    Change(
        "set-point-of-drive-is-target", f"{FOREIGN}/roles.py",
        'and kind in (LENGTH, ANGLE, "") and not of_drive:', 'and kind in (LENGTH, ANGLE, ""):',
        "volts are read as the wanted displacement",
    ),
    Change(
        "length-advised-as-drive", f"{FOREIGN}/choice/advice.py",
        'if role == "y" else (VOLTAGE,))', 'if role == "y" else (LENGTH,))',
        "the advised drive is a commanded position",
    ),
    Change(
        "fields-called-formulas", f"{FOREIGN}/blank.py",
        "text = found.blank[blank[0]][:20]", 'text = ""',
        "who wrote a unit into each field is advised to look for formulas",
    ),
    Change(
        "marks-are-words", TABLE, 'not lower.strip("*-+._?")', 'not lower.strip("*")',
        "what a display shows for no value refuses the file",
    ),
    Change(
        "dash-is-no-sign", f"{FOREIGN}/fields.py", "\\u2010\\u2011\\u2013", "\\u2011",
        "numbers with a dash as their sign refuse the file",
    ),
    Change(
        "invalid-rows-unsaid", ALSO, "[*found.said, *note_marked(found.columns)]", "found.said",
        "rows that the file calls invalid are taken without a word",
    ),
    Change(
        "samples-are-columns", f"{FOREIGN}/choice/choose.py",
        "if len(columns) > SAMPLES_OF * rows:", "if False:",
        "a file that is to be transposed is asked which of its samples is the drive",
    ),
    Change(
        "labels-name-columns", HEADINGS, "if len(ends) == 1]", "if ends]",
        "a label with its value names three columns",
    ),
    Change(
        "name-over-words-not-counted", HEADINGS, "numbers.counts, *of_words]:", "numbers.counts]:",
        "a word behind the last number takes the names away",
    ),
    Change(
        "known-unit-called-unknown", UNDERSTAND,
        '"may be a label" if find_unit_key(stated) else "is not a known unit of time"',
        '"is not a known unit of time"',
        "ms is said to be no known unit of time",
    ),
    Change(
        "exponent-is-a-factor", f"{FOREIGN}/beside.py", "[.,]\\d+)?(?:e[-+]?\\d+)?", "[.,]\\d+)?",
        "a gain of 1.0E+00 is asked about",
    ),
    Change(
        "percent-not-advised", f"{FOREIGN}/roles.py", '_DRIVE | _VOLTAGE if role == "u"',
        '_DRIVE if role == "u"', "a voltage in percent is asked for without its name",
    ),
    Change(
        "rates-of-channels-are-thousands", f"{FOREIGN}/counted.py",
        "{number_of(part) for part in text.split()}", "{number_of(text)}",
        "one rate of 500 Hz for each of two channels is 500500 Hz",
    ),
    Change(
        "wrapped-displacement-unsaid", ALSO,
        "if wrapped := note_wrapped(loaded.columns):", 'if wrapped := "":',
        "a counter that overflows is taken for a stage that jumps",
    ),
    Change(
        "friction-is-wrapped", f"{FOREIGN}/no_value.py", "if not np.all(on & still):",
        "if not np.all(still):", "a loop of friction is to be unwrapped",
    ),
    Change(
        "truth-values-left-out", f"{FOREIGN}/fields.py", "if text.lower() in TRUTHS:", "if False:",
        "rows that pandas marks as invalid are taken without a word",
    ),
    Change(
        "truth-values-refused", ALSO, "all(numbers) and not truths", "all(numbers)",
        "a recording with a column of truth values is refused",
    ),
    Change(
        "units-in-fields-lost", GRID, 'f"{other} and {unit}" if other else unit', "other",
        "drive of millivolts in each field is read as volts",
    ),
    Change(
        "several-units-in-a-column", f"{FOREIGN}/affixes.py",
        'or set(of) - {"", unit}:', "or False:",
        "a column in several units is refused by the line of one, not as a whole",
    ),
    Change(
        "unit-names-a-signal", f"{FOREIGN}/roles.py", '{"amp", "piezo"}) - {"v"})',
        '{"amp", "piezo"}))', "an attenuator in the settings of a device is asked about",
    ),
    Change(
        "names-with-commas-are-unclear", HEADINGS,
        "most = max(map(_known, fitting), default=0)", "most = 0",
        "names that hold commas are not found between blanks",
    ),
    Change(
        "fitted-slope-is-a-factor", f"{FOREIGN}/runs.py",
        "or _OF_LINE.match(str(_first_of(row)).strip())", "",
        "a slope that a spreadsheet calculated is asked about",
    ),
    Change(
        "factor-below-yields", GRID, 'notes[f"{key} (again)" if key in notes else key] = text',
        "notes.setdefault(key, text)", "a gain of 1 above the numbers hides one of 15 below",
    ),
)  # fmt: skip

STATED = f"{FOREIGN}/stated_step.py"
CHANGES += room(
    ("tests/daemon/files/test_digits_and_marks.py",),
    Change(
        "labview-step-not-kept", f"{FOREIGN}/lvm.py", "part.step_s = step\n", "pass\n",
        "times that LabVIEW rounded to a millisecond give a rate that is off by their last digit",
    ),
    Change(
        "segments-lose-the-step", f"{FOREIGN}/lvm.py",
        "step_s = steps.pop() if len(steps) == 1 else 0.0", "step_s = 0.0",
        "the step that LabVIEW states is forgotten where segments are joined",
    ),
    Change(
        "counted-times-unsaid", f"{FOREIGN}/counted.py",
        "        if digit:\n", "        if False:\n",
        "times are replaced by those of the stated period without a word",
    ),
    Change(
        "stated-period-wins-over-the-times", STATED, "if least > most + UNEVEN * digit:",
        "if False:", "a period that is not that of the times replaces them",
    ),
    Change(
        "pause-counted-over", STATED, "> digit * (1.0 + UNEVEN)) + 1", "> np.inf) + 1",
        "rounded times with a pause are not counted from the stated period",
    ),
    Change(
        "last-digit-of-the-first-times", STATED, "np.sort(np.abs(values))[-MOST_LOOKED_AT:]",
        "np.abs(values)[:1]", "times that begin at -0.1 s seem rounded to 0.1 s",
    ),
    Change(
        "repeated-times-have-a-usual-step", f"{FOREIGN}/counted.py",
        "return mean if repeated else float", "return float",
        "a stated step against times that are rounded to it is not said",
    ),
    Change(
        "words-in-brackets-are-labview-units", f"{FOREIGN}/lvm.py",
        '"" if own and known in ("", own) else unit',
        '"" if own or read_heading(column.heading).stated else unit',
        "'Voltage (DC)' is asked for its unit, which the header states; mV against V is not",
    ),
    Change(
        "advised-unit-is-not-taken", f"{FOREIGN}/understand.py",
        "for one in two if _is_kept(one))", "for one in two if one in UNITS)",
        "an option is advised that the command line refuses",
    ),
    Change(
        "decimal-commas-between-commas", f"{FOREIGN}/text.py",
        'if separator == "," and not any(', "if False and not any(",
        "23,42,12 is read as three numbers where two were written",
    ),
    Change(
        "zeros-behind-a-comma", f"{FOREIGN}/runs.py",
        "elif whole and (padded := _padded(body, most)):", 'elif whole and (padded := ""):',
        "decimals are read as a column of their own where there are as many headings",
    ),
    Change(
        "fields-without-headings", f"{FOREIGN}/runs.py", "if named and known and 2 * over",
        "if False and 2 * over", "four fields below three headings are read as row numbers first",
    ),
    Change(
        "lines-of-two-lengths", f"{FOREIGN}/runs.py", "elif whole and len(uneven) > 1:",
        "elif False:", "whole volts move the displacement to the column of the drive",
    ),
    Change(
        "numbers-for-comments", f"{FOREIGN}/runs.py", "    elif whole and noted:\n",
        "    elif False:\n", "decimals push the displacement under the heading of the comments",
    ),
    Change(
        "commas-unsaid", f"{FOREIGN}/runs.py", "if any(headings) or not whole or most < 3:",
        "if True:", "23,42,12 without headings is read as three numbers without a word",
    ),
    Change(
        "commas-not-in-the-question", "daemon/files/loading.py",
        'if "left out" in text or "taken for sep" in text', 'if "left out" in text',
        "who is asked for the columns does not learn that commas may be decimal marks",
    ),
    Change(
        "several-marks-unsaid", f"{FOREIGN}/fields.py",
        "found = _SEVERAL_MARKS.fullmatch(text)", "found = None",
        "23.42.12 is said to be no number, and not why",
    ),
    Change(
        "counter-advised", ADVISED,
        "    may = [i for i in may if not counts_samples(columns[i].values)]\n", "",
        "a count of the samples is advised as the displacement",
    ),
    Change(
        "counter-is-a-column-left", ADVISED,
        "if len(left) - len(counters) >= len(roles):", "if len(left) >= len(roles):",
        "a count of the samples is offered as the displacement that a file lacks",
    ),
    Change(
        "counter-advised-by-number", ADVISED,
        "rest = [i for i in free if i not in (*others, *times, *counters)]",
        "rest = [i for i in free if i not in (*others, *times)]",
        "a count of the samples is advised as the displacement of a file without headings",
    ),
    Change(
        "counter-among-several", CHOOSE,
        "moving = [i for i in moving if not counts_samples(columns[i].values)]", "pass",
        "of a count and a reading the count is advised as the displacement",
    ),
    Change(
        "counter-not-called-one", ADVISED,
        "return f\"; {_only_count(columns, counters)}\" if counters else \"\"", 'return ""',
        "nobody learns that a column only counts the samples",
    ),
    Change(
        "gaps-are-readings", f"{FOREIGN}/epochs.py", "COUNTED_SHARE = 0.9", "COUNTED_SHARE = 1.0",
        "a counter that lost a sample is advised as the displacement",
    ),
    Change(
        "scope-sources-not-names", f"{FOREIGN}/paired.py", "    _name_sources(lines)\n", "",
        "the columns of a GW Instek are called Mode and Detail",
    ),
    Change(
        "scope-mode-ignored", f"{FOREIGN}/paired.py",
        'ways = [] if mode == "detail" else [names]', "ways = [names]",
        "the times of one channel are called by the name of another",
    ),
    Change(
        "scope-period-lost", f"{FOREIGN}/paired.py",
        'lines[place["Memory Length"]] = lines[first - 1]',
        'lines[place["Sampling Period"]] = lines[first - 1]',
        "the rate of a GW Instek is asked for although it states its period",
    ),
    Change(
        "units-of-a-preamble-lost", GRID, "add_units(found, [row for _, row in left])", "pass",
        "units far above the names are asked for",
    ),
    Change(
        "units-of-a-preamble-yield", HEADINGS,
        'found.units[j] = f"{there} and {unit}" if there else unit',
        "found.units[j] = there or unit",
        "of two units that a file states for a column one is taken without a word",
    ),
    Change(
        "unit-of-the-line-above", HEADINGS, "several = len(units) > 1 ", "several = True ",
        "the unit of a setting becomes that of the only channel",
    ),
    Change(
        "one-unit-for-the-first-column", HEADINGS,
        'if len(cells) == 1 and _OF_COLUMNS.fullmatch(re.split(r"\\s*[:=]", cells[0])[0]):',
        "if False:", "a unit that a comment states alone becomes that of the times",
        tests=("tests/daemon/files/test_lab_exports.py",),
    ),
    Change(
        "underscores-are-digits", "daemon/files/csv_table.py",
        'if "_" in text:', "if False:",
        "a field of 1_000 in a recording is read as 1000",
    ),
    Change(
        "units-of-ecsv-lost", HEADINGS, 'if own := _OF_ECSV.search(" ".join(cells)):',
        'if own := "":', "the units that astropy writes above its columns are asked for",
    ),
    Change(
        "hexadecimal-unsaid", f"{FOREIGN}/fields.py",
        'return "; it may be hexadecimal: write it in decimal digits"', 'return ""',
        "a hexadecimal field is said to be no number, and not why",
    ),
)  # fmt: skip
