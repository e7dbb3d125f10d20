"""A real Chromium shows the page of `dehyst run` with the emulated amplifier and gauge.

Skipped without Chromium and its driver.
"""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.chromium import PATIENCE_S, Chromium, needs_chromium
from tests.rigs.gateway_bench import Bench, free_port, wait_until
from tests.rigs.page import PageProcess
from tests.rigs.processes import until
from tests.rigs.service import SAFE_V, Service
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import DoctorReport, Event, FoundEffect, ModelOffer
from dehyst.daemon.bus.session import Bus
from dehyst.daemon.bus.topics import DOCTOR, EVENT, subject
from dehyst.daemon.files.models import save_model
from dehyst.models.errors import DehystError

pytestmark = needs_chromium
MARKUP = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("browser")
    save_model(kept_model(), folder / "model.toml")
    service = Service(folder, folder / "model.toml")
    service.page_port = free_port()  # type: ignore[attr-defined]
    text = service.config.read_text()
    page = f'[page]\nlisten = "127.0.0.1:{service.page_port}"\n'  # type: ignore[attr-defined]
    service.config.write_text(text + page)
    try:
        service.start()
        yield service
    finally:
        service.close()


@pytest.fixture(scope="module")
def window(service: Service) -> Iterator[Chromium]:
    window = Chromium()
    try:
        service.client().close()  # returns once the gateway answers
        url = f"http://127.0.0.1:{service.page_port}/"  # type: ignore[attr-defined]

        def served() -> bool:
            window.chrome.get(url)
            return "dehyst" in window.ask("document.title")

        def unafraid() -> bool:
            try:
                return served()
            except Exception:  # connection refused until the page is served
                return False

        window.until("the page is served", unafraid)
        window.until("it is connected", lambda: window.text("link") == "connected")
        yield window
    finally:
        window.close()


def drawn(window: Chromium) -> tuple[int, float]:
    """Return (number of frames drawn so far, time of the newest point)."""
    frames, newest = window.ask("[dehystPage.plots.frames, dehystPage.plots.newest()]")
    return int(frames), float(newest or 0.0)


def test_it_loads_and_what_it_shows_moves(window: Chromium) -> None:
    assert window.ask("document.getElementById('state').textContent") != "no status yet"
    window.until("points come", lambda: drawn(window)[1] > 0)
    frames, newest = drawn(window)
    window.until("they move", lambda: drawn(window)[1] > newest + 1 and drawn(window)[0] > frames)
    assert abs(drawn(window)[1] - time.time()) < 10.0
    painted = window.ask(
        "[...document.querySelectorAll('#plot-position canvas')].map(c => c.getContext('2d')"
        ".getImageData(0, 0, c.width, c.height).data.some(v => v > 0))"
    )
    assert painted == [True]
    assert window.text("reach") == "reach, µm"
    assert "Hz" in window.text("deadlines")
    assert "operators" in window.text("model")
    window.until(
        "events from before it was connected", lambda: "the loop runs" in window.text("events")
    )
    assert window.text("events").count("the loop runs") == 1
    assert window.complaints() == []


def test_a_set_point_arrives_at_the_amplifier_and_stop_works(
    window: Chromium, service: Service
) -> None:
    before = service.bench.output()[0][-1]
    window.write("target", "8")
    window.write("seconds", "120")
    window.click("go")
    window.until("it runs", lambda: "running" in window.text("state"))
    until(lambda: service.output() > 40.0, PATIENCE_S, "the amplifier's output is up")
    window.until("measured", lambda: abs(window.ask(NEWEST_MEASURED) - 8.0) < 1.0)
    window.click("stop")
    window.until("stopped", lambda: "stopped" in window.text("said"))
    until(lambda: abs(service.output() - SAFE_V) < 0.05, PATIENCE_S, "the safe voltage")
    window.until("ready", lambda: window.text("state") == "ready")
    time_ns, volts = service.bench.output()
    since = volts[time_ns > before]
    top = int(np.argmax(since))
    assert since[top] > 40.0
    assert since[-1] == pytest.approx(SAFE_V, abs=0.05)
    assert np.all(np.diff(since[top:]) <= 0.05)  # the output ramps down and never rises again


