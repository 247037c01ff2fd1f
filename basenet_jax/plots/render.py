"""Plans as MuJoCo sees them: images and frames of videos, drawn off screen.

This needs an OpenGL backend. On a machine without a display the environment variable MUJOCO_GL has to name one (`egl`
on most, `osmesa` where only software is left) before MuJoCo is imported; `offscreen.choose_backend` does so.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import contextlib
import os
from collections.abc import Iterator
from typing import NamedTuple

import jax
import mujoco
import numpy as np
from jaxtyping import UInt8

from basenet_jax.config import WorldConfig
from basenet_jax.offscreen import RenderError
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import TOOL_SITE
from basenet_jax.task.motion import Motion, plan_motion
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.mujoco_scene import PARKED, ROBOT, scene_model, state_addresses
from basenet_jax.world.scene import Scene

_ALONG_THE_TABLE = 115.0  # degrees, the direction in which the video's camera looks
_FOLLOWING = 0.4  # of the way from the paper's table's centre to the base: where it looks at
_BESIDE = 50.0  # degrees, from the robot to the camera of a still picture, seen from what is looked at


class _View(NamedTuple):
    """A camera: the place (m) that it looks at, from how far (m), towards where, and how steeply (degrees)."""

    at: tuple[float, float]
    distance: float
    azimuth: float
    elevation: float = -32.0


class Video(NamedTuple):
    """Frames that are drawn as they are asked for."""

    frames_per_s: float
    frame_count: int
    frames: Iterator[UInt8[np.ndarray, "height width 3"]]


def render_plan(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    *,
    step: int = 0,
    width: int = 960,
    height: int = 640,
    config: WorldConfig = WorldConfig(),
) -> UInt8[np.ndarray, "height width 3"]:
    """An image (RGB) of the robot at the grasp of one step; objects of earlier steps are gone.

    Args:
        robot: the robot.
        scene: one scene, not a batch.
        plan: of that scene.
        outcome: of executing it.
        step: of the plan, from 0; it must have been feasible.
        width: of the image in pixels, and
        height: its height.
        config: of drives and the pick cycle.

    Raises:
        ValueError: the step is none of the plan's feasible ones.
        RenderError: there is no OpenGL backend.
    """
    feasible = np.flatnonzero(jax.device_get(outcome.feasible)).tolist()
    if step not in feasible:
        raise ValueError(f"step: found {step}, feasible are {feasible}")
    painter = _Painter(robot, scene, plan, outcome)
    with _renderer(painter.model, width, height) as renderer:
        motion = plan_motion(robot, scene, plan, outcome, config)
        slot = int(plan.object_index[step])
        taken = int(np.flatnonzero(motion.held == slot)[0])
        painter.set_time(motion, float(motion.time[taken]))
        at = np.asarray(scene.object_pose[slot, :2]) if _is_room(scene) else np.zeros(2)
        return painter.draw(renderer, _beside(motion.base_pose[taken], at))


def render_video(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    *,
    frames_per_s: float = 30.0,
    speed: float = 8.0,
    width: int = 960,
    height: int = 640,
    config: WorldConfig = WorldConfig(),
    given_times: bool = False,
) -> Video:
    """The plan's whole execution, faster than life by `speed`; objects vanish when they are put down.

    Args and errors as for `render_plan`, the latter when the first frame is asked for; `frames_per_s` are the video's,
    `given_times` as for `plan_motion`.
    """
    motion = plan_motion(robot, scene, plan, outcome, config, given_times=given_times)
    times = np.arange(0.0, float(motion.time[-1]) + 1e-9, speed / frames_per_s)

    def frames() -> Iterator[np.ndarray]:
        painter = _Painter(robot, scene, plan, outcome)
        with _renderer(painter.model, width, height) as renderer:
            for time in times.tolist():
                painter.set_time(motion, time)
                x, y = motion.at(time)[0][:2]
                yield painter.draw(renderer, _following(x, y, _is_room(scene)))

    return Video(frames_per_s, len(times), frames())


def _is_room(scene: Scene) -> bool:
    return scene.room.boxes.low.shape[-1] != 1


def _beside(base_pose: np.ndarray, at: np.ndarray) -> _View:
    """What a camera sees that looks at a place (x, y) from beside the robot."""
    x, y = base_pose[:2] - at
    azimuth = float(np.degrees(np.arctan2(y, x))) + 180.0 + _BESIDE
    return _View((float(at[0]), float(at[1])), 4.0, azimuth)


def _following(x: float, y: float, in_room: bool) -> _View:
    """What the film's camera sees, the base being at (x, y): round the table, or over walls and shelves."""
    if in_room:
        return _View((x, y), 6.0, _ALONG_THE_TABLE, -48.0)
    return _View((_FOLLOWING * x, _FOLLOWING * y), 5.5, _ALONG_THE_TABLE)


