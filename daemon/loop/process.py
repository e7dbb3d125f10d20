"""The core process: it composes models, devices, rings and loop, and has no network.

The start reads configuration and models, opens the devices, checks rates, determines the last known
outputs, makes the rings, warms up the kernels, sets real-time priority and runs the loop. On
SIGTERM each output goes to its `safe.on_stop`. On SIGHUP the models are loaded again outside the
loop and swapped in without a jump, or refused. All axes of a controller share this process, its
clock and its deadline (dehyst.daemon.loop.axes).
"""

import logging
import os
import secrets
import time
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from dehyst.daemon import clock, notify
from dehyst.daemon.config import ChannelConfig, Controller
from dehyst.daemon.loop.axes.core import AxisCore
from dehyst.daemon.loop.channels import Channels
from dehyst.daemon.loop.checks import about_late_replies, check_rates_together, crowded, joined
from dehyst.daemon.loop.compiled_apart import compile_in_two
from dehyst.daemon.loop.compiled_loop import CompiledLoop, direct_of, spin_ns, warm_up
from dehyst.daemon.loop.python_loop import Axis, PythonLoop, Together
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.loop.timing.witness import Witness
from dehyst.daemon.rings.records import State
from dehyst.drivers.interface import DeviceTimeout, Joint, ProtocolError

log = logging.getLogger(__name__)
RUN_BITS = 48  # of a run's random number: no two runs have the same
ATTEMPTS = 3
"""Attempts to open the devices, so that a late reply does not abort the start. A device that is not
plugged in, or refuses a setting, is not tried again."""
PAUSE_S = 1.0
"""Pause between the attempts [s]: a machine or unit stalls for about a second, and nothing moves
yet."""
EXTEND_US = 15_000_000  # by which a report of a core that is stopping extends systemd's limit


Serve = Callable[[Callable[[], None], Callable[[], None]], None]
"""Takes (stop, reload), and calls them from then on when the process must end or reload."""


