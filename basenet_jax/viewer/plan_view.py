"""A plan on the floor: where it drives, where it stops and which way it faces there, and the order."""

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
        self._label_m = 0.42 + 0.24 * layer  # from the middle of a stop
        self._labels: list[viser.LabelHandle] = []
        self._handles: dict[str, viser.SceneNodeHandle] = {}

    def show(self, robot: Robot, planned: Planned | None) -> None:
        """Draws a plan instead of the last one; None: nothing."""
        if planned is None:
            self._clear()
            return
        stops = stops_of(planned.plan, planned.outcome)
        poses = np.array(list(stops)).reshape(-1, 3)
        self._draw_path(planned.motion.base_pose[:, :2])
        self._draw_stops(poses, np.asarray(robot.footprint_half_size))
        texts = [f"picks {short_list(numbers)}" for numbers in stops.values()]
        self._write(texts, poses, np.asarray(planned.scene.arrays.table.half_size))

    def _draw_path(self, points: Float[np.ndarray, "K 2"]) -> None:
        moved = np.any(np.diff(points, axis=0) != 0, axis=1)
        legs = np.stack([points[:-1][moved], points[1:][moved]], axis=1)
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

    def _write(self, texts: list[str], poses: Float[np.ndarray, "S 3"], table_half: Float[np.ndarray, "2"]) -> None:
        """Labels stand outside their stops, seen from the table; they are kept, since their number changes little."""
        nearest = np.clip(poses[:, :2], -table_half, table_half)
        away = poses[:, :2] - nearest
        away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        for index, (text, place) in enumerate(zip(texts, poses[:, :2] + self._label_m * away, strict=True)):
            if index == len(self._labels):
                self._labels.append(self._scene.add_label(f"{self._root}/label{index}", text, anchor="center-center"))
            label = self._labels[index]
            label.text, label.position, label.visible = text, (float(place[0]), float(place[1]), self._height), True
        for label in self._labels[len(texts) :]:
            label.visible = False

    def _raised(self, points: np.ndarray) -> np.ndarray:
        return np.concatenate([points, np.full((*points.shape[:-1], 1), self._height)], axis=-1)

    def _clear(self) -> None:
        self._remove(*self._handles)
        for label in self._labels:
            label.visible = False

    def _remove(self, *names: str) -> None:
        for name in names:
            if handle := self._handles.pop(name, None):
                handle.remove()
