"""Where robot and objects are at any time of a plan's execution."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import math
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.robot.model import Robot
from basenet_jax.viewer.bodies import Bodies
from basenet_jax.viewer.planned import Planned
from basenet_jax.world.scene import Scene


class Placed(NamedTuple):
    """A pose in W."""

    position: Float[np.ndarray, "3"]  # m
    wxyz: Float[np.ndarray, "4"]


class Execution:
    """A plan that is carried out: objects go from their surfaces by the gripper to the robot's deck.

    On the deck they stand in rows, in the order of the picks, whatever stowed them there.

    Args:
        planned: the plan.
        robot: its robot, and
        bodies: that robot's, which are moved.
    """

    def __init__(self, planned: Planned, robot: Robot, bodies: Bodies):
        self.planned, self._bodies = planned, bodies
        self._scene, self._motion = planned.scene.arrays, planned.motion
        feasible = np.flatnonzero(planned.outcome.feasible)
        self._picked = [int(planned.plan.object_index[step]) for step in feasible]
        self._grips: dict[int, np.ndarray] = {}  # once they are asked for
        self._cells = _deck_cells(robot, self._scene, self._picked)

    @property
    def end_s(self) -> float:
        """When it is over."""
        return float(self._motion.time[-1])

    def robot_at(self, time: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, " dof"]]:
        """Base pose (x, y, heading in W) and joints at a time (s)."""
        base_pose, joints, _, _ = self._motion.at(time)
        return base_pose, joints

    def objects_at(self, time: float) -> dict[str, Placed]:
        """Pose of each object's centre, by name, at a time (s)."""
        base_pose, joints, held, done = self._motion.at(time)
        stowed, poses = self._picked[:done], {}
        for slot, name in enumerate(self.planned.scene.names):
            if slot == held:
                frame = self._bodies.tool(base_pose, joints) @ self._grip(slot)
            elif slot in stowed:
                frame = frame_at(base_pose) @ self._cells[slot]
            else:
                frame = on_surface(self._scene, slot)
            poses[name] = _placed(frame)
        return poses

    def _grip(self, slot: int) -> Float[np.ndarray, "4 4"]:
        """An object in the tool's frame, once it is grasped."""
        if slot not in self._grips:
            base_pose, joints, _, _ = self._motion.at(float(self._motion.time[np.argmax(self._motion.held == slot)]))
            tool = self._bodies.tool(base_pose, joints)
            self._grips[slot] = np.linalg.inv(tool) @ on_surface(self._scene, slot)
        return self._grips[slot]


def on_surface(scene: Scene, slot: int) -> Float[np.ndarray, "4 4"]:
    """An object's frame in W while it stands where the scene has it."""
    height = float(scene.surface_height[slot]) + float(scene.object_size[slot, 2]) / 2
    return frame_at(scene.object_pose[slot], height)


def placed_on_surface(scene: Scene, slot: int) -> Placed:
    """An object's pose in W while it stands where the scene has it."""
    return _placed(on_surface(scene, slot))


def frame_at(pose: ArrayLike, z: float = 0.0) -> Float[np.ndarray, "4 4"]:
    """The frame at (x, y, yaw), so high above W's floor."""
    frame, (x, y, yaw) = np.eye(4), np.asarray(pose, float)
    frame[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    frame[:3, 3] = x, y, z
    return frame


def _placed(frame: np.ndarray) -> Placed:
    wxyz = np.empty(4)
    mujoco.mju_mat2Quat(wxyz, frame[:3, :3].ravel())
    return Placed(frame[:3, 3], wxyz)


def _deck_cells(robot: Robot, scene: Scene, slots: list[int]) -> dict[int, np.ndarray]:
    """Frames in the base's of objects on the deck, in rows of equal cells."""
    x, y, length, width = np.asarray(robot.deck, float)
    top = float(robot.body_center[2] + robot.body_half_size[2])
    columns = max(1, math.ceil(math.sqrt(len(slots) * length / width)))
    rows = max(1, math.ceil(len(slots) / columns))
    cells = {}
    for index, slot in enumerate(slots):
        row, column = divmod(index, columns)
        place = (x + length * ((column + 0.5) / columns - 0.5), y + width * ((row + 0.5) / rows - 0.5), 0.0)
        cells[slot] = frame_at(place, top + float(scene.object_size[slot, 2]) / 2)
    return cells
