"""Processor time of the page's server: telemetry at 10 kHz with no, one and ten browsers.

    python -m tests.benchmarks.daemon.page [--rate 10000] [--for 20]

A browser views 10 s on 1000 pixels; in the last line each views a different length of time. The
kernel counts the processor time of the server's process.
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path

from tests.rigs.gateway_bench import Bench, wait_until
from tests.rigs.page import Browser, PageProcess

WINDOWS = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 10.0)


class Reader(threading.Thread):
    """A browser that reads all it gets."""

    def __init__(self, page: PageProcess, window_s: float) -> None:
        super().__init__(daemon=True)
        self.browser, self.over = Browser(page), False
        self.browser.look(window_s=window_s)
        self.start()

    def run(self) -> None:
        """Read until stopped."""
        while not self.over:
            self.browser.take(0.5)
        self.browser.close()


def samples(page: PageProcess) -> float:
    """Return the loop's sample count, as the page knows it."""
    lines = page.http.get("/metrics").text.splitlines()
    return next(float(x.split()[1]) for x in lines if x.startswith("dehyst_samples_total{"))


def measure(page: PageProcess, windows: list[float], seconds: float) -> tuple[float, float, float]:
    """Return (share of a processor, frames/s per browser, the loop's samples/s)."""
    readers = [Reader(page, window_s) for window_s in windows]
    time.sleep(4.0)  # the initial traffic is higher
    frames = sum(len(r.browser.frames) for r in readers)
    begun_s, used_s, seen = time.monotonic(), page.cpu_s(), samples(page)
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    share = (page.cpu_s() - used_s) / took_s
    rate = (samples(page) - seen) / took_s
    frames = sum(len(r.browser.frames) for r in readers) - frames
    for reader in readers:
        reader.over = True
    for reader in readers:
        reader.join(10.0)
    return share, frames / took_s / max(1, len(readers)), rate


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=float, default=10_000.0)
    parser.add_argument("--for", dest="seconds", type=float, default=20.0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rate = {"rate_hz = 200.0": f"rate_hz = {args.rate}"}
        bench = Bench(folder, **rate, **{"slew_v_per_s = 10000.0": "slew_v_per_s = 4000.0"})
        bench.start_gateway()
        page = PageProcess(bench.address, log=folder / "page.txt")
        try:
            wait_until("it is found", lambda: "dehyst_up" in page.http.get("/metrics").text)
            time.sleep(5.0)
            print(f"{args.rate:g} Hz, {args.seconds:g} s each")
            rows = {
                "no browser": [], "1 browser": [10.0], "10 browsers": [10.0] * 10,
                "10 browsers, 9 lengths of time": list(WINDOWS),
            }  # fmt: skip
            for what, windows in rows.items():
                share, frames, rate = measure(page, windows, args.seconds)
                print(
                    f"{what:32s} {100 * share:5.2f} % of a processor, {frames:4.1f} frames/s "
                    f"each, {rate:.0f} samples/s"
                )
        finally:
            page.close()
            bench.close()


if __name__ == "__main__":
    main()
