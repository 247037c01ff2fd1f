"""What a robot model says of an arm: where its joints, its tool and its shapes are."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from basenet_jax.documents.fields import DocumentError, describe, field_error
from basenet_jax.robot.capsule_fit import Fit, box_points, extreme_points, fit_capsule
from basenet_jax.robot.mesh_files import MeshFiles
from basenet_jax.robot.model_text import ModelText
from basenet_jax.robot.tool import ToolPlace

Transform = tuple[np.ndarray, np.ndarray]  # rotation, position

MAX_ARM_SHAPES = 300
_COUNTS, _LEFT_OUT = 0, 5  # groups of geoms
_ANY_MESH = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])  # in place of those that aren't needed
_SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_MOST_RAD = 12.7  # a joint's limit: twice round, with room
_LEAST_RANGE = 0.12  # rad: a turning joint's, narrower than what radians that were taken for degrees come to
_MESSAGE = 200  # characters of MuJoCo's messages that are passed on


class Capsule(NamedTuple):
    """A capsule of the arm, in the frame of its link (0: the arm's base, i: after joint i)."""

    link: int
    name: str  # what it stands for
    fit: Fit


class Arm(NamedTuple):
    """An arm read from a model. Transforms are of each frame in the one before it."""

    joint_ids: list[int]
    steps: list[Transform]  # from link to joint frame, for each joint
    tool: Transform
    capsules: list[Capsule]  # by link


def compile_model(text: ModelText, *, joints: Sequence[str], arm_base: str, shapes: str | None) -> mujoco.MjModel:
    """The MuJoCo model of a cleaned text, in which shapes that don't count are marked.

    Args:
        text: of `read_model_text`.
        joints: the arm's; what its first one moves counts, and has to have its meshes.
        arm_base: a body or site; what else it carries is drawn, if it can be read.
        shapes: `collision` or `visual`; None where no shape counts, and no mesh is read.

    Raises:
        DocumentError: a mesh is missing or of a wrong kind, or MuJoCo can't make a model of it.
    """
    try:
        spec = mujoco.MjSpec.from_string(text.xml)
        spec.assets = _choose_shapes(spec, text.meshes, joints[0], arm_base, shapes)
        return spec.compile()
    except DocumentError:
        raise
    except Exception as error:  # MuJoCo raises what it likes
        message = re.sub(r" Element name 'mesh\d+', id \d+", "", " ".join(str(error).split()))
        message = re.sub(r"'?(mesh\d+\.\w+)'?", lambda name: text.meshes.reference(name[1]), message)
        raise DocumentError(f"model: MuJoCo can't read it: {message[:_MESSAGE]}") from None


def _choose_shapes(
    spec: mujoco.MjSpec, files: MeshFiles, first_joint: str, arm_base: str, shapes: str | None
) -> dict[str, bytes]:
    """Marks all shapes as counting or not, and reads the meshes of those that count; the others' are replaced."""
    first, base = spec.joint(first_joint), spec.body(arm_base) or getattr(spec.site(arm_base), "parent", None)
    arm, carried = (
        set() if body is None or shapes is None else {body, *body.find_all("body")}
        for body in (getattr(first, "parent", None), base)
    )
    meshes = {mesh.name: mesh.file for mesh in spec.meshes}
    assets: dict[str, bytes] = {}

    def is_read(name: str, needed: bool) -> bool:
        file = meshes.get(name)
        if file and file not in assets:
            try:
                assets[file] = files.read(file)
            except DocumentError:
                if needed:
                    raise
                return False
        return True

    if (count := sum(geom.parent in arm for geom in spec.geoms)) > MAX_ARM_SHAPES:
        found = f"{count} shapes on the arm"
        raise field_error(
            "model", found, f"are up to {MAX_ARM_SHAPES} (or give its shape as capsules in the robot file)"
        )
    for geom in spec.geoms:
        is_mesh, is_arm = geom.type == mujoco.mjtGeom.mjGEOM_MESH, geom.parent in arm
        counts = (is_arm or geom.parent in carried) and (shapes == "visual" or geom.contype or geom.conaffinity)
        if is_mesh:
            counts = counts and is_read(geom.meshname, is_arm)
        geom.group = _COUNTS if counts else _LEFT_OUT
        if is_mesh and not counts:
            geom.type, geom.meshname, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, "", np.full(3, 1e-3)
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # inertias don't matter, open meshes may be there
        if mesh.file and mesh.file not in assets:
            mesh.file, mesh.uservert = "", _ANY_MESH.ravel()
    return assets


def read_arm(
    model: mujoco.MjModel, *, joints: list[str], arm_base: str, tool: ToolPlace, fixed: Mapping[str, float]
) -> Arm:
    """Reads an arm at the zero configuration, other joints where the file fixes them.

    Args:
        model: of `compile_model`.
        joints: names from the arm's base to its tool.
        arm_base: name of a site or body.
        tool: the frame that grasps are given for.
        fixed: joints that stay, by name (rad or m).

    Raises:
        DocumentError: something is missing or of the wrong kind; the message names the robot file's field.
    """
    data = start_state(model, fixed)
    base_body, base = find_frame(model, data, "frames.arm_base", arm_base)
    tool_body, _ = find_tool(model, data, tool)
    between_them = _joints_between(model, base_body, tool_body, arm_base, tool)
    joint_ids = _check_joints(model, joints, [j for j in between_them if model.joint(j).name not in fixed])
    data.qpos[model.jnt_qposadr[joint_ids]] = 0.0
    mujoco.mj_kinematics(model, data)
    base = find_frame(model, data, "frames.arm_base", arm_base)[1]
    frames = [base, *(_joint_frame(model, data, joint) for joint in joint_ids)]
    capsules = sorted(_capsules(model, data, joint_ids, frames, base_body), key=lambda capsule: capsule.link)
    return Arm(
        joint_ids=joint_ids,
        steps=[between(before, after) for before, after in itertools.pairwise(frames)],
        tool=between(frames[-1], find_tool(model, data, tool)[1]),
        capsules=capsules,
    )


def start_state(model: mujoco.MjModel, fixed: Mapping[str, float]) -> mujoco.MjData:
    """A state of the model with joints where the robot file fixes them.

    Args:
        model: of `compile_model`.
        fixed: positions (rad or m) by the joints' names.

    Raises:
        DocumentError: the model has no such joint, or one of several degrees of freedom.
    """
    data = mujoco.MjData(model)
    for name, position in fixed.items():
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint < 0 or int(model.jnt_type[joint]) not in _SINGLE:
            own = [model.joint(j).name for j in range(model.njnt) if int(model.jnt_type[j]) in _SINGLE]
            found = "a joint that the model hasn't, or that moves in several ways"
            raise field_error(f"fixed.{name}", found, f"are its hinges and slides: {_listed(own)}")
        data.qpos[model.jnt_qposadr[joint]] = position
    mujoco.mj_kinematics(model, data)
    return data


def find_frame(model: mujoco.MjModel, data: mujoco.MjData, field: str, name: str) -> tuple[int, Transform]:
    """The body that a site or body of this name belongs to, and its frame in the world.

    Raises:
        DocumentError: there is none.
    """
    for kind, body_of in ((mujoco.mjtObj.mjOBJ_SITE, model.site_bodyid), (mujoco.mjtObj.mjOBJ_BODY, None)):
        index = mujoco.mj_name2id(model, kind, name)
        if index >= 0:
            part: Any = data.body(index) if body_of is None else data.site(index)
            frame = part.xmat.reshape(3, 3).copy(), part.xpos.copy()
            return (index if body_of is None else int(body_of[index])), frame
    names = [model.site(i).name for i in range(model.nsite)] + [model.body(i).name for i in range(1, model.nbody)]
    raise field_error(field, describe(name), f"are the model's sites and bodies: {_listed(names)}")


def find_tool(model: mujoco.MjModel, data: mujoco.MjData, tool: ToolPlace) -> tuple[int, Transform]:
    """The body that carries the tool frame, and that frame in the world.

    Raises:
        DocumentError: the model has no frame of that name.
    """
    body, (rotation, position) = find_frame(model, data, tool.field, tool.frame)
    return body, (rotation @ tool.rotation, rotation @ tool.position + position)


def between(parent: Transform, child: Transform) -> Transform:
    """The child's rotation and position in its parent, both given in one frame."""
    return parent[0].T @ child[0], parent[0].T @ (child[1] - parent[1])


def _listed(names: list[str]) -> str:
    names = [describe(name) for name in names if name]
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "") if names else "none"


