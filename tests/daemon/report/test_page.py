"""The page builder and the style of pictures, judged by the standard library's own HTML parser."""

import base64
import struct
from html.parser import HTMLParser

import numpy as np
import pytest

from dehyst.daemon.report.page import Page
from dehyst.daemon.report.plotting import (
    MOST_ROWS,
    draw_side_by_side,
    draw_trace,
    estimate_density,
    white_density,
)
from dehyst.models.signals.error_size import finite_rms
from dehyst.models.units import pick_unit, spell_size, spell_unit

NASTY = "<script>alert('x')</script> & \"a\""
VOID = {"meta", "img"}


class Reader(HTMLParser):
    """Collects tags, words and attributes, and checks that every tag is closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.seen, self.words = [], [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def read(page: Page) -> Reader:
    reader = Reader()
    reader.feed(page.to_html())
    reader.close()
    assert reader.open == []
    return reader


def line(axes) -> str:
    axes.plot([0, 1], [0, 1])
    return NASTY


def test_whatever_is_added_is_escaped_and_closed():
    page = Page(NASTY)
    page.add_heading(NASTY)
    page.add_subheading(NASTY)
    page.add_text(NASTY, "lead")
    page.add_bullets([NASTY])
    page.add_cards([(NASTY, NASTY)])
    page.add_table([NASTY], [[NASTY], [NASTY]], chosen=1)
    page.add_pictures(line)
    with page.open_box(warn=True):
        page.add_share(0.5)
    reader = read(page)
    tags = [tag for tag, _ in reader.seen]
    assert "script" not in tags
    assert reader.words.count(NASTY) == 11
    alt, source = next((a["alt"], a["src"]) for tag, a in reader.seen if tag == "img")
    assert alt == NASTY
    head, data = source.split(",", 1)
    assert head == "data:image/png;base64"
    assert base64.b64decode(data).startswith(b"\x89PNG")


def test_a_page_suits_telephones_and_dark_screens():
    html = Page("x").to_html()
    assert 'name="viewport"' in html
    assert "prefers-color-scheme:dark" in html
    assert '<html lang="en">' in html
    assert "url(" not in html


@pytest.mark.parametrize(("share", "width"), [(-0.2, "0%"), (0.256, "26%"), (1.7, "100%")])
def test_a_share_stays_in_its_bar(share, width):
    page = Page("x")
    page.add_share(share)
    assert f"width:{width}" in page.to_html()


def test_pictures_side_by_side_are_one_png():
    png = draw_side_by_side([line, line, line], (1.0, 1.0, 2.0))
    width, height = struct.unpack(">II", png[16:24])
    assert width > 2 * height
    assert draw_side_by_side([line, line, line], (1.0, 1.0, 2.0)) == png  # independent of the run


def test_a_long_trace_keeps_its_peak():
    y = np.zeros(100_000)
    y[54_321] = 7.0
    shown = {}

    def draw(axes) -> str:
        draw_trace(axes, np.arange(y.size) * 1e-3, y, "black", "y")
        shown["top"] = axes.collections[0].get_paths()[0].vertices[:, 1].max()
        return "a peak"

    Page("x").add_pictures(draw)
    assert shown["top"] == 7.0


def test_white_noise_lies_on_its_line():
    noise = 0.3 * np.random.default_rng(1).standard_normal(200_000)
    f, density = estimate_density([noise], 1e-3)
    assert np.median(density[f > 10]) == pytest.approx(white_density(0.3, 1e-3), rel=0.05)
    assert finite_rms(np.r_[noise, np.nan]) == pytest.approx(0.3, rel=0.02)
    assert finite_rms(np.array([np.nan])) == 0.0
    behind = np.r_[noise, np.full(MOST_ROWS, np.nan)]  # the end of a long recording is missing
    assert estimate_density([behind], 1e-3)[1] == pytest.approx(density)


def test_units_are_written_for_people():
    assert pick_unit("um", 0.02) == (1e3, "nm")
    assert pick_unit("um", 1.2) == (1.0, "um")
    assert pick_unit("v", 0.02) == (1.0, "v")
    assert [spell_unit(u) for u in ("v", "v/s", "um/v^2", "um", "1/decade")] == [
        "V", "V/s", "um/V^2", "um", "1/decade"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.81e-3, "s", "1.81 ms"),
        (99e-6, "s", "99 us"),
        (2.5, "s", "2.5 s"),
        (0.0133, "um", "13.3 nm"),
        (1.2, "um", "1.2 um"),
        (1912.0, "v/s", "1910 V/s"),
        (0.00893, "1/decade", "0.00893 1/decade"),
    ],
)
def test_sizes_are_reported_in_a_unit_that_suits_them(value, unit, text):
    assert spell_size(value, unit) == text
