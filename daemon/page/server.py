"""The page's server: static files, the WebSocket, uploads, metrics. Uses Starlette and uvicorn."""

import asyncio
import math
import signal
import socket
from collections import Counter
from collections.abc import AsyncIterator, Generator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from dehyst import __version__
from dehyst.daemon import notify
from dehyst.daemon.page import metrics
from dehyst.daemon.page.doors import BACKLOG, Door, Loop, Wire
from dehyst.daemon.page.guard import Guard, refusal
from dehyst.daemon.page.guesses import origin_of
from dehyst.daemon.page.jobs import KINDS, LARGEST_BYTES, Job, Jobs, Setting
from dehyst.daemon.page.people import COOKIE, SESSION_S, People, Person, Public, TooManyGuesses
from dehyst.daemon.page.visits import Ticks, Visit
from dehyst.daemon.page.watching import Controllers, Watch
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.modelfile import dumps

STATIC = Path(__file__).resolve().parent / "static"
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""A report is made from an untrusted file: it is displayed, but nothing in it may run or load."""
MOST_VISITS, MOST_VISITS_OF_ONE = 256, 32
"""Most WebSockets in total and per address: a few tabs on each of a few screens."""
SMALL_BYTES, SMALL_S = 4096, 10.0  # of a body before the login: a name and a password
STALLED_S = 10.0
"""A body is abandoned if nothing of it arrives for this long."""
UPLOAD_S = 600.0
"""A body is abandoned if it takes longer: the time of the largest file over 1 Mbit/s."""


@dataclass(frozen=True)
class Tls:
    """Paths of PEM files; "": no TLS."""

    certificate: str = ""
    key: str = ""


class Site:
    """Handle the requests of the page."""

    def __init__(self, controllers: Controllers, people: People, public: Public, tls: bool) -> None:
        self.controllers, self.people, self.public, self.tls = controllers, people, public, tls
        self.jobs, self.ticks = Jobs(), Ticks()
        self._visits: Counter[str] = Counter()

    def app(self) -> Starlette:
        """Return the ASGI application."""
        routes = [
            Route("/", self.index),
            Mount("/static", StaticFiles(directory=STATIC)),
            Route("/me", self.me),
            Route("/login", self.login, methods=["POST"]),
            Route("/logout", self.logout, methods=["POST"]),
            Route("/metrics", self.metrics),
            Route("/upload/{kind}", self.upload, methods=["POST"]),
            Route("/job/{number}", self.job),
            Route("/job/{number}/{what}", self.job_file),
            Route("/doctor/{controller}/{case}", self.doctor),
            WebSocketRoute("/stream", self.stream),
        ]
        guard = Middleware(Guard, people=self.people, public=self.public, tls=self.tls)
        return Starlette(
            routes=routes,
            middleware=[guard],
            lifespan=self._life,
            exception_handlers={
                DehystError: _say_why,
                TooManyGuesses: _wait,
                401: self._unknown,
            },
        )

    @asynccontextmanager
    async def _life(self, _: Starlette) -> AsyncIterator[None]:
        ticking = asyncio.create_task(self.ticks.run())
        notify.send("READY=1")
        try:
            yield
        finally:
            notify.send("STOPPING=1")
            ticking.cancel()
            self.jobs.close()

    # -- users ----------------------------------------------------------------------------------

    def _who(self, asked: HTTPConnection) -> Person | None:
        token = asked.cookies.get(COOKIE, "")
        return self.people.who(asked.headers, token, _address(asked))

    async def _unknown(self, request: Request, error: Exception) -> Response:
        """Answer 401, and delete the cookie of an ended session, so that it is not sent again with
        every request."""
        assert isinstance(error, HTTPException)
        answer = PlainTextResponse(error.detail, 401, error.headers)
        if COOKIE in request.cookies and not self.people.lasts(request.cookies[COOKIE]):
            for path in {"/", self._cookie_path(request), f"{self.public.path}/"}:
                answer.delete_cookie(COOKIE, path)
        return answer

    def _cookie_path(self, request: Request) -> str:
        """Return the path of the cookie; pages that share a proxy thus have separate sessions."""
        return f"{self.public.path}/" if self.public.called(request.headers) else "/"

    def _known(self, asked: HTTPConnection, operator: bool = False) -> Person:
        person = self._who(asked)
        if person is None:
            raise HTTPException(401, "log in first", {"www-authenticate": "FormBased"})
        if operator and not person.commands:
            raise HTTPException(403, "an observer may view, not command")
        return person

    async def me(self, request: Request) -> Response:
        """Return who the user is, and whether a page shown at the origin `at` may command."""
        person = self._known(request)
        shown_at = request.query_params.get("at", "")
        return JSONResponse(
            {
                "name": person.name,
                "role": person.role,
                "open": self.people.open,
                "version": __version__,
                "problem": refusal(
                    self.people,
                    self.public,
                    {"host": request.headers.get("host", ""), "origin": shown_at},
                    anywhere=not shown_at,
                ),
            }
        )

    async def login(self, request: Request) -> Response:
        """Begin a session, given name and password."""
        try:
            body = await _body(request, SMALL_BYTES, SMALL_S)
            given = msgspec.json.decode(body, type=dict[str, str])
        except (msgspec.MsgspecError, RecursionError):
            raise HTTPException(400, "name and password are required, as JSON") from None
        name, password = given.get("name", ""), given.get("password", "")
        person = self.people.check(name, password, _address(request))
        if person is None:
            raise HTTPException(401, "wrong name or password")
        answer = JSONResponse({"name": person.name, "role": person.role})
        answer.set_cookie(
            COOKIE,
            self.people.begin(person),
            max_age=round(SESSION_S),
            path=self._cookie_path(request),
            secure=self.tls or request.headers.get("origin", "").startswith("https:"),
            httponly=True,
            samesite="strict",
        )
        return answer

    async def logout(self, request: Request) -> Response:
        """End the session."""
        self.people.finish(request.cookies.get(COOKIE, ""))
        answer = JSONResponse({})
        answer.delete_cookie(COOKIE, self._cookie_path(request))
        return answer

    # -- content --------------------------------------------------------------------------------

    async def index(self, _: Request) -> Response:
        """Return the page itself, which contains no data."""
        return FileResponse(STATIC / "index.html")

    async def metrics(self, request: Request) -> Response:
        """Return the metrics for Prometheus."""
        self._known(request)
        body, content_type = metrics.expose(self.controllers, request.headers.get("accept", ""))
        return Response(body, headers={"content-type": content_type})

    async def stream(self, socket: WebSocket) -> None:
        """Serve the WebSocket of one browser."""
        address = origin_of(_address(socket))
        person = self._who(socket)
        if person is None:
            await socket.send_denial_response(PlainTextResponse("log in first\n", 403))
            return
        if self._visits[address] >= MOST_VISITS_OF_ONE or self._visits.total() >= MOST_VISITS:
            few = PlainTextResponse("too many pages are open; close some\n", 503)
            await socket.send_denial_response(few)
            return
        token = "" if self.people.open else socket.cookies.get(COOKIE, "")
        by_session = self.people.lasts(token)
        self._visits[address] += 1
        try:
            await socket.accept()
            visit = Visit(
                socket,
                person,
                self.controllers,
                self.jobs,
                self.ticks,
                lambda: not by_session or self.people.lasts(token),
            )
            await visit.run()
        finally:
            self._visits[address] -= 1
            if not self._visits[address]:
                del self._visits[address]

    async def upload(self, request: Request) -> Response:
        """Receive a file and return the job that processes it."""
        self._known(request, operator=True)
        kind = request.path_params["kind"]
        if kind not in KINDS:
            raise HTTPException(404, f"a file can be used for {', '.join(KINDS)}")
        watch = self.controllers.watches.get(request.query_params.get("controller", ""))
        settings = self._settings(watch) if watch is not None else {}
        if "" not in settings and kind == "trajectory":
            raise BadInput("the controller's model and limits are not known yet")
        data = await _body(request, LARGEST_BYTES, UPLOAD_S)
        file = request.query_params.get("file", "file")
        controller = watch.name if watch is not None else ""
        return JSONResponse(self.jobs.add(kind, file, data, settings, controller).describe())

    def _settings(self, watch: Watch) -> dict[str, Setting]:
        """Return the settings of the shown axis, as "", and of all axes of its controller by
        name."""
        found = {"": setting_wanted(watch)}
        if len(watch.axes) > 1:
            found |= {one.axis: setting_wanted(one) for one in self.controllers.of_one(watch)}
        return {axis: setting for axis, setting in found.items() if setting is not None}

    def _job(self, request: Request) -> Job:
        self._known(request, operator=True)
        job = self.jobs.get(request.path_params["number"])
        if job is None:
            raise HTTPException(404, "this job is no longer kept")
        return job

    async def job(self, request: Request) -> Response:
        """Return the state of a job."""
        return Response(msgspec.json.encode(self._job(request).describe()), media_type=JSON)

    async def job_file(self, request: Request) -> Response:
        """Return the report or the model that a job made."""
        job, what = self._job(request), request.path_params["what"]
        said = job.describe()
        if what == "report" and said["report"]:
            return FileResponse(
                job.folder / "report.html", headers={"content-security-policy": REPORT_POLICY}
            )
        if what == "model" and said["model"]:
            return FileResponse(job.folder / "model.toml", filename="model.toml")
        raise HTTPException(404, "there is none")

    async def doctor(self, request: Request) -> Response:
        """Return the doctor's report on a case."""
        self._known(request)
        watch = self.controllers.watches.get(request.path_params["controller"])
        case = request.path_params["case"]
        if watch is None or case not in watch.doctor:
            raise HTTPException(404, "there is no such case")
        page = await asyncio.to_thread(watch.doctor_page, case)
        headers = {"content-security-policy": REPORT_POLICY}
        return Response(page, media_type="text/html; charset=utf-8", headers=headers)


