"""Output of `dehyst paper`: a table, a page, pictures."""

from collections.abc import Sequence
from functools import partial

from dehyst.daemon.paper.deviations import DEVIATIONS
from dehyst.daemon.paper.experiments import Result
from dehyst.daemon.paper.pictures import draw_tracking, figures
from dehyst.daemon.report.page import Page
from dehyst.daemon.report.plotting import draw_side_by_side

HEAD = ("stage", "experiment", "paper, nm", "here, nm", "reached", "inverse, nm rms", "rows, %")
RULE = (
    "Reached: the standard deviation is at most the paper's, and the mean at most the paper's "
    "mean plus its standard deviation; for the sweep, the maximum of the last second. Static "
    "models count on the stage of Eq. 11, rate-dependent ones on that of Eq. 12; the other rows "
    "(in brackets) are shown and do not count. The inverse's error is target minus displacement on "
    "the rows whose target can be reached; the last column is their share."
)


def rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """Return the table's cells, in the order of HEAD."""
    return [
        (
            r.stage,
            r.experiment.name,
            _paper(r),
            _here(r),
            _verdict(r),
            f"{r.tracking_rms:.1f}",
            f"{100.0 * r.reachable.mean():.0f}",
        )
        for r in results
    ]


def paper_table(results: Sequence[Result]) -> str:
    """Return the table for a terminal, with its rule."""
    lines = [HEAD, *rows(results)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    cells = ["  ".join(c.ljust(w) for c, w in zip(x, widths, strict=True)).rstrip() for x in lines]
    return "\n".join([*cells, "", RULE, *filter(None, map(maximum_says, results))])


def maximum_says(r: Result) -> str:
    """Explain the maximum of a sweep; "" for other signals, and on stages where it does not
    count."""
    if len(r.experiment.paper) > 1 or not r.counts:
        return ""
    return (
        f"{r.experiment.name} on {r.stage}, largest error of the last second: {r.maximum:.0f} nm. "
        f"The noise alone has {r.noise_maximum:.0f} nm there; without noise the model is off by "
        f"{r.true_maximum:.0f} nm at most, a plain fit that cannot be inverted by "
        f"{r.plain_maximum:.0f} nm (paper: {r.experiment.paper[0]:g} nm, noise included)."
    )


def by_stage(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Return the results of each stage."""
    out: dict[str, list[Result]] = {}
    for one in results:
        out.setdefault(one.stage, []).append(one)
    return out


def page(results: Sequence[Result]) -> str:
    """Return the whole page as HTML text."""
    out = Page("The paper's experiments repeated")
    out.add_text(RULE)
    out.add_table(HEAD, rows(results))
    for text in filter(None, map(maximum_says, results)):
        out.add_text(text)
    out.add_heading("Deviations from the paper")
    out.add_table(*DEVIATIONS)
    for stage, of in by_stage(results).items():
        out.add_heading(f"The stage of {stage}" if stage.startswith("Eq") else f"A {stage} stage")
        for number, draws in figures(of).items():
            out.add_subheading(f"Figure {number}")
            out.add_pictures(*draws)
        out.add_subheading("Tracking with the inverse")
        out.add_pictures(partial(draw_tracking, of))
    return out.to_html()


def pictures(results: Sequence[Result]) -> dict[str, bytes]:
    """Return PNGs by file name: Figures 3 to 7 and the tracking of each stage."""
    out = {}
    for stage, of in by_stage(results).items():
        name = stage.lower().replace(". ", "")
        for number, draws in figures(of).items():
            out[f"{name}-figure-{number}.png"] = draw_side_by_side(draws, [1.0] * len(draws))
        out[f"{name}-tracking.png"] = draw_side_by_side([partial(draw_tracking, of)], [1.0])
    return out


def _paper(r: Result) -> str:
    paper = r.experiment.paper
    return f"{paper[0]:.2f} max" if len(paper) == 1 else f"{paper[0]:.2f} +- {paper[1]:.2f}"


def _here(r: Result) -> str:
    single = len(r.experiment.paper) == 1
    return f"{r.maximum:.2f} max" if single else f"{r.mean:.2f} +- {r.std:.2f}"


def _verdict(r: Result) -> str:
    word = "yes" if r.reached else "no"
    return word if r.counts else f"({word})"
