"""Builds reports: self-contained HTML pages for desktop and phone screens.

Every method adds one element and escapes its arguments; only this file writes HTML.
"""

import base64
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape

from dehyst.daemon.report.plotting import Draw, draw_picture

# A picture is drawn on white. On a dark screen it is inverted and its hues are rotated back;
# invert(0.9) turns white into the dark --paper.
STYLE = """
:root{color-scheme:light dark;--ink:#1d1f23;--paper:#fff;--soft:#59606b;--line:#d8dce2;
 --card:#f2f4f7;--mark:#0072b2;--warn:#b3401c}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;max-width:68em;margin:0 auto;padding:1em;
 color:var(--ink);background:var(--paper);overflow-wrap:break-word}
h1{font-size:1.5em;line-height:1.25;margin:.4em 0}
h2{font-size:1.2em;margin:2em 0 .4em;border-bottom:1px solid var(--line)}
h3{font-size:1em;margin:1.2em 0 .3em}
p{margin:.5em 0;max-width:48em}
.lead{font-size:1.12em}.soft{color:var(--soft);font-size:.9em}
.cards{display:grid;grid-template-columns:repeat(auto-fill,minmax(10.5em,1fr));gap:.7em;
 margin:1em 0}
.card{background:var(--card);border-radius:.5em;padding:.6em .9em;font-size:.9em}
.card b{display:block;font-size:1.5em;line-height:1.3}
.box{border-left:.3em solid var(--mark);background:var(--card);border-radius:.3em;
 padding:.1em 1em .4em;margin:1em 0}
.box.warn{border-color:var(--warn)}
.box h3{margin-top:.6em}
.bar{background:var(--line);height:.6em;border-radius:.3em;max-width:24em;overflow:hidden}
.bar div{background:var(--mark);height:100%}
.wide{overflow-x:auto;margin:.5em 0}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.25em 1em .25em 0;text-align:left;vertical-align:top;
 border-bottom:1px solid var(--line)}
td+td{white-space:nowrap}td:first-child{min-width:8em}
.chosen{font-weight:bold}
summary{cursor:pointer;color:var(--mark)}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,28em),1fr));
 gap:.8em;margin:.8em 0}
img{width:100%;max-width:44em;height:auto;display:block}
@media (max-width:30em){body{padding:.7em}h1{font-size:1.3em}
 .cards{grid-template-columns:1fr 1fr}table{font-size:.88em}
 td+td{white-space:normal}td:first-child{min-width:5em}}
@media screen and (prefers-color-scheme:dark){
 :root{--ink:#e4e6e9;--paper:#1a1a1a;--soft:#a4abb6;--line:#3b3f45;--card:#25282c;
 --mark:#58aee6;--warn:#ff9068}
 img{filter:invert(.9) hue-rotate(180deg)}}
"""

# Nested in the class of one element, so that it applies only inside that element.
NOTEBOOK_STYLE = """
--line:#8886;--card:#8882;--mark:#0072b2;--warn:#b3401c;max-width:68em;overflow-wrap:break-word;
.lead{font-size:1.08em}.soft{opacity:.75;font-size:.9em}
.cards{display:grid;grid-template-columns:repeat(auto-fill,minmax(10.5em,1fr));gap:.7em}
.card{background:var(--card);border-radius:.5em;padding:.5em .8em;font-size:.9em}
.card b{display:block;font-size:1.4em;line-height:1.3}
.box{border-left:.3em solid var(--mark);background:var(--card);padding:.1em 1em .4em;margin:1em 0}
.box.warn{border-color:var(--warn)}
.bar{background:var(--line);height:.6em;border-radius:.3em;max-width:24em;overflow:hidden}
.bar div{background:var(--mark);height:100%}
.wide{overflow-x:auto}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26em),1fr));gap:.8em}
img{width:100%;height:auto;background:#fff}
"""


class Page:
    """A report written from top to bottom."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts: list[str] = []

    def add_heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def add_subheading(self, text: str) -> None:
        """Begin a subsection."""
        self._parts.append(f"<h3>{escape(text)}</h3>")

    def add_text(self, text: str, kind: str = "") -> None:
        """Add a paragraph. kind: "", "lead" (larger) or "soft" (an explanation)."""
        self._parts.append(
            f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"
        )

    def add_bullets(self, lines: Sequence[str]) -> None:
        """Add a list; add nothing if there are no lines."""
        if lines:
            items = "".join(f"<li>{escape(line)}</li>" for line in lines)
            self._parts.append(f"<ul>{items}</ul>")

    def add_cards(self, figures: Sequence[tuple[str, str]]) -> None:
        """Add the most important figures, as (label, figure with its unit)."""
        cards = "".join(
            f'<div class="card"><b>{escape(figure)}</b>{escape(label)}</div>'
            for label, figure in figures
        )
        self._parts.append(f'<div class="cards">{cards}</div>')

    def add_table(
        self, head: Sequence[str], rows: Sequence[Sequence[str]], chosen: int | None = None
    ) -> None:
        """Add a table; the first cell of each row names it. chosen: index of the row in bold."""
        top = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in head)
        lines = "".join(
            ('<tr class="chosen">' if i == chosen else "<tr>")
            + "".join(f"<td>{escape(cell)}</td>" for cell in row)
            + "</tr>"
            for i, row in enumerate(rows)
        )
        # a table wider than a phone screen scrolls sideways, by touch or arrow keys
        self._parts.append(
            f'<div class="wide" tabindex="0"><table><tr>{top}</tr>{lines}</table></div>'
        )

    def add_share(self, share: float) -> None:
        """Add a bar filled to a share of 0 to 1; the text that follows gives the number."""
        percent = 100 * min(max(share, 0.0), 1.0)
        self._parts.append(
            f'<div class="bar" aria-hidden="true"><div style="width:{percent:.0f}%"></div></div>'
        )

    def add_pictures(self, *draws: Draw) -> None:
        """Add pictures, side by side if there is room."""
        self._parts.append('<div class="pictures">')
        for draw in draws:
            png, shows = draw_picture(draw)
            data = base64.b64encode(png).decode()
            self._parts.append(f'<img alt="{escape(shows)}" src="data:image/png;base64,{data}">')
        self._parts.append("</div>")

    @contextmanager
    def open_box(self, warn: bool = False) -> Iterator[None]:
        """Put everything added inside into a highlighted box."""
        self._parts.append('<div class="box warn">' if warn else '<div class="box">')
        yield
        self._parts.append("</div>")

    @contextmanager
    def fold(self, title: str) -> Iterator[None]:
        """Hide everything added inside until the reader opens it by its title."""
        self._parts.append(f"<details><summary>{escape(title)}</summary>")
        yield
        self._parts.append("</details>")

    def to_html(self) -> str:
        """Return the whole page."""
        head = [
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(self._title)}</title><style>{STYLE}</style></head>",
            f"<body><main>\n<h1>{escape(self._title)}</h1>",
        ]
        return "\n".join([*head, *self._parts, "</main></body></html>"]) + "\n"

    def to_fragment(self) -> str:
        """Return the added elements for a notebook: in its colours, with a style confined to the
        fragment."""
        head = f'<div class="dehyst"><style>.dehyst{{{NOTEBOOK_STYLE}}}</style>'
        return "\n".join([head, f"<h3>{escape(self._title)}</h3>", *self._parts, "</div>"])