JSON = "application/json"


def setting_wanted(watch: Watch) -> Setting | None:
    """Return the settings that the check of a trajectory needs; None: not known yet."""
    model, config, status = watch.model, watch.config, watch.status
    if model is None or config is None or status is None:
        return None
    gain, valid = config.actuator.gain, model.validity
    return Setting(
        model=dumps(model),
        unit=status.unit,
        origin=status.origin,
        reach=(status.reach_min, status.reach_max),
        low=max(config.limits.min_v / gain, valid.drive_min),
        high=min(config.limits.max_v / gain, valid.drive_max),
        slew=config.limits.slew_v_per_s / gain,
        mode=config.inverse.mode,
        preview_s=config.inverse.preview_s,
        period_s=config.period_ns * 1e-9,
    )


def _address(asked: HTTPConnection) -> str:
    return asked.client.host if asked.client else ""


async def _body(request: Request, most: int, within_s: float) -> bytes:
    """Return the body. Its size and time are limited while it arrives."""
    parts: list[bytes] = []
    size = 0
    stream = aiter(request.stream())
    try:
        async with asyncio.timeout(within_s):
            while True:
                async with asyncio.timeout(STALLED_S):
                    part = await anext(stream, None)
                if part is None:
                    return b"".join(parts)
                size += len(part)
                if size > most:
                    raise HTTPException(413, f"more than {most} bytes")
                parts.append(part)
    except ClientDisconnect:
        raise HTTPException(400, "the rest did not arrive") from None
    except TimeoutError:
        raise HTTPException(408, "the rest did not arrive in time", CLOSED) from None


