"""An export as a folder: whole or not there at all."""

import importlib.util
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import UNSET

from basenet_jax.atomic import write_atomically, write_folder_atomically
from basenet_jax.config import ExportConfig, WorldConfig
from basenet_jax.exports.bag import write_bag
from basenet_jax.exports.csv_text import to_csv
from basenet_jax.exports.schedule import Schedule, make_schedule
from basenet_jax.exports.yaml_text import to_yaml
from basenet_jax.robot.model import Robot
from basenet_jax.task.motion_check import Overlap
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.plan_file import reason_name
from basenet_jax.world.scene import NamedScene

YAML_NAME, CSV_NAME, BAG_NAME = "plan.yaml", "execution.csv", "bag"
FORMATS = {"yaml": YAML_NAME, "csv": CSV_NAME, "bag": BAG_NAME}


class Export(NamedTuple):
    """What was written."""

    files: list[Path]  # and the folder of the bag
    duration_s: float  # of the execution
    left_out: dict[str, str]  # by the object's name, why its step isn't there
    overlaps: tuple[Overlap, ...]  # what base or arm would touch on their way, by MuJoCo


class ExportError(ValueError):
    """Why a plan can't be exported as asked, and what can be done."""


def check_export(name: str, directory: str | os.PathLike[str], formats: Sequence[str]) -> None:
    """Whether an export can be written, as far as can be told without writing.

    Args:
        name: of the argument or option for the folder, for messages.
        directory: the folder.
        formats: of `FORMATS`.

    Raises:
        ExportError: the folder is there and not empty, can't be made, or a format is unknown or needs a package that
            isn't installed.
    """
    allowed = f"allowed are {', '.join(FORMATS)}"
    if not formats or any(each not in FORMATS for each in formats):
        raise ExportError(f"format: found {', '.join(formats) or 'none'}, {allowed}")
    if "bag" in formats and importlib.util.find_spec("rosbags") is None:
        needed = 'needs the package rosbags: pip install "basenet_jax[ros]"'
        raise ExportError(f"format: found bag, which {needed}; yaml and csv need nothing")
    path = Path(directory)
    try:
        path.resolve(strict=True)
    except FileNotFoundError:
        pass  # to be made
    except (OSError, RuntimeError) as error:  # a name that is too long, or links that lead in circles
        why = error.strerror if isinstance(error, OSError) else "it leads in circles"
        found = f"{name}: found {str(path)[:60]}, which can't be used: {why}"
        raise ExportError(f"{found}, allowed is another name") from None
    if path.exists() and not path.is_dir():
        raise ExportError(f"{name}: found {path}, which is a file, allowed is a new or empty folder")
    if path.is_dir() and any(path.iterdir()):
        raise ExportError(f"{name}: found {path}, which isn't empty, allowed is a new or empty folder")
    above = path.resolve().parent
    if not above.is_dir():
        raise ExportError(f"{name}: found {path}, whose folder isn't there, allowed is a folder in one that is")
    if not os.access(above, os.W_OK):
        raise ExportError(f"{name}: found {path}, which can't be written, allowed is a folder that can")


def check_table_pose(scene: NamedScene, table_pose: tuple[float, float, float]) -> None:
    """Whether a pose of the table's frame in the map means something.

    Args:
        scene: a table's or a room.
        table_pose: x, y, yaw.

    Raises:
        ExportError: it isn't finite, or the scene is a room with a map, whose frame the poses are in already.
    """
    if not all(math.isfinite(number) for number in table_pose):
        raise ExportError(f"table pose: found {list(table_pose)}, allowed are finite numbers")
    if scene.furniture is not None and scene.furniture.map is not UNSET and any(table_pose):
        found = f"table pose: found {list(table_pose)} for a room with a map"
        raise ExportError(f"{found}, allowed is none: its poses are in the map's frame")


def export(
    robot: Robot,
    scene: NamedScene,
    plan: Plan,
    outcome: Outcome,
    directory: str | os.PathLike[str],
    *,
    table_pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    map_frame: str = "map",
    formats: Sequence[str] = tuple(FORMATS),
    config: ExportConfig = ExportConfig(),
    world: WorldConfig = WorldConfig(),
    given_times: bool = False,
) -> Export:
    """Writes the feasible steps of a plan into a new or empty folder, in all formats or, if anything fails, in none.

    Args:
        robot: the scene's.
        scene: one scene.
        plan: of that scene.
        outcome: of executing it.
        directory: of the files; the folder above must be there.
        table_pose: x, y (m) and yaw (rad) of W, the table's frame, in the map; a room's W is the map itself.
        map_frame: the map's name.
        formats: yaml, csv, bag.
        config: of sampling.
        world: of drives and the pick cycle.
        given_times: see `make_schedule`.

    Raises:
        ExportError: see `check_export` and `check_table_pose`; or no step is feasible, or no drive of the robot's own
            leads where the given times say that one does.
        OSError: something can't be written.
    """
    check_export("directory", directory, formats)
    check_table_pose(scene, table_pose)
    left_out = {
        scene.names[int(plan.object_index[step])]: str(reason_name(outcome.reason[step]))
        for step in np.flatnonzero(np.asarray(outcome.is_step & ~outcome.feasible))
    }
    if len(left_out) == int(np.sum(outcome.is_step)):
        raise ExportError("plan: found no step that can be executed, so there is nothing to export")
    where = {"table_pose": table_pose, "map_frame": map_frame}
    try:
        schedule = make_schedule(
            robot, scene, plan, outcome, **where, config=config, world=world, given_times=given_times
        )
    except ValueError as error:
        raise ExportError(f"drives: {error}") from None
    write_folder_atomically(directory, lambda folder: _fill(folder, schedule, formats, config))
    files = [Path(directory) / FORMATS[each] for each in dict.fromkeys(formats)]
    return Export(files, schedule.duration_s, left_out, schedule.overlaps)


def _fill(folder: Path, schedule: Schedule, formats: Sequence[str], config: ExportConfig) -> None:
    if "yaml" in formats:
        write_atomically(folder / YAML_NAME, to_yaml(schedule))
    if "csv" in formats:
        write_atomically(folder / CSV_NAME, to_csv(schedule, config.rate_hz))
    if "bag" in formats:
        write_bag(folder / BAG_NAME, schedule)
