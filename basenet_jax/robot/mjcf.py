"""What an MJCF says of an arm: where its joints, its tool and its capsules are."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np

Transform = tuple[np.ndarray, np.ndarray]  # rotation, position


class Capsule(NamedTuple):
    """A capsule of the arm, in the frame of its link (0: the arm's base, i: after joint i)."""

    link: int
    name: str
    start: np.ndarray
    end: np.ndarray
    radius: float


class Arm(NamedTuple):
    """An arm read from a model. Transforms are of each frame in the one before it."""

    joint_ids: list[int]
    mount: Transform  # of the arm's base in the mobile base
    steps: list[Transform]  # from link to joint frame, for each joint
    tool: Transform
    capsules: list[Capsule]


def read_arm(model: mujoco.MjModel, *, joints: list[str], arm_base: str, tool: str, arm_geoms: str) -> Arm:
    """Reads an arm at the zero configuration.

    Args:
        model: with the mobile base as body "base".
        joints: names from the arm's base to its tool.
        arm_base: name of a body.
        tool: name of a site.
        arm_geoms: what the names of the arm's capsules begin with.

    Raises:
        ValueError: something is missing or of the wrong kind; the message names the robot file's field.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joint_ids = [named(model.joint, "joints", name).id for name in joints]
    if unlimited := [name for name, j in zip(joints, joint_ids, strict=True) if not model.jnt_limited[j]]:
        raise ValueError(f"joints: {', '.join(unlimited)} without a range in the model")
    base = _frame(named(data.body, "frames.arm_base", arm_base))
    frames = [base, *(_joint_frame(model, data, joint) for joint in joint_ids)]
    capsules = list(_capsules(model, data, arm_geoms, joint_ids, frames))
    if not capsules:
        raise ValueError(f"arm_geoms: no geom's name begins with {arm_geoms!r}")
    return Arm(
        joint_ids=joint_ids,
        mount=_between(_frame(named(data.body, "model", "base")), frames[0]),
        steps=[_between(before, after) for before, after in itertools.pairwise(frames)],
        tool=_between(frames[-1], _frame(named(data.site, "frames.tool", tool))),
        capsules=capsules,
    )


def read_box(model: mujoco.MjModel, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Centre in its body and half size (m) of the box that the arm must not touch.

    Raises:
        ValueError: there is no such geom, or it is not a box.
    """
    geom = named(model.geom, "base.body", name)
    if model.geom_type[geom.id] != mujoco.mjtGeom.mjGEOM_BOX:
        raise ValueError(f"base.body: geom {name!r} is not a box")
    return geom.pos.copy(), geom.size.copy()


def named(lookup: Callable[[str], Any], field: str, name: str) -> Any:
    """What the model calls so.

    Raises:
        ValueError: nothing; the message says which field asked for it.
    """
    try:
        return lookup(name)
    except KeyError as error:
        raise ValueError(f"{field}: {error.args[0]}") from error


def _between(parent: Transform, child: Transform) -> Transform:
    """The child's rotation and position in its parent, both given in the world at the zero configuration."""
    return parent[0].T @ child[0], parent[0].T @ (child[1] - parent[1])


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


def _capsules(
    model: mujoco.MjModel, data: mujoco.MjData, prefix: str, joint_ids: list[int], frames: list[Transform]
) -> Iterator[Capsule]:
    """Yields every capsule whose name begins with the prefix."""
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
        start, end = (rotation.T @ (data.geom_xpos[geom] + sign * along - origin) for sign in (-1.0, 1.0))
        yield Capsule(link, name, start, end, float(radius))
