"""A plan on the floor: where it drives, where it stops and which way it faces there, and the order."""

import numpy as np
import viser
from jaxtyping import Float

from basenet_jax.plots.drawing import rectangle, short_list, stops_of, to_world
from basenet_jax.robot.model import Robot
from basenet_jax.viewer.drawing import Color
from basenet_jax.viewer.planned import Planned
from basenet_jax.world.footprints import in_frame
from basenet_jax.world.scene import NamedScene

_FACES = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
_NO_LINES = np.zeros((1, 2, 3))
_ARROW_M = 0.16  # half the length of the arrow that shows a heading


class PlanView:
    """The drawing of one plan. Its parts are kept and changed: a browser that gets new ones compiles shaders anew.

    Args:
        scene: to draw in.
        root: the name under which it stands.
        color: of all of it.
        layer: 0 or 1; two plans lie one above the other, their labels apart, and the second one's say whose they are.
    """

    def __init__(self, scene: viser.SceneApi, root: str, color: Color, layer: int):
        self._scene, self._root = scene, root
        self._second = layer > 0
        self._height = 0.012 + 0.006 * layer
        self._label_m = 0.42 + 0.24 * layer  # from the middle of a stop
        self._labels: list[viser.LabelHandle] = []
        self._drives = scene.add_line_segments(f"{root}/drives", _NO_LINES, color, thickness=0.022, visible=False)
        self._headings = scene.add_arrows(
            f"{root}/headings", _NO_LINES, color, shaft_radius=0.012, head_radius=0.04, head_length=0.1, visible=False
        )
        self._stops = scene.add_mesh_simple(
            f"{root}/stops",
            np.zeros((4, 3)),
            _FACES,
            color=color,
            opacity=0.25,
            side="double",
            flat_shading=True,
            cast_shadow=False,
            visible=False,
        )

    def show(self, robot: Robot, planned: Planned | None) -> None:
        """Draws a plan instead of the last one; None: nothing."""
        if planned is None:
            for handle in (self._drives, self._headings, self._stops, *self._labels):
                handle.visible = False
            return
        stops = stops_of(planned.plan, planned.outcome)
        poses = np.array(list(stops)).reshape(-1, 3)
        self._draw_path(planned.motion.base_pose[:, :2])
        self._draw_stops(poses, np.asarray(robot.footprint_half_size))
        who = f"{planned.maker} " if self._second else ""
        texts = [f"{who}picks {short_list(numbers)}" for numbers in stops.values()]
        self._write(texts, poses, self._label_m * _away_from_surfaces(planned.scene, poses))

    def _draw_path(self, points: Float[np.ndarray, "K 2"]) -> None:
        moved = np.any(np.diff(points, axis=0) != 0, axis=1)
        legs = np.stack([points[:-1][moved], points[1:][moved]], axis=1)
        self._drives.visible = bool(len(legs))
        if len(legs):
            self._drives.points = self._raised(legs)

    def _draw_stops(self, poses: Float[np.ndarray, "S 3"], half: Float[np.ndarray, "2"]) -> None:
        self._stops.visible = self._headings.visible = bool(len(poses))
        if not len(poses):
            return
        corners = np.concatenate([rectangle(pose, half) for pose in poses])
        self._stops.vertices = self._raised(corners)
        self._stops.faces = np.concatenate([_FACES + 4 * index for index in range(len(poses))])
        ends = np.array([(-_ARROW_M, 0.0), (_ARROW_M, 0.0)])
        self._headings.points = self._raised(np.stack([to_world(pose, ends) for pose in poses]))

    def _write(self, texts: list[str], poses: Float[np.ndarray, "S 3"], shift: Float[np.ndarray, "S 2"]) -> None:
        """Labels stand outside their stops, seen from the table; they are kept, since their number changes little."""
        for index, (text, place) in enumerate(zip(texts, poses[:, :2] + shift, strict=True)):
            if index == len(self._labels):
                self._labels.append(self._scene.add_label(f"{self._root}/label{index}", text, anchor="center-center"))
            label = self._labels[index]
            label.text, label.position, label.visible = text, (float(place[0]), float(place[1]), self._height), True
        for label in self._labels[len(texts) :]:
            label.visible = False

    def _raised(self, points: np.ndarray) -> np.ndarray:
        return np.concatenate([points, np.full((*points.shape[:-1], 1), self._height)], axis=-1, dtype=np.float32)


def _away_from_surfaces(scene: NamedScene, poses: Float[np.ndarray, "S 3"]) -> Float[np.ndarray, "S 2"]:
    """For each place the direction (of length 1) that leads away from the nearest surface."""
    boxes = scene.arrays.room.boxes
    tops = np.flatnonzero(boxes.bears_objects)
    pose, half = np.asarray(boxes.pose, float)[tops], np.asarray(boxes.half_size, float)[tops]
    seen = in_frame(pose[None], poses[:, None, :2])
    away = seen - np.clip(seen, -half, half)
    nearest = np.argmin(np.linalg.norm(away, axis=-1), axis=1)
    shortest = away[np.arange(len(poses)), nearest]
    cosine, sine = np.cos(pose[nearest, 2]), np.sin(pose[nearest, 2])
    x, y = shortest.T / np.maximum(np.linalg.norm(shortest, axis=1), 1e-9)
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
