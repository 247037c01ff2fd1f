"""The planner of one's own beside two that come with the package, on one scene."""

import jax
from nearest_stop import NearestStop

import basenet_jax as bn
from basenet_jax.planners.registry import PLANNERS, PlannerKind

PLANNERS["nearest-stop"] = PlannerKind(NearestStop)  # from here on it has a name, as all others have

scene = bn.sample_scene(jax.random.key(3), objects=4)
for name in ("nearest-stop", "greedy-stops", "basenet"):
    outcome = bn.execute(scene, bn.make_plan(scene, planner=name))
    print(f"{name:14} {int(outcome.grasped)} of 4 grasped, N + G {float(outcome.execution):.1f} s")
