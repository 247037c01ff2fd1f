"""The scene in MuJoCo: a model of room, robot and objects, and contact queries in float64 for replay and the judge.

Contacts are declared pair by pair and nothing else collides: the base's footprint with boxes grown by the base's
clearance (rule 1), every capsule of arm and gripper with boxes and the robot's body box (rule 4) and with objects
(rule 5), and capsules with one another and the pedestal (rule 6).
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import jax
import mujoco
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Bool, Float

from basenet_jax.config import PickConfig
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import BASE, BASE_JOINTS, BODY, PEDESTAL, capsule_name
from basenet_jax.world.boxes import Room, blocks
from basenet_jax.world.scene import Scene

BOX, KEEP_OUT, FOOTPRINT = "box", "keep out", "footprint"  # the first two with the number of the box
ROBOT = "robot/"  # before the names of everything that comes from the robot's MJCF
BASE_DIMENSION, ARM_DIMENSION = 1, 3  # of contacts, as MuJoCo calls it: tells those of rules 1 and 4,
OBJECT_DIMENSION, SELF_DIMENSION = 4, 6  # and 5 and 6 apart
_DIMENSIONS = (BASE_DIMENSION, ARM_DIMENSION, OBJECT_DIMENSION, SELF_DIMENSION)
PARKED = (0.0, 0.0, -10.0)  # m: where unused objects wait, below the floor
HIDDEN_GROUP = 4  # of geoms that only contacts need; pictures leave groups above 2 out by default
SLAB = 0.5  # m, half the height of footprint and grown table: rule 1 is planar, so any height does
MARGIN = 1e-4  # m: contacts up to this distance are reported, so that a distance of exactly 0 is among them
_WOOD, _SOLID, _MARKED = (0.72, 0.58, 0.42, 1.0), (0.62, 0.64, 0.66, 1.0), (0.85, 0.55, 0.45, 0.6)
OBJECT_COLORS = ((0.80, 0.33, 0.24), (0.93, 0.93, 0.90), (0.90, 0.73, 0.20), (0.30, 0.49, 0.70), (0.75, 0.45, 0.60))


def build_model(
    robot: Robot,
    room: Room,
    object_size: Float[np.ndarray, "M 3"] | None = None,
    object_class: ArrayLike | None = None,
    config: PickConfig = PickConfig(),
    *,
    with_clutter: bool = False,
) -> mujoco.MjModel:
    """The MuJoCo model of a room, a robot and objects (mocap bodies "object 0", ... parked below the floor).

    Frames of arm and body and their shapes are the MJCF's; of the robot's arrays only the footprint is used. Objects
    come first in the list of mocap bodies, so `mocap_pos[i]` is object i's centre.

    Args:
        robot: its MJCF is `robot_mjcf`'s.
        room: one room (its leaves unbatched and concrete).
        object_size: x, y, z (m) of each object's box; None for no objects.
        object_class: of each object, for its colour; None paints them all alike.
        config: the base's clearance from boxes.
        with_clutter: whether the arm's contacts with objects, itself and the pedestal are declared too.
    """
    spec = mujoco.MjSpec()
    spec.worldbody.add_frame().attach_body(mujoco.MjSpec.from_string(robot.model_xml).body(BASE), ROBOT, "")
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    _add_surroundings(spec, robot, room, config)
    sizes = np.zeros((0, 3)) if object_size is None else np.asarray(object_size, float)
    colors = np.zeros(len(sizes), int) if object_class is None else np.asarray(object_class)
    for index, (size, color) in enumerate(zip(sizes, colors, strict=True)):
        body = spec.worldbody.add_body(name=f"object {index}", mocap=True, pos=PARKED)
        rgba = (*OBJECT_COLORS[color % len(OBJECT_COLORS)], 1.0)
        _add_box(body, f"object {index}", size / 2, (0.0, 0.0, 0.0), rgba=rgba)
    _add_pairs(spec, robot, room)
    if with_clutter:
        _add_clutter_pairs(spec, robot, len(sizes))
    return spec.compile()


def scene_model(robot: Robot, scene: Scene, config: PickConfig = PickConfig()) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Model and data of one concrete scene (unbatched): objects in their true sizes at their poses, the robot at its
    start with its arm at home; unused slots are left out."""
    used = np.asarray(scene.mask)
    pose, size = np.asarray(scene.object_pose, float)[used], np.asarray(scene.object_size, float)[used]
    model = build_model(robot, scene.room, size, np.asarray(scene.object_class)[used], config)
    data = mujoco.MjData(model)
    _place(data, pose, np.asarray(scene.surface_height, float)[used] + size[:, 2] / 2)
    data.qpos[state_addresses(robot, model)] = [*np.asarray(scene.robot_start), *np.asarray(robot.home)]
    mujoco.mj_forward(model, data)
    return model, data