NEWEST_MEASURED = "dehystPage.plots.y[1].filter(v => v !== null).at(-1)"


def test_keys_pause_windows_and_stop(window: Chromium, service: Service) -> None:
    from selenium.webdriver.common.keys import Keys as Key

    body = window.chrome.find_element("tag name", "body")
    window.ask("document.activeElement.blur()")
    body.send_keys("6")
    window.until("a minute", lambda: window.ask("dehystPage.plots.window_s") == 60)
    body.send_keys("p")
    assert window.ask("dehystPage.plots.paused") is True
    newest = drawn(window)[1]
    time.sleep(0.5)
    assert drawn(window)[1] == newest
    body.send_keys("0")
    window.until("live", lambda: drawn(window)[1] > newest)
    body.send_keys("4", "g", "7", Key.ENTER)
    window.until("going", lambda: "going to 7 µm" in window.text("said"))
    window.chrome.find_element("id", "target").send_keys(Key.ESCAPE)
    window.until("stopped", lambda: "stopped" in window.text("said"))


def aimed(window: Chromium, um: float) -> bool:
    """Return whether the newest target of the loop is `um` [um]."""
    aim = window.ask("dehystPage.now.aim")
    return aim is not None and abs(aim - um) < 1e-6


def test_arrows_step_and_space_stops_whatever_has_the_focus(window: Chromium) -> None:
    from selenium.webdriver.common.keys import Keys as Key

    body = window.chrome.find_element("tag name", "body")
    window.write("seconds", "60")
    window.write("step", "0.25")
    window.write("target", "7")
    window.click("go")
    window.until("there", lambda: aimed(window, 7.0))
    assert window.ask("document.activeElement.id") == "go"
    body.send_keys(Key.ARROW_UP)
    window.until("a step up", lambda: aimed(window, 7.25))
    for key, um in ((Key.ARROW_RIGHT, 7.5), (Key.ARROW_DOWN, 7.25), (Key.ARROW_LEFT, 7.0)):
        time.sleep(0.15)  # a held key repeats ten times a second
        body.send_keys(key)
        window.until(f"a step to {um}", lambda um=um: aimed(window, um))  # type: ignore[misc]
    time.sleep(0.15)
    body.send_keys(Key.SHIFT + Key.ARROW_UP)
    window.until("ten steps", lambda: aimed(window, 9.5))
    window.click("jog-down")
    window.until("by the button", lambda: aimed(window, 9.25))
    focused = window.ask("document.activeElement.id")
    assert focused == "jog-down"
    window.chrome.find_element("id", focused).send_keys(" ")
    window.until("stopped", lambda: "stopped" in window.text("said"))
    window.until("no target", lambda: window.ask("dehystPage.now.aim") is None)
    time.sleep(0.5)
    assert "stopped" in window.text("said")  # the button was not pressed


def test_steps_end_at_the_reach(window: Chromium) -> None:
    from selenium.webdriver.common.keys import Keys as Key

    window.write("step", "1000")
    window.ask("document.activeElement.blur()")
    body = window.chrome.find_element("tag name", "body")
    body.send_keys(Key.ARROW_UP)
    most = window.ask("dehystPage.now.reach()")[1]
    window.until("the end", lambda: aimed(window, most))
    time.sleep(0.15)
    body.send_keys(Key.ARROW_UP)
    window.until("words", lambda: "is the end of the reach" in window.text("said"))
    body.send_keys(" ")
    window.until("stopped", lambda: "stopped" in window.text("said"))
    window.write("step", "0.1")


def go_to_8(window: Chromium) -> None:
    """Send the stage to 8 um; return when the target is there."""
    window.write("target", "8")
    window.write("seconds", "60")
    window.click("go")
    window.until("there", lambda: aimed(window, 8.0))


