"""How long the completion of a put to an axis waits."""

import asyncio
import time
from contextlib import nullcontext
from typing import Any

import pytest

pytest.importorskip("caproto", reason="caproto is not installed")
from dehyst.daemon.client.readings import AxisView
from dehyst.daemon.epics import records
from dehyst.daemon.epics.records import AxisRecords


class _Watched(AxisRecords):
    """An axis whose motion the test gives: a path for `flies_s`, on target `late_s` later."""

    flies_s = late_s = 0.0

    async def _run(self, job: Any, *args: Any) -> None:
        self.begun_s = time.monotonic()

    def _view(self) -> AxisView:
        passed_s = time.monotonic() - self.begun_s
        there = passed_s > self.flies_s + self.late_s
        return AxisView("um", 0.005, 0, 9, 0.1, flying=passed_s < self.flies_s, on_target=there)

    async def _update(self) -> None:
        pass


@pytest.mark.parametrize(("flies_s", "late_s", "done"), [(0.0, 0.3, True), (1.2, 0.3, True),
                                                          (0.3, 9.0, False)])  # fmt: skip
def test_a_put_waits_for_the_end_of_its_path_and_then_as_long_as_it_says(
    monkeypatch: pytest.MonkeyPatch, flies_s: float, late_s: float, done: bool
) -> None:
    monkeypatch.setattr(records, "DONE_S", 0.6)
    axis = _Watched("T", "x", None, None)  # type: ignore[arg-type]
    axis.flies_s, axis.late_s = flies_s, late_s
    with nullcontext() if done else pytest.raises(TimeoutError, match=r"within 0\.6 s"):
        assert asyncio.run(axis._put_motor(axis.motor, 4.0)) == 4.0
