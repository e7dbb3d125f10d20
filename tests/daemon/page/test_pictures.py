"""The page's layout in a real Chromium: on a phone, a desktop and a 4K screen, with one axis and
with three, in light and dark.

    DEHYST_PICTURES=docs python -m pytest -n 0 tests/daemon/page/test_pictures.py

rewrites the pictures of docs/page.md and docs/doctor.md.
"""

import io
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from PIL import Image
from tests.daemon.doctor.test_examination import lay
from tests.rigs.axes_bench import AxesBench
from tests.rigs.chromium import Chromium, needs_chromium
from tests.rigs.gateway_bench import Bench
from tests.rigs.page import PageProcess

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import DoctorReport
from dehyst.daemon.bus.session import Bus
from dehyst.daemon.bus.topics import DOCTOR, subject
from dehyst.daemon.doctor.examination import examine
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case
from dehyst.daemon.gateway.doctor_report import describe_report
from dehyst.models.errors import DehystError

pytestmark = needs_chromium
WRITTEN = os.environ.get("DEHYST_PICTURES", "")
LARGEST_BYTES = 400_000
SCREENS = {360: (780, 2.0), 1280: (900, 1.0), 3840: (2160, 1.0)}
"""Width [px] -> (height [px], device pixels per CSS pixel)."""


@dataclass
class Scene:
    """A page that shows a moving stage."""

    page: PageProcess
    axes: int
    began: float


def in_circles(play: Callable[[np.ndarray, list[np.ndarray]], Any], over: threading.Event) -> None:
    """Play the same path repeatedly until `over` is set."""
    t_s = np.arange(0.0, 60.0, 0.02)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, t_s / 2))
    ways = [
        5.6 + a * rise * np.sin(2 * np.pi * f * t_s) for a, f in ((3, 0.33), (3, 0.22), (1, 0.1))
    ]
    while not over.is_set():
        try:
            play(t_s, ways)
        except DehystError:
            time.sleep(0.2)


@pytest.fixture(scope="module", params=[1, 3])
def scene(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Scene]:
    folder, over = tmp_path_factory.mktemp("scene"), threading.Event()
    bench = Bench(folder) if request.param == 1 else AxesBench(folder)
    page = None
    player: threading.Thread | None = None
    try:
        bench.start_gateway()
        page = PageProcess(bench.address, log=folder / "page.txt")

        def progress(_at_s: float, _total_s: float) -> None:
            if over.is_set():
                raise DehystError("the pictures are taken")

        if isinstance(bench, Bench):
            client = bench.client("a person")
            task = lambda t, ways: client.play(t, ways[0], progress=progress)  # noqa: E731
        else:
            group = bench.group(label="a person")
            task = lambda t, ways: group.play(  # noqa: E731
                t, dict(zip("xyz", ways, strict=True)), progress=progress
            )
        player = threading.Thread(target=in_circles, args=(task, over))
        player.start()
        yield Scene(page, request.param, time.monotonic())
    finally:
        over.set()
        if player is not None:
            player.join(20.0)
        if page is not None:
            page.close()
        bench.close()


@pytest.fixture(scope="module")
def window() -> Iterator[Chromium]:
    window = Chromium()
    try:
        yield window
    finally:
        window.close()


def show(window: Chromium, scene: Scene, width: int, dark: bool = False) -> int:
    """Show the page on a screen of this width [px]; return the screen's height [px]."""
    height, dense = SCREENS[width]
    window.chrome.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": dense, "mobile": width < 500},
    )
    window.chrome.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]},
    )
    window.chrome.get("about:blank")
    window.complaints()  # drop the complaints of the previous page
    window.chrome.get(scene.page.url)
    window.until("it is connected", lambda: window.text("link") == "connected")
    window.until("its status", lambda: window.ask("dehystPage.status !== null"))
    window.until("points", lambda: window.ask("dehystPage.plots.x.length > 20"))
    if scene.axes > 1:
        window.until("the axes", lambda: window.ask("(dehystPage.axes.drawn || 0) > 0"))
    return height