def test_where_the_stage_is_stands_there_large(window: Chromium) -> None:
    go_to_8(window)
    window.until("measured", lambda: abs(float(window.text("now-measured")) - 8.0) < 0.5)
    window.until("its figure", lambda: window.text("now-target") == "8.000")
    error = float(window.text("now-error").replace("−", "-"))
    assert abs(error) < 0.5
    assert 20.0 < float(window.text("now-volts")) < 120.0
    high = "document.getElementById('now-measured').getBoundingClientRect().height"
    assert window.ask(high) > 3 * window.ask(high.replace("now-measured", "target-unit"))


def test_hold_holds_in_motion_and_at_rest(window: Chromium, service: Service) -> None:
    go_to_8(window)
    window.click("hold")
    window.until("held", lambda: "holding 8 µm" in window.text("said"))
    window.click("release")
    window.until("at rest", lambda: window.text("state") == "ready")
    before = service.output()
    assert before == pytest.approx(SAFE_V, abs=0.05)
    window.click("hold")
    window.until("held", lambda: "holding the present voltage" in window.text("said"))
    time.sleep(1.0)
    assert "cannot be reached" not in window.text("said")
    assert service.output() == pytest.approx(before, abs=0.05)
    window.click("stop")
    window.until("stopped", lambda: "stopped" in window.text("said"))


def trajectory(path: Path, middle: float, points: int = 400) -> Path:
    """Write a file with one second of a sine around `middle` [um]; return its path."""
    t_s = np.arange(points) / points
    target = middle + np.sin(2 * np.pi * t_s)
    path.write_text(
        "t_s,target_um\n" + "".join(f"{t:.6f},{y:.6f}\n" for t, y in zip(t_s, target, strict=True))
    )
    return path


NOTE_JOBS = """(() => {
  const send = window.fetch;
  window.jobs = [];
  window.fetch = async (...what) => {
    const answer = await send(...what);
    if (what[0].startsWith("upload/")) window.jobs.push((await answer.clone().json()).number);
    return answer;
  };
})()"""
STATE_OF_FIRST_JOB = """(() => {
  if (!window.jobs.length) return "sending";
  const asked = new XMLHttpRequest();
  asked.open("GET", `job/${window.jobs[0]}`, false);
  asked.send();
  return JSON.parse(asked.responseText).state;
})()"""


def test_a_file_that_is_given_while_another_is_checked_shows_its_own_figures(
    window: Chromium, tmp_path: Path
) -> None:
    first = trajectory(tmp_path / "first.csv", 6.0)
    second = trajectory(tmp_path / "second.csv", 12.0, points=777)
    field = window.chrome.find_element("id", "file")
    shown = "!document.getElementById('preview').hidden"
    window.ask(NOTE_JOBS)
    field.send_keys(str(first))
    window.click("as-trajectory")
    field.send_keys(str(second))  # while the first file is still being checked
    assert "second.csv" in window.text("job-text")
    window.until("the first file is checked", lambda: window.ask(STATE_OF_FIRST_JOB) == "done")
    time.sleep(2.0)  # longer than the page takes to ask for it again
    assert not window.ask(shown)
    assert "second.csv" in window.text("job-text")
    window.click("as-trajectory")
    window.until("its figures", lambda: window.ask(shown))
    assert "777 points" in window.text("preview-figures")
    assert "11 to 13 µm" in window.text("preview-figures")
    assert window.text("play") == "play second.csv"
    labels = window.ask(
        "[...document.querySelectorAll('#plot-preview .u-series:not(.quiet) th')]"
        ".map(e => e.textContent)"
    )
    assert labels == ["target", "reach"]
    field.send_keys(str(first))  # which removes the preview of the second file
    assert not window.ask(shown)
    assert window.ask("dehystPage.plots.paused") is False


