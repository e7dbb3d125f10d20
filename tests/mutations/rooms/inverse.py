"""The static inverse and the ends of the range."""

from tests.mutations.change import Change, room

STATIC, SAMPLE = "models/inverse/static.py", "models/inverse/sample.py"
MODE, CASCADE = "models/physics/resonance.py", "models/cascade/step.py"

REACH = "models/cascade/reach.py"

CHANGES = [
    *room(
        ("tests/models/cascade/test_reach.py",),
        Change(
            "reach-without-blocks",
            REACH,
            "    acting = [b for b in model.blocks if _acts_at_rest(b)]\n",
            "    acting: list[Block] = []\n",
            "the reach ignores the blocks, so reachable targets are refused",
        ),
        Change(
            "reach-ignores-clip",
            REACH,
            "    drive = np.clip(drive, *_clipped_range(model))\n",
            "",
            "targets beyond the clipped drive are admitted",
        ),
        Change(
            "reach-of-the-reading",
            REACH,
            "    return block.place == \"stage\" and",
            "    return block.place != \"drive\" and",
            "the reach is that of the reading instead of the stage",
        ),
    ),
    *room(
        ("tests/models/inverse/test_static.py",),
        Change(
            "walk-wrong-way", STATIC, "up = (rest > 0.0) == (total > 0.0)",
            "up = rest > 0.0", "a falling stage is driven in the wrong direction",
        ),
        Change(
            "last-piece", STATIC, "    v += rest / slope\n    return max(v, v_min), v >= v_min",
            "    return max(v, v_min), v >= v_min", "the target is missed on the way down",
        ),
        Change(
            "last-piece-up", STATIC, "        v += rest / slope\n        return min(v, v_max)",
            "        return min(v, v_max)", "the target is missed on the way up",
        ),
        Change(
            "weights-not-joined", STATIC,
            "            slope += b[i]\n        if slope == 0.0:\n            return v, False",
            "            slope = b[i]\n        if slope == 0.0:\n            return v, False",
            "the target is missed on the way up",
        ),
        Change(
            "plays-not-advanced", STATIC,
            "        play_step(static.r, h, last - static.limits[0].u_offset)\n", "",
            "hysteresis is not compensated",
        ),
        Change(
            "offset-not-added", STATIC,
            "return min(max(v + u_offset, drive_min), drive_max), flags",
            "return min(max(v, drive_min), drive_max), flags",
            "a bipolar stage is driven with a wrong offset",
        ),
        Change(
            "not-clamped", STATIC, "return min(max(v + u_offset, drive_min), drive_max), flags",
            "return v + u_offset, flags", "the drive leaves its range",
            survives="`walk` holds the range itself; this is the wall behind it, for rounding",
        ),
        Change(
            "not-monotone-accepted", STATIC, "    require_monotone(model)\n", "",
            "a model that cannot be inverted is inverted",
        ),
        Change(
            "drive-range-any", STATIC, "if not low < high:", "if False:",
            "an empty drive range is accepted",
        ),
    ),
    *room(
        ("tests/models/inverse/test_modes.py",),
        Change(
            "mode-undone-where-unstable", MODE, "return rings <= math.exp(-dt / RINGS_S) and",
            "return True or", "the drive that inverts a mode grows without bound",
        ),
        Change(
            "mode-from-the-drive-before", MODE, "turn * s.x - free)", "turn * s.x)",
            "an oscillating mode is compensated as if it were at rest",
        ),
        Change(
            "mode-undone-from-what-was-applied", CASCADE,
            "_from + b.own : b.s_from + 2 * b.own] = after",
            "_from + b.own : b.s_from + 2 * b.own] = states[b.s_from : b.s_from + b.own]",
            "a step beyond the slew rate makes the drive oscillate between its limits forever",
        ),
    ),
    *room(
        ("tests/models/inverse/test_low_end.py", "tests/models/inverse/test_static.py"),
        Change(
            "static-drive-not-flagged", STATIC, "        flags |= BEYOND_DRIVE\n    return",
            "        pass\n    return", "an unreachable target is not reported",
        ),
        Change(
            "static-low-not-flagged", STATIC, "return v_min, abs(part) >= abs(rest)",
            "return v_min, True", "a target below the range is not reported",
        ),
        Change(
            "static-high-not-flagged", STATIC, "return v_max, abs(part) >= abs(rest)",
            "return v_max, True", "a target above the range is not reported",
        ),
        Change(
            "static-low-saturation", STATIC, "if y < min(y_first, y_last) or y >",
            "if y >", "a target below the saturation is not reported",
        ),
        Change(
            "static-high-saturation", STATIC,
            "if y < min(y_first, y_last) or y > max(y_first, y_last):",
            "if y < min(y_first, y_last):", "a target above the saturation is not reported",
        ),
        Change(
            "low-end-not-flagged", SAMPLE, "at_end = u <= limits.low or u >= limits.high",
            "at_end = u >= limits.high", "a target below the range is not reported",
        ),
        Change(
            "high-end-not-flagged", SAMPLE, "at_end = u <= limits.low or u >= limits.high",
            "at_end = u <= limits.low", "a target above the range is not reported",
        ),
        Change(
            "low-saturation-not-flagged", SAMPLE,
            "if state.target < min(y_a, y_b) or state.target >", "if state.target >",
            "a target below the saturation is not reported",
        ),
    ),
    *room(
        ("tests/models/cascade/test_cascade.py",),
        Change(
            "late-memory", "models/inverse/compensator.py", "pack(with_delays_behind(model), ",
            "pack(model, ",
            "after a delayed drive a rate-dependent stage is driven past its target",
        ),
    ),
]  # fmt: skip
