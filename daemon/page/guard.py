"""Around every request: the right host, the same origin, and headers that let nothing else in."""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse

from dehyst.daemon.page.people import People, same_origin

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-cache",
}
LOOKS = ("GET", "HEAD")


class Guard:
    """ASGI middleware. secure: served over TLS."""

    def __init__(self, app: App, people: People, secure: bool) -> None:
        self._app, self._people, self._secure = app, people, secure

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Refuse, or pass on with the headers added."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        looks = scope["type"] == "http" and scope["method"] in LOOKS
        refused = ""
        if not self._people.knows_host(headers.get("host", "")):
            refused = "this page is called by localhost or 127.0.0.1 alone"
        elif not looks and not same_origin(headers):
            refused = "a request of another origin"

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    out.setdefault(name, value)
                if self._secure:
                    out["strict-transport-security"] = "max-age=31536000"
            await send(message)

        if not refused:
            await self._app(scope, receive, sent)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refused})
        else:
            await PlainTextResponse(f"refused: {refused}\n", 403)(scope, receive, sent)
