"""What can be picked from a place on the floor, and why not the rest."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.config import GridConfig, PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.picking import Pick, Reason, pick
from basenet_jax.world.scene import NamedScene, Scene


@dataclass(frozen=True)
class Answer:
    """What can be picked from one base pose."""

    base_pose: Float[np.ndarray, "3"]  # (x, y, heading) in W
    names: tuple[str, ...]
    times: tuple[float | None, ...]  # s of each object's pick cycle; None: it can't be picked
    # Why not; NONE where it can. Where nothing can be picked at any heading tried: the rule reached farthest over them.
    reasons: tuple[Reason, ...]

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
    rules: PickConfig = PickConfig(),
) -> Answer:
    """What can be picked from (x, y) on the floor, with the heading from which most can be, in least time.

    Where nothing can be, the heading is the first that doesn't collide with the table, if there is one.

    Args:
        scene: padded; the same number of slots is compiled once.
        place: m, in W.
        grid: how many headings are tried.
        rules: of picks.
    """
    robot = load_robot(scene.robot)
    poses, picks = jax.device_get(_pick_all(robot, scene.arrays, np.array(place), grid.turns, rules))
    feasible, slots = picks.feasible & scene.arrays.mask, range(len(scene.names))
    collides = np.all(picks.reason == Reason.BASE_COLLIDES, axis=1)  # a rule of the pose alone, whatever is picked
    order = np.lexsort((np.sum(picks.time * feasible, axis=1), collides, -np.sum(feasible, axis=1)))
    best = int(order[0])
    reason = picks.reason[best] if np.any(feasible) else np.max(picks.reason, axis=0)
    return Answer(
        base_pose=np.asarray(poses[best], float),
        names=scene.names,
        times=tuple(float(picks.time[best, slot]) if feasible[best, slot] else None for slot in slots),
        reasons=tuple(Reason(int(reason[slot])) for slot in slots),
    )


@jax.jit(static_argnames=("turns", "rules"))
def _pick_all(
    robot: Robot, scene: Scene, place: Float[Array, "2"], turns: int, rules: PickConfig
) -> tuple[Float[Array, "turns 3"], Pick]:
    """The base poses at a place, and the picks of all objects from each."""
    headings = jnp.arange(turns) * (2.0 * jnp.pi / turns)
    poses = jnp.stack([jnp.full(turns, place[0]), jnp.full(turns, place[1]), headings], axis=-1)
    return poses, pick(robot, poses[:, None], scene.grasps, scene.room, rules)
