"""How soon the viewer's page shows the new plan when an object is dropped, and what the server costs.

A headless browser drags objects with the mouse; in a room (`--world rooms`) its surfaces, with all that stands on them.
A drop's latency is the time from when the mouse lets go, right after its last move, to when the page has drawn the new
plan, by the page's own clock. Apart stands the server's share of it: from when it knew of the last move to when it had
sent the plan. CPU is the server's process alone, as a share of one core: idle, and while the plan is played at its
usual speed, one page being open. The browser draws by software on the same cores.
"""

import contextlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

import jax
import numpy as np
import tyro
from rich.table import Table

from basenet_jax.api import sample_scene
from basenet_jax.compilation import enable_cache
from basenet_jax.plots.drawing import to_world
from basenet_jax.viewer.editing import PlacementError, move_object, pad
from basenet_jax.viewer.furnishing import move_piece
from basenet_jax.viewer.pointing import Target, hit
from basenet_jax.world.generate_rooms import draw_room
from basenet_jax.world.scene import NamedScene
from benchmarks.browser import drag, page_of, where_seen
from benchmarks.harness import Options, Report, parse

NAME = "viewer_latency"
_STEP_M = 0.06  # by which objects are dragged, there and back
_SURFACE_STEP_M = 0.3  # by which surfaces are: some ten pixels, all of a room being seen; less is taken for a click
_PATIENCE_S = 600.0  # with compiling
_MOVED_S = 120.0  # a plan after a move, which may have to be compiled
_SETTLED_MS = 1_000  # after which all that a drop brings is drawn
_MOVES, _MOVE_MS = 6, 80.0  # of a drag
# When the mouse let go, and when the first frame after the newest figures was drawn (both ms). Reading a pixel waits
# until all of a frame is.
_WATCH_DRAWING = """() => {
  window.dropped = window.drawn = 0;
  addEventListener("pointerup", (event) => { dropped = event.timeStamp; }, true);
  const context = document.querySelector("canvas").getContext("webgl2");
  const wait = () => {
    context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));
    drawn = performance.now();
  };
  const isPlan = (node) => node.textContent.includes("N + G");
  new MutationObserver((changes) => {
    if (changes.some((change) => [...change.addedNodes].some(isPlan)))
      requestAnimationFrame(() => setTimeout(wait));
  }).observe(document.body, {childList: true, subtree: true});
}"""

FreeDrag = Callable[[NamedScene, Any, int], tuple[np.ndarray, np.ndarray]]
_RENDERER = """() => {
  const context = document.querySelector("canvas").getContext("webgl2");
  return context.getParameter(context.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
}"""


@dataclass(frozen=True)
class ViewerOptions(Options):
    """Options, and what is shown."""

    objects: int = 10
    """In the scene."""
    kind: Annotated[Literal["table", "rooms"], tyro.conf.arg(name="world")] = "table"
    """The paper's world, of which objects are dragged, or a room, of which surfaces are."""
    planner: str = "basenet"
    """Which plans."""
    repeats: int = 50
    """Drops."""
    watch_s: float = 10.0
    """How long the CPU is watched, idle and playing (s)."""


@dataclass(frozen=True)
class _Drop:
    drawn_s: float
    sent_s: float


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    from basenet_jax.viewer.app import Viewer
    from basenet_jax.viewer.session import Choices

    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(ViewerOptions, NAME, __doc__, arguments)
    enable_cache()
    report = Report(NAME, options, arguments)
    if options.kind == "rooms":
        scene, free_drag = pad(draw_room(options.seed, options.objects)), _free_drag_of_surface
    else:
        scene, free_drag = sample_scene(jax.random.key(options.seed), objects=options.objects), _free_drag
    viewer = Viewer(scene, Choices((options.planner,)))
    sends = _watch_sends()
    try:
        viewer.session.wait_idle(_PATIENCE_S)
        with page_of(viewer, 900, 600) as page:
            if options.kind == "rooms":
                _look_down(viewer, page)
            page.evaluate(_WATCH_DRAWING)
            drawn_by = page.evaluate(_RENDERER)
            drops = list(itertools.islice(_drops(viewer, page, sends, free_drag), options.repeats))
            watch_s = 1.0 if options.quick else options.watch_s
            idle = _cpu_share(watch_s)
            viewer.page.timeline.play()
            playing = _cpu_share(watch_s)
    finally:
        viewer.close()
    what = f"{options.objects} objects, {options.planner}{', surfaces of a room' * (options.kind == 'rooms')}"
    latencies = [
        {"what": f"drop to plan {stage}, {what}", "unit": "ms", **_spread([getattr(drop, leaf) for drop in drops])}
        for stage, leaf in (("drawn", "drawn_s"), ("sent", "sent_s"))
    ]
    shares = [
        {"what": f"CPU of the server, {what}", "unit": "% of a core", "median": 100.0 * share}
        for what, share in (("idle", idle), ("playing", playing))
    ]
    results = [*latencies, *shares]
    return report.finish(results, table=_table(results), drops=[asdict(drop) for drop in drops], drawn_by=drawn_by)


def _watch_sends() -> list[float]:
    """When each message to a page was handed to the network, from now on."""
    from websockets.asyncio.server import ServerConnection

    send, times = ServerConnection.send, []

    async def timed(self, *arguments, **options):
        await send(self, *arguments, **options)
        times.append(time.perf_counter())

    ServerConnection.send = timed
    return times


