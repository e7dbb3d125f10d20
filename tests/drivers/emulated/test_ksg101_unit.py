"""The emulated KSG101 alone: bytes in, bytes out, on a clock of its own."""

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import Decoder, encode_apt
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit


def test_a_unit_that_is_served_late_reads_the_moment_at_which_the_reading_was_due() -> None:
    now, asked = [100.0], []

    def position(time_s: float) -> float:
        asked.append(time_s)
        return 3.0 * (time_s - 100.0)  # um, 3 um a second

    unit = Ksg101Unit(Ksg101Knobs(max_travel_um=20.0, latency_s=0.25), position, lambda: now[0])
    unit.feed(encode_apt("tsg_req_reading", source=codec.HOST, destination=codec.UNIT, chan=1))
    assert unit.take() == b""
    now[0] = 101.0  # three quarters of a second late
    (reply,) = Decoder().feed(unit.take())
    assert asked == [100.25]
    assert reply.values["reading"] == round(0.75 / 20.0 * 32767)
