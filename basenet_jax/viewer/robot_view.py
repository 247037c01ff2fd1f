"""A robot on the page: a frame for each of its bodies, so that only what moves is sent."""

import numpy as np
import viser

from basenet_jax.viewer.bodies import Bodies, Body
from basenet_jax.viewer.drawing import Color

_GHOST_OPACITY, _GHOST_SHARE = 0.45, 0.6  # of a second robot, and how much of its colour is its own


class RobotView:
    """The bodies as a tree of frames with their meshes below them.

    Args:
        scene: to draw in.
        root: the name under which they stand.
        bodies: of the robot.
        ghost: the colour of a robot that one can look through; None for a solid one.
    """

    def __init__(self, scene: viser.SceneApi, root: str, bodies: Bodies, ghost: Color | None = None):
        self._bodies = bodies
        self._root = scene.add_frame(root, show_axes=False)
        self._frames: list[viser.FrameHandle] = []
        self.base_meshes: list[viser.MeshHandle] = []
        self._state: tuple[float, ...] | None = None
        for index, body in enumerate(bodies.bodies):
            parent = self._frames[body.parent].name if body.parent >= 0 else root
            frame = scene.add_frame(f"{parent}/{index}", show_axes=False)
            self._frames.append(frame)
            meshes = _add_meshes(scene, frame.name, body, ghost)
            self.base_meshes += meshes if body.parent < 0 else []

    def show(self, base_pose: np.ndarray, joints: np.ndarray) -> None:
        """Puts the robot into a state."""
        state = (*base_pose, *joints)
        if state == self._state:
            return  # as at every move of an object that is being dragged
        self._state = state
        for frame, (position, wxyz) in zip(self._frames, self._bodies.place(base_pose, joints), strict=True):
            frame.position, frame.wxyz = position, wxyz

    def set_visible(self, visible: bool) -> None:
        """Shows or hides it."""
        self._root.visible = visible

    def remove(self) -> None:
        """Takes it off the page."""
        self._root.remove()


def _add_meshes(scene: viser.SceneApi, root: str, body: Body, ghost: Color | None) -> list[viser.MeshHandle]:
    handles = []
    for number, shape in enumerate(body.shapes):
        color, opacity = shape.color, None
        if ghost is not None:
            mixed = _GHOST_SHARE * np.array(ghost) + (1.0 - _GHOST_SHARE) * np.array(color)
            color, opacity = mixed.astype(int), _GHOST_OPACITY
        name = f"{root}/shape{number}"
        handles.append(
            scene.add_mesh_simple(
                name, shape.vertices, shape.faces, color=color, opacity=opacity, flat_shading=shape.flat
            )
        )
    return handles