def recording(path: Path, width: float) -> Path:
    """Write a recording of a stage with one hysteresis loop of this width; return its path."""
    t_s = np.arange(0.0, 20.0, 0.02)
    drive = 75.0 - 75.0 * np.cos(2 * np.pi * 0.2 * t_s) * np.exp(-t_s / 20.0)
    drive *= np.minimum(1.0, t_s / 2.0)
    um = play_operator(drive, width) / 10.0
    um += 0.005 * np.random.default_rng(3).normal(size=t_s.size)
    rows = "".join(f"{t:.2f},{u:.5f},{y:.5f}\n" for t, u, y in zip(t_s, drive, um, strict=True))
    path.write_text("t_s,u_v,y_um\n" + rows)
    return path


def play_operator(drive: np.ndarray, width: float) -> np.ndarray:
    out, at = np.zeros_like(drive), 0.0
    for i, u in enumerate(drive):
        at = max(u - width, min(u + width, at))
        out[i] = at
    return out


def test_what_was_found_of_a_recording_stays_when_another_file_is_given(
    window: Chromium, tmp_path: Path
) -> None:
    first, second = (recording(tmp_path / f"{n}.csv", w) for n, w in (("one", 5.0), ("two", 8.0)))
    field = window.chrome.find_element("id", "file")
    found = "!document.getElementById('job-said').hidden"
    listed = "[...document.querySelectorAll('#earlier summary')].map(e => e.textContent)"
    field.send_keys(str(first))
    window.click("as-identify")
    wait_until("the first", lambda: window.ask(found), 300.0)
    said = window.text("job-said")
    assert window.ask(listed) == []
    field.send_keys(str(second))
    assert window.ask(listed) == ["one.csv: identify"]
    assert window.ask("document.querySelector('#earlier pre').textContent") == said
    for what in ("report", "model"):
        href = f"document.querySelector('#earlier a[href$={what}]').href"
        assert window.ask(f"fetch({href}).then(answer => answer.status)") == 200
    window.click("as-identify")
    field.send_keys(str(trajectory(tmp_path / "way.csv", 6.0)))  # during the second's job
    assert window.ask(listed) == ["one.csv: identify"]
    both = ["two.csv: identify", "one.csv: identify"]
    wait_until("the second", lambda: window.ask(listed) == both, 300.0)
    assert "way.csv" in window.text("job-text")


def test_a_zoom_asks_for_what_is_finer(window: Chromium) -> None:
    window.ask("document.activeElement.blur()")
    window.chrome.find_element("tag name", "body").send_keys("5")
    shown = "(({min, max}) => max - min)(dehystPage.plots.plots.position.scales.x)"
    window.until("half a minute", lambda: abs(window.ask(shown) - 30.0) < 0.1)
    window.until("its points", lambda: window.ask("dehystPage.plots.x.length") > 50)
    window.ask(
        "(() => { const p = dehystPage.plots.plots.position, w = p.bbox.width / devicePixelRatio;"
        "p.setSelect({left: 0.9 * w, width: 0.08 * w, top: 0, height: 9}); })()"
    )
    window.until("the stretch", lambda: window.ask("dehystPage.plots.range !== null"))
    first, end = window.ask("dehystPage.plots.range")
    assert 1.0 < end - first < 4.0
    ends = "[dehystPage.plots.x[0], dehystPage.plots.x.at(-1), dehystPage.plots.x.length]"
    window.until("its points", lambda: window.ask(ends)[0] > first - 1.0)
    assert window.ask(ends)[1] < end + 1.0
    assert window.ask(ends)[2] > 50
    window.click("live")
    newest = drawn(window)[1]
    window.until("live again", lambda: drawn(window)[1] > newest + 1)


def test_an_event_with_markup_stays_text(window: Chromium, service: Service) -> None:
    now_ns = time.monotonic_ns()
    event = Event(time_ns=now_ns, wall_ns=time.time_ns(), level=2, code="<b>code</b>", text=MARKUP)
    with Bus.connect([f"tcp/127.0.0.1:{service.port}"]) as bus:
        sender = bus.sender(Keys("dehyst", "test").pubsub(subject(EVENT)), EVENT)
        until(lambda: sender.put(encoding.encode(event)) or MARKUP in window.text("events"))
    assert window.ask("document.querySelectorAll('#events img, #events script').length") == 0
    assert "<b>code</b>" in window.text("events")
    assert "owned" not in window.chrome.title
    assert window.complaints() == []


