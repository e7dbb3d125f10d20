"""What a call of each driver costs, and the rate that the driver declares at open(). Serial units
are emulated in a separate process; vendors' libraries are the tests' stand-ins in C, which answer
at once, so that only this software is measured there.

    python -m tests.benchmarks.drivers.rates [CALLS]

One row for each: median and 99th percentile of a call from Python and, if there is one, of the
function that the compiled loop calls; the declared rate; the rate that this many calls in a row
achieved. The bar: a declared rate is achieved.
"""

import ctypes
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.daqmx import standin as daqmx
from tests.rigs.direct_calls import FUNCTION
from tests.rigs.ljm import standin as ljm
from tests.rigs.sysfs import lay_out

from dehyst.drivers.direct_calls import Reachable
from dehyst.drivers.interface import Actuator
from dehyst.drivers.registry import load_actuator, load_sensor

SERIAL = {"mdt693b": "ksg101", "mdt694b": "", "kpz101": "", "kpc101": "kpc101", "bpc303": "bpc303"}
"""The emulated amplifiers, and the gauge that is measured with each."""

CONVERTER = {
    "name": "ad5592r",
    "out_voltage0_raw": "8738",
    "out_voltage0_scale": "0.1526",
    "in_voltage0_raw": "100",
    "in_voltage0_scale": "0.1",
}

LEAST_SHARE = 0.8  # achieved share of the declared rate: the machine has other work too


def durations_s(call: Callable[[], object], calls: int) -> list[float]:
    took = []
    for _ in range(calls):
        start_s = time.perf_counter()
        call()
        took.append(time.perf_counter() - start_s)
    return sorted(took)


def direct_call(device: Any, value: float) -> Callable[[], object] | None:
    direct = device.direct() if isinstance(device, Reachable) else None
    if direct is None:
        return None
    function, held = FUNCTION(direct.function), ctypes.c_double(value)
    return lambda: function(direct.context, 0, ctypes.byref(held))


def row(name: str, device: Any, calls: int, bars: Bars) -> None:
    """Open, measure, print, close."""
    device.open()
    spec = device.spec
    stands = device.output() if isinstance(device, Actuator) else 0.0
    call = (lambda: device.write(stands)) if isinstance(device, Actuator) else device.read
    by_python = durations_s(call, calls)
    direct = direct_call(device, stands)
    best = by_python if direct is None else durations_s(direct, calls)
    achieved_hz = calls / sum(best)
    shown = [by_python[calls // 2], by_python[calls * 99 // 100]]
    shown += [best[calls // 2], best[calls * 99 // 100]] if direct else []
    text = "".join(f"{1e3 * value:10.4f}" for value in shown) + " " * 10 * (4 - len(shown))
    print(f"{name:<28}{text}{spec.max_rate_hz:12.0f}{achieved_hz:12.0f}")
    title = f"{name}: achieved of the declared rate"
    if busy := too_busy():
        bars.cannot(title, busy)
    else:
        bars.least(title, achieved_hz / spec.max_rate_hz, LEAST_SHARE)
    device.close()


@contextmanager
def emulated(*words: str) -> Iterator[dict[str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "dehyst.daemon.main", "emulate", "--dir", folder, *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())
            process.terminate()


def main() -> int:
    calls = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    bars = Bars()
    print(f"{'calls in ms':<28}{'Python':>10}{'99 %':>10}{'direct':>10}{'99 %':>10}"
          f"{'declared Hz':>12}{'achieved':>12}")  # fmt: skip
    for amplifier, sensor in SERIAL.items():
        with emulated("--amplifier", amplifier) as ports:
            port = ports.get(amplifier, ports.get("mdt693b"))  # also the MDT694B's name
            output = load_actuator(amplifier).from_settings({"port": port})
            row(f"{amplifier} output (emulated)", output, calls, bars)
            if sensor:
                gauge = load_sensor(sensor).from_settings({"port": ports[sensor]})
                row(f"{sensor} gauge (emulated)", gauge, calls, bars)
    patched = pytest.MonkeyPatch()
    with tempfile.TemporaryDirectory() as folder:
        daqmx.Standin(daqmx.compile_library(Path(folder)), patched)
        ljm.plug(ljm.compile_library(Path(folder)), patched)
        voltage = {"channel": "Dev1/ai0", "input": "voltage", "um_per_v": 2.0}
        for name, load, settings in (
            ("nidaqmx output", load_actuator, {"channel": "Dev1/ao0"}),
            ("nidaqmx input", load_sensor, voltage),
            ("nidaqmx, mean of 10, clocked", load_sensor,
             {**voltage, "average": 10, "sample_hz": 100_000.0}),
            ("labjack output", load_actuator, {}),
            ("labjack input, mean of 5", load_sensor, {"um_per_v": 2.0, "average": 5}),
        ):  # fmt: skip
            row(name, load(name.split()[0].strip(",")).from_settings(settings), calls, bars)
    patched.undo()
    with tempfile.TemporaryDirectory() as folder:
        converter = str(lay_out(Path(folder) / "converter", CONVERTER))
        output = load_actuator("iio").from_settings({"path": converter})
        row("iio output (a file)", output, calls, bars)
        gauge = load_sensor("iio").from_settings({"path": converter, "um_per_mv": 0.5})
        row("iio input (a file)", gauge, calls, bars)
    module = "tests.drivers.python_object.amplifier:Amplifier"
    own = {"object": module, "write": "voltage", "output": "voltage", "max_v": 150.0}
    row("python output, a property", load_actuator("python").from_settings(own), calls, bars)
    own = {"object": module, "read": "voltage", "um_per_unit": 0.1, "min_um": 0.0, "max_um": 20.0}
    row("python sensor, a property", load_sensor("python").from_settings(own), calls, bars)
    shared = {"stage": "rates"}
    row("simulated output", load_actuator("simulated").from_settings(shared), calls, bars)
    row("simulated gauge", load_sensor("simulated").from_settings(shared), calls, bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