def _place(data: mujoco.MjData, pose: Float[np.ndarray, "M 3"], height: Float[np.ndarray, " M"]) -> None:
    """Objects at (x, y, yaw) in W, their centres so high (m)."""
    data.mocap_pos[:, :2], data.mocap_pos[:, 2] = pose[:, :2], height
    data.mocap_quat[:, 0], data.mocap_quat[:, 3] = np.cos(pose[:, 2] / 2), np.sin(pose[:, 2] / 2)


def state_addresses(robot: Robot, model: mujoco.MjModel) -> np.ndarray:
    """Where base pose and joints, in this order, are in `qpos`."""
    return np.array([model.joint(ROBOT + name).qposadr[0] for name in (*BASE_JOINTS, *robot.joint_names)])


class MujocoChecker:
    """Rules 1, 4, 5 and 6 by MuJoCo's own contacts, in float64 and one state after another (about 20 us each).

    Args:
        robot: the robot.
        room: one concrete room.
        config: the base's clearance, and up to which distance it counts as touching.
        scene: unbatched and concrete, whose objects count; None: neither objects nor the arm itself do.
    """

    def __init__(self, robot: Robot, room: Room, config: PickConfig = PickConfig(), *, scene: Scene | None = None):
        sizes = None if scene is None else np.asarray(scene.object_size, float)
        self.model = build_model(robot, room, sizes, config=config, with_clutter=scene is not None)
        self.data = mujoco.MjData(self.model)
        self._scene = scene
        self._home = np.asarray(robot.home)
        self._addresses = state_addresses(robot, self.model)
        self._touching = config.touching_m

    def base_touches(self, base_pose: Float[np.ndarray, "N 3"]) -> Bool[np.ndarray, " N"]:
        """Whether the footprint touches the grown table (rule 1); poses as x, y (m), heading (rad) in W."""
        joints = np.broadcast_to(self._home, (len(base_pose), len(self._home)))
        return self.distances(base_pose, joints)[:, 0] <= self._touching

    def arm_touches(
        self, base_pose: Float[np.ndarray, "N 3"], joints: Float[np.ndarray, "N dof"]
    ) -> Bool[np.ndarray, " N"]:
        """Whether a capsule of arm or gripper touches the table's box or the body box (rule 4); joints in rad."""
        return self.distances(base_pose, joints)[:, 1] <= 0.0

    def stand(self, standing: Bool[np.ndarray, " M"]) -> None:
        """Leaves only some of the scene's objects standing."""
        assert self._scene is not None
        pose, size = (np.asarray(x, float) for x in (self._scene.object_pose, self._scene.object_size))
        height = np.asarray(self._scene.surface_height, float) + size[:, 2] / 2
        _place(self.data, pose, np.where(standing, height, PARKED[2]))

    def distances(
        self, base_pose: Float[np.ndarray, "N 3"], joints: Float[np.ndarray, "N dof"]
    ) -> Float[np.ndarray, "N 4"]:
        """Distance (m) of the deepest contact of rules 1, 4, 5 and 6: negative inside, infinite beyond `MARGIN`."""
        result = np.full((len(base_pose), len(_DIMENSIONS)), np.inf)
        states = np.concatenate([base_pose, joints], axis=1, dtype=float)
        for row, state in zip(result, states, strict=True):
            self.data.qpos[self._addresses] = state
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            contact = self.data.contact
            for dimension, distance in zip(contact.dim, contact.dist, strict=True):
                rule = _DIMENSIONS.index(dimension)
                row[rule] = min(row[rule], distance)
        return result


