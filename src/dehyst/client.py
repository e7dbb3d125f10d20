"""The client class for users' own programs: see dehyst.daemon.client.client."""

from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.finding import daemons
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.player import Played
from dehyst.daemon.rings.records import Flag, State
from dehyst.models.errors import DehystError

__all__ = [
    "BusError",
    "Client",
    "DehystError",
    "Flag",
    "Group",
    "Played",
    "Refusal",
    "State",
    "daemons",
]
