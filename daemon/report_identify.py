"""The report of an identification: one self-contained HTML page."""

import base64
import html
from collections.abc import Sequence

import numpy as np

from dehyst import __version__
from dehyst.daemon import report_identify_pictures as pictures
from dehyst.daemon.verdict import verdict
from dehyst.models.coverage import Coverage
from dehyst.models.identify import Identification
from dehyst.models.recording import Recording

Z95 = 1.96

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em;
       color: #222; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; margin: 0.5em 0; }
td, th { padding: 0.15em 0.8em; border-bottom: 1px solid #ddd; text-align: right; }
td:first-child, th:first-child { text-align: left; }
img { max-width: 100%; } .big { font-size: 1.1em; } .chosen { font-weight: bold; }
.note { color: #555; }
"""


def page(
    result: Identification, recordings: Sequence[Recording], covered: Coverage, model_name: str
) -> str:
    """The whole page as HTML text."""
    names = ", ".join(r.name for r in recordings)
    fit, unit = result.model.fit, result.model.displacement_unit
    span = max(float(np.nanmax(r.displacement) - np.nanmin(r.displacement)) for r in recordings
               if r.displacement is not None)  # fmt: skip
    parts = [
        f"<h1>Identification of {_text(model_name)}</h1>",
        f"<p>From {_text(names)}, by dehyst {__version__}.</p>",
        f'<p class="big">{_text(verdict(result))}</p>',
        _table(
            ["", unit, "of the span"],
            [
                [label, _number(value), f"{value / span:.3%}" if value is not None else ""]
                for label, value in (
                    ("fit, rms", fit.rms),
                    ("held-out rows, rms", fit.holdout_rms),
                    ("noise, rms (sample to sample)", fit.noise_rms),
                )
            ],
        ),
        _validity(result),
        _notes(result, covered),
    ]
    for number, recording in enumerate(recordings):
        title = f": {recording.name}" if len(recordings) > 1 else ""
        parts.append(f"<h2>Measured and model{_text(title)}</h2>")
        parts.append(_image(pictures.time_and_loop(result, recording, number)))
        parts.append(f"<h2>What is left{_text(title)}</h2>")
        parts.append(_image(pictures.residual(result, recording, number)))
    parts += [
        "<h2>What the drive covers</h2>",
        _image(pictures.coverage(covered, recordings[0].drive_unit)),
        "<h2>Structure</h2>",
        "<p>Chosen on held-out rows: the simplest structure within half a per cent of the best "
        "power.</p>",
        _structures(result),
        _image(pictures.orders(result)),
        "<h2>Parameters</h2>",
        "<p>The slope after a reversal, dz/du, once the drive has travelled back by twice the "
        "threshold: the partial sums of the weights. These combinations are what the data "
        "determine; single weights of neighbouring operators are not. Intervals are 95 %, with the "
        "noise's and the misfit's correlation in time. z is the hysteresis before the "
        "saturation, its scale fixed by c1 = 1.</p>",
        _image(pictures.slopes(result)),
        _parameters(result),
    ]
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>Identification of {_text(model_name)}</title><style>{STYLE}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )


def _text(text: str) -> str:
    return html.escape(text)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _image(data: bytes) -> str:
    return f'<p><img alt="" src="data:image/png;base64,{base64.b64encode(data).decode()}"></p>'


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], chosen: int = -1) -> str:
    top = "".join(f"<th>{_text(h)}</th>" for h in head)
    lines = [
        f"<tr{' class=chosen' if i == chosen else ''}>"
        + "".join(f"<td>{_text(cell)}</td>" for cell in row)
        + "</tr>"
        for i, row in enumerate(rows)
    ]
    return f"<table><tr>{top}</tr>{''.join(lines)}</table>"


def _validity(result: Identification) -> str:
    v, unit = result.model.validity, result.model.drive_unit
    parts = [f"drive {v.drive_min:.4g} to {v.drive_max:.4g} {unit}"]
    if v.rate_max is not None:
        parts.append(f"rates up to {v.rate_max:.4g} {unit}/s")
    if v.band_hz is not None:
        parts.append(f"band {v.band_hz:.3g} Hz")
    if v.period_s is not None:
        parts.append(f"sampled every {v.period_s:.4g} s")
    return (
        f"<p>Valid for {_text(', '.join(parts))}; there the model can be inverted everywhere.</p>"
    )


def _notes(result: Identification, covered: Coverage) -> str:
    lines = [*result.notes, *covered.missing]
    if result.shape.rate:
        lines += covered.missing_rate
    if not lines:
        return ""
    return '<ul class="note">' + "".join(f"<li>{_text(line)}</li>" for line in lines) + "</ul>"


def _structures(result: Identification) -> str:
    unit = result.model.displacement_unit
    rows, chosen = [], -1
    for i, c in enumerate(result.tried):
        if c.shape == result.shape and c.offset == result.model.hysteresis.u_offset:
            chosen = i
        rows.append(
            [
                c.shape.name,
                f"{c.offset:.4g}",
                f"{c.held_rms:.4g}",
                "yes" if c.invertible else "no",
            ]
        )
    head = ["structure", f"drive offset, {result.model.drive_unit}", f"held out, {unit} rms"]
    return _table([*head, "can be inverted"], rows, chosen)


def _parameters(result: Identification) -> str:
    h, unit = result.model.hysteresis, result.model.drive_unit
    n = h.n
    slopes, errors, bound = result.params.slopes, result.errors.slopes, result.at_bound
    rate = result.model.validity.rate_max

    def cell(i: int) -> str:
        if bound[i]:
            return f"{slopes[i]:.4g} (on its bound)"
        return f"{slopes[i]:.4g} ± {Z95 * errors[i]:.2g}"

    k = np.asarray(h.k)
    if result.shape.rate:
        at = f"{rate:.4g} {unit}/s"
        head = [f"threshold, {unit}", f"slope at +{at}", f"slope at -{at}", "weight b"]
        head.append(f"rate weight k, s/{unit}")
        rows = [
            [f"{h.r[i]:.5g}", cell(i), cell(n + i), f"{h.b[i]:.4g}", f"{k[i]:.4g}"]
            for i in range(n)
        ]
    else:
        head = [f"threshold, {unit}", "slope", "weight b"]
        rows = [[f"{h.r[i]:.5g}", cell(i), f"{h.b[i]:.4g}"] for i in range(n)]
    poly = [
        [f"c{power}", f"{value:.5g} ± {Z95 * error:.2g}"]
        for power, value, error in zip(
            result.shape.powers, h.c[list(result.shape.powers)], result.errors.c, strict=True
        )
    ]
    poly.insert(min(1, len(poly)), ["c1", f"{h.c[1]:g} (fixes the scale)"])
    shifts = [
        [f"offset of recording {i + 2}", f"{s:.4g} ± {Z95 * e:.2g}"]
        for i, (s, e) in enumerate(zip(result.params.shifts, result.errors.shifts, strict=True))
    ]
    return _table(head, rows) + _table(["saturation", ""], poly + shifts)