def _joints_between(model: mujoco.MjModel, base: int, tool_body: int, arm_base: str, tool: ToolPlace) -> list[int]:
    """All joints that move the tool against the arm's base, from the base on."""
    found: list[int] = []
    body = tool_body
    while body != base:
        if body == 0:
            allowed = f"is a frame that {describe(arm_base)} carries"
            raise field_error(tool.field, f"{describe(tool.frame)}, which it doesn't", allowed)
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        found = [*range(first, first + count), *found]
        body = int(model.body_parentid[body])
    return found


def _check_joints(model: mujoco.MjModel, names: list[str], found: list[int]) -> list[int]:
    own = [model.joint(joint).name for joint in found]
    if own != names:
        wrong = next((i for i, (a, b) in enumerate(itertools.zip_longest(names, own)) if a != b), 0)
        what = describe(names[wrong]) if wrong < len(names) else "nothing"
        allowed = f"are all joints from arm base to tool, in order: {_listed(own)}"
        if missing := [name for name in own if name not in names]:
            allowed += f" (or freeze some at a value: fixed: {{{missing[0]}: 0}})"
        raise field_error(f"joints[{wrong}]", what, allowed)
    for index, joint in enumerate(found):
        kind = int(model.jnt_type[joint])
        if kind not in _SINGLE:
            raise field_error(f"joints[{index}]", "a joint of several degrees of freedom", "are hinges and slides")
        if not model.jnt_limited[joint] and np.any(model.jnt_range[joint]):
            low, high = model.jnt_range[joint]
            what = f"the range {low:g} to {high:g} in the model, which limits nothing"
            raise field_error(f"joints[{index}]", what, "are a range that is not empty, or none")
        if kind == int(mujoco.mjtJoint.mjJNT_SLIDE) and not model.jnt_limited[joint]:
            raise field_error(f"joints[{index}]", "a slide without a range in the model", "are slides with one")
        if kind == int(mujoco.mjtJoint.mjJNT_HINGE) and model.jnt_limited[joint]:
            _check_range(f"joints[{index}]", names[index], model.jnt_range[joint])
    return found


