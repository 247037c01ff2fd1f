"""Our default planner: the learned policy over candidate stops, in one greedy rollout or as the best of many.

Unlike the paper's, it shares a stop between all objects that are picked well from there, and weighs a drive against
slower picks; see `policies.stop_policy`.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from basenet_jax.config import AlignedConfig, WorldConfig
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.candidates import Candidates, check_candidates, join
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.policies.stop_policy import StopGraph, StopPolicy, make_scene, stop_graph
from basenet_jax.policies.stop_rollout import StopPlan, best_of, choose_best, plan_of, play
from basenet_jax.policies.trained import load_policies
from basenet_jax.robot.model import Robot
from basenet_jax.task.navigation import navigation_time
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene

_PAIRS_AT_ONCE = 1536  # of stop and object: all those of ten objects and the aligned stops in reach


class BaSeNet:
    """Parks at stops in line with the table, in the order and number that the learned policy finds best.

    Where they can't serve an object, the grid's poses join them.
    """

    def __init__(
        self,
        setup: PlannerSetup,
        *,
        sampled: bool = False,
        policy: StopPolicy = StopPolicy(),
        params: Any = None,
        aligned: AlignedConfig = AlignedConfig(),
    ):
        """Prepares the stops.

        Args:
            setup: robot, table, world, weights and, if sampled, the number of rollouts.
            sampled: play many rollouts drawn from the policy beside the greedy one, and take the best by its cost.
            policy: the network, and
            params: its parameters; by default those of the setup's weights.
            aligned: the stops.

        Raises:
            ValueError: the weights are missing, damaged, of other networks or for another robot; the message names
                the file.
        """
        self._setup, self._samples = setup, setup.samples if sampled else 0
        self._policy = policy
        self._params = load_policies(setup.weights, setup.robot.name).stops if params is None else params
        self._stops = jax.device_put(aligned_poses(setup.robot, setup.table, aligned, setup.world.pick))
        self._graph = self._graph_of(self._stops)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored by a single greedy rollout."""
        candidates = self._check(scene, self._stops)
        plan, complete = self._plan(scene, candidates, self._graph, key)
        if bool(complete):
            return plan
        everywhere = join(candidates, self._check(scene, self._setup.grid_poses))
        return self._plan(scene, everywhere, self._graph_of(everywhere.base_pose), key)[0]

    def _plan(self, scene: Scene, candidates: Candidates, graph: StopGraph, key: Array) -> tuple[Plan, Array]:
        setup = self._setup
        return _plan(setup.robot, scene, candidates, graph, self._policy, self._params, key, self._samples, setup.world)

    def _check(self, scene: Scene, poses: Float[ArrayLike, "K 3"]) -> Candidates:
        return check_candidates(self._setup.robot, scene, poses, self._setup.world, pairs_at_once=_PAIRS_AT_ONCE)

    def _graph_of(self, poses: Float[Array, "K 3"]) -> StopGraph:
        setup = self._setup
        return _stop_graph(setup.robot, setup.table, poses, setup.world.navigation)


_stop_graph = jax.jit(stop_graph, static_argnames="config")


@jax.jit(static_argnames=("policy", "samples", "world"))
def _plan(
    robot: Robot,
    scene: Scene,
    candidates: Candidates,
    graph: StopGraph,
    policy: StopPolicy,
    params: Any,
    key: Array,
    samples: int,
    world: WorldConfig,
) -> tuple[Plan, Array]:
    """The plan, and whether it serves every object."""
    first_drive = navigation_time(robot, scene.robot_start, graph.poses, scene.table, world.navigation)
    own = make_scene(graph, candidates.pick_time, first_drive, scene.robot_start, scene.grasps, scene.mask)
    if samples:
        stops = best_of(policy, params, graph, own, key, samples)
    else:
        stops = plan_of(graph, own, play(policy, params, graph, own, choose_best))
    reachable = jnp.any(jnp.isfinite(candidates.pick_time), axis=0)
    plan = _as_plan(scene, stops, graph, jnp.where(reachable, int(Reason.UNREACHABLE), candidates.reason))
    return plan, jnp.all((stops.picked_at >= 0) | ~scene.mask)


def _as_plan(scene: Scene, stops: StopPlan, graph: StopGraph, reason: Array) -> Plan:
    """One step for each object, by its visit; those not served come last."""
    last = len(scene.mask)
    visit = jnp.where(stops.picked_at >= 0, stops.picked_at, jnp.where(scene.mask, last, last + 1))
    order = jnp.argsort(visit, stable=True)
    served = visit[order] < last
    poses = graph.poses[stops.stops[jnp.minimum(visit[order], last - 1)]]
    return Plan(
        object_index=jnp.where(scene.mask[order], order, -1),
        base_pose=jnp.where(served[:, None], poses, 0.0),
        served=served,
        reason=jnp.where(served | ~scene.mask[order], int(Reason.NONE), reason[order]),
    )
