"""Table of the differences between the experiments and the paper, with reasons."""

DEVIATIONS: tuple[tuple[str, ...], tuple[tuple[str, ...], ...]] = (
    ("what", "paper", "here", "why"),
    (
        (
            "symbol in Eq. 1",
            "x(t) - r and u(t) + r",
            "u(t) in both places",
            "the operator has one input; x is defined nowhere",
        ),
        (
            "order of c in Eq. 11 and 12",
            "[.., 0, .., 0, ..] without powers",
            "descending: c5, 0, c3, 0, c1",
            "only then do 10 V give 11.69 and 11.49 µm, the stack's 11.6 µm",
        ),
        (
            "sign of the weights",
            "partial sums below zero (w1 = -2.31)",
            "positive partial sums in identified models; the stages keep the paper's",
            "otherwise the output moves the wrong way after each reversal, and no inverse exists",
        ),
        (
            "initial state",
            "de-energised, H = 0",
            "the same; every drive starts at 0 V",
            "a start elsewhere would hide the first curve",
        ),
        (
            "offset of Eq. 9",
            "centred sum of sines",
            "half the range is added",
            "the stack's range is 0 to 10 V",
        ),
        (
            "first threshold",
            "Eq. 10 begins above 0",
            "thresholds are free",
            "the paper's own fits have r1 = 0",
        ),
        (
            "noise",
            "level of 100 nm",
            "25 nm rms, 100 nm being four standard deviations; --noise changes it",
            "its errors of 45.55 nm exclude 100 nm rms",
        ),
        (
            "sweep",
            "amplitude and length are not given",
            "1 V peak to peak, 10 s, frequency linear in time",
            "94.11 nm is 8.25 % of 1.14 µm, about 1 V; the length is our choice "
            "and keeps the run short",
        ),
        (
            "sampling",
            "not given",
            "1 kHz; 4 s of every other signal",
            "fifty samples per period at 20 Hz",
        ),
    ),
)
"""Header and rows, as in docs/paper.md."""
