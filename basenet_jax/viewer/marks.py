"""What is drawn for the mouse: the plate where the robot starts, the place that was asked about, and the gizmo."""

import math

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.robot.model import Robot
from basenet_jax.viewer.drawing import START_COLOR, Color

_RIM_M = 0.09  # of the plate beyond the base, so that it can be seen and grabbed below the robot
_PLATE_M = 0.012  # its thickness
_ASKED: Color = (90, 90, 90)
_GIZMO_M = 0.28


def turn(yaw: float) -> Float[np.ndarray, "4"]:
    """The quaternion (w, x, y, z) of a turn about z (rad)."""
    return np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])


def yaw_of(wxyz: np.ndarray) -> float:
    """The turn about z (rad), in (-pi, pi], of a quaternion that has no other."""
    angle = 2.0 * math.atan2(float(wxyz[3]), float(wxyz[0]))
    return math.atan2(math.sin(angle), math.cos(angle))


class StartPlate:
    """A plate on the floor, as large as the base and a rim, with an arrow that shows the heading."""

    def __init__(self, scene: viser.SceneApi, robot: Robot):
        length, width = (2.0 * (np.asarray(robot.footprint_half_size, float) + _RIM_M)).tolist()
        size = (length, width, _PLATE_M)
        self.handle = scene.add_box("/start", START_COLOR, size, opacity=0.35, cast_shadow=False)
        front = np.array([[(length / 2, 0.0, 0.0), (length / 2 + 0.25, 0.0, 0.0)]])
        scene.add_arrows("/start/heading", front, START_COLOR, shaft_radius=0.015, head_radius=0.05, head_length=0.12)
        scene.add_label("/start/label", "start", position=(-length / 2, 0.0, 0.05), anchor="top-center")

    def move(self, pose: Float[np.ndarray, "3"]) -> None:
        """Puts it at (x, y, heading) in W."""
        self.handle.position, self.handle.wxyz = (float(pose[0]), float(pose[1]), _PLATE_M / 2), turn(pose[2])


class PlaceMark:
    """The base at the place that was asked about."""

    def __init__(self, scene: viser.SceneApi):
        self._scene = scene
        self._box: viser.BoxHandle | None = None

    def show(self, pose: Float[np.ndarray, "3"] | None, half_size: Float[np.ndarray, "2"]) -> None:
        """At (x, y, heading) in W; None: nowhere."""
        if self._box is not None:
            self._box.remove()
            self._box = None
        if pose is None:
            return
        length, width = (2.0 * np.asarray(half_size, float)).tolist()
        place, wxyz = (float(pose[0]), float(pose[1]), 0.02), turn(pose[2])
        self._box = self._scene.add_box(
            "/asked", _ASKED, (length, width, 0.02), opacity=0.5, cast_shadow=False, position=place, wxyz=wxyz
        )
        ends = np.array([[(0.0, 0.0, 0.02), (length / 2, 0.0, 0.02)]])
        self._scene.add_arrows("/asked/heading", ends, _ASKED, shaft_radius=0.015, head_radius=0.05, head_length=0.12)
        self._scene.add_label("/asked/label", "asked", position=(0.0, 0.0, 0.05), anchor="bottom-center")


class Gizmo:
    """Handles to slide what is selected in the plane and to turn it about z."""

    def __init__(self, scene: viser.SceneApi):
        self.handle = scene.add_transform_controls(
            "/gizmo", _GIZMO_M, active_axes=(True, True, False), depth_test=False, visible=False
        )

    @property
    def pose(self) -> Float[np.ndarray, "3"]:
        """(x, y, yaw) in W, where the mouse has put it."""
        x, y, _ = self.handle.position
        return np.array([x, y, yaw_of(self.handle.wxyz)])

    def show(self, at: tuple[Float[np.ndarray, "3"], float] | None) -> None:
        """At a pose (x, y, yaw) and a height (m); None: nowhere."""
        self.handle.visible = at is not None
        if at is not None:
            pose, height = at
            self.handle.position = (float(pose[0]), float(pose[1]), height)
            self.handle.wxyz = turn(pose[2])