def _check_range(field: str, name: str, limits: np.ndarray) -> None:
    low, high = limits
    found = f"{describe(name)}, which turns from {low:.4g} to {high:.4g} rad in the model"
    if max(abs(low), abs(high)) > _MOST_RAD:
        raise field_error(
            field, found, f"are limits up to {_MOST_RAD} rad (are they in degrees?), or a continuous joint"
        )
    if high - low < _LEAST_RANGE:
        hint = "are they in radians, where the model's compiler takes degrees? a joint that stays belongs under fixed"
        raise field_error(field, found, f"are ranges of {_LEAST_RANGE} rad or more ({hint})")


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
    model: mujoco.MjModel, data: mujoco.MjData, joint_ids: list[int], frames: list[Transform], base_body: int
) -> Iterator[Capsule]:
    """Yields a capsule for every geom that the arm's base carries."""
    link_of_body = {base_body: 0} | {int(model.jnt_bodyid[j]): link for link, j in enumerate(joint_ids, start=1)}
    for geom in np.flatnonzero(model.geom_group == _COUNTS).tolist():
        body = int(model.geom_bodyid[geom])
        while body and body not in link_of_body:
            body = int(model.body_parentid[body])
        if body not in link_of_body:
            continue
        rotation, origin = frames[link := link_of_body[body]]
        turn = rotation.T @ data.geom_xmat[geom].reshape(3, 3)
        offset = rotation.T @ (data.geom_xpos[geom] - origin)
        if (fit := _fit(model, geom)) is not None:
            placed = Fit(turn @ fit.start + offset, turn @ fit.end + offset, fit.radius)
            yield Capsule(link, model.geom(geom).name or model.body(int(model.geom_bodyid[geom])).name, placed)


def _fit(model: mujoco.MjModel, geom: int) -> Fit | None:
    """The capsule about a geom in its own frame; None for what has no extent, such as planes."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    along = np.array([0.0, 0.0, size[1]])
    if kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
        return Fit(-along, along, float(size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return Fit(np.zeros(3), np.zeros(3), float(size[0]))
    if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return fit_capsule(box_points(size))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = model.mesh_vert[first : first + count].astype(float)
        return fit_capsule(extreme_points(points))
    return None