CARDS = """[...document.querySelectorAll('main .card')].map(card => {
  const box = card.getBoundingClientRect();
  const inside = [...card.querySelectorAll('*')].map(e => e.getBoundingClientRect())
    .filter(b => b.height > 0 && b.width > 0).map(b => b.bottom);
  return {name: card.getAttribute('aria-label'), left: box.left, right: box.right, top: box.top,
    bottom: box.bottom, lowest: Math.max(box.top, ...inside)};
}).filter(c => c.bottom > c.top)"""


@pytest.mark.parametrize("width", SCREENS)
def test_the_most_used_comes_first_and_nothing_is_cut_or_half_empty(
    window: Chromium, scene: Scene, width: int
) -> None:
    height = show(window, scene, width)
    assert window.ask("document.documentElement.scrollWidth") <= width
    wide = (
        "[...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right"
        f" > {width} + 1).map(e => e.id || e.tagName)"
    )
    assert window.ask(wide) == []
    cards = {card["name"]: card for card in window.ask(CARDS)}
    for first in ("where the stage is", "command"):  # visible without scrolling
        assert cards[first]["bottom"] <= height, first
    stop = window.ask("document.getElementById('stop').getBoundingClientRect().toJSON()")
    assert 0 <= stop["top"] < stop["bottom"] <= height
    order = [window.ask(f"document.getElementById('{name}').getBoundingClientRect().top")
             for name in ("now", "files", "model")]  # fmt: skip
    assert order == sorted(order)
    for name, card in cards.items():
        empty = (card["bottom"] - card["lowest"]) / (card["bottom"] - card["top"])
        if name != "events":  # a list that fills over time
            assert empty < 0.5, (name, card)
        for other in cards.values():
            if other is not card:
                assert (
                    card["right"] <= other["left"] + 1
                    or other["right"] <= card["left"] + 1
                    or card["bottom"] <= other["top"] + 1
                    or other["bottom"] <= card["top"] + 1
                ), (name, other["name"])
    letters = window.ask("parseFloat(getComputedStyle(document.body).fontSize)")
    assert letters >= {360: 15, 1280: 14, 3840: 24}[width]
    cell = "'#axes-table td:nth-child(2)'" if scene.axes > 1 else "'#now-measured'"
    large = window.ask(f"parseFloat(getComputedStyle(document.querySelector({cell})).fontSize)")
    assert large >= (1.2 if scene.axes > 1 else 3.0) * letters
    assert window.complaints() == []


def test_all_charts_have_one_axis_of_time(window: Chromium, scene: Scene) -> None:
    show(window, scene, 1280)
    if not window.ask("document.getElementById('more').checked"):
        window.click("more")
    shown = "[...document.querySelectorAll('#plots .plot')].every(p => p.clientHeight > 0)"
    window.until("four charts", lambda: window.ask(shown))
    timed = "Object.values(dehystPage.plots.plots).every(p => p.scales.x.max > 0)"
    window.until("drawn", lambda: window.ask(timed))
    ends = window.ask(
        "(() => { const p = Object.values(dehystPage.plots.plots);"
        "return p.map(q => [q.bbox.left, q.bbox.width, q.scales.x.min, q.scales.x.max]); })()"
    )
    assert all(end == ends[0] for end in ends[1:])
    window.click("more")


def test_noise_at_rest_is_a_small_part_of_the_picture(window: Chromium, scene: Scene) -> None:
    show(window, scene, 1280)
    span, reach = window.ask(
        "(() => { const p = dehystPage.plots, one = p.plots.position; p.pause(true);"
        "p.y[0] = p.x.map(() => 9); p.y[1] = p.x.map((_, i) => 9 + 0.004 * (i % 2));"
        "p.fresh = true; p.tick(); const y = one.scales.y;"
        "return [y.max - y.min, p.reach[1] - p.reach[0]]; })()"
    )
    assert span >= 0.05 * reach


