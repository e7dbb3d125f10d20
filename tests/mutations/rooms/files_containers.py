"""Files of other programs: columns apart in time, and what containers keep beside the numbers."""

from tests.mutations.change import Change, room

FOREIGN = "daemon/files/foreign"
APART, BESIDE = f"{FOREIGN}/rows_apart.py", f"{FOREIGN}/beside.py"
LIBRARIES, ARRAYS, BLOCKS = (
    f"{FOREIGN}/containers/{name}.py" for name in ("libraries", "arrays", "blocks")
)

CHANGES = room(
    ("tests/daemon/files/test_rows_apart.py",),
    Change(
        "begun-apart-is-joined", APART,
        "if max(begins.values(), default=0.0) - early <= WHOLE * period:", "if True:",
        "a gauge that began 0.2 s after the drive is joined to it row by row",
    ),
    Change(
        "periods-apart-are-joined", APART, "if slow[1] > (1.0 + SAME_STEP) * fast[1]:", "if False:",
        "a gauge of 100 Hz is joined row by row to a drive of 200 Hz",
    ),
    Change(
        "times-of-two-sheets-unread", APART,
        "if np.allclose(first, second, rtol=0.0, atol=near):", "if True:",
        "drive and displacement on two sheets with other times are joined row by row",
    ),
) + room(
    ("tests/daemon/files/test_odd_containers.py",),
    Change(
        "references-are-names", LIBRARIES, "(texts := texts_in(np.asarray(value)))",
        "(texts := [text_of(one) for one in np.asarray(value).reshape(-1).tolist()])",
        "an HDF5 file with a dimension scale cannot be read",
    ),
    Change(
        "index-of-a-table-is-read", LIBRARIES, '("#refs#", "#subsystem#", "/_i_")',
        '("#refs#", "#subsystem#")', "with --rate an index of PyTables is read as the recording",
    ),
    Change(
        "lone-array-wins", ARRAYS, "len(roles[n]), counts[n] > 1, n", "len(roles[n]), True, n",
        "one long array takes the place of drive and displacement",
    ),
    Change(
        "no-name-is-a-unit", f"{FOREIGN}/containers/attributes.py", '!= "N.":', '!= "":',
        "the times of a table of pandas are asked for as newtons",
    ),
    Change(
        "blank-displacement-passed-over", f"{FOREIGN}/blank.py",
        "if blank and role not in reading.columns:", "if False:",
        "volts of a sensor are read where the displacement is a formula without values",
    ),
    Change(
        "generated-is-measured", f"{FOREIGN}/roles.py", '"generated", "generation"}', "}",
        "the drive of a TDMS file is advised as the displacement",
    ),
    Change(
        "blocks-are-channels", BLOCKS, "        elif order:\n", "        elif False:\n",
        "of 30 blocks of 100 samples one is read",
    ),
    Change(
        "blocks-of-no-order-are-taken", BLOCKS, "rises_evenly(times.ravel(order))), None)",
        'rises_evenly(times.ravel(order))), "C")', "blocks are joined in no order of time",
    ),
    Change(
        "small-table-hides-the-names", f"{FOREIGN}/grid.py", "own = _width_of_most(kinds, width)",
        "own = width", "two results at the right of a sheet take the names from its columns",
    ),
    Change(
        "rows-below-names-unread", ARRAYS, "if named and all(", "if False and all(",
        "JSON with a row of names above the rows of numbers is refused",
    ),
    Change(
        "units-of-a-table-lost", ARRAYS,
        "column.unit = column.unit or unit_in_lists(column.heading, lists)", "pass",
        "kilovolts of a table of MATLAB are read as volts",
    ),
    Change(
        "counts-of-a-scope-are-volts", BESIDE, '"slope", "lsb", "yinc", "yincrement",',
        '"slope", "lsb",', "the counts of an oscilloscope are read as volts",
    ),
)  # fmt: skip