def _add_surroundings(spec: mujoco.MjSpec, robot: Robot, room: Room, config: PickConfig) -> None:
    world, base = spec.worldbody, spec.body(ROBOT + BASE)
    world.add_light(pos=(0.0, 0.0, 4.0), dir=(0.0, 0.0, -1.0))
    spec.visual.headlight.ambient = (0.4, 0.4, 0.4)
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(6.0, 6.0, 0.1),
        rgba=(0.88, 0.88, 0.86, 1.0),
        contype=0,
        conaffinity=0,
    )
    boxes = jax.tree.map(np.asarray, jax.device_get(room.boxes))
    for index in np.flatnonzero(boxes.blocks_base | boxes.blocks_arm):
        (x, y, yaw), (half_x, half_y) = boxes.pose[index].astype(float), boxes.half_size[index].astype(float)
        low, high = float(boxes.low[index]), float(boxes.high[index])
        turned = (np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
        looks = {"rgba": _WOOD if boxes.bears_objects[index] else _SOLID if boxes.blocks_arm[index] else _MARKED}
        half = (half_x, half_y, (high - low) / 2)
        _add_box(world, f"{BOX} {index}", half, (x, y, (low + high) / 2), quat=turned, **looks)
        grown = (half_x + config.base_clearance_m, half_y + config.base_clearance_m, SLAB)
        _add_box(world, f"{KEEP_OUT} {index}", grown, (x, y, SLAB), quat=turned, group=HIDDEN_GROUP)
    _add_box(base, FOOTPRINT, (*robot.footprint_half_size, SLAB), (0.0, 0.0, SLAB), group=HIDDEN_GROUP)


def _add_box(body, name: str, half_size, position, **looks) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(name=name, type=box, size=half_size, pos=position, contype=0, conaffinity=0, **looks)


def _add_pairs(spec: mujoco.MjSpec, robot: Robot, room: Room) -> None:
    boxes, body = jax.tree.map(np.asarray, jax.device_get(room.boxes)), spec.geom(ROBOT + BODY)
    for index in np.flatnonzero(blocks(boxes, body.pos[2] + body.size[2])):
        name = f"{KEEP_OUT} {index}"
        spec.add_pair(geomname1=FOOTPRINT, geomname2=name, condim=BASE_DIMENSION, margin=MARGIN)
    solid = [f"{BOX} {index}" for index in np.flatnonzero(boxes.blocks_arm)]
    for index, meets_body in enumerate(robot.capsule_meets_body):
        for box in (*solid, ROBOT + BODY) if meets_body else solid:
            spec.add_pair(geomname1=ROBOT + capsule_name(index), geomname2=box, condim=ARM_DIMENSION, margin=MARGIN)


def _add_clutter_pairs(spec: mujoco.MjSpec, robot: Robot, objects: int) -> None:
    for capsule, meets_body in enumerate(robot.capsule_meets_body):
        others = [(f"object {index}", OBJECT_DIMENSION) for index in range(objects)]
        if meets_body and spec.geom(ROBOT + PEDESTAL) is not None:
            others.append((ROBOT + PEDESTAL, SELF_DIMENSION))
        others += [(ROBOT + capsule_name(b), SELF_DIMENSION) for a, b in robot.self_pairs if a == capsule]
        for other, dimension in others:
            spec.add_pair(geomname1=ROBOT + capsule_name(capsule), geomname2=other, condim=dimension, margin=MARGIN)
