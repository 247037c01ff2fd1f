"""Writes random scene files: `python -m basenet_jax.generate --objects 10 --count 50 --out scenes`."""

import dataclasses
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from basenet_jax.command_line import TablesAndScenes, parse, world_of_file
from basenet_jax.config import TableConfig, WorldConfig

_MAX_COUNT = 100_000
_QUIET_S = 2.0  # work shorter than this shows no progress


@dataclass(frozen=True)
class Arguments:
    """Writes random scenes as scene-0000.yaml, scene-0001.yaml, ... into a folder.

    Objects are of the five packaged classes, uniformly on a table of 2.0 x 0.8 m unless --world.table says otherwise;
    the robot starts 2.5 to 3 m from its centre. With --world rooms they stand on one to three surfaces of a room of 6
    to 10 by 5 to 8 m with up to six obstacles. Scene i of a seed is the same whatever the count.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder to write to; made if it isn't there."""
    objects: int = 10
    """Number of objects in each scene, 1 to 50."""
    count: int = 50
    """Number of scenes, 1 to 100000."""
    seed: int = 0
    """Of the random scenes, 0 to 4294967295."""
    robot: str = "ur5e_mobile"
    """The robot that the scenes name: a packaged one, or the path of a robot file."""
    overwrite: bool = False
    """Replace scene files of the same names."""
    config: Path | None = None
    """YAML or JSON file of settings, such as a training's config.json, whose world is used. Options come before it."""
    kind: Annotated[Literal["table", "rooms"], tyro.conf.arg(name="world")] = "table"
    """The paper's world, one table, or rooms."""
    world: TablesAndScenes = field(default_factory=TablesAndScenes)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        world = world_of_file(given)
        defaults = {"world": TablesAndScenes(world.table, world.scene)}
        options = parse(Arguments, given, "python -m basenet_jax.generate", defaults)
        world = dataclasses.replace(world, table=options.world.table, scene=options.world.scene)
    except ValueError as error:
        return _fail(2, str(error))
    for name, value, low, high in (
        ("objects", options.objects, 1, 50),
        ("count", options.count, 1, _MAX_COUNT),
        ("seed", options.seed, 0, 2**32 - 1),
    ):
        if not low <= value <= high:
            return _fail(2, f"--{name}: found {value}, allowed are {low} to {high}")
    if options.kind == "rooms" and world.table != TableConfig():
        return _fail(2, "--world.table: found settings of a table, allowed are none with --world rooms")
    try:
        return _generate(options, world)
    except OSError as error:
        return _fail(2, f"--out: {options.out}: can't be written: {error.strerror}")
    except KeyboardInterrupt:
        return _fail(130, f"interrupted; the scenes written so far are in {options.out}")


def _generate(options: Arguments, world: WorldConfig) -> int:
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return _fail(2, f"--out: found {options.out}, which can't be a folder to write to: {error.strerror}")
    if not os.access(options.out, os.W_OK):
        return _fail(2, f"--out: found {options.out}, which can't be written, allowed is a writable folder")
    names = [f"scene-{index:04d}.yaml" for index in range(options.count)]
    present = sorted({entry.name for entry in options.out.iterdir()} & set(names))
    if present and not options.overwrite:
        found = f"{len(present)} of the files to write, such as {present[0]}"
        return _fail(2, f"--out: found {found}, in {options.out}, allowed is a folder without, or --overwrite")

    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    import jax

    from basenet_jax.api import sample_scene
    from basenet_jax.compilation import enable_cache
    from basenet_jax.progress import make_reporter
    from basenet_jax.robot.reading import load_robot
    from basenet_jax.world.generate_rooms import draw_room
    from basenet_jax.world.scene_file import save_scene

    enable_cache()
    try:
        load_robot(options.robot)
    except ValueError as error:
        return _fail(2, str(error))
    key, reporter, shown, begin = jax.random.key(options.seed), make_reporter(), False, time.monotonic()
    index = 0
    try:
        for index, name in enumerate(names):
            if options.kind == "rooms":
                drawn = draw_room([options.seed, index], options.objects, robot=options.robot, config=world.scene)
            else:
                own = jax.random.fold_in(key, index)
                drawn = sample_scene(own, objects=options.objects, robot=options.robot, world=world)
            save_scene(options.out / name, drawn)
            if not shown and time.monotonic() - begin > _QUIET_S:
                reporter.start("scenes", options.count, index, unit="scenes")
                shown = True
            if shown:
                reporter.update(index + 1, {})
    except ValueError as error:  # no place for so many objects, or in rooms for the robot
        return _fail(2, f"--objects: scene {index} of seed {options.seed}: {error}")
    finally:
        reporter.finish()
    print(f"{options.count} scenes with {options.objects} objects: {options.out / names[0]} to {names[-1]}")
    return 0


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.generate: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