def _look_down(viewer, page) -> None:
    """Has the page look at the first surface from above, so that steps of its middle are many pixels."""
    (client,) = viewer.server.get_clients().values()
    x, y, _ = np.asarray(viewer.session.scene.arrays.room.boxes.pose[0], float)
    with client.atomic():
        client.camera.position, client.camera.look_at = (x, y - 3.0, 5.0), (x, y, 0.7)
    page.wait_for_timeout(_SETTLED_MS)


def _drops(viewer, page, sends: list[float], free_drag: FreeDrag) -> Iterator[_Drop]:
    """Drops of one object after the other, each dragged along the table and later back.

    Left out are those whose plan was drawn before the mouse let go, or has the figures of the plan before.
    """
    session = viewer.session
    (client,) = viewer.server.get_clients().values()
    for number in itertools.count():
        viewer.page.select(None)  # its gizmo may stand before the next object
        page.wait_for_timeout(100)
        start, end = free_drag(session.scene, client.camera, number)
        before = session.last
        ends = (where_seen(client.camera, point, page) for point in (start, end))
        drag(page, *ends, moves=_MOVES, move_ms=_MOVE_MS)
        _wait(lambda before=before: session.last != before)
        page.wait_for_timeout(_SETTLED_MS)  # for what comes with letting go of the mouse, for sending and drawing
        session.wait_idle(_PATIENCE_S)
        asked, shown = session.last
        # With nothing sent since, the plan had gone out before its thread looked at the clock.
        sent = min((each for each in sends if each > shown), default=shown)
        drawn_ms = page.evaluate("drawn - dropped")
        if drawn_ms > 0.0:
            yield _Drop(drawn_s=1e-3 * drawn_ms, sent_s=sent - asked)


def _free_drag(scene: NamedScene, camera, number: int) -> tuple[np.ndarray, np.ndarray]:
    """From the top of an object that the camera sees to a place where it can stand; another one for every number."""
    arrays, count = scene.arrays, len(scene.names)
    for slot, angle in itertools.product(np.roll(range(count), -number), np.arange(8) * np.pi / 4 + number):
        name, pose = scene.names[slot], np.asarray(arrays.object_pose[slot], float)
        move = _STEP_M * np.array([np.cos(angle), np.sin(angle), 0.0])
        top = np.array([*pose[:2], arrays.room.table_height + arrays.object_size[slot, 2]])
        seen, _ = hit(scene, camera.position, top - [0.0, 0.0, 0.002] - camera.position)
        if seen != Target(name):
            continue
        with contextlib.suppress(PlacementError):
            moved = move_object(scene, name, pose + move).arrays.object_pose[slot]
            return top, np.array([*moved[:2], top[2]])
    raise RuntimeError("no object can be dragged anywhere, use fewer")


def _free_drag_of_surface(scene: NamedScene, camera, number: int) -> tuple[np.ndarray, np.ndarray]:
    """From a place on a surface's top that the camera sees, as `_free_drag`."""
    boxes, surfaces = scene.arrays.room.boxes, np.flatnonzero(scene.arrays.room.boxes.bears_objects)
    corners = 0.8 * np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])
    angles = np.arange(8) * np.pi / 4 + number
    for box, corner, angle in itertools.product(np.roll(surfaces, -number), corners, angles):
        name, place = scene.box_names[box], to_world(boxes.pose[box], corner[None] * boxes.half_size[box])[0]
        top, move = np.array([*place, boxes.high[box]]), _SURFACE_STEP_M * np.array([np.cos(angle), np.sin(angle), 0.0])
        seen, _ = hit(scene, camera.position, top - [0.0, 0.0, 0.002] - camera.position)
        if seen == Target(name):
            with contextlib.suppress(PlacementError):
                move_piece(scene, name, np.asarray(boxes.pose[box], float) + move)
                return top, top + move
    raise RuntimeError("no surface can be dragged anywhere, take another seed")


def _wait(done) -> None:
    end = time.perf_counter() + _MOVED_S
    while not done():
        if time.perf_counter() > end:
            raise RuntimeError("a drag moved nothing: is something before the object?")
        time.sleep(0.005)


def _cpu_share(seconds: float) -> float:
    """How much of one core this process, all threads together, takes meanwhile."""
    begin, used = time.perf_counter(), time.process_time()
    time.sleep(seconds)
    return (time.process_time() - used) / (time.perf_counter() - begin)


def _spread(latencies: list[float]) -> dict[str, float]:
    low, median, high, most = 1e3 * np.quantile(latencies, [0.25, 0.5, 0.75, 1.0])
    return {"median": median, "q1": low, "q3": high, "max": most, "count": len(latencies)}


def _table(results: list[dict[str, Any]]) -> Table:
    table = Table(title="The viewer")
    for column in ("what", "median", "quartiles", "most", "unit"):
        table.add_column(column, justify="left" if column in ("what", "unit") else "right")
    for row in results:
        quartiles = f"{row['q1']:.1f} to {row['q3']:.1f}" if "q1" in row else ""
        most = f"{row['max']:.1f}" if "max" in row else ""
        table.add_row(row["what"], f"{row['median']:.1f}", quartiles, most, row["unit"])
    return table


if __name__ == "__main__":
    main()
