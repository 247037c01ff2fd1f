"""From what a user asks for to planners and scenes, with every wrong wish refused before any work."""

import dataclasses
import errno
import os
import stat
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax

from basenet_jax.config import GridConfig, UncertaintyConfig, WorldConfig
from basenet_jax.devices import use_devices
from basenet_jax.evaluation import provenance
from basenet_jax.evaluation.planning import Planners, choose_planners, own_options
from basenet_jax.evaluation.scene_sets import SceneSet, load_sets, random_set
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.reading import DEFAULT_ROBOT, load_robot
from basenet_jax.settings import Settings
from basenet_jax.task.reliability import Chance
from basenet_jax.world.scene import MAX_OBJECTS

DEFAULT_OBJECTS, DEFAULT_SCENES = (5, 10), 50
MAX_SCENES = 100_000


@dataclass(frozen=True)
class Request:
    """An evaluation as the command line asks for it; see `basenet_jax.evaluate`."""

    out: Path
    objects: tuple[int, ...] | None
    scenes: int | None
    planners: tuple[str, ...]
    scene_dir: Path | None
    seed: int
    repeats: int
    options: dict[str, Any] = field(default_factory=dict)  # of planners; each takes those that it has
    robot: str | None = None
    timed: int = 100
    devices: int | None = None
    world: WorldConfig = field(default_factory=WorldConfig)
    grid: GridConfig = field(default_factory=GridConfig)
    reliability: float = 0.95
    noise: bool = False


def prepare(
    request: Request, arguments: list[str], uncertainty: UncertaintyConfig | None = None
) -> tuple[Planners, list[SceneSet], dict[str, Any]]:
    """The planners, the scenes, and what the results are made with (see `table_files.write_tables`).

    Args:
        request: what is asked for.
        arguments: the command's, for the record.
        uncertainty: if given, planners that can are there twice, as they are and planning for these errors.

    Raises:
        ValueError: something asked for can't be had; the message says what was found and what is allowed.
    """
    _check_numbers(request)
    use_devices(request.devices)  # so that too many are refused now
    given = request.options | ({} if request.devices is None else {"devices": request.devices})
    options = own_options(request.planners, given)
    chance = None if uncertainty is None else Chance.of(uncertainty, request.reliability)
    factories = choose_planners(options, chance)
    _check_folder(request.out)
    setup, sets, source = _scenes(request)
    planners = Planners(factories, setup)
    for name in planners.names:  # so that bad weights are refused before hours of work
        planners.get(name, sets[0].scene(0).room)
    _make_folder(request.out)
    about = {
        "command": provenance.command("basenet_jax.evaluate", arguments),
        "scenes": source,
        "robot": setup.robot.name,
        "seed": request.seed,
        "repeats": request.repeats,
        "timed": request.timed,
        "weights": provenance.weights_fingerprint(request.options.get("weights")),
        "world": dataclasses.asdict(request.world),
        "grid": dataclasses.asdict(request.grid),
        "options": {name: _plain(own) for name, own in options.items() if own is not None},
        **({} if uncertainty is None else {"uncertainty": dataclasses.asdict(uncertainty)}),
        **({} if uncertainty is None else {"least_reliability": request.reliability}),
        "versions": provenance.versions(),
        "hardware": provenance.hardware(),
        "commit": provenance.commit(),
    }
    return planners, sets, about


def _scenes(request: Request) -> tuple[PlannerSetup, list[SceneSet], str]:
    """The planners' setup, the scenes, and in words where they come from."""
    shared: dict[str, Any] = {"world": request.world, "grid": request.grid}
    if request.scene_dir is not None:
        robot, sets = load_sets(request.scene_dir, request.robot)
        setup = PlannerSetup(robot=jax.device_put(load_robot(robot)), **shared)
        return setup, sets, f"{sum(map(len, sets))} files of {request.scene_dir.name}"
    setup = PlannerSetup(robot=jax.device_put(load_robot(request.robot or DEFAULT_ROBOT)), **shared)
    count, objects = request.scenes or DEFAULT_SCENES, tuple(dict.fromkeys(request.objects or DEFAULT_OBJECTS))
    sets = [random_set(number, count, seed=request.seed, world=setup.world) for number in objects]
    numbers = " / ".join(map(str, objects))
    return setup, sets, f"{count} random ones with {numbers} objects each, seed {request.seed}"


def _check_numbers(request: Request) -> None:
    if request.scene_dir is not None and (request.objects is not None or request.scenes is not None):
        raise ValueError("--scene-dir: its files say what the scenes are; leave out --objects and --scenes")
    for number in request.objects or ():
        if not 1 <= number <= MAX_OBJECTS:
            raise ValueError(f"--objects: found {number}, allowed are 1 to {MAX_OBJECTS}")
    for name in ("scenes", "repeats", "timed"):
        number = getattr(request, name)
        if number is not None and not 1 <= number <= MAX_SCENES:
            raise ValueError(f"--{name}: found {number}, allowed are 1 to {MAX_SCENES}")
    if not 0 <= request.seed < 2**32:
        raise ValueError(f"--seed: found {request.seed}, allowed are 0 to {2**32 - 1}")


def _plain(options: Settings) -> dict[str, Any]:
    """Options for the record; of paths the last part."""
    values = dataclasses.asdict(options)
    return {name: value.name if isinstance(value, Path) else value for name, value in values.items()}


def _check_folder(folder: Path) -> None:
    """Whether the folder could be made: what is refused later leaves none behind."""
    try:
        above = next(each for each in (folder, *folder.absolute().parents) if os.path.lexists(each))
        if not stat.S_ISDIR(above.stat().st_mode):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        if not os.access(above, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise ValueError(f"--out: {folder} can't be written: {error.strerror}") from error


def _make_folder(folder: Path) -> None:
    """Makes sure that results can be written, before any work is done for them."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(f"--out: {folder} can't be written: {error.strerror}") from error
