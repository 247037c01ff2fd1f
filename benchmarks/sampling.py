"""Random scenes and environment steps per second, by batch size.

A scene has ten objects of random classes, none overlapping, and a robot start. A problem is what one reset of the
base-pose environment draws: one grasp and a robot that doesn't collide. A step parks the base where a random action
says and tries the pick in full; most random actions fail early, see `success`, and `picks` has the dear ones.
"""

import sys
from collections.abc import Callable
from typing import Any

import jax
from jax import Array

from basenet_jax.config import WorldConfig
from basenet_jax.learning._brax import State
from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.policies.base_pose import ACTION_SIZE
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.boxes import Room
from basenet_jax.world.generate import draw_scene
from basenet_jax.world.scene import Scene
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.scaling_picture import draw_scaling, rate_points
from benchmarks.timing import measure, speed

NAME = "sampling"
BATCHES, QUICK_BATCHES = (64, 512, 4_096, 32_768), (512,)
OBJECTS = 10


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(Options, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    env = BasePoseEnv(jax.device_put(load_robot()))
    rows = {name: [] for name in ("scenes", "problems", "steps")}
    for batch in QUICK_BATCHES if options.quick else BATCHES:
        keys = jax.random.split(jax.random.key(options.seed), batch)
        state = jax.jit(jax.vmap(env.reset))(keys)
        action = jax.random.uniform(jax.random.key(options.seed + 1), (batch, ACTION_SIZE), minval=-1.0)
        rows["scenes"].append(_row(f"scenes of {OBJECTS} objects", "scenes/s", _draw_scenes, (keys,), options))
        rows["problems"].append(_row("problems", "problems/s", jax.vmap(env.reset), (keys,), options))
        success = float(jax.jit(env.step)(state, action).metrics["success"].mean())
        rows["steps"].append(_row("environment steps", "steps/s", env.step, (state, action), options, success=success))
    results = [row for kind in rows.values() for row in kind]
    return report.finish(
        results,
        table=speed_table("Random scenes and environment steps", results, "batch", "success"),
        picture=draw_scaling(
            "Random scenes and environment steps",
            {kind[0]["what"]: rate_points(kind, "batch") for kind in rows.values()},
            size="batch",
            value="per second",
        ),
    )


def _draw_scenes(keys: Array) -> Scene:
    world = WorldConfig()
    room = Room.from_config(world.table)
    return jax.vmap(lambda key: draw_scene(key, OBJECTS, room, slots=OBJECTS, config=world.scene)[0])(keys)


def _row(
    what: str,
    unit: str,
    function: Callable[..., Scene | State],
    arguments: tuple[Any, ...],
    options: Options,
    **facts: Any,
) -> dict[str, Any]:
    batch = len(jax.tree.leaves(arguments[0])[0])
    return speed(what, unit, batch, measure(function, [arguments], repeats=options.repeats), batch=batch, **facts)


if __name__ == "__main__":
    main()