def test_what_the_doctor_found_is_shown_and_markup_in_it_stays_text(
    window: Chromium, service: Service
) -> None:
    found = DoctorReport(
        case="mismatch-1", time_ns=time.monotonic_ns(), wall_ns=time.time_ns(), changed_wall_ns=1,
        state="found", verdict="explained", says=MARKUP, unit="um", noise=0.02, rms_in_use=0.3,
        rms_augmented=0.02, experiment=("excite", MARKUP),
        effects=(FoundEffect(name="lag", acts_on="drive", share=0.9, says=MARKUP),),
        offer=ModelOffer(
            number=2**61 + 1, seconds=10.0, rms_in_use=0.3, rms_offered=0.03, noise=0.02,
            trial_s=10.0,
        ),
    )  # fmt: skip
    with Bus.connect([f"tcp/127.0.0.1:{service.port}"]) as bus:
        sender = bus.sender(Keys("dehyst", "test").pubsub(subject(DOCTOR)), DOCTOR)
        until(lambda: sender.put(encoding.encode(found)) or MARKUP in window.text("doctor-says"))
    assert MARKUP in window.text("doctor-effects")
    assert "0.3 becomes 0.03" in window.text("doctor-figures")
    assert window.ask("document.querySelectorAll('#doctor img, #doctor script').length") == 0
    assert window.ask("document.querySelectorAll('#model-loop polyline').length") == 2
    accept = window.chrome.find_element("id", "accept")
    assert accept.is_enabled()
    accept.click()  # the daemon does not know this offer, but must be asked for exactly this number
    window.until("refused", lambda: "no such offer" in window.text("said"))
    assert "owned" not in window.chrome.title
    assert window.complaints() == []


def test_accepting_asks_where_the_trajectory_in_play_may_be_cut(
    window: Chromium, service: Service
) -> None:
    """Before a model is accepted, the page states what this does to the trajectory in play and asks
    for confirmation; after "no", nothing is decided."""
    offer = ModelOffer(
        number=77, seconds=10.0, rms_in_use=0.3, rms_offered=0.03, noise=0.02, trial_s=10.0,
        reach_in_use=(0.0, 20.0), reach_offered=(1.0, 20.0),
    )  # fmt: skip
    found = DoctorReport(
        case="mismatch-2", time_ns=time.monotonic_ns(), wall_ns=time.time_ns(), changed_wall_ns=1,
        state="found", verdict="explained", says="Found: creep.", unit="um", noise=0.02,
        rms_in_use=0.3, rms_augmented=0.02, effects=(), offer=offer,
    )  # fmt: skip
    with Bus.connect([f"tcp/127.0.0.1:{service.port}"]) as bus:
        sender = bus.sender(Keys("dehyst", "test").pubsub(subject(DOCTOR)), DOCTOR)
        put = lambda: sender.put(encoding.encode(found))  # noqa: E731
        until(lambda: put() or "reach:" in window.text("doctor-figures"))
    accept = window.chrome.find_element("id", "accept")
    question = window.chrome.find_element("id", "question")
    t_s = np.arange(0.0, 60.0, 0.01)
    over = threading.Event()
    with service.client() as client:

        def play() -> None:
            while not over.is_set():  # again where this machine stood still and it starved
                with suppress(DehystError):
                    client.play(t_s, 8.0 + np.sin(t_s))

        player = threading.Thread(target=play, daemon=True)
        player.start()
        window.until("it plays", lambda: not client.status().trajectory_done)
        window.until("the page knows it", lambda: "running" in window.text("state"))
        for answer, follows in (("no", "Found: creep"), ("yes", "no such offer")):
            accept.click()
            window.until("it asks", question.is_displayed)
            assert "may leave the new reach" in window.text("question-text")
            question.find_element("css selector", f"button[value={answer}]").click()
            window.until("it has closed", lambda: not question.is_displayed())
            where = "doctor-says" if answer == "no" else "said"
            window.until("what follows", lambda f=follows, w=where: f in window.text(w))  # type: ignore[misc]
        over.set()
        client.stop()
        player.join(20.0)
    assert window.complaints() == []


