"""Driver of the Thorlabs KPZ101 / TPZ001 piezo driver on USB serial (APT protocol), open loop."""

from dehyst.drivers.apt.actuator import AptPiezo
from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.apt.codec import VOLTAGE_LIMITS_V
from dehyst.drivers.apt.link import AptKind
from dehyst.drivers.apt.settings import PiezoSettings
from dehyst.drivers.interface import ProtocolError

KIND = AptKind("kpz101", models=("KPZ101", "TPZ001"), prefixes=("29", "81"))


class Kpz101Settings(PiezoSettings, frozen=True):
    """Settings of one piezo driver."""

    driver = "kpz101"


class Kpz101(AptPiezo):
    """Thorlabs KPZ101 piezo driver on USB serial, open loop, 75, 100 or 150 V."""

    kind = KIND
    settings_type = Kpz101Settings

    def _read_limit_v(self, channel: AptChannel) -> float:
        reply = channel.ask("pz_req_tpz_iosettings", "pz_get_tpz_iosettings")
        code = int(reply.values["voltage_limit"])
        if code not in VOLTAGE_LIMITS_V:
            raise ProtocolError(
                f"{channel.path}: the unit reports an unknown voltage limit, code {code}"
            )
        return VOLTAGE_LIMITS_V[code]
