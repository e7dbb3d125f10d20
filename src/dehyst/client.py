"""The client class for users' own programs: see dehyst.daemon.client."""

from dehyst.daemon.bus import BusError
from dehyst.daemon.client import Client, Refusal, daemons
from dehyst.daemon.player import Played
from dehyst.daemon.records import Flag, State

__all__ = ["BusError", "Client", "Flag", "Played", "Refusal", "State", "daemons"]
