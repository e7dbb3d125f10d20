"""Files of other programs: what they do not say plainly is asked for, not guessed."""

from tests.mutations.change import Change, room

FOREIGN = "daemon/files/foreign"
CHOOSE, ADVICE = f"{FOREIGN}/choice/choose.py", f"{FOREIGN}/choice/advice.py"
UNITS, TEXT = f"{FOREIGN}/units.py", f"{FOREIGN}/text.py"

CHANGES = room(
    ("tests/daemon/files/test_not_said_plainly.py",),
    Change(
        "cut-number-is-a-number", TEXT, "    return len(last) < len(before[-1]) or short\n",
        "    return len(last) < len(before[-1])\n",
        "the last displacement of a killed logger is 15 instead of 15.97 um",
    ),
    Change(
        "cut-number-in-own-form", "daemon/files/csv_table.py",
        'if not text.endswith("\\n") and _is_cut(text, before):', "if False:",
        "the last displacement of a killed recorder is wrong",
    ),
    Change(
        "lost-samples-are-no-gap", f"{FOREIGN}/counted.py",
        "rows = count if heading else", "rows = count if False else",
        "a second of lost samples is cut out of the times, and every rate across it is wrong",
    ),
    Change(
        "decimated-at-the-rate-of-the-converter", f"{FOREIGN}/counted.py",
        "elif step_s > 0.0 and note:", "elif False:",
        "500 rows a second are read as 5000",
    ),
    Change(
        "unit-left-in-a-heading", UNITS, '    return Heading(text, "", _left_over(plain))',
        "    return Heading(text)", "kilovolts are taken as volts",
    ),
    Change(
        "unit-of-another-script", UNITS,
        "given = _OTHER_SCRIPTS.get(given, given)", "pass",
        "a heading in Russian asks for the unit that it states",
    ),
    Change(
        "gain-in-words-lost", f"{FOREIGN}/understand.py",
        "    if found.factor:\n", "    if False:\n",
        "the input of an amplifier is read as the voltage of the stage",
    ),
    Change(
        "heading-that-a-shell-changes", ADVICE,
        'not re.search(r"[\\"$`\\\\!,]", heading)', "'\"' not in heading",
        "the option that a message advises is refused, or names another column",
    ),
    Change(
        "expected-is-measured", f"{FOREIGN}/roles.py",
        '"alarm", "expected", "nominal",', '"alarm",',
        "the expected position is advised as the measured one",
    ),
    Change(
        "still-drive-advised", CHOOSE,
        "found = moving if len(moving) > both else found", "pass",
        "a bias that stands still is advised as the drive",
    ),
    Change(
        "channels-in-turn-are-rows", f"{FOREIGN}/grid.py",
        "    refuse_long(name, rows[first:], numeric, found.headings)\n", "",
        "drive and displacement in turn are written down as one recording",
    ),
    Change(
        "channel-in-a-word-unseen", f"{FOREIGN}/long.py",
        "if in_turn or (valued and", "if in_turn or (False and",
        "an export with one value a row is advised to take the number of its table as the drive",
    ),
    Change(
        "own-columns-are-one-value-a-row", f"{FOREIGN}/long.py",
        'valued = not {"u", "y"} <= own and', "valued =",
        "a recording with a word that moves in each row is refused",
    ),
    Change(
        "annotations-are-numbers", f"{FOREIGN}/grid.py",
        "    rows = without_annotations(name, rows)\n", "",
        "InfluxDB's export is advised to take the number of its table as the drive",
    ),
    Change(
        "channels-below-each-other-are-parts", "daemon/files/times.py",
        "if np.array_equal(first, second) and first[0] > np.ptp(first):", "if False:",
        "drive and displacement of one export are two recordings",
    ),
    Change(
        "milliseconds-of-a-clock-lost", f"{FOREIGN}/epochs.py",
        'unit := "s" if c.clock else find_unit_key', 'unit := "" if c.clock else find_unit_key',
        "a clock of whole seconds with its milliseconds in a column is refused",
    ),
    Change(
        "scale-of-twincat-lost", f"{FOREIGN}/paired.py", 'return "scale" in words or (',
        "return (", "a channel of TwinCAT that is still to be scaled is read as it is",
    ),
    Change(
        "regions-read-as-western", f"{FOREIGN}/encoding.py",
        "    if encoding := find_encoding(data):\n", '    if encoding := "cp1252":\n',
        "a displacement in micrometres under Cyrillic or Japanese headings is not found",
    ),
    Change(
        "elapsed-added-to-a-clock", f"{FOREIGN}/epochs.py",
        "if parts[0][0].clock and np.any(", "if False and np.any(",
        "a time since the start is added to the time of day",
    ),
    Change(
        "seconds-with-a-pause-not-believed", f"{FOREIGN}/epochs.py",
        "often = minutes > 1 or not in_seconds", "often = True",
        "a pause of 200 s is refused as hours, minutes and seconds",
        ("tests/daemon/files/test_stated_scales.py",),
    ),
    Change(
        "lengths-unsaid", f"{FOREIGN}/containers/arrays.py",
        "needed += _first_of_each(found,", "needed = needed or _first_of_each(found,",
        "a displacement of another length is named, and then the drive is asked for in a circle",
        ("tests/daemon/files/test_left_out_parts.py",),
    ),
    Change(
        "half-of-a-matrix-advised", CHOOSE,
        '{"t": advised["t"]} | offered', '{"t": advised["t"]}',
        "of a matrix the time alone is asked for, and drive and displacement are not found",
        ("tests/daemon/files/test_foreign_advice.py",),
    ),
    Change(
        "names-not-offered", CHOOSE,
        "    elif offered:\n", "    elif False:\n",
        "convert does not say how to name drive and displacement",
        ("tests/daemon/files/test_foreign_advice.py",),
    ),
    Change(
        "points-are-commas", TEXT,
        'if separator == "," and not any("." in line for line in lines[places[layout.first] :]):',
        'if separator == ",":',
        "an oscilloscope's file is to be written with decimal points, which it has",
    ),
    Change(
        "end-of-dos-is-a-line", TEXT, "text.removesuffix(END_OF_FILE)", "text",
        "the last row of a whole file is left out as cut short",
    ),
    Change(
        "end-of-dos-is-an-own-line", "daemon/files/csv_table.py",
        "block.removesuffix(END_OF_FILE.encode())", "block",
        "a whole recording is refused as cut short",
    ),
    Change(
        "zero-bytes-without-a-way-out", "daemon/files/csv_table.py",
        'if raw.rstrip(b"\\0") == before:', "if False:",
        "a recording whose writer was stopped is refused as no text",
    ),
    Change(
        "rate-of-another-script", f"{FOREIGN}/stated_step.py",
        "|采样(?:频率|率)|サンプリング(?:周波数|レート)", "",
        "a rate that a file states in Chinese is asked for",
    ),
    Change(
        "serial-numbers-are-seconds", UNITS,
        "is_unit = plain not in LETTERS if len(plain) > 1 else", "is_unit = len(plain) > 1 or",
        "serial numbers become times in seconds",
    ),
    Change(
        "date-of-another-script", f"{FOREIGN}/fields.py",
        "elif cjk := _CJK_DATE.fullmatch(text):", "elif cjk := None:",
        "dates in Chinese are no times",
        ("tests/daemon/files/test_foreign_words.py",),
    ),
    Change(
        "period-never-set", f"{FOREIGN}/counted.py", "if step_s == UNSET_S and", "if False and",
        "rows of 5 ms are read as 1 s apart, without a word",
        ("tests/daemon/files/test_rows_apart.py",),
    ),
    Change(
        "other-runs-are-channels", f"{FOREIGN}/understand.py",
        "others = _other_runs(columns, [*chosen.values()])", "others: list[list[str]] = []",
        "time, drive and displacement of another run are written beside those of this",
        ("tests/daemon/files/test_rows_apart.py",),
    ),
    Change(
        "counter-from-0-cut", f"{FOREIGN}/epochs.py",
        "or (even and not clock):", "or False:",
        "a counter of 16 bits that begins at 0 is cut in two where it starts again",
        ("tests/daemon/files/test_odd_habits.py",),
    ),
)  # fmt: skip

