"""The server of the page: who is let in, and messages that may be sent from any thread."""

import asyncio
import contextlib
import hmac
import http
import io
import ipaddress
import secrets
import socket
from collections.abc import Callable, Iterator
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

_Answer = Callable[[ServerConnection, Request], Response | None]
_TOKEN_BYTES = 16
_ELSEWHERE = {socket.AF_INET: "192.0.2.1", socket.AF_INET6: "2001:db8::1"}  # addresses of documentation, never sent to


class Gate:
    """Lets in this machine's own pages or, where others reach the server, those who were given its link.

    A page of somebody else's in the same browser reaches this machine's servers too. It comes with its own `Origin` or,
    after having its name resolved to this machine, with its own `Host`.

    Args:
        host: that the server is bound to.
    """

    def __init__(self, host: str):
        self.token = None if is_loopback(host) else secrets.token_urlsafe(_TOKEN_BYTES)

    def refusal(self, request: Request) -> str | None:
        """Why a request isn't answered; None: it is."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or len(origins) > 1:
            return "a request has one Host, and one Origin at most"
        if origins and urlsplit(origins[0]).netloc.lower() != hosts[0].lower():
            return "this page takes nothing from pages of others"
        if self.token is None:
            name = _hostname(hosts[0])
            return None if name is not None and is_loopback(name) else "this page is for this machine alone"
        if self._has_token(request, hosts[0]):
            return None
        return "open the link that the command printed, with its token"

    def cookie(self, request: Request) -> str | None:
        """What keeps the token in a browser, so that its websocket has it; None: the request came without it."""
        if self.token is None or not self._is_token(_query_token(request)):
            return None
        return f"{_cookie_name(request.headers['Host'])}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def before(self, answer: _Answer) -> _Answer:
        """What answers requests, but those that are refused."""

        def process(connection: ServerConnection, request: Request) -> Response | None:
            if reason := self.refusal(request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            response = answer(connection, request)
            if response is not None and (cookie := self.cookie(request)):
                response.headers["Set-Cookie"] = cookie
            return response

        return process

    def _has_token(self, request: Request, host: str) -> bool:
        jar = SimpleCookie()
        with contextlib.suppress(CookieError):
            for header in request.headers.get_all("Cookie"):
                jar.load(header)
        kept = jar.get(_cookie_name(host))
        return self._is_token(_query_token(request)) or (kept is not None and self._is_token(kept.value))

    def _is_token(self, given: str) -> bool:
        return self.token is not None and hmac.compare_digest(given.encode(), self.token.encode())


def serve(host: str, port: int, gate: Gate) -> viser.ViserServer:
    """A server that asks a gate before it answers.

    Args:
        host: address to serve on.
        port: its port; 0 for any.
        gate: to ask.
    """
    with contextlib.redirect_stdout(io.StringIO()), _asking(gate):  # viser greets
        server = viser.ViserServer(host=host, port=port, verbose=False)
    connections = server._websock_server
    _wake_safely(connections.get_message_buffer())
    connections.on_client_connect(lambda connection: _wake_safely(connection.get_message_buffer()))
    return server


def address_of(host: str) -> str:
    """What a browser calls a host: of those that stand for all of a machine's addresses, the one that others reach."""
    bare = host.strip("[]")
    if bare in ("0.0.0.0", "::", ""):
        bare = _own_address(socket.AF_INET6 if bare == "::" else socket.AF_INET)
    return f"[{bare}]" if ":" in bare else bare


def is_loopback(host: str) -> bool:
    """Whether only this machine itself reaches a host."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class ThreadSafeEvent(asyncio.Event):
    """An event of asyncio that may be set from any thread; its own fails now and then if its loop waits meanwhile.

    Args:
        loop: in which it is waited for.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop):
        super().__init__()
        self._own_loop = loop

    def set(self) -> None:
        """Wakes those that wait, in their own thread."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            here = None
        if here is self._own_loop:
            super().set()
        else:
            with contextlib.suppress(RuntimeError):  # the loop is closed, nobody waits
                self._own_loop.call_soon_threadsafe(super().set)


def _wake_safely(buffer) -> None:
    """Gives a message buffer of viser's, which all threads push to, an event that they may set."""
    before = buffer.message_event
    buffer.message_event = ThreadSafeEvent(buffer.event_loop)
    buffer.event_loop.call_soon_threadsafe(before.set)  # whoever waits already waits for the new one then


@contextlib.contextmanager
def _asking(gate: Gate) -> Iterator[None]:
    """Websocket servers that are made meanwhile ask the gate: viser has no other way to look at requests."""
    whole = websockets.asyncio.server.serve

    def guarded(*arguments, process_request: _Answer, **options):
        return whole(*arguments, process_request=gate.before(process_request), **options)

    websockets.asyncio.server.serve = guarded
    try:
        yield
    finally:
        websockets.asyncio.server.serve = whole


def _own_address(family: socket.AddressFamily) -> str:
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.connect((_ELSEWHERE[family], 9))  # sends nothing, but chooses the address to send from
        return probe.getsockname()[0]
    return socket.gethostname()


def _hostname(host: str) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


def _query_token(request: Request) -> str:
    return parse_qs(urlsplit(request.path).query).get("token", [""])[0]


def _cookie_name(host: str) -> str:
    """Of a server: browsers keep cookies by host, whatever the port."""
    return f"basenet_jax_{host.rpartition(':')[2]}" if ":" in host else "basenet_jax"
