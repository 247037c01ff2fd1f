"""The objects on the page: a box for each, with what the plan says of it."""

from collections.abc import Callable, Mapping

import numpy as np
import viser

from basenet_jax.viewer.drawing import class_color
from basenet_jax.viewer.execution import Placed, placed_on_surface
from basenet_jax.world.scene import NamedScene

_ABOVE_M = 0.03  # of a label over its object


class ObjectViews:
    """Boxes by the objects' names.

    Args:
        scene: to draw in.
        bind: called with every new box and its object's name, to make it draggable.
    """

    def __init__(self, scene: viser.SceneApi, bind: Callable[[viser.BoxHandle, str], None]):
        self._scene, self._bind = scene, bind
        self._boxes: dict[str, viser.BoxHandle] = {}
        self._labels: dict[str, viser.LabelHandle] = {}
        self._looks: dict[str, tuple] = {}
        self._count = 0  # of boxes ever made: names of nodes are not used again

    def show(self, scene: NamedScene) -> None:
        """As many boxes as there are objects, each where it stands."""
        looks = {name: _looks(scene, slot) for slot, name in enumerate(scene.names)}
        for name in [name for name, own in self._looks.items() if looks.get(name) != own]:
            self._boxes.pop(name).remove()
            del self._labels[name], self._looks[name]
        for name in [name for name in scene.names if name not in self._boxes]:
            self._add(name, *looks[name])
        self._looks = looks
        self.place({name: placed_on_surface(scene.arrays, slot) for slot, name in enumerate(scene.names)})

    def place(self, poses: Mapping[str, Placed]) -> None:
        """Moves boxes to where they are."""
        for name, (position, wxyz) in poses.items():
            if box := self._boxes.get(name):  # a plan may be older than the scene
                box.position, box.wxyz = position, wxyz

    def label(self, texts: Mapping[str, str]) -> None:
        """What stands over each object; nothing over those that aren't named."""
        for name, handle in self._labels.items():
            handle.text = texts.get(name, "")
            handle.visible = bool(handle.text)

    def _add(self, name: str, size: tuple[float, ...], kind: int) -> None:
        self._count += 1
        node = f"/objects/{self._count}"
        box = self._boxes[name] = self._scene.add_box(node, class_color(kind), np.array(size))
        height = size[2] / 2 + _ABOVE_M
        label = self._scene.add_label(
            f"{node}/label", "", position=(0.0, 0.0, height), anchor="bottom-center", visible=False
        )
        self._labels[name] = label
        self._bind(box, name)


def _looks(scene: NamedScene, slot: int) -> tuple[tuple[float, ...], int]:
    """What a box is made from: the object's sides (m) and its class."""
    return tuple(np.asarray(scene.arrays.object_size[slot], float).tolist()), int(scene.arrays.object_class[slot])
