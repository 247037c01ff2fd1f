"""Who is let in to the page's server, and that its messages may be sent from any thread."""

import asyncio
import collections
import contextlib
import http.client
import threading

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request
from websockets.sync.client import connect
from websockets.typing import Origin

from basenet_jax.viewer.serving import Gate, ThreadSafeEvent, address_of, is_loopback, serve
from tests.viewer import WATCHDOG_S

LOCAL, ELSEWHERE = "127.0.0.1", "0.0.0.0"


def request(path="/", **headers):
    return Request(path, Headers({name: value for name, value in headers.items() if value is not None}))


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080", "localhost", "LOCALHOST:9000"])
def test_this_machine_s_own_pages_are_let_in(host):
    gate = Gate(LOCAL)
    assert gate.refusal(request(Host=host)) is None
    assert gate.refusal(request(Host=host, Origin=f"http://{host}")) is None


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("localhost:8080", "http://evil.example"),
        ("localhost:8080", "http://localhost:3000"),  # another server's page on this machine
        ("localhost:8080", "null"),
        ("evil.example:8080", "http://evil.example:8080"),  # a name that was made to mean this machine
        ("evil.example:8080", None),
        ("localhost.evil.example:8080", None),
        ("[::1", None),
        (None, None),
    ],
)
def test_pages_of_others_are_not(host, origin):
    assert Gate(LOCAL).refusal(request(Host=host, Origin=origin))


def test_from_elsewhere_one_needs_the_token_in_link_or_cookie():
    gate, host = Gate(ELSEWHERE), "192.168.0.7:8080"
    assert gate.token
    assert "link" in str(gate.refusal(request(Host=host)))
    assert gate.refusal(request("/?token=wrong", Host=host))
    assert gate.refusal(request(f"/?token={gate.token}", Host=host)) is None
    kept = str(gate.cookie(request(f"/?token={gate.token}", Host=host)))
    assert "HttpOnly" in kept
    assert "SameSite=Strict" in kept
    cookie = kept.split(";")[0]
    assert gate.refusal(request(Host=host, Cookie=f"other=1; {cookie}", Origin=f"http://{host}")) is None
    assert gate.refusal(request(Host=host, Cookie=cookie, Origin="http://evil.example"))
    assert gate.refusal(request(Host=host, Cookie=cookie[:-1]))
    assert gate.cookie(request(Host=host)) is None
    assert Gate(ELSEWHERE).token != gate.token


@pytest.fixture(scope="module")
def server():
    made = serve(LOCAL, 0, Gate(LOCAL))
    yield made
    made.stop()


def test_a_websocket_of_a_foreign_page_is_refused(server):
    address = f"ws://127.0.0.1:{server.get_port()}"
    with pytest.raises(InvalidStatus) as refused:
        connect(address, origin=Origin("http://evil.example"), open_timeout=WATCHDOG_S)
    assert refused.value.response.status_code == http.HTTPStatus.FORBIDDEN
    with connect(address, origin=Origin(f"http://127.0.0.1:{server.get_port()}"), open_timeout=WATCHDOG_S):
        pass


def test_the_page_is_not_given_to_a_foreign_name(server):
    def status(host):
        with contextlib.closing(http.client.HTTPConnection(LOCAL, server.get_port(), timeout=WATCHDOG_S)) as connection:
            connection.request("GET", "/", headers={"Host": host})
            with connection.getresponse() as response:
                return response.status

    assert status(f"localhost:{server.get_port()}") == http.HTTPStatus.OK
    assert status("evil.example") == http.HTTPStatus.FORBIDDEN


def test_other_servers_are_as_they_were(server):
    import websockets.asyncio.server

    assert isinstance(websockets.asyncio.server.serve, type)


class Watched(collections.deque):
    """Waiters of an event; keeps who goes through them."""

    def __init__(self):
        super().__init__()
        self.threads = set()

    def __iter__(self):
        self.threads.add(threading.get_ident())
        return super().__iter__()


def test_an_event_is_set_from_another_thread_without_touching_its_waiters_there():
    """asyncio's own goes through them where it is set: a `RuntimeError`, should one more begin to wait meanwhile."""

    async def main():
        event = ThreadSafeEvent(asyncio.get_running_loop())
        event._waiters = waiters = Watched()
        waiting = asyncio.ensure_future(event.wait())
        await asyncio.sleep(0)
        thread = threading.Thread(target=event.set)
        thread.start()
        await asyncio.wait_for(waiting, WATCHDOG_S)
        thread.join()
        return waiters.threads

    assert asyncio.run(main()) == {threading.get_ident()}


def test_viser_s_messages_wake_by_such_an_event(server):
    assert isinstance(server._websock_server.get_message_buffer().message_event, ThreadSafeEvent)


@pytest.mark.parametrize(
    ("host", "local"),
    [("localhost", True), ("127.0.0.1", True), ("127.3.2.1", True), ("::1", True), ("0.0.0.0", False), ("::", False)],
)
def test_what_is_this_machine_alone(host, local):
    assert is_loopback(host) is local
    assert (Gate(host).token is None) is local


def test_links_name_an_address_that_others_reach():
    assert address_of("0.0.0.0") not in ("0.0.0.0", "localhost", "")
    assert address_of("::1") == "[::1]"
    assert address_of("127.0.0.1") == "127.0.0.1"