ENCODING, COUNTED = f"{FOREIGN}/encoding.py", f"{FOREIGN}/counted.py"

CHANGES += room(
    ("tests/daemon/files/test_encodings.py",),
    Change(
        "garbled-letters-name-columns", ENCODING,
        'return best if letters >= 0 and (sure or not rivals) else ""', "return best",
        "headings in Hebrew are shown, and advised, as Cyrillic or as accents",
    ),
    Change(
        "letters-swapped-in-case", ENCODING, "- 2 * _changes_case(letters), signs", ", signs",
        "a short heading in KOI8-R is not recognised, because that of Windows has as usual letters",
    ),
    Change(
        "first-encoding-that-decodes", ENCODING,
        "= max(looks, key=lambda look: look[0], default=", "= next(iter(looks), ",
        "headings in Russian, Greek, Chinese, Japanese and Korean are garbled",
    ),
) + room(
    ("tests/daemon/files/test_contradictions.py",),
    Change(
        "unit-of-an-option-unsaid", COUNTED,
        'if time is not None and reading.time_unit and own not in ("", find_unit_key(',
        'if False and time is not None and own not in ("", find_unit_key(',
        "--time-unit s reads times in milliseconds a thousand times too long, silently",
    ),
    Change(
        "rate-of-an-option-unsaid", COUNTED,
        'found.said.append(f"{other}, --rate {here}, which is used")', "pass",
        "--rate 1000 replaces the 200 Hz that the file states, silently",
    ),
    Change(
        "rate-next-to-times-unsaid", COUNTED,
        "steps = waves or ({found.step_s} if found.step_s and",
        "steps = waves or ({found.step_s} if False and",
        "a rate that its times contradict is passed over",
    ),
    Change(
        "times-without-a-unit-against-a-rate", COUNTED,
        "elif sure and not in_seconds:", "elif False:",
        "times in milliseconds are taken as seconds, although the file states the rate",
    ),
) + room(
    ("tests/daemon/files/test_sums_below.py",),
    Change(
        "sums-are-rows", f"{FOREIGN}/text.py",
        "    if not (below := rows_below(last, decimal)):\n", "    if True:\n",
        "a file with a mean below its numbers is refused, or the mean becomes a row",
    ),
    Change(
        "sums-of-a-sheet-are-rows", f"{FOREIGN}/containers/libraries.py",
        'if size := rows_below(rows, "."):', "if size := 0:",
        "a spreadsheet with totals below its numbers is refused",
    ),
    Change(
        "sums-below-own-names", "daemon/files/loading.py",
        "        if not ends_in_other_rows(path):\n", "        if True:\n",
        "a recording below which somebody wrote the mean is refused",
    ),
    Change(
        "words-are-sums", f"{FOREIGN}/runs.py",
        "return below if notes or any(map(is_sum, here)) else 0", "return below",
        "damaged rows at the end are left out as if they were sums",
    ),
    Change(
        "factor-of-a-sheet-lost", f"{FOREIGN}/containers/apart.py",
        '        "factor": text_of(found.factor),\n', "",
        "the gain that a spreadsheet states above its numbers is passed over",
        ("tests/daemon/files/test_contradictions.py",),
    ),
    Change(
        "notes-below-are-rows", f"{FOREIGN}/runs.py",
        "notes = max(map(length_of, here)) < width", "notes = False",
        "a file that states its number of samples below its numbers is refused",
    ),
    Change(
        "names-over-merged-fields-lost", f"{FOREIGN}/headings.py",
        'return [n or (o if role_of(o, "")[0] else "")', 'return [n or ""',
        "the times under a heading of two lines have no name",
    ),
    Change(
        "labelled-names-unread", TEXT, "    _join_labelled(lines)\n", "",
        "names and period of a file of SignalExpress are asked for",
        ("tests/daemon/files/test_foreign_advice.py",),
    ),
)  # fmt: skip

