"""The robot: what its MJCF says of frames, joints and shapes, and what its robot file adds, as one frozen pytree."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import functools
import itertools
import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import mujoco
import numpy as np
from flax import struct
from jax import Array
from jaxtyping import Float

Transform = tuple[np.ndarray, np.ndarray]  # rotation, position

Positive = Annotated[float, msgspec.Meta(gt=0)]


class _Frames(msgspec.Struct, forbid_unknown_fields=True):
    arm_base: str
    tool: str


class _BaseLimits(msgspec.Struct, forbid_unknown_fields=True):
    linear: Positive
    angular: Positive


class _Base(msgspec.Struct, forbid_unknown_fields=True):
    footprint: tuple[Positive, Positive]
    body: str
    speed: _BaseLimits
    acceleration: _BaseLimits


class _Deck(msgspec.Struct, forbid_unknown_fields=True):
    center: tuple[float, float]
    size: tuple[Positive, Positive]


class RobotFile(msgspec.Struct, forbid_unknown_fields=True):
    """The robot file (`basenet-robot/1`): everything about a mobile manipulator that its MJCF can't say."""

    format: Literal["basenet-robot/1"]
    name: str
    model: str
    frames: _Frames
    joints: list[str]
    joint_speed: list[Positive]
    joint_acceleration: list[Positive]
    home_degrees: list[float]
    stow_degrees: list[float]
    base: _Base
    deck: _Deck
    arm_geoms: str
    closed_form: Literal["ur"] | None = None


@struct.dataclass
class Robot:
    """A mobile manipulator, as arrays that any kernel can be traced over.

    Leaves are float64 NumPy arrays: under jit they become float32, or stay float64 where x64 is enabled, so one
    robot serves both precisions. `n` joints, `m` capsules. Frame a is the arm's base frame, frame b the base's.
    """

    joint_rotation: Float[Array, "n 3 3"]  # of each joint frame (z along the axis) in the link before it
    joint_position: Float[Array, "n 3"]  # likewise, m
    tool_rotation: Float[Array, "3 3"]  # of the tool frame in the last link
    tool_position: Float[Array, "3"]
    mount_rotation: Float[Array, "3 3"]  # of frame a in frame b
    mount_position: Float[Array, "3"]
    joint_lower: Float[Array, " n"]  # rad (m for sliding joints)
    joint_upper: Float[Array, " n"]
    joint_speed: Float[Array, " n"]  # rad/s
    joint_acceleration: Float[Array, " n"]  # rad/s^2
    home: Float[Array, " n"]
    stow: Float[Array, " n"]
    capsule_start: Float[Array, "m 3"]  # in the capsule's link
    capsule_end: Float[Array, "m 3"]
    capsule_radius: Float[Array, " m"]
    body_center: Float[Array, "3"]  # of the body box, in frame b
    body_half_size: Float[Array, "3"]
    footprint_half_size: Float[Array, "2"]
    base_speed: Float[Array, "2"]  # m/s, rad/s
    base_acceleration: Float[Array, "2"]  # m/s^2, rad/s^2
    deck: Float[Array, "4"]  # centre x, y and size x, y in frame b
    name: str = struct.field(pytree_node=False)
    model_path: str = struct.field(pytree_node=False)
    joint_names: tuple[str, ...] = struct.field(pytree_node=False)
    prismatic: tuple[bool, ...] = struct.field(pytree_node=False)
    capsule_link: tuple[int, ...] = struct.field(pytree_node=False)  # 0: the arm's base, i: after joint i
    capsule_geoms: tuple[str, ...] = struct.field(pytree_node=False)  # their names in the MJCF
    body_geom: str = struct.field(pytree_node=False)  # the body box's
    closed_form: str | None = struct.field(pytree_node=False)

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joint_names)


def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    assets = resources.files("basenet_jax.robot") / "assets"
    return tuple(sorted(entry.name[:-5] for entry in assets.iterdir() if entry.name.endswith(".yaml")))


@functools.cache
def load_robot(name: str = "ur5e_mobile") -> Robot:
    """A packaged robot by its name.

    Raises:
        ValueError: there is no such robot.
    """
    if name not in packaged_robots():
        raise ValueError(f"robot: found {name!r}, allowed are {', '.join(packaged_robots())}")
    with resources.as_file(resources.files("basenet_jax.robot") / "assets") as assets:
        return read_robot(assets / f"{name}.yaml")