class _Painter:
    """Puts a scene's model into states of a motion and draws it."""

    def __init__(self, robot: Robot, scene: Scene, plan: Plan, outcome: Outcome):
        scene, plan, outcome = jax.device_get((scene, plan, outcome))
        self.model, self._data = scene_model(robot, scene)
        self.model.geom("floor").size[:2] = 0.0  # without end, so that no black shows behind it
        self.model.light_diffuse[:], self.model.light_specular[:] = 0.35, 0.0
        if _is_room(scene):  # a lamp over W's origin would leave the rest of it dark, and far shadows are streaks
            self.model.light_type[:] = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
            self.model.light_castshadow[:] = False
        self._addresses = state_addresses(robot, self.model)
        self._tool = self._data.site(ROBOT + TOOL_SITE)
        self._body = {int(slot): index for index, slot in enumerate(np.flatnonzero(scene.mask))}
        self._picked = [int(plan.object_index[step]) for step in np.flatnonzero(outcome.feasible)]
        self._rest = self._data.mocap_pos.copy(), self._data.mocap_quat.copy()

    def set_time(self, motion: Motion, time: float) -> None:
        """Puts robot and objects where they are at a time (s)."""
        base_pose, joints, held, done = motion.at(time)
        self._data.mocap_pos[:], self._data.mocap_quat[:] = self._rest
        for slot in self._picked[:done]:
            self._data.mocap_pos[self._body[slot]] = PARKED
        if held >= 0:
            taken = float(motion.time[np.flatnonzero(motion.held == held)[0]])
            grip_base_pose, grip_joints, _, _ = motion.at(taken)
            before = self._move(grip_base_pose, grip_joints)
            self._carry(self._body[held], before, self._move(base_pose, joints))
        self._move(base_pose, joints)
        mujoco.mj_forward(self.model, self._data)

    def draw(self, renderer: mujoco.Renderer, view: _View) -> np.ndarray:
        """The image from a camera."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (*view.at, 0.6)
        camera.distance, camera.azimuth, camera.elevation = view.distance, view.azimuth, view.elevation
        renderer.update_scene(self._data, camera)
        return renderer.render()

    def _move(self, base_pose: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (m) and rotation matrix of the tool in W, the robot being put into this state."""
        self._data.qpos[self._addresses] = [*base_pose, *joints]
        mujoco.mj_kinematics(self.model, self._data)
        return self._tool.xpos.copy(), self._tool.xmat.reshape(3, 3).copy()

    def _carry(self, body: int, before: tuple[np.ndarray, ...], after: tuple[np.ndarray, ...]) -> None:
        """Moves an object as the tool has moved."""
        turn = after[1] @ before[1].T
        matrix, quaternion = np.empty(9), np.empty(4)
        mujoco.mju_quat2Mat(matrix, self._rest[1][body])
        mujoco.mju_mat2Quat(quaternion, (turn @ matrix.reshape(3, 3)).ravel())
        self._data.mocap_pos[body] = after[0] + turn @ (self._rest[0][body] - before[0])
        self._data.mocap_quat[body] = quaternion


@contextlib.contextmanager
def _renderer(model: mujoco.MjModel, width: int, height: int) -> Iterator[mujoco.Renderer]:
    """A renderer that is closed at the end.

    Raises:
        RenderError: there is no OpenGL backend.
    """
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as error:  # each backend has its own kinds
        chosen = os.environ.get("MUJOCO_GL")
        raise RenderError(
            f"MuJoCo can't draw off screen with MUJOCO_GL={chosen or '(not set)'}; start Python with MUJOCO_GL=egl or, "
            f"where there is no such driver, MUJOCO_GL=osmesa ({error})"
        ) from error
    try:
        yield renderer
    finally:
        renderer.close()