LABORATORIES = room(
    ("tests/daemon/files/test_lab_exports.py",),
    Change(
        "missing-zeros-unnoticed", f"{FOREIGN}/epochs.py",
        '    if lack_zeros(values):\n',
        '    if False:\n',
        'a file of "10.99" and "10.100" is cut into parts with a wrong time base',
    ),
    Change(
        "factor-of-a-row-unread", f"{FOREIGN}/beside.py",
        '|factor|faktor|slope|divider|teiler"',
        '|slope"',
        'a factor that stands in a row above the numbers is neither applied nor asked for',
    ),
    Change(
        "slope-in-a-line-unread", f"{FOREIGN}/beside.py",
        '(?:gain|factor|slope|sensitivity)\\b',
        '(?:gain)\\b',
        'the slope of a channel in a line of notes is passed over',
    ),
    Change(
        "unit-of-time-above-unread", f"{FOREIGN}/understand.py",
        '        if other:\n',
        '        if False:\n',
        'milliseconds that a line above states are taken as seconds',
    ),
    Change(
        "codes-are-volts", f"{FOREIGN}/choice/doubts.py",
        '    if words_of(drive.heading) & _NOT_VOLTS:\n',
        '    if False:\n',
        'codes of a converter are taken as volts',
    ),
    Change(
        "parts-of-a-day-are-seconds", f"{FOREIGN}/choice/doubts.py",
        '((0.01, 1.0), (30_000.0',
        '((30_000.0',
        'parts of a day are taken as seconds',
    ),
    Change(
        "times-apart-are-one", f"{FOREIGN}/choice/choose.py",
        'if not (together and all(scales))',
        'if not all(scales)',
        'times of another group are dropped as the same time',
    ),
    Change(
        "two-times-are-the-same", f"{FOREIGN}/epochs.py",
        'alike = all(gap <= 0.5 * length / rows for gap in apart)',
        'alike = True',
        'of two times that differ one is taken without a question',
    ),
    Change(
        "digits-of-one-name-apart", f"{FOREIGN}/epochs.py",
        'return names.count(name) > 1 or not name',
        'return not name',
        'seconds and nanoseconds of one stamp are two times',
    ),
    Change(
        "milliseconds-since-1970", f"{FOREIGN}/epochs.py",
        '"ms": (10**12, 41 * 10**11), ',
        '',
        'a unix_time in milliseconds is refused',
    ),
    Change(
        "zone-apart-unread", f"{FOREIGN}/fields.py",
        '_ZONE_APART.sub(r"\\1\\2", text)',
        'text',
        'a date with its time zone apart is no time',
    ),
    Change(
        "either-end-is-the-year", f"{FOREIGN}/fields.py",
        '(?<=/)\\d\\d)[ T,]',
        '\\d\\d)[ T,]',
        'a date that begins with its year in two digits is one of another year',
    ),
    Change(
        "numbered-label-divides", f"{FOREIGN}/units.py",
        '    plain = _NUMBERED.sub("", plain)\n',
        '',
        'the label of a point behind a unit makes the unit unknown',
    ),
    Change(
        "quotient-is-its-unit", f"{FOREIGN}/units.py",
        '    if per := _PER.search(plain):\n',
        '    if False:\n',
        'a sensitivity in um per V is read as a displacement in volts',
    ),
    Change(
        "voltage-of-an-output-is-measured", f"{FOREIGN}/roles.py",
        '    if driven and voltage:  #',
        '    if False:  #',
        'the control voltage of a controller of PI is asked for',
    ),
    Change(
        "points-of-thousands-unseen", f"{FOREIGN}/runs.py",
        '"," in cell and GROUPED_BY_POINTS.fullmatch(cell) for cells in columns',
        'False for cells in columns',
        '75.000 is asked about beside 12.865,4',
    ),
    Change(
        "byte-order-mark-inside", f"{FOREIGN}/text.py",
        '.replace("\\ufeff", "")',
        '',
        'joined files are refused for their byte order marks',
    ),
    Change(
        "one-unit-in-words-is-the-first-columns", f"{FOREIGN}/headings.py",
        'len(labels) == 1 < len(cells)',
        'len(labels) == 1',
        'the unit of the displacement becomes that of the time',
    ),
    Change(
        "fields-kept-as-text", f"{FOREIGN}/fields.py",
        '.removeprefix(\'="\')',
        '',
        'fields that a spreadsheet keeps as text are no numbers',
    ),
    Change(
        "texts-are-no-numbers", f"{FOREIGN}/containers/arrays.py",
        'len(texts) > MOST_COLUMNS and "," not in',
        'False and "," not in',
        'numbers that are kept as texts are no column',
    ),
    Change(
        "word-for-no-value", "daemon/files/csv_table.py",
        '    "missing", "undef", "no data", "nodata",',
        '    "undef", "no data", "nodata",',
        'a line in which an instrument writes MISSING is refused',
    ),
    Change(
        "date-beside-elapsed-time", f"{FOREIGN}/choice/choose.py",
        '            found = [one]\n',
        '            pass\n',
        'a date next to the elapsed time is asked about',
    ),
)  # fmt: skip

CHANGES = [*CHANGES, *LABORATORIES]