def read_robot(path: Path) -> Robot:
    """Reads a robot file and the MJCF that it names.

    Raises:
        ValueError: the file or the model doesn't describe a mobile manipulator; the message names the field.
    """
    try:
        file = msgspec.yaml.decode(path.read_bytes(), type=RobotFile)
    except (OSError, msgspec.MsgspecError) as error:
        raise ValueError(f"{path}: {error}") from error
    model_path = path.parent / file.model
    try:
        model = mujoco.MjModel.from_xml_path(str(model_path))
    except ValueError as error:
        raise ValueError(f"{path}: model: {model_path} can't be read: {error}") from error
    try:
        return _build(file, model, str(model_path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _build(file: RobotFile, model: mujoco.MjModel, model_path: str) -> Robot:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joint_ids = [_named(model.joint, "joints", name).id for name in file.joints]
    arm_base = _frame(_named(data.body, "frames.arm_base", file.frames.arm_base))
    frames = [arm_base, *(_joint_frame(model, data, j) for j in joint_ids)]
    steps = [_between(before, after) for before, after in itertools.pairwise(frames)]
    tool = _between(frames[-1], _frame(_named(data.site, "frames.tool", file.frames.tool)))
    mount = _between(_frame(_named(data.body, "model", "base")), frames[0])
    capsules = list(_capsules(model, data, file.arm_geoms, joint_ids, frames))
    if not capsules:
        raise ValueError(f"arm_geoms: no geom's name begins with {file.arm_geoms!r}")
    body = _named(model.geom, "base.body", file.base.body)
    if model.geom_type[body.id] != mujoco.mjtGeom.mjGEOM_BOX:
        raise ValueError(f"base.body: geom {file.base.body!r} is not a box")
    per_joint = {
        "joint_speed": file.joint_speed,
        "joint_acceleration": file.joint_acceleration,
        "home_degrees": file.home_degrees,
        "stow_degrees": file.stow_degrees,
    }
    for field, values in per_joint.items():
        if len(values) != len(joint_ids):
            raise ValueError(f"{field}: found {len(values)} values, needs one for each of {len(joint_ids)} joints")
    unlimited = [name for name, j in zip(file.joints, joint_ids, strict=True) if not model.jnt_limited[j]]
    if unlimited:
        raise ValueError(f"joints: {', '.join(unlimited)} without a range in the model")
    sliding = tuple(bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in joint_ids)
    unit = np.where(sliding, 1.0, math.pi / 180.0)
    leaves: dict[str, Any] = {
        "joint_rotation": np.stack([rotation for rotation, _ in steps]),
        "joint_position": np.stack([position for _, position in steps]),
        "tool_rotation": tool[0],
        "tool_position": tool[1],
        "mount_rotation": mount[0],
        "mount_position": mount[1],
        "joint_lower": model.jnt_range[joint_ids, 0].copy(),
        "joint_upper": model.jnt_range[joint_ids, 1].copy(),
        "joint_speed": np.array(file.joint_speed),
        "joint_acceleration": np.array(file.joint_acceleration),
        "home": np.array(file.home_degrees) * unit,
        "stow": np.array(file.stow_degrees) * unit,
        "capsule_start": np.stack([start for _, _, start, _, _ in capsules]),
        "capsule_end": np.stack([end for _, _, _, end, _ in capsules]),
        "capsule_radius": np.array([radius for *_, radius in capsules]),
        "body_center": body.pos.copy(),
        "body_half_size": body.size.copy(),
        "footprint_half_size": np.array(file.base.footprint) / 2,
        "base_speed": np.array([file.base.speed.linear, file.base.speed.angular]),
        "base_acceleration": np.array([file.base.acceleration.linear, file.base.acceleration.angular]),
        "deck": np.array([*file.deck.center, *file.deck.size]),
    }
    return Robot(
        **leaves,
        name=file.name,
        model_path=model_path,
        joint_names=tuple(file.joints),
        prismatic=sliding,
        capsule_link=tuple(link for link, *_ in capsules),
        capsule_geoms=tuple(name for _, name, *_ in capsules),
        body_geom=file.base.body,
        closed_form=file.closed_form,
    )


def _between(parent: Transform, child: Transform) -> Transform:
    """The child's rotation and position in its parent, both given in the world at the zero configuration."""
    return parent[0].T @ child[0], parent[0].T @ (child[1] - parent[1])


def _named(lookup: Callable[[str], Any], field: str, name: str) -> Any:
    """What the model calls so; the error says which field asked for it."""
    try:
        return lookup(name)
    except KeyError as error:
        raise ValueError(f"{field}: {error.args[0]}") from error


def _frame(part: Any) -> Transform:
    """Rotation and position of a body or site in the world."""
    return part.xmat.reshape(3, 3).copy(), part.xpos.copy()


def _joint_frame(model: mujoco.MjModel, data: mujoco.MjData, joint: int) -> Transform:
    """The frame at the joint's anchor whose z is its axis; the body's own axes where they already are."""
    rotation = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
    axis = model.jnt_axis[joint]
    if abs(axis[2]) < 1.0 - 1e-12 or axis[2] < 0:
        helper = np.eye(3)[np.argmin(np.abs(axis))]
        x = np.cross(helper, axis) / np.linalg.norm(np.cross(helper, axis))
        rotation = rotation @ np.stack([x, np.cross(axis, x), axis], axis=1)
    return rotation.copy(), data.xanchor[joint].copy()


def _capsules(model, data, prefix: str, joint_ids: list[int], frames: list[Transform]):
    """Yields (link, name, start, end, radius) of every capsule whose name begins with the prefix."""
    link_of_body = {int(model.jnt_bodyid[joint]): link for link, joint in enumerate(joint_ids, start=1)}
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if not name.startswith(prefix):
            continue
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_CAPSULE:
            raise ValueError(f"arm_geoms: geom {name!r} is not a capsule")
        body = int(model.geom_bodyid[geom])
        while body and body not in link_of_body:
            body = int(model.body_parentid[body])
        rotation, origin = frames[link := link_of_body.get(body, 0)]
        radius, half_length = model.geom_size[geom][:2]
        along = data.geom_xmat[geom].reshape(3, 3)[:, 2] * half_length
        ends = (rotation.T @ (data.geom_xpos[geom] + sign * along - origin) for sign in (-1.0, 1.0))
        yield link, name, *ends, float(radius)
