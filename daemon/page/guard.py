"""Check every request for its host and origin, limit concurrent requests per address, and add
security headers to the response."""

from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse

from dehyst.daemon.page.guesses import origin_of
from dehyst.daemon.page.people import People, Public, host_name, same_origin

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
MOST_AT_ONCE = 32
"""Most requests of one address that are handled at the same time; a browser makes six."""


def refusal(people: People, public: Public, headers: Mapping[str, str], anywhere: bool) -> str:
    """Return why a request is refused because of its host or origin, and the remedy; "": it is not.
    anywhere: it may come from any origin, because it changes nothing or no browser sent it."""
    host, origin = headers.get("host", "")[:80], headers.get("origin", "")[:120]
    if not people.knows_host(host) and not (public.origin and host_name(host) == public.host):
        return (
            f"this page answers to localhost and 127.0.0.1, not to {host!r}. Behind a reverse "
            "proxy, set page.public_url (--public-url) to the address that people type"
        )
    if anywhere or same_origin(headers) or public.called(headers):
        return ""
    if not origin:
        return "a request that changes something carries an Origin header, as browsers send it"
    return (
        f"the request comes from a page at {origin!r}, and this page is {host!r}. Behind a reverse "
        "proxy, set page.public_url (--public-url) to the address that people type"
    )


class Guard:
    """ASGI middleware. tls: this server itself uses TLS."""

    def __init__(self, app: App, people: People, public: Public, tls: bool) -> None:
        self._app, self._people, self._public, self._tls = app, people, public, tls
        self._at_once: Counter[tuple[str, bool]] = Counter()

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Refuse the request, or pass it on and add the headers to the response."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if self._public.path and scope["path"].startswith(f"{self._public.path}/"):
            scope["path"] = scope["path"].removeprefix(self._public.path)  # the proxy kept it
        headers = Headers(scope=scope)
        if scope["type"] == "websocket":  # browsers always send an Origin for a WebSocket
            anywhere = "origin" not in headers
        else:
            anywhere = scope["method"] in LOOKS
        refused = refusal(self._people, self._public, headers, anywhere)

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    out.setdefault(name, value)
                if self._tls:
                    out["strict-transport-security"] = "max-age=31536000"
            await send(message)

        if refused:
            answer = PlainTextResponse(f"refused: {refused}\n", 403)
            if scope["type"] == "websocket":
                await receive()
            await answer(scope, receive, sent)
        elif scope["type"] == "websocket":
            await self._app(scope, receive, sent)
        else:
            await self._counted(scope, receive, sent)

    async def _counted(self, scope: Message, receive: Receive, send: Send) -> None:
        """Limit concurrent requests. Reads and changes are counted separately, so that a body that
        never arrives does not block reading."""
        address = origin_of((scope.get("client") or ("",))[0])
        key = address, scope["method"] in LOOKS
        if self._at_once[key] >= MOST_AT_ONCE:
            text = f"{MOST_AT_ONCE} requests of your address are being answered; try again\n"
            await PlainTextResponse(text, 503, {"retry-after": "1"})(scope, receive, send)
            return
        self._at_once[key] += 1
        try:
            await self._app(scope, receive, send)
        finally:
            self._at_once[key] -= 1
            if not self._at_once[key]:
                del self._at_once[key]
