"""Writes a scene of one table as a room: `python -m basenet_jax.convert scene.yaml --out room.yaml`."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from basenet_jax.command_line import parse


@dataclass(frozen=True)
class Arguments:
    """Writes a basenet-scene/1 file as basenet-scene/2, to go on from: a room with one table, W in its middle.

    It means what it meant: drives are of a point, and other objects are not in the arm's way. Change `drives` to
    docked and `clutter` to true for a robot that fits where it drives.
    """

    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")]
    """Scene file, YAML or JSON."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """File to write: YAML, or JSON where its name ends in .json."""
    robot: str | None = None
    """The robot that the scene was written for, where it isn't a packaged one: the path of its robot file."""
    overwrite: bool = False
    """Replace a file of the same name."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    options = parse(Arguments, sys.argv[1:] if arguments is None else arguments, "python -m basenet_jax.convert", {})
    if options.out.exists() and not options.overwrite:
        return _fail(f"--out: found {options.out}, allowed is a new file, or --overwrite")

    # Here and not above: JAX takes seconds to import, which --help needn't wait for.
    from basenet_jax.world.room_file import as_room
    from basenet_jax.world.scene_file import load_scene, save_scene

    try:
        scene = load_scene(options.scene, robot=options.robot)
        if scene.furniture is not None:
            return _fail(f"{options.scene}: format: found 'basenet-scene/2', allowed is 'basenet-scene/1'")
        save_scene(options.out, as_room(scene))
    except ValueError as error:
        return _fail(str(error))
    except OSError as error:
        return _fail(f"--out: {options.out}: can't be written: {error.strerror}")
    print(f"{len(scene.names)} objects on one table, as a room: {options.out}")
    return 0


def _fail(message: str) -> int:
    print(f"basenet_jax.convert: {message}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
