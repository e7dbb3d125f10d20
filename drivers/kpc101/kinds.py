"""The two kinds of units, and the check of a rack's bay before one of its channels is used."""

from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.apt.codec import BAY_OCCUPIED, BAYS, RACK
from dehyst.drivers.apt.link import AptKind
from dehyst.drivers.apt.role import AptRole
from dehyst.drivers.interface import DriverConfigError

ONE_CHANNEL = AptKind("kpc101", models=("KPC101", "BPC301"), prefixes=("113", "41"))
THREE_CHANNELS = AptKind(
    "bpc303", models=("BPC303",), prefixes=("71",), address=RACK, channels=BAYS
)


def check_bay(channel: AptChannel, number: int) -> None:
    """Raise DriverConfigError if the bay of this channel is empty. number: from 1."""
    reply = channel.ask("rack_req_bayused", "rack_get_bayused", to=RACK, bay=number - 1)
    if reply.values["state"] != BAY_OCCUPIED:
        raise DriverConfigError(
            f"{channel.path}: the bay of channel {number} is empty; choose another channel"
        )


class OneOfThree(AptRole):
    """A role of one channel of a BPC303; its settings select the channel."""

    kind = THREE_CHANNELS

    @property
    def number(self) -> int:
        """The channel's number, from 1."""
        return int(self.settings.channel)

    def _check_channel(self, channel: AptChannel) -> None:
        check_bay(channel, self.number)

    def _more_words(self) -> str:
        return f" channel {self.number}"
