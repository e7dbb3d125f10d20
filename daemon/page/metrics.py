"""Prometheus metrics at `/metrics`, from the newest status of every controller."""

import math
from collections.abc import Iterator

from prometheus_client import CollectorRegistry
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from dehyst.daemon.page.watching import Controllers, Watch
from dehyst.daemon.rings.records import State

STATES = [state.name.lower() for state in State]
QUANTILES = (("0.5", "p50"), ("0.99", "p99"), ("0.999", "p999"), ("1", "max"))


class ControllerMetrics(Collector):
    """Collect metrics from the watches on request."""

    def __init__(self, controllers: Controllers) -> None:
        self._controllers = controllers

    def collect(self) -> Iterator[Metric]:
        """Yield the metric families, each with the samples of all controllers."""
        here = ["controller"]
        up = GaugeMetricFamily(
            "dehyst_up", "1 if status arrives and the loop is running", labels=here
        )
        state = StateSetMetricFamily("dehyst_state", "State of the loop", labels=here)
        error = GaugeMetricFamily(
            "dehyst_error",
            "Measured minus target over the last second, in the displacement unit",
            labels=[*here, "unit", "stat"],
        )
        samples = CounterMetricFamily("dehyst_samples", "Samples of the loop's run", labels=here)
        missed = CounterMetricFamily("dehyst_deadlines_missed", "Deadlines missed", labels=here)
        causes = CounterMetricFamily(
            "dehyst_deadlines_missed_by_cause", "The same by cause", labels=[*here, "cause"]
        )
        wakeup = GaugeMetricFamily(
            "dehyst_wakeup_seconds",
            "Lateness of the loop's wake-up over its last window",
            labels=[*here, "quantile"],
        )
        health = GaugeMetricFamily(
            "dehyst_health",
            "Misfit of stage and model, 1: the largest expected; below 0: learning",
            labels=here,
        )
        mismatch = GaugeMetricFamily(
            "dehyst_mismatch", "1: stage and model do not match", labels=here
        )
        trim = GaugeMetricFamily(
            "dehyst_trim",
            "Slow trim, in the displacement unit",
            labels=[*here, "unit"],
        )
        frozen = GaugeMetricFamily("dehyst_trim_frozen", "1: the trim is frozen", labels=here)
        device = GaugeMetricFamily("dehyst_device_ok", "1: works", labels=[*here, "device"])
        lost = CounterMetricFamily(
            "dehyst_page_lost_samples", "Telemetry that did not reach this page", labels=here
        )
        for name, watch in sorted(dict(self._controllers.watches).items()):
            status = watch.status
            up.add_metric([name], float(alive(watch)))
            if status is None:
                continue
            state.add_metric([name], {s: status.state == s for s in STATES})
            rms, most = watch.error()
            for stat, value in (("rms", rms), ("max", most)):
                if math.isfinite(value):
                    error.add_metric([name, status.unit, stat], value)
            samples.add_metric([name], status.samples)
            missed.add_metric([name], status.missed)
            for cause, count in status.missed_by.items():
                causes.add_metric([name, cause], count)
            for quantile, field in QUANTILES:
                wakeup.add_metric([name, quantile], getattr(status.wake_us, field) * 1e-6)
            health.add_metric([name], status.gateway.health)
            mismatch.add_metric([name], float(bool(status.gateway.mismatch)))
            trim.add_metric([name, status.unit], status.trim)
            frozen.add_metric([name], float(bool(status.trim_frozen)))
            device.add_metric([name, "actuator"], float(status.actuator_ok))
            device.add_metric([name, "sensor"], float(status.sensor_ok))
            lost.add_metric([name], watch.lost)
        yield from (up, state, error, samples, missed, causes, wakeup)
        yield from (health, mismatch, trim, frozen, device, lost)


def alive(watch: Watch) -> bool:
    """Return whether the controller's status arrives and its loop runs."""
    return watch.status is not None and not watch.silent and watch.status.core_alive


def expose(controllers: Controllers, accept: str) -> tuple[bytes, str]:
    """Return (body, content type) of one response."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(ControllerMetrics(controllers))
    encoder, content_type = choose_encoder(accept)
    return encoder(registry), content_type
