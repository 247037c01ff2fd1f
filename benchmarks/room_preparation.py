"""What the benchmark of rooms measures beside plans: making rooms ready, and inverse kinematics clear of obstacles."""

import dataclasses
import json
import os
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np
import yaml
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from PIL import Image

from basenet_jax.planners import prepared_stops
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.free_ik import collision_free_ik
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.grasps import top_down
from basenet_jax.world.scene_file import load_scene
from benchmarks.docked_rooms import office_cells, twelve_boxes
from benchmarks.timing import measure, measure_plain

RESOLUTION_M = 0.05
SURFACE = {"size": [1.4, 0.7], "height": 0.75}
SURFACES = 3
FREE_CELLS = (70, 60)  # along x and y, round the middle of a surface of the map

Row = dict[str, Any]


def row_of(what: str, times: Sequence[float], cpu: Sequence[float], said: str = "", **facts: Any) -> Row:
    """A row of results: the spread of some wall times (s), and the median of CPU times (s)."""
    spread = {"median_s": statistics.median(times), "min_s": min(times), "max_s": max(times)}
    return {"what": what, **spread, "cpu_s": statistics.median(cpu), "said": said, **facts}


def preparations(seed: int, repeats: int, *, with_map: bool) -> list[Row]:
    """Times of making rooms' stops and drives ready, warm: of twelve boxes, and of a map whose file is read."""
    room = _twelve(seed)
    rows = _prepare("a room of 12 boxes", lambda: room, repeats)
    if with_map:
        with tempfile.TemporaryDirectory() as folder:
            file = _map_scene(Path(folder), np.random.default_rng(seed))
            rows += _prepare("a map of 400 x 400 cells", lambda: load_scene(file).arrays.room, min(repeats, 3))
    return rows


def _prepare(what: str, read: Any, repeats: int) -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for how, cache in (("anew", "off"), ("from the cache folder", "on")):
            with _environment(XDG_CACHE_HOME=folder, BASENET_JAX_CACHE=cache):

                def prepare() -> None:
                    prepared_stops.forget()
                    jax.block_until_ready(PlannerSetup(room=read()).aligned_stops())

                timing = measure_plain(prepare, repeats=repeats)
                setup = PlannerSetup(room=read())
                stops, boxes = len(setup.aligned_stops().poses), len(setup.room.boxes.low)
            said = f"{stops} stops, {boxes} boxes"
            rows.append(row_of(f"{what} {how}", timing.runs_s, timing.cpu_s, said, stops=stops, boxes=boxes))
    prepared_stops.forget()
    return rows


@contextmanager
def _environment(**settings: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in settings}
    os.environ |= settings
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _twelve(seed: int) -> Room:
    """Twelve boxes, as many of which are surfaces as have some 400 stops."""
    room = twelve_boxes(np.random.default_rng(seed))
    for count in range(1, 13):
        bears: Any = np.arange(12) < count
        some = dataclasses.replace(room, boxes=dataclasses.replace(room.boxes, bears_objects=bears))
        if len(PlannerSetup(room=some).aligned_stops().poses) >= 384:
            return some
    return room


def _map_scene(folder: Path, rng: np.random.Generator) -> Path:
    """Files of a room with a map, three tables and an object."""
    closed = office_cells(rng)
    Image.fromarray(np.where(closed[::-1], 0, 254).astype(np.uint8)).save(folder / "office.png")
    about = {"image": "office.png", "resolution": RESOLUTION_M, "origin": [0.0, 0.0, 0.0], "negate": 0}
    (folder / "office.yaml").write_text(yaml.safe_dump(about | {"occupied_thresh": 0.65, "free_thresh": 0.25}))
    places = _free_places(closed)
    surfaces = [{"name": f"table_{i}", "pose": [*place, 0.0], **SURFACE} for i, place in enumerate(places)]
    x, y = places[0]
    scene = {
        "format": "basenet-scene/2",
        "map": "office.yaml",
        "surfaces": surfaces,
        "robot": {"model": "ur5e_mobile", "start": [x, y - 1.0, 0.0]},
        "objects": [{"name": "mug_1", "class": "mug", "on": "table_0", "pose": [x, y, 0.0]}],
    }
    file = folder / "office_scene.json"
    file.write_text(json.dumps(scene))
    return file


def _free_places(closed: Bool[np.ndarray, "rows columns"]) -> list[list[float]]:
    """Middles (x, y in m) of the first free rectangles of the map, each in another room than the one before."""
    found: list[list[float]] = []
    width, height = FREE_CELLS
    free = ~np.any(sliding_window_view(closed, (height, width)), axis=(2, 3))
    for row, column in np.argwhere(free)[:: len(closed) // 8]:
        place = [round(RESOLUTION_M * float(column + width / 2), 3), round(RESOLUTION_M * float(row + height / 2), 3)]
        if len(found) < SURFACES and all(np.hypot(*np.subtract(place, other)) > 4.0 for other in found):
            found.append(place)
    return found


def free_ik_rate(seed: int, count: int, repeats: int) -> Row:
    """`collision_free_ik` of grasps over twelve boxes, each from another base beside its box."""
    robot, rng = jax.device_put(load_robot()), np.random.default_rng(seed)
    boxes = twelve_boxes(rng).boxes
    base, grasp = _over_boxes(boxes, rng, count)
    made = jax.jit(top_down)(grasp)
    timing = measure(collision_free_ik, [(robot, boxes, base, made)], repeats=min(repeats, 5))
    found = float(np.mean(jax.jit(collision_free_ik)(robot, boxes, base, made).found)) if count else 0.0
    rate = timing.rate(count)["median"]
    per_core = rate / timing.cores
    said = f"{rate:,.0f} a second, {timing.cores:.1f} cores busy; {100 * found:.0f} % found"
    facts = {"rate": rate, "rate_per_core": per_core, "found_share": found, "compile_s": timing.compile_s}
    return row_of(f"collision_free_ik, {count:,} grasps, 12 boxes", timing.runs_s, timing.cpu_s, said, **facts)


def _over_boxes(
    boxes: Boxes, rng: np.random.Generator, count: int
) -> tuple[Float[np.ndarray, "N 3"], Float[np.ndarray, "N 4"]]:
    """Bases (x, y, heading) within a metre of a box, and tools pointing down (x, y, z, yaw) over its top."""
    own = rng.integers(len(boxes.low), size=count)
    pose, half = (np.asarray(x, float)[own] for x in (boxes.pose, boxes.half_size))
    along = rng.uniform(-1.0, 1.0, (count, 2)) * half
    sine, cosine = np.sin(pose[:, 2]), np.cos(pose[:, 2])
    place = pose[:, :2] + np.stack([cosine, sine], -1) * along[:, :1] + np.stack([-sine, cosine], -1) * along[:, 1:]
    height = np.asarray(boxes.high)[own] + rng.uniform(0.2, 0.5, count)
    away, angle = np.hypot(*half.T) + rng.uniform(0.4, 1.0, count), rng.uniform(-np.pi, np.pi, count)
    base = pose[:, :2] + away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    heading, yaw = rng.uniform(-np.pi, np.pi, (2, count))
    tool = np.column_stack([place, height, yaw])
    return np.column_stack([base, heading]).astype(np.float32), tool.astype(np.float32)
