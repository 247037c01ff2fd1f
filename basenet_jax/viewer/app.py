"""The viewer: server, session and page put together."""

import contextlib
import io
import socket
import threading

from basenet_jax.viewer.controls import Controls
from basenet_jax.viewer.mouse import Mouse
from basenet_jax.viewer.page import Page
from basenet_jax.viewer.panel import Panel
from basenet_jax.viewer.serving import Gate, address_of, serve
from basenet_jax.viewer.session import Choices, Session
from basenet_jax.viewer.visitors import Visitors
from basenet_jax.world.scene import NamedScene


class Viewer:
    """A running viewer.

    Args:
        scene: the first one.
        choices: of the command line.
        host: address to serve on, and
        port: its port, which must be free; 0 for any.
        seed: of random scenes.
    """

    def __init__(self, scene: NamedScene, choices: Choices, *, host: str = "127.0.0.1", port: int = 0, seed: int = 0):
        self._gate = Gate(host)
        self.server = serve(host, port, self._gate)
        lock = threading.RLock()
        panel = Panel(self.server.gui, choices.planners)
        self.page = Page(self.server, panel, lock, scene)
        self.session = Session(scene, choices, self.page, lock)
        controls = Controls(panel, self.page, self.session, seed)
        self.page.visitors = Visitors(self.server, panel.files, controls.open_scene, controls.open_plan)
        self.page.on_drag = Mouse(self.server, self.page, self.session).on_drag
        self.session.begin()

    @property
    def url(self) -> str:
        """The link that opens the page; where others than this machine reach it, with its token."""
        link = f"http://{address_of(self.server.get_host())}:{self.server.get_port()}"
        return link if self._gate.token is None else f"{link}/?token={self._gate.token}"

    def close(self) -> bool:
        """Ends all of it; False if a compilation goes on, which nothing can break off."""
        self.page.timeline.close()
        ended = self.session.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
        return ended


def check_address(host: str, port: int) -> None:
    """Finds out beforehand what the server would try for ever.

    Raises:
        ValueError: nothing can be served there.
    """
    if not 0 <= port <= 65535:
        raise ValueError(f"--port: found {port}, allowed are 0 to 65535")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
    except OSError as error:
        found = f"found {host} and {port}, where nothing can be served ({error.strerror})"
        raise ValueError(f"--host, --port: {found}; allowed are an address of this machine and a free port") from None
