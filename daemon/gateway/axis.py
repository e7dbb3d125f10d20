"""One axis in the gateway: its keys, rings, admission and publisher."""

from functools import partial

from dehyst.daemon import clock
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.session import Bus
from dehyst.daemon.config import Config
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.command_intake import AxisInbox
from dehyst.daemon.gateway.core_rings import CoreRings
from dehyst.daemon.gateway.in_play import read_in_play, write_in_play
from dehyst.daemon.gateway.lease import Lease
from dehyst.daemon.gateway.publisher import Publisher, Served


class ServedAxis:
    """One served axis. config: the axis's; served: what the gateway reports about itself."""

    def __init__(self, config: Config, bus: Bus, served: Served) -> None:
        self.config, self.keys = config, Keys(config.bus.base, config.name)
        rings = CoreRings(config.directory)
        lease = Lease(round(config.setpoint.lease_s * clock.NS))
        setpoint = config.setpoint
        admission = Admission("", setpoint.queue_s, setpoint.stale_s, lease, setpoint.stay)
        self.publisher = Publisher(config, bus, self.keys, rings, admission, served)
        admission.decide_offer = self.publisher.doctor_desk.decide
        admission.report = self.publisher.report_later
        admission.keep = partial(write_in_play, config.directory)
        admission.begun = read_in_play(config.directory)
        self.inbox = AxisInbox(bus, self.keys, rings, admission)
