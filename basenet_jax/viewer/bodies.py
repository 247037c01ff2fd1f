"""The robot's bodies as meshes and where they are, from the MJCF's own geoms, by MuJoCo."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int

from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import BASE_JOINTS, TOOL_SITE

Color = tuple[int, int, int]
_SECTIONS = 20  # of round shapes


@dataclass(frozen=True)
class Shape:
    """Part of a body in one colour, in the body's frame."""

    vertices: Float[np.ndarray, "V 3"]  # m
    faces: Int[np.ndarray, "F 3"]
    color: Color
    flat: bool  # its edges are sharp


@dataclass(frozen=True)
class Body:
    """A body: its parent's place in the list of bodies (-1: the world), and what it looks like."""

    name: str
    parent: int
    shapes: tuple[Shape, ...]


class Bodies:
    """The bodies of a robot, from the base to the last link, and their poses in any state."""

    def __init__(self, robot: Robot):
        self._model = mujoco.MjModel.from_xml_string(robot.model_xml)
        self._data = mujoco.MjData(self._model)
        names = (*BASE_JOINTS, *robot.joint_names)
        self._addresses = [int(self._model.joint(name).qposadr[0]) for name in names]
        self.bodies = tuple(self._body(index) for index in range(1, self._model.nbody))

    def place(self, base_pose: np.ndarray, joints: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Position (m) and quaternion (w, x, y, z) of each body in its parent's frame.

        Args:
            base_pose: (x, y, heading) in W.
            joints: rad (m for sliding ones).
        """
        self._move(base_pose, joints)
        poses = []
        for index in range(1, self._model.nbody):
            parent = self._model.body_parentid[index]
            inverse, position, turn = np.empty(4), np.empty(3), np.empty(4)
            mujoco.mju_negQuat(inverse, self._data.xquat[parent])
            mujoco.mju_rotVecQuat(position, self._data.xpos[index] - self._data.xpos[parent], inverse)
            mujoco.mju_mulQuat(turn, inverse, self._data.xquat[index])
            poses.append((position, turn))
        return poses

    def tool(self, base_pose: np.ndarray, joints: np.ndarray) -> Float[np.ndarray, "4 4"]:
        """The tool frame in W."""
        self._move(base_pose, joints)
        site, frame = self._data.site(TOOL_SITE), np.eye(4)
        frame[:3, :3], frame[:3, 3] = site.xmat.reshape(3, 3), site.xpos
        return frame

    def _move(self, base_pose: np.ndarray, joints: np.ndarray) -> None:
        self._data.qpos[self._addresses] = [*base_pose, *joints]
        mujoco.mj_kinematics(self._model, self._data)

    def _body(self, index: int) -> Body:
        """One body with a shape for each colour and kind of edge that its geoms have."""
        model, alike = self._model, {}
        for geom in np.flatnonzero(model.geom_bodyid == index):
            color = tuple(round(255 * float(channel)) for channel in model.geom_rgba[geom][:3])
            flat = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
            alike.setdefault((color, bool(flat)), []).append(_mesh(model, int(geom)))
        shapes = []
        for (color, flat), meshes in alike.items():
            mesh = trimesh.util.concatenate(meshes)
            shapes.append(Shape(np.asarray(mesh.vertices), np.asarray(mesh.faces), color, flat))
        return Body(model.body(index).name, int(model.body_parentid[index]) - 1, tuple(shapes))


def _mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    """A geom in its body's frame; robots' models are made of boxes, spheres and capsules."""
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * size)
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        mesh = trimesh.creation.uv_sphere(radius=size[0], count=[_SECTIONS // 2, _SECTIONS])
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=[_SECTIONS // 2, _SECTIONS])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))  # releases of trimesh put its origin in different places
    else:
        raise NotImplementedError(f"geom {geom} is no box, sphere or capsule, but of MuJoCo's type {kind}")
    frame, matrix = np.eye(4), np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    frame[:3, :3], frame[:3, 3] = matrix.reshape(3, 3), model.geom_pos[geom]
    return mesh.apply_transform(frame)
