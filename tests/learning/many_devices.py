"""A program for `test_many_devices`: learners and planners on several devices, their results on stdout as JSON.

`python many_devices.py COUNT NAME ...` uses so many of this process' devices. With `PORT:INDEX` instead it is one of
two processes, 0 or 1, which use all the devices of both.
"""

import json
import sys
from typing import Any

import jax
import numpy as np

from basenet_jax.batch import sample_scenes
from basenet_jax.config import AlignedConfig, WorldConfig
from basenet_jax.devices import Devices, use_devices
from basenet_jax.learning.base_pose_env import BasePoseEnv
from basenet_jax.learning.config import ReinforceConfig, SacConfig, StopLearningConfig
from basenet_jax.learning.reinforce import Reinforce, ReinforceState
from basenet_jax.learning.sac import Sac
from basenet_jax.learning.stop_learning import StopLearning
from basenet_jax.planners.protocol import PlannerSetup, plan_batch
from basenet_jax.planners.registry import make_options, make_planner
from basenet_jax.policies.trained import load_policies
from basenet_jax.robot.reading import load_robot

SAC = SacConfig(
    hidden=(16,),
    episodes_per_iteration=32,
    updates_per_iteration=2,
    batch_size=16,
    replay_size=64,
    iterations_per_interval=2,
    evaluation_problems=16,
)
REINFORCE = ReinforceConfig(
    objects=3,
    features=8,
    layers=1,
    navigation_weight=1.0,
    episodes_per_update=16,
    updates_per_interval=2,
    test_episodes=16,
    evaluation_scenes=8,
)
STOPS = StopLearningConfig(
    objects=3,
    features=8,
    layers=1,
    library_objects=16,
    examples=16,
    search_iterations=10,
    imitation_intervals=1,
    imitations_per_update=16,
    problems_per_update=8,
    samples=2,
    updates_per_interval=2,
    intervals=2,
    evaluation_problems=8,
)
SCENES = 11  # no multiple of anything
LEARNERS = ("sac", "reinforce", "stops")


def learner(name: str, devices: Devices) -> dict[str, Any]:
    """What a learner's first intervals come to: what it learned, and its metrics."""
    robot = load_robot()
    if name == "sac":
        made = Sac(BasePoseEnv(robot), SAC, devices)
        return run(made, lambda state: (state.actor, state.critics, state.log_alpha, state.replay.data))
    if name == "stops":
        made = StopLearning(robot, STOPS, aligned=AlignedConfig(step_m=0.4), devices=devices)
        return run(made, lambda state: (state.params, state.answers), intervals=2)
    base_pose = jax.tree.map(np.asarray, load_policies(None, robot.name).base_pose)
    return run(Reinforce(robot, base_pose, REINFORCE, WorldConfig(), devices), without_last_bias)


def run(learner: Any, kept: Any, intervals: int = 1) -> dict[str, Any]:
    state = jax.jit(learner.init)(jax.random.key(0))
    interval, metrics = jax.jit(learner.interval, donate_argnums=0), {}
    for _ in range(intervals):
        state, metrics = interval(state)
    return {
        "metrics": {name: float(value) for name, value in metrics.items()},
        "learned": [np.asarray(leaf, float).ravel().tolist() for leaf in jax.tree.leaves(kept(state))],
        "whole copies": all(leaf.sharding.is_fully_replicated for leaf in jax.tree.leaves(state)),
        "on": len(jax.tree.leaves(state)[0].sharding.device_set),
    }


def without_last_bias(state: ReinforceState) -> Any:
    """It moves all logits alike, so its gradient is nothing but rounding, of which Adam makes whole steps."""
    layers = dict(state.params["params"])
    last = max(name for name in layers if name.startswith("Dense"))
    return layers | {last: layers[last]["kernel"]}


def plans(name: str, devices: Devices) -> list[Any]:
    """A planner's plans of some scenes."""
    scenes = sample_scenes(jax.random.key(3), count=SCENES, objects=4)
    options = make_options(name, {"devices": devices.count})
    made = plan_batch(make_planner(name, PlannerSetup(), options), scenes, jax.random.key(4))
    return [np.asarray(leaf, float).tolist() for leaf in jax.tree.leaves(made)]


def main(count: str, *names: str) -> None:
    if ":" in count:
        port, index = count.split(":")
        jax.distributed.initialize(f"127.0.0.1:{port}", num_processes=2, process_id=int(index))
    devices = use_devices(None if ":" in count else int(count))
    made = {name: (learner if name in LEARNERS else plans)(name, devices) for name in names}
    print(json.dumps(made))


if __name__ == "__main__":
    main(*sys.argv[1:])
