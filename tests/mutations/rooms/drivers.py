"""The amplifier's and the gauge's drivers."""

from tests.mutations.change import Change, room

DRIVER, LINK = "drivers/mdt693b/driver.py", "drivers/mdt693b/link.py"
FACTS, EXCHANGE = "drivers/mdt693b/unit_facts.py", "drivers/mdt693b/exchange.py"
REPLIES, CODEC = "drivers/mdt693b/replies.py", "drivers/mdt693b/codec.py"
KSG, KSG_CODEC = "drivers/ksg101/driver.py", "drivers/ksg101/codec.py"

CHANGES = [
    *room(
        ("tests/drivers/mdt693b/test_driver.py",),
        Change(
            "beyond-the-range",
            DRIVER,
            "if not minimum <= volts <= maximum:  # NaN included",
            "if False:",
            "a voltage outside the unit's limits is sent",
        ),
        Change(
            "nan-to-the-amplifier",
            DRIVER,
            "if not minimum <= volts <= maximum:",
            "if volts < minimum or volts > maximum:",
            "NaN is sent to the amplifier",
        ),
        Change(
            "rounded-over-the-limit",
            DRIVER,
            "        if rounded > maximum:\n",
            "        if False:\n",
            "rounding to the millivolt goes beyond the limit",
        ),
        Change(
            "rounded-under-the-limit",
            DRIVER,
            "        elif rounded < minimum:\n",
            "        elif False:\n",
            "rounding to the millivolt goes below the limit",
        ),
        Change(
            "own-limit-ignored",
            FACTS,
            "min(limit_v, axis_max_v, limit_v if max_v is None else max_v)",
            "min(limit_v, axis_max_v)",
            "the user's own limit does not hold",
        ),
        Change(
            "own-limit-above-the-switch",
            FACTS,
            "min(limit_v, axis_max_v, limit_v if max_v is None else max_v)",
            "axis_max_v if max_v is None else max_v",
            "the user's limit goes beyond the unit's switch",
        ),
        Change(
            "axis-limit-ignored",
            FACTS,
            "min(limit_v, axis_max_v, ",
            "min(limit_v, ",
            "the axis maximum of the unit does not hold",
        ),
        Change(
            "master-scan-adds",
            FACTS,
            "if scan_v != 0.0:",
            "if False:",
            "master scan adds a voltage to every set-point",
        ),
        Change(
            "another-unit",
            FACTS,
            "if known is not None and serial != known:",
            "if False:",
            "after an unplug another unit, at another voltage, is driven",
        ),
        Change(
            "unwanted-unit",
            FACTS,
            "if wanted is not None and serial != wanted:",
            "if False:",
            "another unit than the configured one is driven",
        ),
        Change(
            "late-refusal-silent",
            DRIVER,
            "elif tried_v is None and refusals > 0:",
            "elif False:",
            "a set that the unit refused late counts as carried out",
        ),
        Change(
            "late-ack-forgotten",
            DRIVER,
            "if tried_v is not None and acks > 0:",
            "if False:",
            "a set that was carried out late is not known, and the next one jumps",
        ),
        Change(
            "tolerance-4.5",
            "drivers/mdt693b/tuning.py",
            "readback_tolerance_v: float = ",
            "readback_tolerance_v: float = 4.5 + 0.0 * ",
            "an initial_v that is wrong by volts is believed",
        ),
        Change(
            "initial-not-compared",
            DRIVER,
            "if initial_v is not None and abs(initial_v - readback_v) > "
            "TUNING.readback_tolerance_v:",
            "if False:",
            "a wrong initial_v makes the first set a jump",
        ),
        Change(
            "lost-set-believed",
            DRIVER,
            "near = abs(nearest_v - readback_v) <= TUNING.readback_tolerance_v",
            "near = True",
            "after the unit was switched off its old voltage is believed",
        ),
        Change(
            "tried-forgotten",
            DRIVER,
            "candidates = [self._set_v] if tried_v is None else [self._set_v, tried_v]",
            "candidates = [self._set_v]",
            "a set under way when the link broke is forgotten",
        ),
        Change(
            "outside-stays",
            DRIVER,
            "if abs(inside_v - volts) > TUNING.readback_tolerance_v:",
            "if False:",
            "an output outside the limits counts as the nearest allowed one",
        ),
        Change(
            "set-before-step",
            DRIVER,
            "            self.get_in_step(link)\n            self.trying(volts)\n",
            "            self.trying(volts)\n",
            "an earlier set's acknowledgement is taken for this one's",
        ),
    ),
    *room(
        ("tests/drivers/mdt693b/test_codec.py", "tests/drivers/mdt693b/test_golden.py"),
        Change(
            "any-ack",
            EXCHANGE,
            "return form is not None and not payload",
            "return form is not None",
            "a garbled reply counts as carried out",
        ),
        Change(
            "echo-not-removed",
            EXCHANGE,
            "            text = text[len(self.sent) :]\n",
            "            pass\n",
            "a unit that echoes cannot be used",
        ),
        Change(
            "barrier-anything",
            CODEC,
            "if barrier and (form.pattern is None or form.blank):",
            "if False:",
            "a late reply is taken for the barrier's",
        ),
        Change(
            "voltage-like-limit",
            REPLIES,
            r"_WHOLE = re.compile(rb\"\[ *(?P<value>\d+) *\]\")".replace('\\"', '"'),
            r'_WHOLE = re.compile(rb"\[ *(?P<value>[\d.]+) *\]")',
            "a late voltage is taken for the barrier's answer",
            tests=(
                "tests/drivers/mdt693b/test_codec.py",
                "tests/drivers/mdt693b/test_driver.py",
                "tests/drivers/mdt693b/test_golden.py",
            ),
        ),
        Change(
            "minus-lost",
            REPLIES,
            r'_NUMBER = re.compile(rb"\[? *(?P<value>-?\d+',
            r'_NUMBER = re.compile(rb"\[? *-?(?P<value>\d+',
            "a negative reading loses its sign",
        ),
    ),
    *room(
        ("tests/drivers/ksg101/test_codec.py",),
        Change(
            "gauge-sign",
            KSG_CODEC,
            '("chan", "reading", "smoothed"), "HhH"',
            '("chan", "reading", "smoothed"), "HHH"',
            "negative readings become full scale",
        ),
        Change(
            "gauge-order",
            KSG_CODEC,
            'struct.unpack_from("<" + layout.data, data)',
            'struct.unpack_from(">" + layout.data, data)',
            "readings have their bytes swapped",
        ),
        Change(
            "gauge-others-messages",
            KSG_CODEC,
            "destination & ~HAS_DATA != self.receiver or source != self.sender:",
            "destination & ~HAS_DATA != self.receiver:",
            "another unit's reading is taken",
        ),
        Change(
            "gauge-garbage",
            KSG_CODEC,
            "if length > LONGEST or",
            "if",
            "garbage holds the gauge up until it has sent 65 kB",
        ),
        Change(
            "gauge-half-message",
            KSG_CODEC,
            "            elif len(self._buffer) < size:\n                break\n",
            "",
            "half a message is decoded",
        ),
        Change(
            "gauge-skipped-not-counted",
            KSG_CODEC,
            "                self.skipped += 1\n",
            "",
            "a bad line is not told",
        ),
    ),
]
