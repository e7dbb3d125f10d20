"""report.html of a diagnosis: one self-contained page that a technician can read."""

import base64
from html import escape
from typing import Any

from dehyst.daemon import report_pictures as pictures
from dehyst.models.diagnosis import Diagnosis, Finding, Value

VERDICTS = {
    "clean": "Nothing was left out that these recordings could show.",
    "explained": "What the hysteresis model left out was found and modelled.",
    "partly": "Part of what was left out was found and modelled; something else remains.",
    "unknown": "Something acts here that no entry of the library explains.",
}
COLUMNS = (
    "hysteresis model alone", "hysteresis of any shape, held out", "augmented model, held out"
)  # fmt: skip
STYLE = """
body{font:16px/1.45 system-ui,sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}
h1{font-size:1.6em;margin-bottom:.2em} h2{font-size:1.2em;margin:1.8em 0 .5em}
img{max-width:100%;height:auto} table{border-collapse:collapse;margin:.4em 0}
td,th{padding:.25em .9em .25em 0;text-align:left;vertical-align:top;border-bottom:1px solid #e5e5e5}
.verdict{font-size:1.15em}.big{font-size:1.5em;font-weight:600}
.cards{display:flex;flex-wrap:wrap;gap:1em;margin:1em 0}
.card{background:#f4f6f8;border-radius:8px;padding:.7em 1.1em;min-width:11em}
.finding{border-left:5px solid #1f5fbf;padding:.1em 1em;margin:1em 0;background:#f8fafc}
.finding.unknown{border-color:#c0392b}
.bar{background:#dde3ea;height:.6em;border-radius:4px;max-width:24em}
.bar div{background:#1f5fbf;height:100%;border-radius:4px}
.small{color:#666;font-size:.9em}
"""


def page(diagnosis: Diagnosis, names: list[str]) -> str:
    """The page as text. names: the recordings' file names."""
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width'>",
        f"<title>Diagnosis: {escape(diagnosis.verdict)}</title><style>{STYLE}</style>",
        f"<h1>Diagnosis: {escape(diagnosis.verdict)}</h1>",
        f"<p class='verdict'>{VERDICTS[diagnosis.verdict]}</p>",
        f"<p class='small'>Recordings: {escape(', '.join(names))}</p>",
        _cards(diagnosis),
    ]
    if diagnosis.findings:
        parts.append("<h2>What was left out</h2>")
        parts += [_finding(f) for f in diagnosis.findings]
    if diagnosis.next_experiment:
        parts.append(f"<h2>Next experiment</h2><p>{escape(diagnosis.next_experiment)}</p>")
    parts += [
        "<h2>Before and after</h2>",
        "<p class='small'>Every sample is predicted by a fit that did not see its stretch of "
        "the recording.</p>",
        _image(pictures.errors(diagnosis), "errors before and after"),
        "<h2>Where the misfit sits</h2>",
        "<p class='small'>Rms error where the recording was at that time, drive, rate and so on. "
        "Grey above green is what the hysteresis model alone misses, blue above green what the "
        "augmented model still misses.</p>",
        _image(pictures.locate(diagnosis), "rms error by time, drive, rate and rest"),
        "<h2>What remains against the noise</h2>",
        _image(pictures.spectrum(diagnosis), "spectrum of the errors"),
        _limits(diagnosis),
        _figures(diagnosis),
    ]
    if diagnosis.notes:
        parts.append("<h2>Notes</h2><ul>")
        parts += [f"<li>{escape(note)}</li>" for note in diagnosis.notes]
        parts.append("</ul>")
    return "\n".join(parts) + "\n"


def _image(png: bytes, alt: str) -> str:
    return f"<img alt='{alt}' src='data:image/png;base64,{base64.b64encode(png).decode()}'>"