CLOSED = {"connection": "close"}


async def _wait(_: Request, error: Exception) -> Response:
    assert isinstance(error, TooManyGuesses)
    return PlainTextResponse(f"{error}\n", 429, {"retry-after": str(math.ceil(error.wait_s))})


async def _say_why(_: Request, error: Exception) -> Response:
    return JSONResponse({"detail": str(error)}, 400)


class Server(uvicorn.Server):
    """Ends at a signal, but leaves it to the caller how the process ends."""

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """Handle the signals without raising them again afterwards, as uvicorn would."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self.handle_exit)
        yield


def serve_page(
    controllers: Controllers, people: People, door: socket.socket, tls: Tls, public: Public
) -> int:
    """Serve until SIGTERM or SIGINT on a listening socket, and return the exit code."""
    site = Site(controllers, people, public, bool(tls.certificate))
    options: dict[str, Any] = {}
    if tls.certificate:
        options = {"ssl_certfile": tls.certificate, "ssl_keyfile": tls.key}
    settings = uvicorn.Config(
        site.app(),
        http=Door,
        ws=Wire,
        loop=f"{Loop.__module__}:{Loop.__qualname__}",
        log_level="error",
        access_log=False,
        server_header=False,
        # client address as given by a proxy on this machine; without a proxy it could be forged
        proxy_headers=bool(public.origin),
        forwarded_allow_ips="127.0.0.1,::1",
        backlog=BACKLOG,
        ws_max_size=65_536,  # bytes of a message, which has a few hundred
        ws_ping_interval=5.0,
        ws_ping_timeout=10.0,  # a page that does not answer is closed after 15 s
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
        **options,
    )
    server = Server(settings)
    server.run([door])
    return 0 if server.started else 1
