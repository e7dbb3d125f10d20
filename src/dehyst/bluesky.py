"""The stage as a bluesky device: see dehyst.daemon.client.bluesky_device."""

from dehyst.daemon.client.bluesky_device import BlueskyStage as Stage
from dehyst.daemon.client.positioner import Positioner
from dehyst.daemon.client.readings import Flight, Reading

__all__ = ["Flight", "Positioner", "Reading", "Stage"]