def _cards(diagnosis: Diagnosis) -> str:
    k, unit = pictures.scale(diagnosis)
    cards = [("noise of the recording", diagnosis.noise)]
    for key, label in (
        ("base", "error, hysteresis model alone"),
        ("heldout_base", "held-out error, hysteresis of any shape"),
        ("heldout_augmented", "held-out error, augmented model"),
    ):
        value = _overall(diagnosis, diagnosis.rms.get(key))
        if value is not None:
            cards.append((label, value))
    return "<div class='cards'>" + "".join(
        f"<div class='card'><div class='big'>{k * value:.3g} {escape(unit)}</div>{label}</div>"
        for label, value in cards
    ) + "</div>"  # fmt: skip


def _overall(diagnosis: Diagnosis, value: Any) -> float | None:
    """One rms from a number, or from one number a recording."""
    if value is None:
        return None
    if isinstance(value, int | float):
        return float(value)
    sizes = {v.name: v.t_s.size for v in diagnosis.views}
    total = sum(sizes.get(n, 1) for n in value)
    return float((sum(sizes.get(n, 1) * r**2 for n, r in value.items()) / total) ** 0.5)


def _finding(finding: Finding) -> str:
    kind = "finding unknown" if finding.name == "unknown" else "finding"
    out = [f"<div class='{kind}'><h3>{escape(finding.title or finding.name)}</h3>"]
    out.append(f"<p>{escape(finding.says)}</p>")
    if finding.name != "unknown":
        percent = 100 * min(max(finding.share, 0.0), 1.0)
        out.append(
            f"<div class='bar'><div style='width:{percent:.0f}%'></div></div>"
            f"<p class='small'>takes {percent:.0f} % of the explainable misfit (held out); "
            f"acts on the {escape(finding.place)}</p>"
        )
    if finding.ambiguous_with:
        others = escape(", ".join(finding.ambiguous_with))
        out.append(f"<p>These recordings cannot tell it from: <b>{others}</b>.</p>")
    if finding.parameters:
        rows = "".join(_parameter(k, v) for k, v in finding.parameters.items())
        out.append(
            f"<table><tr><th>parameter</th><th>value</th><th>95 % interval</th></tr>{rows}</table>"
        )
    if finding.equation:
        out.append(f"<p class='small'>{escape(finding.equation)} ({escape(finding.source)})</p>")
    return "".join(out) + "</div>"


def _parameter(key: str, value: Value) -> str:
    unit = escape("" if value.unit == "1" else pictures.written(value.unit))
    words = escape(_words(key, value.unit))
    stated = f"{value.low:.4g} to {value.high:.4g} {unit}"
    return f"<tr><td>{words}</td><td>{value.value:.4g} {unit}</td><td>{stated}</td></tr>"


def _words(key: str, unit: str) -> str:
    """A parameter's key without its unit, which stands behind the value."""
    tail = "_" + unit.lower().replace("/", "_per_")
    return (key.removesuffix(tail) if unit != "1" else key).replace("_", " ")


def _limits(diagnosis: Diagnosis) -> str:
    if not diagnosis.would_have_seen:
        return ""
    rows = []
    for limit in diagnosis.would_have_seen:
        if limit.value is None:
            text = "cannot be seen with this drive"
        else:
            text = f"{limit.side} {limit.value:.3g} {escape(pictures.written(limit.unit))}"
        rows.append(
            f"<tr><td>{escape(limit.name)}</td><td>{text}</td>"
            f"<td class='small'>{escape(limit.why)}</td></tr>"
        )
    return (
        "<h2>What would have been seen</h2><p class='small'>Effects that were not found, and the "
        "size from which these recordings would have shown them.</p>"
        f"<table><tr><th>effect</th><th>would have been seen</th><th></th></tr>{''.join(rows)}"
        "</table>"
    )


def _figures(diagnosis: Diagnosis) -> str:
    k, unit = pictures.scale(diagnosis)
    rows = []
    for view in diagnosis.views:
        cells = "".join(
            f"<td>{k * float(((view.displacement - y) ** 2).mean()) ** 0.5:.3g} {escape(unit)}</td>"
            for y in (view.base, view.shape, view.augmented)
        )
        rows.append(f"<tr><td>{escape(view.name)}</td>{cells}</tr>")
    head = "".join(f"<th>{label}</th>" for label in COLUMNS)
    return f"<h2>Errors by recording</h2><table><tr><th></th>{head}</tr>{''.join(rows)}</table>"
