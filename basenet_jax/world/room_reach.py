"""Where a base gets to in a room, on the host: for rooms that are drawn, not for plans."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from basenet_jax.robot.model import Robot
from basenet_jax.world.boxes import Room, blocks
from basenet_jax.world.footprints import extent, rectangle_gaps, within

_CELL_M = 0.05  # of the grid over the floor
_CLEAR_M = 0.05  # what the base keeps clear of while it moves
_STOP_CLEAR_M = 0.10  # and where it stops
_SLACK_M = 1e-3  # less for points, so that places on an edge are the same in both precisions
_ALONG_M = 0.2  # between stops along a side
_UNDOCK_M = 4.0  # straight, at most


class Reach:
    """The places of a room where the base may turn, and which of them are connected."""

    def __init__(self, room: Room, robot: Robot) -> None:
        """Takes an unbatched room with a bounded floor, on the host."""
        body_top = float(robot.body_center[2] + robot.body_half_size[2])
        solid = np.asarray(blocks(room.boxes, body_top))
        self.pose, self.half_size = (np.asarray(x, float)[solid] for x in (room.boxes.pose, room.boxes.half_size))
        self.floor = np.asarray(room.floor, float)
        self.footprint = np.asarray(robot.footprint_half_size, float)
        self.radius = float(np.hypot(*self.footprint))
        shape: tuple[int, ...] = tuple(np.ceil((self.floor[2:] - self.floor[:2]) / _CELL_M).astype(int).tolist())
        points = self.floor[:2] + _CELL_M * (np.moveaxis(np.indices(shape), 0, -1) + 0.5)
        self._labels = np.zeros(shape, np.int32)
        ndimage.label(self.turning(points.reshape(-1, 2)).reshape(shape), output=self._labels)

    def turning(self, points: Float[np.ndarray, "N 2"]) -> Bool[np.ndarray, " N"]:
        """Which points are turning places: outside all boxes grown by the base's radius and what it keeps clear."""
        inside = np.all((points >= self.floor[:2] + self.radius) & (points <= self.floor[2:] - self.radius), axis=-1)
        margin = self.radius + _CLEAR_M - _SLACK_M
        return inside & ~np.any(within(points, self.pose, self.half_size, margin), axis=-1)

    def part(self, points: Float[np.ndarray, "N 2"]) -> Int[np.ndarray, " N"]:
        """The connected part of the floor that turning places belong to; 0: none."""
        cell = np.floor((points - self.floor[:2]) / _CELL_M).astype(int)
        cell = np.clip(cell, 0, np.array(self._labels.shape) - 1)
        return np.where(self.turning(points), self._labels[cell[:, 0], cell[:, 1]], 0)

    def stands(self, pose: Float[np.ndarray, "1 3"]) -> bool:
        """Whether the base may stop at a pose."""
        return len(self._clear(pose, _STOP_CLEAR_M, 0.0)) == 1

    def serves(self, part: int, surface: Float[np.ndarray, "3"], half_size: Float[np.ndarray, "2"]) -> bool:
        """Whether a stop in line with a side of a surface can be left straight to that part of the floor."""
        stops = self._clear(self._stops(surface, half_size), _STOP_CLEAR_M, 0.0)
        ahead = np.concatenate([stops, stops])
        signs = np.repeat([1.0, -1.0], len(stops))
        distances = np.arange(0.0, _UNDOCK_M, _CELL_M)
        direction = np.stack([np.cos(ahead[:, 2]), np.sin(ahead[:, 2])], axis=-1) * signs[:, None]
        places = ahead[:, None, :2] + distances[:, None] * direction[:, None]
        turns = self.turning(places.reshape(-1, 2)).reshape(places.shape[:2])
        first, found = np.argmax(turns, axis=1), np.any(turns, axis=1)
        ends = places[np.arange(len(ahead)), first]
        found[found] = self.part(ends[found]) == part
        middle = np.concatenate([(ahead[:, :2] + ends) / 2, ahead[:, 2:]], axis=-1)
        return any(len(self._clear(middle[[i]], _CLEAR_M, float(distances[first[i]]))) for i in np.flatnonzero(found))

    def _stops(self, surface: Float[np.ndarray, "3"], half_size: Float[np.ndarray, "2"]) -> Float[np.ndarray, "N 3"]:
        """Base poses as near as may be to the sides of a surface, along them and across."""
        poses = []
        for side in range(4):
            yaw = surface[2] + side * np.pi / 2  # of the side's normal
            away, along = (half_size if side % 2 == 0 else half_size[::-1]).astype(float)
            for turn in range(4):
                depth = self.footprint[0 if turn % 2 == 0 else 1]
                distance = away + _STOP_CLEAR_M + _SLACK_M + depth
                for shift in _ALONG_M * np.arange(-(along // _ALONG_M), along // _ALONG_M + 1):
                    x = surface[0] + np.cos(yaw) * distance - np.sin(yaw) * shift
                    y = surface[1] + np.sin(yaw) * distance + np.cos(yaw) * shift
                    poses.append((x, y, yaw + turn * np.pi / 2))
        return np.array(poses)

    def _clear(self, poses: Float[np.ndarray, "N 3"], margin: float, longer: float) -> Float[np.ndarray, "K 3"]:
        """Those at which the footprint, longer by so much (m), is on the floor and clear of boxes by a margin (m)."""
        half = self.footprint + np.array([longer / 2, 0.0])
        reach = extent(poses, half)
        inside = np.all((reach[:, :2] >= self.floor[:2]) & (reach[:, 2:] <= self.floor[2:]), axis=-1)
        gaps = rectangle_gaps(poses, half[None], self.pose, self.half_size + margin)
        return poses[inside & np.all(gaps > 0.0, axis=1)]
