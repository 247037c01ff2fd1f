"""Shows scenes and plans live in the browser: `python -m basenet_jax.view scene.yaml`."""

import importlib.util
import os
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from basenet_jax.command_line import PlannerArguments, parse, world_of_file
from basenet_jax.config import WorldConfig


@dataclass(frozen=True, kw_only=True)
class Arguments(PlannerArguments):
    """Serves a web page on which a scene can be changed with the mouse while its plan follows, and be played.

    Ctrl-C ends it. The page shows table or room, objects, robot, the plan on the floor with its navigation time N and
    grasping time G, and why objects can't be picked; scene and plan files can be opened and saved there. It is for
    people you trust: whoever has the link can use it. Exit codes: 0 ended, 2 bad input.
    """

    scene: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENE]")] = None
    """Scene file, YAML or JSON. Default: a random scene."""
    host: str = "127.0.0.1"
    """Address to serve on; 0.0.0.0 for all of this machine's. Others than this machine's own need the printed link."""
    port: int = 8080
    """Port to serve on, 0 to 65535; 0 for any free one."""
    planner: str = "basenet"
    """pbg, pbg-gc, mbp, mbp-gc, dp, greedy-stops, refined, basenet-paper, basenet or basenet-sample."""
    compare: str | None = None
    """A second planner, shown beside the first."""
    robot: str | None = None
    """A packaged robot's name or the path of a robot file, instead of the robot that scenes name."""
    objects: int = 10
    """In a random scene, 1 to 50."""
    kind: Annotated[Literal["table", "rooms"], tyro.conf.arg(name="world")] = "table"
    """Of random scenes: the paper's world, one table, or a room."""
    seed: int = 0
    """Of random scenes."""
    config: Path | None = None
    """YAML or JSON file of settings, such as a training's config.json, whose world is used. Options come before it."""
    world: WorldConfig = field(default_factory=WorldConfig)
    """Of drives, picks and random scenes; a scene file has its own table."""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        defaults = {"world": world_of_file(given)}
    except ValueError as error:
        return _fail(2, str(error))
    options = parse(Arguments, given, "python -m basenet_jax.view", defaults)
    if importlib.util.find_spec("viser") is None:
        return _fail(2, 'viser is not installed: pip install "basenet_jax[viewer]"')
    try:
        return _view(options)
    except KeyboardInterrupt:
        return _fail(130, "interrupted")


def _view(options: Arguments) -> int:
    # Here and not above: JAX and MuJoCo take seconds to import, which --help needn't wait for.
    import jax

    from basenet_jax.api import sample_scene
    from basenet_jax.compilation import enable_cache
    from basenet_jax.planners.registry import shared_options
    from basenet_jax.robot.reading import DEFAULT_ROBOT
    from basenet_jax.viewer.app import Viewer, check_address
    from basenet_jax.viewer.editing import pad
    from basenet_jax.viewer.planned import Choices, planner_for
    from basenet_jax.viewer.serving import is_loopback
    from basenet_jax.world.generate_rooms import draw_room
    from basenet_jax.world.scene_file import load_scene

    enable_cache()
    planners = (options.planner, *([options.compare] if options.compare else []))
    shared = {"options": options.given_options(), "world": options.world, "grid": options.grid}
    choices = Choices(planners, robot=options.robot, **shared)
    robot = options.robot or DEFAULT_ROBOT
    try:
        check_address(options.host, options.port)
        if options.scene is not None:
            scene = pad(load_scene(options.scene, robot=options.robot))
        elif options.kind == "rooms":
            scene = pad(draw_room(options.seed, options.objects, robot=robot, config=options.world.scene))
        else:
            scene = sample_scene(
                jax.random.key(options.seed), objects=options.objects, robot=robot, world=options.world
            )
        shared_options(planners, choices.options)
        for name in planners:
            planner_for(scene, name, choices)
    except ValueError as error:
        return _fail(2, str(error))
    if scene.written_for:
        print(f"basenet_jax.view: {options.scene} names the robot {scene.written_for}, not this", file=sys.stderr)
    if not is_loopback(options.host):
        warning = (
            f"--host {options.host}: whoever has this link, in any network from which it is reached, can use the page"
        )
        print(f"basenet_jax.view: {warning}", file=sys.stderr)
    viewer = Viewer(scene, choices, host=options.host, port=options.port, seed=options.seed)
    print(f"basenet_jax.view: {viewer.url} (Ctrl-C ends it)", flush=True)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        if not viewer.close():
            os._exit(0)  # a compilation goes on, which Python would wait for
    return 0


def _fail(code: int, message: str) -> int:
    print(f"basenet_jax.view: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
