"""Plans as MuJoCo sees them: images and short videos, drawn off screen.

This needs an OpenGL backend. On a machine without a display the environment variable MUJOCO_GL has to name one (`egl`
on most, `osmesa` where only software is left) before MuJoCo is imported, that is, before Python starts.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path

import jax
import mujoco
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from basenet_jax.atomic import write_atomically
from basenet_jax.config import PickConfig
from basenet_jax.plots.motion import Motion, plan_motion
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import TOOL_SITE
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.world.mujoco_scene import PARKED, ROBOT, scene_model, state_addresses
from basenet_jax.world.scene import Scene

_ELEVATION = -32.0  # degrees, of the camera's axis
_ALONG_THE_TABLE = 115.0  # degrees, the direction in which the video's camera looks


class RenderError(RuntimeError):
    """MuJoCo can't draw here, and what to do about it."""


def render_plan(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    *,
    step: int = 0,
    width: int = 960,
    height: int = 640,
    config: PickConfig = PickConfig(),
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
        config: of the pick cycle.

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
        taken = int(np.flatnonzero(motion.held == int(plan.object_index[step]))[0])
        painter.set_time(motion, float(motion.time[taken]))
        return painter.draw(renderer, _beside(motion.base_pose[taken]), distance=4.0)


def render_video(
    robot: Robot,
    scene: Scene,
    plan: Plan,
    outcome: Outcome,
    *,
    frames_per_s: float = 8.0,
    speed: float = 8.0,
    width: int = 480,
    height: int = 320,
    config: PickConfig = PickConfig(),
) -> UInt8[np.ndarray, "frames height width 3"]:
    """The plan's whole execution, faster than life by `speed`; objects vanish when they are put down.

    Args and errors as for `render_plan`; `frames_per_s` are those of the video.
    """
    painter = _Painter(robot, scene, plan, outcome)
    frames = []
    with _renderer(painter.model, width, height) as renderer:
        motion = plan_motion(robot, scene, plan, outcome, config)
        for time in np.arange(0.0, float(motion.time[-1]) + 1e-9, speed / frames_per_s):
            painter.set_time(motion, float(time))
            frames.append(painter.draw(renderer, azimuth=_ALONG_THE_TABLE, distance=5.5))
    return np.stack(frames)


def save_video(
    path: str | os.PathLike[str], frames: UInt8[np.ndarray, "frames height width 3"], frames_per_s: float = 8.0
) -> None:
    """Writes frames as an animated GIF, whole or not at all.

    Raises:
        ValueError: the name doesn't end in .gif.
        OSError: it can't be written.
    """
    if Path(path).suffix.lower() != ".gif":
        raise ValueError(f"path: found {path}, allowed are names ending in .gif")
    first, *rest = (Image.fromarray(frame).quantize() for frame in frames)
    stream = io.BytesIO()
    first.save(stream, "GIF", save_all=True, append_images=rest, duration=1000 / frames_per_s, loop=0)
    write_atomically(path, stream.getvalue())


def _beside(base_pose: np.ndarray) -> float:
    """Azimuth (degrees) of a camera that looks at the table from 50 degrees beside the robot."""
    return float(np.degrees(np.arctan2(base_pose[1], base_pose[0]))) + 180.0 + 50.0


class _Painter:
    """Puts a scene's model into states of a motion and draws it."""

    def __init__(self, robot: Robot, scene: Scene, plan: Plan, outcome: Outcome):
        scene, plan, outcome = jax.device_get((scene, plan, outcome))
        self.model, self._data = scene_model(robot, scene)
        self.model.geom("floor").size[:2] = 0.0  # without end, so that no black shows behind it
        self.model.light_diffuse[:], self.model.light_specular[:] = 0.35, 0.0
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

    def draw(self, renderer: mujoco.Renderer, azimuth: float, distance: float) -> np.ndarray:
        """The image from a camera that looks at the table from `distance` (m), to where `azimuth` (degrees) points."""
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (0.0, 0.0, 0.6)
        camera.distance, camera.azimuth, camera.elevation = distance, azimuth, _ELEVATION
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
