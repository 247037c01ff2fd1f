"""What stands in a room, on the page: a frame for each piece of furniture, with its boxes below it."""

import itertools
from collections.abc import Callable

import numpy as np
import viser
from jaxtyping import Float
from msgspec.structs import replace

from basenet_jax.viewer.drawing import KEEP_OUT, SOLID, WOOD, WOOD_BELOW, Color
from basenet_jax.viewer.furnishing import Piece, pieces, pose_of
from basenet_jax.viewer.marks import turn
from basenet_jax.viewer.pointing import SKIRTING_M
from basenet_jax.world.footprints import in_frame
from basenet_jax.world.furniture import FLAT_M, KeepOutFields, SurfaceFields, WallFields
from basenet_jax.world.scene import NamedScene

_BOARD_M, _INSET_M = 0.04, 0.06  # of a table that is solid: its top, and by how much what is below is smaller
_GLASS = 0.22  # opacity of walls above their skirting
_FLAT_OPACITY = 0.35  # of areas to keep out of
_HATCH_M = 0.15  # between their lines

Bind = Callable[[viser.BoxHandle, str], None]


class FurnitureViews:
    """Furniture by name; only what has changed is sent.

    Args:
        scene: to draw in.
        bind: called with every new box and its piece's name, to make it draggable.
    """

    def __init__(self, scene: viser.SceneApi, bind: Bind):
        self._scene, self._bind = scene, bind
        self._frames: dict[str, viser.FrameHandle] = {}
        self._looks: dict[str, Piece] = {}
        self._poses: dict[str, tuple[float, ...]] = {}
        self._count = 0  # of frames ever made: names of nodes are not used again

    def show(self, scene: NamedScene) -> None:
        """As much furniture as there is, each piece where it stands; nothing in the paper's world."""
        placed = {name: piece for name, (piece, _) in pieces(scene.furniture).items()}
        looks = {name: _at_origin(piece) for name, piece in placed.items()}
        for name in [name for name, own in self._looks.items() if looks.get(name) != own]:
            self._frames.pop(name).remove()
            del self._looks[name], self._poses[name]
        for name, piece in placed.items():
            if name not in self._frames:
                self._add(name, piece)
                self._looks[name] = looks[name]
            pose = tuple(pose_of(piece).tolist())
            if self._poses.get(name) != pose:
                self._frames[name].position, self._frames[name].wxyz = (pose[0], pose[1], 0.0), turn(pose[2])
                self._poses[name] = pose

    def _add(self, name: str, piece: Piece) -> None:
        self._count += 1
        node = f"/furniture/{self._count}"
        self._frames[name] = self._scene.add_frame(node, show_axes=False)
        if isinstance(piece, SurfaceFields):
            self._add_surface(node, piece)
        elif isinstance(piece, WallFields):
            self._add_wall(node, piece)
        elif isinstance(piece, KeepOutFields):
            size = (*piece.size, FLAT_M / 2)
            self._add_box(node, name, size, FLAT_M / 4, KEEP_OUT, opacity=_FLAT_OPACITY, cast_shadow=False)
            lines = hatching(np.array(piece.size) / 2, _HATCH_M)
            points = np.concatenate([lines, np.full((*lines.shape[:2], 1), FLAT_M / 2)], axis=-1)
            self._scene.add_line_segments(f"{node}/hatch", points, KEEP_OUT, thickness=1.5, thickness_units="screen")
        else:
            self._add_box(node, name, piece.size, piece.z + piece.size[2] / 2, SOLID)

    def _add_surface(self, node: str, piece: SurfaceFields) -> None:
        (length, width), solid = piece.size, not isinstance(piece.thickness, float)
        board = min(_BOARD_M, piece.height) if solid else piece.thickness
        assert isinstance(board, float)
        self._add_box(node, piece.name, (length, width, board), piece.height - board / 2, WOOD)
        low = piece.height - board
        if solid and low > 0.0:
            size = (max(length - _INSET_M, length / 2), max(width - _INSET_M, width / 2), low)
            self._add_box(node, piece.name, size, low / 2, WOOD_BELOW)

    def _add_wall(self, node: str, piece: WallFields) -> None:
        points = in_frame(pose_of(piece), np.array(piece.points))
        low = min(SKIRTING_M, piece.height)
        for start, end in itertools.pairwise(points):
            length, middle = float(np.hypot(*(end - start))), (start + end) / 2
            yaw = float(np.arctan2(*(end - start)[::-1]))
            self._add_box(node, piece.name, (length, piece.thickness, low), low / 2, SOLID, middle, yaw)
            if (rest := piece.height - low) > 0.0:
                glass = {"opacity": _GLASS, "cast_shadow": False}
                size = (length, piece.thickness, rest)
                self._add_box(node, None, size, low + rest / 2, SOLID, middle, yaw, **glass)

    def _add_box(
        self,
        node: str,
        name: str | None,
        size: tuple[float, float, float],
        height: float,
        color: Color,
        place: Float[np.ndarray, "2"] | tuple[float, float] = (0.0, 0.0),
        yaw: float = 0.0,
        **looks,
    ) -> None:
        """A box of a piece; without a name the mouse goes through it."""
        self._count += 1
        position, wxyz = (float(place[0]), float(place[1]), height), turn(yaw)
        box = self._scene.add_box(f"{node}/{self._count}", color, size, position=position, wxyz=wxyz, **looks)
        if name is not None:
            self._bind(box, name)


def hatching(half_size: Float[np.ndarray, "2"], step: float) -> Float[np.ndarray, "L 2 2"]:
    """Lines at 45 degrees across a rectangle about the origin, so far (m) apart along its sides."""
    length, width = half_size
    offsets = np.arange(-(length + width) + step, length + width, step)  # of y = x + offset
    left, right = np.maximum(-length, -width - offsets), np.minimum(length, width - offsets)
    return np.stack([np.stack([x, x + offsets], axis=-1) for x in (left, right)], axis=1)


def _at_origin(piece: Piece) -> Piece:
    """What tells whether a piece is drawn anew: all of it but where it stands."""
    if not isinstance(piece, WallFields):
        return replace(piece, pose=(0.0, 0.0, 0.0))
    local = np.round(in_frame(pose_of(piece), np.array(piece.points)), 2)
    return replace(piece, points=[(float(x), float(y)) for x, y in local])
