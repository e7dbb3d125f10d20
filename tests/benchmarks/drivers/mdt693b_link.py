"""How fast the MDT693B driver writes, through pyserial and a pty, with the emulator in a separate
process, as with `dehyst run`.

    python -m tests.benchmarks.drivers.mdt693b_link [SETS]

Four rows: the bare pty (the same bytes, no codec, no checks) as the reference; the driver with a
unit that answers at once, in both dialects; the driver with the default unit. Each row has the
times of one write in milliseconds, and the rate that the driver declared at open().
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.benchmarks.bars import Bars, too_busy

from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.serial_port import SerialPort

MOST_ADDED_MS = 0.5  # a tenth of the period at 200 Hz
AT_ONCE = ["--latency-s", "0", "--jitter-s", "0"]


def percentiles_ms(durations_s: list[float]) -> str:
    ordered = sorted(durations_s)
    picks = (ordered[int(len(ordered) * p / 100)] for p in (50, 99))
    return "".join(f"{1e3 * value:9.3f}" for value in (*picks, ordered[-1]))


def bare(path: str, sets: int) -> tuple[list[float], float]:
    port = SerialPort(path)
    port.write(b"echo=0\r")
    time.sleep(0.1)
    port.read_available()
    durations_s = []
    for index in range(sets):
        start_s = time.perf_counter()
        port.write(b"xvoltage=%.3f\r" % (50.0 + 0.001 * (index % 1000)))
        while not port.read_until_deadline(port._clock() + 1.0):
            pass
        durations_s.append(time.perf_counter() - start_s)
    port.close()
    return durations_s, 0.0


def driven(path: str, sets: int) -> tuple[list[float], float]:
    driver = Mdt693b.from_settings({"port": path})
    driver.open()
    declared_hz = driver.spec.max_rate_hz
    durations_s = []
    for index in range(sets):
        start_s = time.perf_counter()
        driver.write(50.0 + 0.001 * (index % 1000))
        durations_s.append(time.perf_counter() - start_s)
    driver.close()
    return durations_s, declared_hz


def main() -> int:
    busy, bars = too_busy(), Bars()
    sets = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    bare_ms = 0.0
    print(
        f"{'one write, ms':28}{'median':>9}{'99 %':>9}{'longest':>9}{'rate_hz':>10}{'declared':>10}"
    )
    for name, run, options in (
        ("bare pty, 1.10", bare, [*AT_ONCE, "--dialect", "1.10"]),
        ("driver, 1.10, at once", driven, [*AT_ONCE, "--dialect", "1.10"]),
        ("driver, 1.05, at once", driven, [*AT_ONCE, "--dialect", "1.05"]),
        ("driver, default unit", driven, []),
    ):
        with tempfile.TemporaryDirectory() as folder:
            link = str(Path(folder) / "port")
            command = [sys.executable, "-m", "dehyst.drivers.emulated.mdt693b_port", "--link", link]
            process = subprocess.Popen(
                [*command, "--start-v", "50", *options],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                text=True,
            )
            assert process.stdout is not None
            try:
                json.loads(process.stdout.readline())
                durations_s, declared_hz = run(link, sets)
            finally:
                process.terminate()
                process.wait()
                process.stdout.close()
        rate_hz = sets / sum(durations_s)
        declared = f"{declared_hz:10.0f}" if declared_hz else " " * 10
        print(f"{name:28}{percentiles_ms(durations_s)}{rate_hz:10.0f}{declared}")
        median_ms = 1e3 * sorted(durations_s)[len(durations_s) // 2]
        if run is bare:
            bare_ms = median_ms
        elif options and busy:
            bars.cannot(f"{name}: what the driver adds to a bare write", busy)
        elif options:
            added = median_ms - bare_ms
            bars.most(f"{name}: what the driver adds to a bare write", added, MOST_ADDED_MS, "ms")
        if declared_hz and busy:
            bars.cannot(f"{name}: sustained of the declared rate", busy)
        elif declared_hz:  # a declared rate that is not sustained makes a loop late
            bars.least(f"{name}: sustained of the declared rate", rate_hz / declared_hz, 1.0)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