class Core:
    """One run of the loop's process."""

    def __init__(self, controller: Controller, serve: Serve) -> None:
        self.controller, self._serve = controller, serve
        self.axes = [AxisCore(config, tell_systemd) for config in controller.axes]
        self._by_name = {axis.config.axis: axis for axis in self.axes}
        # drivers measure their rate when they open, so open them at the loop's priority
        with realtime.raised(controller.loop.priority):
            self._joint = self._open_patiently()

    def _open_patiently(self) -> list[tuple[Joint, tuple[int, ...]]]:
        """Call _open; repeat it where a reply is late or out of step."""
        for _ in range(ATTEMPTS - 1):
            try:
                return self._open()
            except (DeviceTimeout, ProtocolError) as error:
                log.warning("%s; the devices are opened again", error)
                time.sleep(PAUSE_S)
        return self._open()

    def _open(self) -> list[tuple[Joint, tuple[int, ...]]]:
        """Open the devices of all axes, or none; return outputs that share a unit, see `joined`."""
        opened: list[AxisCore] = []
        try:
            for axis in self.axes:
                axis.open()
                opened.append(axis)
            return joined([axis.actuator.device for axis in self.axes])
        except BaseException:
            for axis in opened:
                axis.close()
            raise

    def run(self) -> bool:
        """Run until SIGTERM or SIGINT; return True when the outputs are where safe.on_stop requires
        them. Raises DehystError before anything has moved."""
        try:
            self._run()
            return all(axis.at_rest for axis in self.axes)
        finally:
            for axis in self.axes:
                axis.close()

    def _run(self) -> None:
        loop, axes = self.controller.loop, self.axes
        specs = [(axis.actuator.device.spec, axis.sensor.device.spec) for axis in axes]
        every = check_rates_together([axis.config for axis in axes], specs, self._joint)
        self._crowded = crowded(self.controller.period_ns * 1e-9, specs, self._joint)
        for axis in axes:
            axis.begin()
        channels = self._channels()
        channels.start()
        run, awake_ns = secrets.randbits(RUN_BITS) | 1, spin_ns(loop.spin_us, loop.rate_hz)
        for axis, n in zip(axes, every, strict=True):
            axis.prepare(self._by_name, run, n, awake_ns)
        runner = self._engine()
        compile_in_two()
        warm_up([axis.twin() for axis in axes], isinstance(runner, CompiledLoop))
        allowed = tuple(sorted(os.sched_getaffinity(0)))
        cpus = (loop.cpu,) if loop.cpu >= 0 else allowed[:8]
        period_ns = self.controller.period_ns
        witness = Witness(period_ns, cpus, loop.priority, clock.monotonic_ns())
        words = "compiled loop" if isinstance(runner, CompiledLoop) else "Python loop"
        for axis in axes:
            axis.monitor.use_witness(witness)
            axis.say_how(words)
        self._say_of_circles()
        axes[0].stepper.events.extend(about_late_replies(loop.rate_hz, specs, self._joint))
        if isinstance(runner, PythonLoop):
            obtained = self._enter()
            axes[0].stepper.events.extend(obtained.advice)
            for axis in axes:
                axis.monitor.obtained = obtained
        self._serve(self._stop, self._reload)
        notify.send("READY=1")
        try:
            runner.run()
        finally:
            notify.send("STOPPING=1")
            witness.close()
            channels.close()

    def _stop(self) -> None:
        for axis in self.axes:
            axis.monitor.stop()

    def _reload(self) -> None:
        for axis in self.axes:
            axis.reload()
        self._say_of_circles()

    def _enter(self) -> realtime.Obtained:
        """Set the loop's real-time properties for the calling thread."""
        loop = self.controller.loop
        return realtime.enter_realtime(loop.priority, loop.cpu, loop.rate_hz)

    def _engine(self) -> PythonLoop | CompiledLoop:
        """Return the loop that the configuration and the devices allow."""
        wish = self.controller.loop.engine
        first, *others = [axis.monitor for axis in self.axes]
        reachable = all(
            direct_of(link.device) is not None
            for axis in self.axes
            for link in (axis.actuator, axis.sensor)
        )
        if wish == "compiled" or (wish == "auto" and reachable):
            return CompiledLoop(first, self._enter, others)
        checks = [axis.readback_check() for axis in self.axes]
        return PythonLoop(
            first,
            readback=checks[0],
            beside=[Axis(*pair) for pair in zip(others, checks[1:], strict=True)],
            together=[Together(joint, places) for joint, places in self._joint if joint.together],
            crowded=self._crowded,
        )

    def _channels(self) -> Channels:
        """Return the further sensors; one with equal settings in several axes is opened once."""
        configs: dict[tuple[str, str], ChannelConfig] = {}
        heard: dict[tuple[str, str], list[Stepper]] = {}
        for axis in self.axes:
            for name, config in axis.config.channels.items():
                same = [key for key in configs if key[1] == name and configs[key] == config]
                key = same[0] if same else (axis.config.axis, name)
                configs[key] = config
                heard.setdefault(key, []).append(axis.stepper)
        names = {key: ".".join(filter(None, key)) for key in configs}
        by_name = {names[key]: key for key in configs}

        def measured(name: str, value: float) -> None:
            key = by_name[name]
            for stepper in heard[key]:
                stepper.measured(key[1], value)

        def report(text: str) -> None:
            for axis in self.axes:
                axis.stepper.events.append(text)

        return Channels({names[key]: config for key, config in configs.items()}, measured, report)

    def _say_of_circles(self) -> None:
        """Report axes that follow each other's drives in a circle: one of them is a sample late."""
        follows = {
            name: {w.axis for w in axis.followed(axis.stepper.compensator).values() if w.drive}
            for name, axis in self._by_name.items()
        }
        left = dict(follows)
        while free := [name for name, others in left.items() if not others & left.keys()]:
            for name in free:
                del left[name]
        if left:
            names = ", ".join(left)
            self.axes[0].stepper.events.append(
                f"the axes {names} follow each other's drives in a circle: the first of them uses "
                "the drive of the previous sample"
            )


def tell_systemd(status: NDArray[Any]) -> None:
    """Send systemd a watchdog heartbeat; while the output ramps, extend the stop time-out, so that
    systemd waits for its end whatever TimeoutStopSec= is."""
    if int(status["state"][0]) == State.STOPPING:
        notify.send("WATCHDOG=1", "STOPPING=1", f"EXTEND_TIMEOUT_USEC={EXTEND_US}")
    else:
        notify.send("WATCHDOG=1")


def run_core(controller: Controller, serve: Serve) -> int:
    """Run the core process; return its exit code."""
    return 0 if Core(controller, serve).run() else 1
