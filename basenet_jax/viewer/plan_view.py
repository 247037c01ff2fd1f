"""A plan on the floor: where it drives, where it stops and which way it faces there, and the order."""

from typing import Literal

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.plots.drawing import rectangle, short_list, stops_of, to_world
from basenet_jax.robot.model import Robot
from basenet_jax.viewer.drawing import Color
from basenet_jax.viewer.planned import Planned

_FACES = np.array([(0, 1, 2), (0, 2, 3)])
_ARROW_M = 0.16  # half the length of the arrow that shows a heading


class PlanView:
    """The drawing of one plan, made anew for each.

    Args:
        scene: to draw in.
        root: the name under which it stands.
        color: of all of it.
        layer: 0 or 1; two plans lie one above the other, their labels apart.
    """

    def __init__(self, scene: viser.SceneApi, root: str, color: Color, layer: int):
        self._scene, self._root, self._color = scene, root, color
        self._height = 0.012 + 0.006 * layer
        self._anchor: Literal["top-center", "bottom-center"] = "top-center" if layer else "bottom-center"
        self._labels: list[viser.LabelHandle] = []
        self._handles: dict[str, viser.SceneNodeHandle] = {}

    def show(self, robot: Robot, planned: Planned | None) -> None:
        """Draws a plan instead of the last one; None: nothing."""
        stops = {} if planned is None else stops_of(planned.plan, planned.outcome)
        poses = np.array(list(stops)).reshape(-1, 3)
        self._draw_path(np.zeros((0, 2)) if planned is None else planned.motion.base_pose[:, :2])
        self._draw_stops(poses, np.asarray(robot.footprint_half_size))
        self._write([f"picks {short_list(numbers)}" for numbers in stops.values()], poses)

    def _draw_path(self, points: Float[np.ndarray, "K 2"]) -> None:
        moved = np.any(np.diff(points, axis=0) != 0, axis=1)
        legs = np.stack([points[:-1][moved], points[1:][moved]], axis=1) if len(points) else np.zeros((0, 2, 2))
        self._remove("drives")
        if len(legs):
            self._handles["drives"] = self._scene.add_line_segments(
                f"{self._root}/drives", self._raised(legs), self._color, thickness=0.022
            )

    def _draw_stops(self, poses: Float[np.ndarray, "S 3"], half: Float[np.ndarray, "2"]) -> None:
        self._remove("stops", "headings")
        if not len(poses):
            return
        corners = np.concatenate([rectangle(pose, half) for pose in poses])
        faces = np.concatenate([_FACES + 4 * index for index in range(len(poses))])
        self._handles["stops"] = self._scene.add_mesh_simple(
            f"{self._root}/stops",
            self._raised(corners),
            faces,
            color=self._color,
            opacity=0.25,
            side="double",
            flat_shading=True,
            cast_shadow=False,
        )
        ends = np.array([(-_ARROW_M, 0.0), (_ARROW_M, 0.0)])
        arrows = np.stack([to_world(pose, ends) for pose in poses])
        self._handles["headings"] = self._scene.add_arrows(
            f"{self._root}/headings",
            self._raised(arrows),
            self._color,
            shaft_radius=0.012,
            head_radius=0.04,
            head_length=0.1,
        )

    def _write(self, texts: list[str], poses: Float[np.ndarray, "S 3"]) -> None:
        """Labels are kept and moved: their number changes little."""
        for index, (text, pose) in enumerate(zip(texts, poses, strict=True)):
            place = (float(pose[0]), float(pose[1]), self._height + 0.05)
            if index == len(self._labels):
                name = f"{self._root}/label{index}"
                self._labels.append(self._scene.add_label(name, text, position=place, anchor=self._anchor))
            label = self._labels[index]
            label.text, label.position, label.visible = text, place, True
        for label in self._labels[len(texts) :]:
            label.visible = False

    def _raised(self, points: np.ndarray) -> np.ndarray:
        return np.concatenate([points, np.full((*points.shape[:-1], 1), self._height)], axis=-1)

    def _remove(self, *names: str) -> None:
        for name in names:
            if handle := self._handles.pop(name, None):
                handle.remove()
