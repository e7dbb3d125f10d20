"""One output of a Thorlabs KPC101, BPC301 or BPC303 on its USB serial port (APT protocol)."""

from typing import ClassVar

from dehyst.drivers.apt.actuator import HIGHEST_V, AptPiezo
from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.apt.settings import PiezoSettings
from dehyst.drivers.interface import ProtocolError
from dehyst.drivers.kpc101.kinds import ONE_CHANNEL, OneOfThree
from dehyst.drivers.kpc101.settings import Bpc303Settings, Kpc101Settings


class Kpc101(AptPiezo):
    """Thorlabs KPC101 or BPC301 on USB serial, open loop, 75, 100 or 150 V."""

    kind = ONE_CHANNEL
    settings_type: ClassVar[type[PiezoSettings]] = Kpc101Settings

    def _read_limit_v(self, channel: AptChannel) -> float:
        reply = channel.ask("pz_req_outputmaxvolts", "pz_get_outputmaxvolts")
        limit_v = reply.values["voltage_100mv"] / 10.0
        if not 0.0 < limit_v <= HIGHEST_V:
            raise ProtocolError(
                f"{channel.path}: the unit reports a maximum output of {limit_v:g} V, which is "
                "none of the three known limits"
            )
        return float(limit_v)


class Bpc303(OneOfThree, Kpc101):
    """One channel of a Thorlabs BPC303 on USB serial, open loop, 75, 100 or 150 V."""

    settings_type = Bpc303Settings
    settings: Bpc303Settings
