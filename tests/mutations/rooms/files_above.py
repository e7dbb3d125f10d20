"""Files of other programs: the lines above the numbers, and what stands in front of them."""

from tests.mutations.change import Change, room

FOREIGN = "daemon/files/foreign"
APART, PAIRED = f"{FOREIGN}/rows_apart.py", f"{FOREIGN}/paired.py"
HEADINGS, ADVICE = f"{FOREIGN}/headings.py", f"{FOREIGN}/choice/advice.py"

CHANGES = room(
    ("tests/daemon/files/test_lines_above.py",),
    Change(
        "metadata-are-names", HEADINGS,
        "plain = [line for line in rows if not _is_property(line[1])]", "plain = [*rows]",
        "the set-point of a recording from Simulink is read as its displacement",
    ),
    Change(
        "names-with-one-prefix-are-metadata", HEADINGS,
        "rows = plain if any(_known(texts_of(row)) > 1 for _, row in plain) else rows",
        "rows = plain",
        "columns that begin with the name of their device have no names",
    ),
    Change(
        "labelled-names-overlooked", HEADINGS, '"kanalname",\n', '"kanalnummer",\n',
        "the kind of each sensor is taken for its name",
    ),
    Change(
        "shared-times-unread", PAIRED, "for shared in (False, True):", "for shared in (False,):",
        "a TwinCAT file with one column of times is refused",
    ),
    Change(
        "ticks-are-times", PAIRED, 'return "ns"\n', 'return "us"\n',
        "Windows' ticks are a thousand times too long",
    ),
    Change(
        "address-is-an-offset", PAIRED, 'and not words.startswith("index")', "",
        "the address of a channel is asked for as an offset of its values",
    ),
    Change(
        "voltage-of-output-measures", f"{FOREIGN}/roles.py",
        'of_output = voltage and "voltage of output" in heading.lower()', "of_output = False",
        "the drive of a PI controller is advised as its displacement",
    ),
    Change(
        "time-in-front-is-a-word", f"{FOREIGN}/text.py", "    split_off_times(lines)\n", "",
        "a log of a serial monitor holds no rows of numbers",
    ),
    Change(
        "boot-message-is-the-row", f"{FOREIGN}/text.py",
        "if best[0] < FEW_FIELDS * len(sample) and", "if False and",
        "one row is read of a log of thousands, that of a boot message",
    ),
    Change(
        "period-next-to-names-lost", HEADINGS,
        "number_of(stated[short]) if short in stated else value", "value",
        "the rate of an oscilloscope is asked for although it states its period",
    ),
    Change(
        "channel-with-unit-unknown", f"{FOREIGN}/units.py",
        "if of_channel := _OF_CHANNEL.fullmatch(plain):",
        'if of_channel := _OF_CHANNEL.fullmatch(""):',
        "volts of an oscilloscope are asked for as an unknown unit",
    ),
    Change(
        "converter-counts-are-volts", PAIRED, 'if mode == "fast" and', "if False and",
        "whole numbers of a converter are read as volts",
    ),
    Change(
        "counts-advised-next-to-volts", ADVICE,
        "any(_in_counts(c, columns[i]) for c in columns[:i])", "False",
        "the counts of the drive are advised as the displacement",
    ),
    Change(
        "clock-moved-to-the-front", f"{FOREIGN}/epochs.py",
        "return [joined if column.number == first else column for column in kept]",
        "return [joined, *(column for column in kept if column.number != first)]",
        "a time is asked for by a name that no column has",
    ),
    Change(
        "rows-in-turn-are-usable", "daemon/files/foreign/understand.py",
        "    refuse_no_common_row(name, columns, chosen)\n", "",
        "no usable row is left, and nobody says why",
    ),
    Change(
        "variables-in-turn-are-one", f"{FOREIGN}/text.py",
        '                refuse_long(name, rows, numeric, [""] * len(numeric))\n', "",
        "drive and displacement of EPICS in turn are read as one channel",
    ),
    Change(
        "envelope-is-samples", "daemon/files/foreign/understand.py",
        "    refuse_envelope(name, columns, chosen, reading)\n", "",
        "minimum and maximum of an instant are two samples at twice the rate",
    ),
    Change(
        "rounded-times-are-an-envelope", APART, "np.mean(low < high) >= OF_PAIRS",
        "np.mean(low < high) >= 0.4",
        "a recording with rounded times is refused",
    ),
)  # fmt: skip
