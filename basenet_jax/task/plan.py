"""Plans, and the one judge that says what executing them costs."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax import struct
from basenet_jax.compilation import Stored
from basenet_jax.config import WorldConfig
from basenet_jax.robot.kinematics import geometric_jacobian
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives, GivenDrives, PointDrives, are_docked, make_drives
from basenet_jax.task.picking import ArmCheck, Pick, Reason, Rules, pick
from basenet_jax.world.boxes import Boxes, Room
from basenet_jax.world.clearance import base_collides, capsules_touch
from basenet_jax.world.grasps import Grasps
from basenet_jax.world.scene import Scene


@struct.dataclass
class Plan:
    """In which order to pick and where to park for each pick; one step per object, padded to M steps.

    Objects that no base pose can serve come last, with `served` false.
    """

    object_index: Int[Array, "*batch M"]  # slot of the scene; -1: no step
    base_pose: Float[Array, "*batch M 3"]  # (x, y, heading) in W
    served: Bool[Array, "*batch M"]  # whether the step has a base pose
    reason: Int[Array, "*batch M"]  # a `Reason`: why a step has none


@struct.dataclass
class Outcome:
    """What executing a plan comes to, step by step."""

    is_step: Bool[Array, "*batch M"]
    feasible: Bool[Array, "*batch M"]
    reason: Int[Array, "*batch M"]  # a `Reason`
    navigation_time: Float[Array, "*batch M"]  # s
    pick_time: Float[Array, "*batch M"]  # s
    joints: Float[Array, "*batch M waypoints dof"]  # rad
    grasp: Int[Array, "*batch M"]  # which of the object's grasps; -1: none
    least_singular_value: Float[Array, "*batch M"] | None = None  # see `with_singular_values`; None: not computed
    reliability: Float[Array, "*batch M"] | None = None  # see `reliability.with_reliability`; None: not computed

    @property
    def grasped(self) -> Int[Array, "*batch"]:
        """Number of objects grasped."""
        return self.feasible.sum(axis=-1)

    @property
    def navigation(self) -> Float[Array, "*batch"]:
        """Navigation time N of the whole plan (s)."""
        return self.navigation_time.sum(axis=-1)

    @property
    def picking(self) -> Float[Array, "*batch"]:
        """Grasping time G of the whole plan (s)."""
        return self.pick_time.sum(axis=-1)

    @property
    def execution(self) -> Float[Array, "*batch"]:
        """Execution time N + G (s)."""
        return self.navigation + self.picking


def execute(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    drives: Drives | None = None,
    *,
    config: WorldConfig = WorldConfig(),
    arm_check: ArmCheck = capsules_touch,
) -> Outcome:
    """Executes plans: drive (time counts), pick (time counts if feasible), step by step.

    An infeasible pick costs nothing and its object stays, where rule 5 holds in the way of later ones. A base pose that
    collides with the room or can't be reached ends the episode: that drive and all later steps are not executed.

    Args:
        robot: the robot.
        scene: one scene or a batch.
        plan: of the same batch shape.
        drives: of the room that all scenes are in, or given; by default of a point, each round its scene's one table.
        config: of navigation and picks.
        arm_check: tests joint states for collision.
    """
    is_step = plan.object_index >= 0
    goes = is_step & plan.served
    # An unserved step comes after all served ones, so where the robot would drive from there doesn't matter.
    before = jnp.concatenate([scene.robot_start[..., None, :], plan.base_pose[..., :-1, :]], axis=-2)
    room = jax.tree.map(lambda x: jnp.expand_dims(x, scene.robot_start.ndim - 1), scene.room)
    drives = PointDrives(room, config.navigation) if drives is None else drives
    drive = drives.each(robot, before, plan.base_pose)
    collides = base_collides(robot, plan.base_pose, room, config.pick.base_clearance_m, config.pick.touching_m)
    fails = goes & (collides | ~jnp.isfinite(drive))
    ended = jnp.cumsum(fails, axis=-1) - fails > 0  # by an earlier step
    executed = goes & ~ended & ~fails
    slot = jnp.maximum(plan.object_index, 0)
    picks = _pick_in_order(robot, scene, plan.base_pose, slot, executed, room, config, arm_check)
    stopped = jnp.where(collides, Reason.BASE_COLLIDES, Reason.UNREACHABLE)
    reason = jnp.where(ended, Reason.NOT_EXECUTED, jnp.where(fails, stopped, picks.reason))
    reason = jnp.where(plan.served, reason, plan.reason)
    feasible = executed & picks.feasible
    return Outcome(
        is_step=is_step,
        feasible=feasible,
        reason=jnp.where(is_step, reason, Reason.NONE),
        navigation_time=jnp.where(executed, drive, 0.0),
        pick_time=jnp.where(feasible, picks.time, 0.0),
        joints=picks.joints,
        grasp=picks.grasp,
    )


def _pick_in_order(
    robot: Robot,
    scene: Scene,
    base_pose: Float[Array, "*batch M 3"],
    slot: Int[Array, "*batch M"],
    executed: Bool[Array, "*batch M"],
    room: Room,
    config: WorldConfig,
    arm_check: ArmCheck,
) -> Pick:
    """The picks of all steps, each among the objects that are left by those before it.

    All are tried at once as if every one before had succeeded, and again as long as that wasn't so: each time at least
    one more step in order is right, and nearly always all are at the first.
    """
    grasps = _by_step(scene.grasps, slot)

    def try_all(neighbours: Boxes | None) -> Pick:
        return pick(robot, base_pose, grasps, room, config.pick, arm_check, neighbours=neighbours)

    if not Rules.of(config.pick, room).object_in_the_way:
        return try_all(None)
    boxes = jax.tree.map(lambda x: jnp.expand_dims(x, slot.ndim - 1), scene.object_boxes)
    objects = jnp.arange(scene.mask.shape[-1])

    def among_left(taken: Bool[Array, "*batch M"]) -> Pick:
        """Where the steps take what they are said to."""
        takes = (slot[..., None] == objects) & taken[..., None]
        gone = (jnp.cumsum(takes, axis=-2) > 0) | (slot[..., None] == objects)
        return try_all(dataclasses.replace(boxes, blocks_arm=boxes.blocks_arm & ~gone))

    def again(state: tuple[Array, Pick]) -> tuple[Array, Pick]:
        taken = executed & state[1].feasible
        return taken, among_left(taken)

    def wrong(state: tuple[Array, Pick]) -> Array:
        return jnp.any(state[0] != (executed & state[1].feasible))

    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(among_left, executed))
    return jax.lax.while_loop(wrong, again, (~executed, dataclasses.replace(nothing, feasible=executed)))[1]


def _by_step(grasps: Grasps, slot: Int[Array, "*batch S"]) -> Grasps:
    """The grasps of the object of each step."""
    return jax.tree.map(
        lambda x: jnp.take_along_axis(x, jnp.expand_dims(slot, tuple(range(slot.ndim, x.ndim))), slot.ndim - 1), grasps
    )


compiled_execute = Stored(execute, static=("config",))


def judge(
    robot: Robot, scenes: Scene, plans: Plan, world: WorldConfig = WorldConfig(), given: GivenDrives | None = None
) -> Outcome:
    """`execute` of one scene or a batch, compiled, with the drives of each scene's room, unless others are given.

    Scenes in which one drives docked are judged one after the other: each room has its own roads.

    Args:
        robot: the robot.
        scenes: one scene or a batch with one leading axis, concrete.
        plans: of the same batch shape.
        world: of drives and picks.
        given: drives instead of the rooms' own.
    """
    if given is not None or not are_docked(scenes.room, world.navigation):
        return compiled_execute(robot, scenes, plans, given, config=world)
    if scenes.mask.ndim == 1:
        drives = make_drives(robot, scenes.room, world.navigation)
        return compiled_execute(robot, scenes, plans, drives, config=world)
    rows = [jax.tree.map(lambda x, row=row: x[row], (scenes, plans)) for row in range(len(scenes.mask))]
    judged = (judge(robot, scene, plan, world) for scene, plan in rows)
    return jax.tree.map(lambda *x: jnp.stack(x), *judged)


_compiled_jacobian = Stored(geometric_jacobian)


def with_singular_values(robot: Robot, outcome: Outcome) -> Outcome:
    """The outcome with how near each pick comes to a pose in which the arm can't move in every direction.

    That is the least singular value of the tool's geometric Jacobian (m and rad), the least over the pick's waypoints;
    0 where nothing is picked. A stretched elbow's is 0. Beside the judge, since planners judge without it.

    Args:
        robot: of the outcome.
        outcome: concrete, of one plan or a batch.
    """
    # By NumPy: a process that loads its programs would wait as long for JAX's decomposition as for all the rest.
    jacobian, feasible = jax.device_get((_compiled_jacobian(robot, outcome.joints), outcome.feasible))
    least = np.linalg.svd(jacobian, compute_uv=False)[..., -1].min(axis=-1)
    return dataclasses.replace(outcome, least_singular_value=jnp.asarray(np.where(feasible, least, 0.0)))
