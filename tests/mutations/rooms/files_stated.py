"""Files of other programs: what containers state beside the arrays."""

from tests.mutations.change import Change, room

FOREIGN = "daemon/files/foreign"
CONTAINERS = f"{FOREIGN}/containers"

CHANGES = room(
    ("tests/daemon/files/test_stated_beside.py",),
    Change(
        "factor-as-text-lost", f"{CONTAINERS}/attributes.py",
        "if number is not None and math.isfinite(number):", "if False:",
        "counts are read as micrometres, because their factor is a text",
    ),
    Change(
        "unsigned-is-signed", f"{CONTAINERS}/attributes.py",
        'if values.dtype.kind == "i" and text_in', 'if False and text_in',
        "the drive of a netCDF file jumps to negative volts",
    ),
    Change(
        "factor-of-a-stem-lost", f"{FOREIGN}/beside.py",
        'stems = [own, *{split_heading(own)[0]} - {own, ""}]', "stems = [own]",
        "'pos_scale' next to 'pos_um' is not asked about",
    ),
    Change(
        "factor-in-words-is-none", f"{FOREIGN}/beside.py",
        "return float(found[1]) if found else otherwise", "return otherwise",
        "'20 V/V' next to the numbers is no factor",
    ),
    Change(
        "gain-of-all-unasked", f"{CONTAINERS}/arrays.py",
        "if not factors and not all(", "if False and not all(",
        "the input of an amplifier is read as the voltage of the stage, next to its gain",
    ),
    Change(
        "calibration-is-the-recording", f"{CONTAINERS}/arrays.py",
        "if not of_wanted and size < FEWEST_ROWS <= max(sizes)", "if False",
        "a table of 11 rows is read, and the recording next to it left out",
    ),
    Change(
        "short-run-advised", f"{CONTAINERS}/arrays.py",
        "whole = next((size for size in runs if size >= FEWEST_ROWS), runs[0])", "whole = runs[0]",
        "the calibration is advised as the recording",
    ),
    Change(
        "every-channel-is-called-value", f"{FOREIGN}/roles.py",
        "    heading = own_part(heading)\n", "",
        "the drive of an EPICS archive is advised as its displacement",
    ),
    Change(
        "channels-in-rows-of-json", f"{CONTAINERS}/arrays.py",
        "(describe_channel_rows(k, v, columns) for k, v in words.items())", '("" for k in words)',
        "all values of a log are advised as the drive",
    ),
    Change(
        "reading-drives", f"{FOREIGN}/roles.py", '"response", "reading", "ausgang", "dehnung"',
        '"response", "ausgang", "dehnung"',
        "the reading of a meter is advised as the drive",
    ),
    Change(
        "units-of-a-structure-lost", f"{FOREIGN}/beside.py",
        '        group = group_of(group.rstrip("/."))\n', '        return ""\n',
        "units in a structure of their own are asked for",
    ),
    Change(
        "unit-of-a-signal-lost", f"{FOREIGN}/beside.py",
        'signals = (own, _NUMBERS_OF.sub("", own))', "signals = (own,)",
        "'OutputUnit' next to 'OutputData' is asked for",
    ),
    Change(
        "units-of-y-lost", f"{FOREIGN}/beside.py",
        "for key in (*UNIT_FIELDS, *UNITS_OF_Y) if", "for key in UNIT_FIELDS if",
        "the units in an oscilloscope's structures are asked for",
    ),
    Change(
        "header-names-nothing", f"{FOREIGN}/beside.py",
        "is_alone else _header_of(heading, notes)", "is_alone else {}",
        "of two channels in volts the owner is asked which one drives, though their headers say so",
    ),
    Change(
        "time-type-is-damage", f"{CONTAINERS}/libraries.py",
        "except TypeError:", "except ZeroDivisionError:",
        "a table whose times are of HDF5's own type is called damaged",
        tests=(
            "tests/daemon/files/test_odd_containers.py"
            "::test_a_type_that_the_library_does_not_read_is_no_damage",
        ),
    ),
)  # fmt: skip
