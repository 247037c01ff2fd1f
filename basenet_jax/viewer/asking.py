"""What can be picked from a place on the floor, and why not the rest."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.config import GridConfig, PickConfig, WorldConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.drives import make_drives
from basenet_jax.task.picking import Pick, Reason, pick
from basenet_jax.viewer.editing import box_name
from basenet_jax.world.footprints import rectangle_gaps
from basenet_jax.world.room_checks import boxes_at_base, stays_on_floor
from basenet_jax.world.scene import NamedScene, Scene

_NEAR_M = 2.0  # from the base's middle: no arm reaches boxes that are farther away


@dataclass(frozen=True)
class Answer:
    """What can be picked from one base pose."""

    base_pose: Float[np.ndarray, "3"]  # (x, y, heading) in W
    names: tuple[str, ...]
    times: tuple[float | None, ...]  # s of each object's pick cycle; None: it can't be picked
    # Why not; NONE where it can. Where nothing can be picked at any heading tried: the rule reached farthest over them.
    reasons: tuple[Reason, ...]
    at_base: tuple[str, ...] = ()  # boxes that the base touches, or whose margin it does
    on_floor: bool = True  # whether the base is within the floor's bounds
    in_the_way: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # boxes without which the arm reaches it
    way: bool = True  # whether the base gets there from where it starts

    @property
    def collides(self) -> bool:
        """Whether the base touches the table or its margin at every heading that was tried."""
        return Reason.BASE_COLLIDES in self.reasons

    @property
    def count(self) -> int:
        """Number of objects that can be picked."""
        return sum(time is not None for time in self.times)


def ask(
    scene: NamedScene,
    place: tuple[float, float],
    grid: GridConfig = GridConfig(),
    world: WorldConfig = WorldConfig(),
) -> Answer:
    """What can be picked from (x, y) on the floor, with the heading from which most can be, in least time.

    Where nothing can be, the heading is the first that doesn't collide with a box, if there is one. In rooms it is said
    which boxes are in the way, and whether the base gets there.

    Args:
        scene: padded; the same number of slots and boxes is compiled once.
        place: m, in W.
        grid: how many headings are tried.
        world: of drives and picks.
    """
    robot, rules = load_robot(scene.robot), world.pick
    poses, picks = jax.device_get(_pick_all(robot, scene.arrays, np.array(place), grid.turns, rules))
    feasible, slots = picks.feasible & scene.arrays.mask, range(len(scene.names))
    collides = np.all(picks.reason == Reason.BASE_COLLIDES, axis=1)  # a rule of the pose alone, whatever is picked
    order = np.lexsort((np.sum(picks.time * feasible, axis=1), collides, -np.sum(feasible, axis=1)))
    best = int(order[0])
    reason = picks.reason[best] if np.any(feasible) else np.max(picks.reason, axis=0)
    pose, room = np.asarray(poses[best], float), scene.arrays.room
    touching = [slot for slot in slots if reason[slot] == Reason.ARM_COLLIDES]
    return Answer(
        base_pose=pose,
        at_base=tuple(dict.fromkeys(box_name(scene, box) for box in boxes_at_base(pose, robot, room, rules))),
        on_floor=stays_on_floor(pose, robot, room),
        in_the_way=_find_in_the_way(scene, place, grid.turns, rules, touching),
        way=bool(collides[best]) or scene.furniture is None or _gets_there(robot, scene, pose, world),
        names=scene.names,
        times=tuple(float(picks.time[best, slot]) if feasible[best, slot] else None for slot in slots),
        reasons=tuple(Reason(int(reason[slot])) for slot in slots),
    )


def _gets_there(robot: Robot, scene: NamedScene, pose: Float[np.ndarray, "3"], world: WorldConfig) -> bool:
    drives = make_drives(robot, scene.arrays.room, world.navigation)
    start = np.asarray(scene.arrays.robot_start, np.float32)
    return bool(np.isfinite(drives.matrix(robot, start[None], pose[None].astype(np.float32))).all())


def _find_in_the_way(
    scene: NamedScene, place: tuple[float, float], turns: int, rules: PickConfig, slots: Sequence[int]
) -> dict[str, tuple[str, ...]]:
    """By object, the boxes of a room each of which alone keeps the arm from it, whatever the base's heading."""
    if scene.furniture is None or not slots:
        return {}
    robot, boxes, found = load_robot(scene.robot), scene.arrays.room.boxes, {}
    spot, point = np.array([[*place, 0.0]]), np.zeros((1, 2))
    near = rectangle_gaps(spot, point, boxes.pose, boxes.half_size)[0] < _NEAR_M
    for box in np.flatnonzero(np.asarray(boxes.blocks_arm) & near):
        without = np.array(boxes.blocks_arm)
        without[box] = False
        room = dataclasses.replace(scene.arrays.room, boxes=dataclasses.replace(boxes, blocks_arm=without))
        arrays = dataclasses.replace(scene.arrays, room=room)
        _, picks = _pick_all(robot, arrays, np.array(place), turns, rules)
        freed = np.any(np.asarray(picks.feasible), axis=0)
        for slot in (slot for slot in slots if freed[slot]):
            found[scene.names[slot]] = (*found.get(scene.names[slot], ()), scene.box_names[box])
    return found


@jax.jit(static_argnames=("turns", "rules"))
def _pick_all(
    robot: Robot, scene: Scene, place: Float[Array, "2"], turns: int, rules: PickConfig
) -> tuple[Float[Array, "turns 3"], Pick]:
    """The base poses at a place, and the picks of all objects from each."""
    headings = jnp.arange(turns) * (2.0 * jnp.pi / turns)
    poses = jnp.stack([jnp.full(turns, place[0]), jnp.full(turns, place[1]), headings], axis=-1)
    return poses, pick(robot, poses[:, None], scene.grasps, scene.room, rules)
