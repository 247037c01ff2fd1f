"""Random rooms, drawn on the host: a seed gives the same room everywhere."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from basenet_jax.config import MAX_OBJECTS, SceneConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import DEFAULT_ROBOT, load_robot, robot_name
from basenet_jax.world.footprints import extent, rectangle_gaps
from basenet_jax.world.furniture import Furniture, ObstacleFields, SurfaceFields, furnish
from basenet_jax.world.room_fields import ROOM_FORMAT, RoomFields, RoomObjectFields
from basenet_jax.world.room_file import room_scene
from basenet_jax.world.room_reach import Reach
from basenet_jax.world.scene import OBJECT_CLASSES, NamedScene
from basenet_jax.world.scene_fields import RobotFields

_FLOOR_M = ((6.0, 10.0), (5.0, 8.0))
_SURFACES, _OBSTACLES = (1, 3), (0, 6)
_SURFACE_M = ((0.8, 2.4), (0.5, 1.0), (0.6, 0.9))  # length, width, height
_OBSTACLE_M = ((0.2, 0.8), (0.2, 1.8))  # side, height
_NEAR_WALL_M = 1.0  # half of the surfaces have some part so near to an edge of the floor
_APART_M = 0.05  # furniture, at least
_ROOMS, _PLACES = 256, 1024  # tried


class Draw(NamedTuple):
    """Random numbers, rounded as files write them; the generator is asked for nothing but `random`, which stays."""

    generator: np.random.Generator

    def number(self, low: float, high: float) -> float:
        """Uniform."""
        return round(float(low + (high - low) * self.generator.random()), 4)

    def integer(self, low: int, high: int) -> int:
        """Uniform, both bounds included."""
        return low + int((high - low + 1) * self.generator.random())

    def chance(self, share: float) -> bool:
        """True in this share of the draws."""
        return bool(self.generator.random() < share)


def draw_room(
    seed: int | Sequence[int], objects: int, *, robot: str = DEFAULT_ROBOT, config: SceneConfig = SceneConfig()
) -> NamedScene:
    """One random room: a floor of 6 to 10 by 5 to 8 m, one to three surfaces, up to six obstacles.

    From where the robot starts, a turning place, the floor leads to a stop at one side or more of every surface.

    Args:
        seed: of the room, a number or several.
        objects: how many, 1 to 50, on all surfaces together.
        robot: whose base drives there, as for `load_robot`.
        config: how far apart objects are, and from edges.

    Raises:
        ValueError: the number is out of range, or so many objects, or so large a robot, find no place in 256 rooms.
    """
    if not 1 <= objects <= MAX_OBJECTS:
        raise ValueError(f"objects: found {objects}, allowed are 1 to {MAX_OBJECTS}")
    draw, base = Draw(np.random.default_rng(seed)), load_robot(robot)
    for _ in range(_ROOMS):
        furniture = _draw_furniture(draw)
        if furniture is None or (start := _draw_start(draw, furniture, base)) is None:
            continue
        items = _draw_objects(draw, furniture, objects, config)
        if items is not None:
            return _scene(furniture, start, items, robot)
    raise ValueError(f"objects: found {objects}, which find no place in {_ROOMS} rooms, allowed are fewer")


def _draw_furniture(draw: Draw) -> Furniture | None:
    """Surfaces and obstacles on a floor; None: one of them found no place."""
    floor = (0.0, 0.0, draw.number(*_FLOOR_M[0]), draw.number(*_FLOOR_M[1]))
    placed: list[tuple[float, ...]] = []  # x, y, yaw, half sizes
    surfaces, obstacles = [], []
    for number in range(1, 1 + draw.integer(*_SURFACES)):
        length, width, height = (draw.number(*bounds) for bounds in _SURFACE_M)
        turned, near_wall = draw.chance(0.25), draw.chance(0.5)
        yaw = draw.number(-math.pi, math.pi) if turned else round(draw.integer(0, 3) * math.pi / 2, 7)
        pose = _place(draw, floor, placed, (length, width), yaw, near_wall)
        if pose is None:
            return None
        surfaces.append(SurfaceFields(name=f"surface_{number}", pose=pose, size=(length, width), height=height))
    for number in range(1, 1 + draw.integer(*_OBSTACLES)):
        side, height = (draw.number(*bounds) for bounds in _OBSTACLE_M)
        pose = _place(draw, floor, placed, (side, side), draw.number(-math.pi, math.pi), near_wall=False)
        if pose is None:
            return None
        obstacles.append(ObstacleFields(name=f"obstacle_{number}", pose=pose, size=(side, side, height)))
    return Furniture(floor=floor, surfaces=surfaces, obstacles=obstacles)


def _place(
    draw: Draw,
    floor: Sequence[float],
    placed: list[tuple[float, ...]],
    size: tuple[float, float],
    yaw: float,
    near_wall: bool,
) -> tuple[float, float, float] | None:
    """A pose on the floor, apart from what is placed, to which it is then added."""
    half = np.array(size) / 2
    reach = extent(np.array([0.0, 0.0, yaw]), half)[2:]
    low, high = reach, np.array(floor[2:]) - reach
    others = np.array(placed).reshape(-1, 5)
    for _ in range(_PLACES):
        spot = [draw.number(low[axis], high[axis]) for axis in (0, 1)]
        if near_wall:
            wall, distance = draw.integer(0, 3), draw.number(0.0, _NEAR_WALL_M)
            spot[wall % 2] = round(float(low[wall % 2] + distance if wall < 2 else high[wall % 2] - distance), 4)
        if np.any(spot < low) or np.any(spot > high):
            continue
        pose = np.array([[*spot, yaw]])
        if np.all(rectangle_gaps(pose, half[None], others[:, :3], others[:, 3:]) >= _APART_M):
            placed.append((*spot, yaw, *half))
            return (spot[0], spot[1], yaw)
    return None


def _draw_start(draw: Draw, furniture: Furniture, robot: Robot) -> tuple[float, float, float] | None:
    """A turning place from which every surface is served, and a heading; None: there is no such place."""
    room, _ = furnish(furniture)
    reach = Reach(room, robot)
    floor, tops = reach.floor, [(np.array(each.pose), np.array(each.size) / 2) for each in furniture.surfaces]
    for _ in range(_PLACES):
        x, y = draw.number(floor[0], floor[2]), draw.number(floor[1], floor[3])
        start = (x, y, draw.number(-math.pi, math.pi))
        part = int(reach.part(np.array([start[:2]]))[0])
        if part and reach.stands(np.array([start])):
            return start if all(reach.serves(part, *top) for top in tops) else None
    return None


def _draw_objects(draw: Draw, furniture: Furniture, count: int, config: SceneConfig) -> list[RoomObjectFields] | None:
    """Objects of the packaged classes, uniformly on all surfaces together; the largest are placed first."""
    kinds = [OBJECT_CLASSES[draw.integer(0, len(OBJECT_CLASSES) - 1)] for _ in range(count)]
    radius = np.array([min(math.hypot(*kind.size[:2]) / 2, config.max_footprint_radius_m) for kind in kinds])
    tops = np.array([surface.size for surface in furniture.surfaces]) / 2 - config.edge_margin_m
    if np.any(tops <= 0):
        return None
    share = np.cumsum(np.prod(tops, axis=1)) / np.sum(np.prod(tops, axis=1))
    spots, on = np.full((count, 2), np.inf), np.full(count, -1)
    for index in np.argsort(-radius, kind="stable"):
        for _ in range(config.tries):
            surface = int(np.searchsorted(share[:-1], draw.generator.random(), side="right"))
            spot = _on_top(draw, furniture.surfaces[surface], tops[surface])
            beside = on == surface
            if np.all(np.linalg.norm(spots[beside] - spot, axis=1) >= radius[beside] + radius[index]):
                spots[index], on[index] = spot, surface
                break
        else:
            return None
    numbers = [[each.name for each in kinds[: i + 1]].count(kind.name) for i, kind in enumerate(kinds)]
    return [
        RoomObjectFields(
            name=f"{kind.name}_{number}",
            class_=kind.name,
            on=furniture.surfaces[surface].name,
            pose=(float(x), float(y), draw.number(-math.pi, math.pi)),
        )
        for kind, number, (x, y), surface in zip(kinds, numbers, spots, on, strict=True)
    ]


def _on_top(draw: Draw, surface: SurfaceFields, half: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    x, y, yaw = surface.pose
    along, across = draw.number(-half[0], half[0]), draw.number(-half[1], half[1])
    turned = (math.cos(yaw) * along - math.sin(yaw) * across, math.sin(yaw) * along + math.cos(yaw) * across)
    return np.round(np.array([x, y]) + turned, 4)


def _scene(
    furniture: Furniture, start: tuple[float, float, float], items: list[RoomObjectFields], robot: str
) -> NamedScene:
    own = {name: getattr(furniture, name) for name in furniture.__struct_fields__}
    fields = RoomFields(
        format=ROOM_FORMAT, robot=RobotFields(model=robot_name(robot), start=start), objects=items, **own
    )
    return room_scene(fields, *furnish(furniture), robot)
