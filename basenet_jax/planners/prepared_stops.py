"""The stops in line with a room's surfaces, with all drives between them: made once, and kept in the cache folder.

In a room of a dozen boxes that takes a tenth of a second and two programs to compile; in one with a map of many hundred
rectangles, seconds.
"""

import functools
import hashlib
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from basenet_jax.cache_files import keep, read_kept
from basenet_jax.compilation import cache_folder, source_digest
from basenet_jax.config import AlignedConfig, NavigationConfig, PickConfig
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.robot.model import Robot
from basenet_jax.task.docked_drives import Places, SharedGates
from basenet_jax.task.drive_space import DriveSpace
from basenet_jax.task.drives import DockedDrives, are_docked, base_identity, make_drives
from basenet_jax.task.gates import Gates
from basenet_jax.task.prepared_world import PreparedWorld, prepare_world
from basenet_jax.task.roadmap import Roadmap, padded
from basenet_jax.world.boxes import Room, fingerprint

_LEAST = 256  # stops


def prepared_stops(
    robot: Robot,
    room: Room,
    aligned: AlignedConfig = AlignedConfig(),
    pick: PickConfig = PickConfig(),
    navigation: NavigationConfig = NavigationConfig(),
) -> PreparedWorld:
    """The stops of a room, see `aligned_poses`, and the drives between them; from memory or the cache where it can be.

    Where one drives docked, they are filled up with copies to one of few numbers, so that rooms share programs.

    Args:
        robot: its base counts.
        room: unbatched, concrete.
        aligned: where the stops are.
        pick: of the base's clearance from boxes.
        navigation: of the drives.
    """
    what = (base_identity(robot), fingerprint(room), aligned, pick.base_clearance_m, pick.touching_m, navigation)
    return _in_memory(_Asked(hashlib.sha256(repr(what).encode()).hexdigest(), robot, room, aligned, pick, navigation))


def filled_up(poses: Float[np.ndarray, "S 3"]) -> Float[np.ndarray, "K 3"]:
    """Poses of a room filled up with copies to one of few numbers; when a table is moved, it nearly always stays."""
    return np.resize(poses, (max(_LEAST, padded(len(poses))), 3)) if len(poses) else poses


def forget() -> None:
    """Drops what is kept in memory: who measures, or has changed the cache folder, asks as a new process does."""
    _in_memory.cache_clear()


@dataclass(frozen=True)
class _Asked:
    """What stops are asked for, known again by a digest of all that they depend on."""

    digest: str
    robot: Robot = field(compare=False)
    room: Room = field(compare=False)
    aligned: AlignedConfig = field(compare=False)
    pick: PickConfig = field(compare=False)
    navigation: NavigationConfig = field(compare=False)


@functools.lru_cache(maxsize=8)
def _in_memory(asked: _Asked) -> PreparedWorld:
    # Drives of a point are computed faster than read.
    path = _path(asked) if are_docked(asked.room, asked.navigation) else None
    world = None if path is None else _load(path, reverse=asked.navigation.reverse or asked.robot.omnidirectional)
    if world is None:
        poses = aligned_poses(asked.robot, asked.room, asked.aligned, asked.pick)
        if are_docked(asked.room, asked.navigation):
            poses = filled_up(poses)
        drives = make_drives(asked.robot, asked.room, asked.navigation)
        world = prepare_world(jax.device_put(asked.robot), drives, poses)
        if path is not None:
            keep(path, _packed(world))
    return world


def _path(asked: _Asked) -> Path | None:
    folder = cache_folder()
    if folder is None:
        return None
    version = hashlib.sha256(f"{source_digest()} {jax.config.jax_enable_x64}".encode()).hexdigest()  # type: ignore[attr-defined]
    return folder / "rooms" / f"{asked.digest}-{version[:16]}"


# The structure of what is kept: files hold the leaves alone.
def _like(reverse: bool) -> PreparedWorld:
    leaf: Any = 0.0
    return PreparedWorld(
        drives=DockedDrives(Roadmap(DriveSpace(*[leaf] * 9), *[leaf] * 7, reverse=reverse)),
        poses=leaf,
        ends=Gates(*[leaf] * 5),
        goals=SharedGates(Gates(*[leaf] * 5), Places(*[leaf] * 3)),
        known=leaf,
    )


def _packed(world: PreparedWorld) -> bytes:
    stream = io.BytesIO()
    leaves = jax.tree_util.tree_leaves_with_path(jax.device_get(world))
    np.savez(stream, **{jax.tree_util.keystr(path): leaf for path, leaf in leaves})
    return stream.getvalue()


def _load(path: Path, *, reverse: bool) -> PreparedWorld | None:
    content = read_kept(path)
    if content is None:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        kept = jax.tree_util.tree_map_with_path(lambda name, _: arrays[jax.tree_util.keystr(name)], _like(reverse))
    return jax.device_put(kept)