def test_arrows_move_the_axes_of_the_plane(window: Chromium, scene: Scene) -> None:
    from selenium.webdriver.common.keys import Keys as Key

    if scene.axes == 1:
        pytest.skip("one axis has no plane")
    show(window, scene, 1280)
    assert window.text("command-axis") == "axis x"
    window.ask("dehystPage.ask = (asked) => { (window.asked = window.asked || []).push(asked); }")
    window.ask("document.activeElement.blur()")
    body = window.chrome.find_element("tag name", "body")
    for key in (Key.ARROW_RIGHT, Key.ARROW_UP, Key.PAGE_UP, Key.ARROW_LEFT):
        body.send_keys(key)
        time.sleep(0.15)
    asked = window.ask("window.asked")
    names = [one["name"].rpartition("-")[2] for one in asked]
    assert names == ["x", "y", "z", "x"]
    body.send_keys(" ")
    assert window.ask("window.asked.at(-1).ask") == "stop"


@pytest.mark.parametrize("width", SCREENS)
def test_a_picture_can_be_taken(window: Chromium, scene: Scene, width: int, tmp_path: Path) -> None:
    """A screenshot of the page is not empty; with DEHYST_PICTURES it is written to docs."""
    dark = (scene.axes, width) in ((3, 360), (3, 3840))
    height = show(window, scene, width, dark)
    assert window.ask("document.documentElement.dataset.theme") == ("dark" if dark else "light")
    if WRITTEN:
        time.sleep(max(1.0, 18.0 + scene.began - time.monotonic()))
        whole = window.ask("document.documentElement.scrollHeight")
        window.chrome.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": whole if width == 1280 else max(height, min(whole, 1500)),
             "deviceScaleFactor": SCREENS[width][1], "mobile": width < 500},
        )  # fmt: skip
        time.sleep(12.0)
    picture = Image.open(io.BytesIO(window.chrome.get_screenshot_as_png())).convert("RGB")
    assert picture.width == width * SCREENS[width][1]
    assert len(picture.getcolors(1 << 24) or ()) > 50  # something is drawn
    name = f"page{'-axes' if scene.axes > 1 else ''}{'' if width == 1280 else f'-{width}'}.png"
    keep(picture, (Path(WRITTEN) if WRITTEN else tmp_path) / name)


def keep(picture: Image.Image, path: Path) -> None:
    """Save the picture as a small file."""
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
    assert path.stat().st_size < LARGEST_BYTES


def examined(folder: Path) -> DoctorReport:
    """Return the doctor's report on a stage whose amplifier has become slow."""
    kept = cases.get_record(lay(folder, amplifier_tau_s=0.015), cases.CASE, Case)
    assert kept is not None
    name = time.strftime("mismatch-%Y%m%d-%H%M%S")
    case = replace(
        kept, name=name, later_s=10.0, wall_ns=time.time_ns(), time_ns=time.monotonic_ns()
    )
    cases.put_record(folder, cases.CASE, case)
    return describe_report(case, examine(folder), None, (10.0, 60.0))


@pytest.mark.skipif(not WRITTEN, reason="the findings are drawn where pictures are asked for")
def test_the_findings_on_a_telephone(window: Chromium, scene: Scene, tmp_path: Path) -> None:
    if scene.axes > 1:
        pytest.skip("one axis is enough")
    report = examined(tmp_path)
    show(window, scene, 360)
    with Bus.connect([scene.page.address]) as bus:
        sender = bus.sender(Keys("dehyst", "bench").pubsub(subject(DOCTOR)), DOCTOR)

        def heard() -> bool:
            sender.put(encoding.encode(report))
            return "Found: " in window.text("doctor-says")

        window.until("the findings", heard)
    assert window.ask("document.documentElement.scrollWidth") <= 360
    bar, card = window.ask(
        "['header', '#doctor'].map(q => document.querySelector(q).getBoundingClientRect().height)"
    )
    window.chrome.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 360, "height": round(bar + card + 16), "deviceScaleFactor": 2.0, "mobile": True},
    )
    top = "document.querySelector('#doctor').getBoundingClientRect().top"
    window.ask(f"scrollBy(0, {top} - {bar + 8})")
    time.sleep(2.0)
    picture = Image.open(io.BytesIO(window.chrome.get_screenshot_as_png())).convert("RGB")
    keep(picture, Path(WRITTEN) / "page-doctor-telephone.png")
