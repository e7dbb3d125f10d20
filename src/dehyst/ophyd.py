"""The stage as an ophyd-async device: see dehyst.daemon.client.ophyd_device."""

from dehyst.daemon.client.ophyd_device import OphydStage as Stage

__all__ = ["Stage"]
