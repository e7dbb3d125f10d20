"""Serve one browser's WebSocket: the view it shows, its commands, the messages to it.

Every TICK_S a visit is sent the data completed since it was last served. Visits with the same view
share the encoded bytes. A slow browser delays only itself, and receives more at once later.
"""

import asyncio
import contextlib
import math
from collections.abc import Callable
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from dehyst.daemon import notify
from dehyst.daemon.client.offer_change import CUTS
from dehyst.daemon.page import wire
from dehyst.daemon.page.buckets import FINEST_NS, level_between, level_for
from dehyst.daemon.page.commanding import Commander, target_now
from dehyst.daemon.page.jobs import Jobs
from dehyst.daemon.page.people import Person
from dehyst.daemon.page.watching import TICK_S, Controllers, Watch
from dehyst.models.errors import BadInput, DehystError

STATUS_TICKS, BEAT_TICKS = 5, 10  # of 0.1 s: a status twice, a sign of life once per second
MOST_WAITING = 100  # messages that wait to be sent to a browser
MOST_A_TICK = 50
"""Most messages handled per browser and tick; a person sends a few per second."""
STOPPED, RELEASED = "stopped: holding, then to the safe voltage", "released: to the safe voltage"


class Ticks:
    """Wake all visits together, and cache for one tick what they share."""

    def __init__(self) -> None:
        self.number = 0
        self._event = asyncio.Event()
        self._shared: dict[Any, Any] = {}

    async def run(self) -> None:
        """Tick until cancelled."""
        while True:
            await asyncio.sleep(TICK_S)
            self.number += 1
            if self.number % BEAT_TICKS == 0:
                notify.send("WATCHDOG=1")
            self._shared.clear()
            event, self._event = self._event, asyncio.Event()
            event.set()

    async def next(self) -> int:
        """Wait for the next tick and return its number."""
        await self._event.wait()
        return self.number

    def share(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of `make`, called at most once per tick and key."""
        if key not in self._shared:
            self._shared[key] = make()
        return self._shared[key]


class Visit:
    """One WebSocket. person: the user; lasts: whether the session that opened it is still valid."""

    def __init__(
        self,
        socket: WebSocket,
        person: Person,
        controllers: Controllers,
        jobs: Jobs,
        ticks: Ticks,
        lasts: Callable[[], bool],
    ) -> None:
        self.socket, self.person = socket, person
        self.controllers, self.jobs, self.ticks = controllers, jobs, ticks
        self._lasts = lasts
        self._look: wire.Look | None = None
        self._past: wire.Past | None = None
        self._cursor = -1
        self._run = self._event = self._changes = self._findings = self._path = -1
        self._commanders: dict[str, Commander] = {}
        self._waiting: asyncio.Queue[str | bytes] = asyncio.Queue(MOST_WAITING)
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Serve until the browser disconnects or its session ends."""
        tasks = [asyncio.create_task(each()) for each in (self._serve, self._hear, self._last)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for commander in self._commanders.values():
                commander.close()
        for task in tasks:
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await task
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            async with asyncio.timeout(1.0):
                await self.socket.close(1008)

    async def _last(self) -> None:
        while self._lasts():
            await self.ticks.next()

    # -- to the browser -------------------------------------------------------------------------

    async def _serve(self) -> None:
        first = True
        while True:
            number = await self.ticks.next()
            while not self._waiting.empty():
                await self._send(self._waiting.get_nowait())
            await self._serve_past()
            if first or number % STATUS_TICKS == 0:
                await self._send(
                    self.ticks.share(
                        "controllers", lambda: wire.describe_controllers(self.controllers)
                    )
                )
            first = False
            watch = self._watch()
            if watch is not None and self._look is not None:
                await self._serve_watch(watch, self._look, number)

    async def _serve_watch(self, watch: Watch, look: wire.Look, number: int) -> None:
        share = self.ticks.share
        if watch.changes != self._changes:
            self._changes = watch.changes
            await self._send(share((watch, "model"), lambda: wire.describe_model(watch)))
        if watch.findings != self._findings:
            self._findings = watch.findings
            await self._send(share((watch, "doctor"), lambda: wire.encode_doctor_reports(watch)))
        frame, self._cursor, self._run = share(
            (watch, level_for(look.window_s, look.width_px), self._cursor, self._run),
            lambda: self._frame(watch, look),
        )
        if frame:
            await self._send(frame)
        newer = [one for one in list(watch.events) if one[0] > self._event]  # it may grow meanwhile
        if newer:
            self._event, events = newer[-1][0], [said for _, said in newer]
            await self._send(wire.encode_view("events", name=watch.name, events=events))
        if number % STATUS_TICKS == 0:
            await self._send(share((watch, "status"), lambda: wire.describe_status(watch)))
            if len(watch.axes) > 1:
                text, self._path = share(
                    (watch.axes, "axes", self._path),
                    lambda: wire.describe_axes(self.controllers.of_one(watch), self._path),
                )
                await self._send(text)

    def _frame(self, watch: Watch, look: wire.Look) -> tuple[bytes, int, int]:
        level = level_for(look.window_s, look.width_px)
        with watch.lock:
            run = watch.buckets.run
            cursor = self._cursor if run == self._run else -1
            piece = watch.buckets.since(level, cursor, look.window_s)
        frame = b""
        if piece.number.size or piece.anew:
            frame = wire.plot_frame(piece, level, watch.wall_offset_ns)
        return frame, piece.cursor, run

    async def _send(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            await self.socket.send_bytes(message)
        else:
            await self.socket.send_text(message)

    def say(self, text: str, wrong: bool = False) -> None:
        """Send this person a text, from any thread; wrong: it is an error."""
        message = wire.encode_view("said", text=text, wrong=wrong)

        def put() -> None:
            with contextlib.suppress(asyncio.QueueFull):
                self._waiting.put_nowait(message)

        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(put)

    # -- from the browser -----------------------------------------------------------------------

    async def _hear(self) -> None:
        tick, heard = 0, 0
        while True:
            message = await self.socket.receive()
            if message["type"] != "websocket.receive" or not self._lasts():
                return
            try:
                await self._do(wire.read_ask(message))
            except DehystError as error:
                self.say(str(error), True)
            heard = heard + 1 if tick == self.ticks.number else 1
            tick = self.ticks.number
            if heard >= MOST_A_TICK:  # the rest is read in the next tick
                await self.ticks.next()

    async def _do(self, ask: wire.Ask) -> None:
        if isinstance(ask, wire.Look):
            if self._look is None or self._look.name != ask.name:
                self._event = self._changes = self._findings = self._path = -1
            self._look, self._cursor = ask, -1
            return
        watch = self._watch()
        if watch is None:
            raise BadInput("no controller is chosen, or it is no longer known")
        if isinstance(ask, wire.Past):
            self._past = ask  # replaces an earlier request
            return
        if not self.person.commands:
            raise BadInput("an observer may view, not command")
        if isinstance(ask, wire.DecideOffer):
            if ask.action == "accept" and not ask.confirmed and watch.is_cut_by(int(ask.offer)):
                await self._send(wire.encode_view("question", text=CUTS, offer=ask.offer))
                return
            await asyncio.to_thread(watch.decide_offer, ask.action, int(ask.offer))
            self.say(f"{ask.action}: in progress")
            return
        commander = self._commander(watch)
        if isinstance(ask, wire.Stop):
            for watch_of in self.controllers.of_one(watch):
                if watch_of is not watch and watch_of.name in self._commanders:
                    self._commanders[watch_of.name].end_task()
            await asyncio.to_thread(commander.stop, ask.at_once)
            self.say(RELEASED if ask.at_once else STOPPED)
        elif isinstance(ask, wire.Go):
            if not math.isfinite(ask.value):
                raise BadInput("the set-point must be a finite number")
            self._commander(self._axis(watch, ask.name)).go(ask.value, ask.seconds, ask.take_over)
        elif isinstance(ask, wire.HoldAsked):
            held = self.controllers.of_one(watch) if ask.everywhere else [watch]
            for one in held:
                self._commander(one).hold(target_now(one.newest), ask.seconds, ask.take_over)
        else:
            self._play(watch, commander, ask)

    def _axis(self, watch: Watch, name: str) -> Watch:
        """Return an axis of the shown controller by its name on the bus; "": the shown axis.
        Raises BadInput."""
        for one in self.controllers.of_one(watch):
            if name in ("", one.name):
                return one if name else watch
        raise BadInput(f"{name} is not an axis of this controller")

    def _play(self, watch: Watch, commander: Commander, ask: wire.Play) -> None:
        job = self.jobs.get(ask.job)
        if job is None:
            raise BadInput("this trajectory is no longer kept; upload it again")
        of_one = self.controllers.of_one(watch)
        names = {one.name for one in of_one} if job.result.get("axes") else {watch.name}
        if job.controller not in names:
            raise BadInput(
                f"{job.file} was checked for {job.controller}, and {watch.name} is shown: show "
                f"{job.controller}, or give the file again"
            )
        if job.result.get("outside", 1.0) > 0:
            raise BadInput(f"{job.file} leaves the reach; shift or scale it")
        t_s, targets = job.trajectory()
        if "" in targets:
            commander.play(t_s, targets[""], job.file, ask.take_over)
            return
        found = [self._commanders.get(one.name) for one in of_one]
        mine = [one for one in found if one is not None]
        for one in mine:
            if one is not commander:
                one.end_task()
        numbers = {one.number for one in mine}
        commander.play_together(t_s, targets, job.file, ask.take_over, numbers)

    async def _serve_past(self) -> None:
        ask, self._past = self._past, None
        watch = self._watch()
        if ask is not None and watch is not None:
            try:
                await self._send(self._draw_past(watch, ask))
            except BadInput as error:
                self.say(str(error), True)

    def _draw_past(self, watch: Watch, ask: wire.Past) -> bytes:
        first_ns, end_ns = round(ask.first_s * 1e9), round(ask.end_s * 1e9)
        with watch.lock:
            newest_ns = watch.buckets.newest_ns
            if not end_ns - first_ns > 0 or newest_ns < 0:
                raise BadInput("there is no data for this period")
            level = level_between(newest_ns, first_ns, end_ns, ask.width_px)
            piece = watch.buckets.since(level, -1, (newest_ns - first_ns) * 1e-9)
        inside = piece.number * (FINEST_NS << level) <= end_ns
        cut = piece._replace(
            number=piece.number[inside], least=piece.least[inside], largest=piece.largest[inside]
        )
        return wire.plot_frame(cut, level, watch.wall_offset_ns, wire.MAGIC_PAST)

    def _watch(self) -> Watch | None:
        return self.controllers.watches.get(self._look.name) if self._look is not None else None

    def _commander(self, watch: Watch) -> Commander:
        if watch.name not in self._commanders:
            client = self.socket.client
            who = f"{self.person.name or 'somebody'} on the page, {client.host if client else ''}"
            self._commanders[watch.name] = Commander(watch, who[:64], self.say)
        return self._commanders[watch.name]