def test_a_daemon_that_starts_is_shown_as_starting(window: Chromium, tmp_path: Path) -> None:
    bench = Bench(tmp_path, start=False)
    page = None
    try:
        bench.start_gateway()
        page = PageProcess(bench.address, log=tmp_path / "page.txt")
        window.chrome.switch_to.new_window("tab")
        window.chrome.get(page.url)
        window.until("it starts", lambda: window.text("state") == "starting")
        assert "it takes commands when it is ready" in window.text("reason")
        assert not window.chrome.find_element("id", "go").is_enabled()
        assert window.chrome.find_element("id", "stop").is_enabled()
        bench.start_loop()
        bench.has_loop = True
        window.until("it is ready", lambda: window.text("state") == "ready")
        window.until("its reach", lambda: window.text("reach") == "reach, µm")
        assert window.chrome.find_element("id", "go").is_enabled()
    finally:
        window.chrome.close()
        window.chrome.switch_to.window(window.chrome.window_handles[0])
        if page is not None:
            page.close()
        bench.close()


def test_an_observer_sees_and_cannot_command(window: Chromium, service: Service) -> None:
    folder = service.folder
    page = PageProcess(f"tcp/127.0.0.1:{service.port}", "--observe", log=folder / "observe.txt")
    try:
        window.chrome.switch_to.new_window("tab")
        window.chrome.get(page.url)
        window.until("it is connected", lambda: window.text("link") == "connected")
        window.until("it moves", lambda: drawn(window)[1] > 0)
        assert window.text("who") == "observer"
        for button in ("stop", "hold", "release", "target", "accept", "reject"):
            assert not window.chrome.find_element("id", button).is_enabled(), button
        before = service.output()
        window.ask("dehystPage.ask({ask: 'go', value: 8, seconds: 5})")  # bypasses the buttons
        window.until("refused", lambda: "observer" in window.text("said"))
        assert service.output() == pytest.approx(before, abs=0.05)
    finally:
        window.chrome.close()
        window.chrome.switch_to.window(window.chrome.window_handles[0])
        page.close()


def process_of(service: Service, verb: str) -> int:
    """Return the pid of the supervisor's child that runs this verb, or 0 if there is none."""
    assert service.supervisor is not None
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if parent == service.supervisor.pid and verb.encode() in words:
            found.append(int(folder.name))
    return found[0] if found else 0


def test_a_killed_gateway_and_a_killed_page_come_back(window: Chromium, service: Service) -> None:
    for verb in ("gateway", "page"):
        pid = process_of(service, verb)
        assert pid
        os.kill(pid, signal.SIGKILL)
        until(lambda old=pid, v=verb: process_of(service, v) not in (0, old), PATIENCE_S, verb)  # type: ignore[misc]
        newest = time.time()  # on a quiet machine it is back before the page shows a gap
        window.until("it is drawn again", lambda n=newest: drawn(window)[1] > n + 1)  # type: ignore[misc]


def test_on_a_telephone_nothing_is_wider_than_the_screen(service: Service) -> None:
    window = Chromium(390, 844)
    try:
        window.chrome.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True},
        )
        window.chrome.get(f"http://127.0.0.1:{service.page_port}/")  # type: ignore[attr-defined]
        window.until("it is connected", lambda: window.text("link") == "connected")
        window.until("it moves", lambda: drawn(window)[1] > 0)
        assert window.ask("document.documentElement.scrollWidth") == 390
        wide = window.ask(
            "[...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right"
            " > 391).map(e => e.id || e.tagName)"
        )
        assert wide == []
    finally:
        window.close()
