"""Our default planner: the learned policy over candidate stops, in one greedy rollout or as the best of many.

Unlike the paper's, it shares a stop between all objects that are picked well from there, and weighs a drive against
slower picks; see `policies.stop_policy`.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax.config import AlignedConfig, WorldConfig
from basenet_jax.devices import Devices
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.candidates import Candidates, check_candidates, estimate_times, join
from basenet_jax.planners.optimistic import settle, stop_scenes
from basenet_jax.planners.protocol import PlannerSetup, in_parts
from basenet_jax.policies.stop_policy import StopGraph, StopPolicy, StopScene, stop_graph
from basenet_jax.policies.stop_rollout import StopPlan, cheapest, choose_best, plans_of, play, sample
from basenet_jax.policies.trained import load_stops
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene, Table

_PAIRS = 1536  # of stop and object: all those of ten objects and the aligned stops in reach
_PAIRS_AT_ONCE = 4 * _PAIRS  # of several scenes, estimated in one round
_SCENES_AT_ONCE = 16  # planned in one round
_BATCH = 256  # scenes of one call of the compiled program on each device; more go in several calls


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
        self._setup, self._devices = setup, setup.devices
        params = load_stops(setup.weights, setup.robot.name) if params is None else params
        self._made_for = _MadeFor(setup.robot, setup.table, params)
        self._program = _Program(policy, setup.samples if sampled else 0, setup.world)
        stops = jax.device_put(aligned_poses(setup.robot, setup.table, aligned, setup.world.pick))
        self._graph = self._graph_of(stops)

    @property
    def stops(self) -> Float[Array, "K 3"]:
        """The aligned stops, (x, y, heading) in W."""
        return self._graph.poses

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored by a single greedy rollout."""
        plan, complete = _plan_one(self._program, self._made_for, scene, self._graph, key)
        return plan if bool(complete) else self._plan_everywhere(scene, key)

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """Plans a batch of scenes in one program; see `BatchPlanner`."""
        keys = jax.random.split(key, len(scenes.mask))

        def plan_part(scenes: Scene, keys: Array) -> tuple[Plan, Array]:
            return _plan_apart(self._devices, self._program, self._made_for, scenes, self._graph, keys)

        plan, complete = in_parts(plan_part, scenes, keys, devices=self._devices, most=_BATCH)
        for index in np.flatnonzero(~np.asarray(complete)).tolist():
            scene, own_key = jax.tree.map(lambda x, index=index: x[index], (scenes, keys))
            anew = self._plan_everywhere(scene, own_key)
            plan = jax.tree.map(lambda all, one, index=index: all.at[index].set(one), plan, anew)
        return plan

    def _plan_everywhere(self, scene: Scene, key: Array) -> Plan:
        """A plan over the aligned stops, checked in full, and the grid's poses where these serve what the stops don't.

        The drives between all of them are millions, which are costed for nothing where the grid doesn't help.
        """
        setup = self._setup
        aligned, grid = (
            check_candidates(setup.robot, scene, poses, setup.world, pairs_at_once=_PAIRS)
            for poses in (self._graph.poses, setup.grid_poses)
        )
        both, missed = join(aligned, grid), ~jnp.any(aligned.serves, axis=0)
        if bool(jnp.any(grid.serves & missed)):
            candidates, graph = both, self._graph_of(both.base_pose)
        else:
            candidates, graph = dataclasses.replace(aligned, reason=both.reason), self._graph
        return _plan_checked(self._program, self._made_for, scene, candidates, graph, key)

    def _graph_of(self, poses: Float[Array, "K 3"]) -> StopGraph:
        setup = self._setup
        return _stop_graph(setup.robot, setup.table, poses, setup.world.navigation)


class _MadeFor(NamedTuple):
    """What stays the same from call to call."""

    robot: Robot
    table: Table
    params: Any  # of the policy


_stop_graph = jax.jit(stop_graph, static_argnames="config")


@dataclass(frozen=True)
class _Program:
    """What the compiled programs are made for."""

    policy: StopPolicy
    samples: int  # rollouts drawn beside the greedy one
    world: WorldConfig

    def plan_stops(self, made_for: _MadeFor, scenes: Scene, graph: StopGraph, times: Array, keys: Array) -> StopPlan:
        """Plans of a batch by pick times that are estimated, or exact."""
        robot, table, params = made_for

        def play_greedily(own: StopScene) -> StopPlan:
            return plans_of(graph, own, play(self.policy, params, graph, own, choose_best))

        greedy = settle(robot, table, graph, scenes, times, play_greedily, self.world, at_once=_SCENES_AT_ONCE)
        if not self.samples:
            return greedy.plan

        def sample_one(own: tuple[Scene, Array, Array]) -> StopPlan:
            """On the times that the greedy plan left, so that the best of all is no worse than it."""
            scene, times, key = own
            batch = jax.tree.map(lambda x: x[None], scene)

            def draw(own: StopScene) -> Array:
                return sample(self.policy, params, graph, jax.tree.map(lambda x: x[0], own), key, self.samples)

            visited = draw(stop_scenes(robot, table, graph, batch, times[None], self.world))

            def take_cheapest(own: StopScene) -> StopPlan:
                return jax.vmap(cheapest, in_axes=(None, 0, None))(graph, own, visited)

            settled = settle(robot, table, graph, batch, times[None], take_cheapest, self.world, at_once=1)
            return jax.tree.map(lambda x: x[0], settled.plan)

        return jax.lax.map(sample_one, (scenes, greedy.pick_time, keys))


@jax.jit(static_argnames="program")
def _plan_one(
    program: _Program, made_for: _MadeFor, scene: Scene, graph: StopGraph, key: Array
) -> tuple[Plan, Bool[Array, ""]]:
    one = jax.tree.map(lambda x: x[None], (scene, key))
    return jax.tree.map(lambda x: x[0], _plan_many(program, made_for, one[0], graph, one[1]))


@jax.jit(static_argnames="program")
def _plan_many(
    program: _Program, made_for: _MadeFor, scenes: Scene, graph: StopGraph, keys: Array
) -> tuple[Plan, Bool[Array, " B"]]:
    """Plans by estimated pick times, and whether each serves every object."""
    robot, _, _ = made_for
    at_once = min(len(scenes.mask), _PAIRS_AT_ONCE // _PAIRS) * _PAIRS
    times = estimate_times(robot, graph.poses, scenes.grasps, scenes.mask, program.world.pick, pairs_at_once=at_once)
    stops = program.plan_stops(made_for, scenes, graph, times, keys)
    unserved = jnp.full(scenes.mask.shape, int(Reason.UNREACHABLE))
    complete = jnp.all((stops.picked_at >= 0) | ~scenes.mask, axis=-1)
    return jax.vmap(_as_plan, in_axes=(0, 0, None, 0))(scenes, stops, graph, unserved), complete


@jax.jit(static_argnames=("devices", "program"))
def _plan_apart(
    devices: Devices, program: _Program, made_for: _MadeFor, scenes: Scene, graph: StopGraph, keys: Array
) -> tuple[Plan, Bool[Array, " B"]]:
    plan = devices.apart(partial(_plan_many, program), in_axes=(None, 0, None, 0))
    return plan(made_for, scenes, graph, keys)


@jax.jit(static_argnames="program")
def _plan_checked(
    program: _Program, made_for: _MadeFor, scene: Scene, candidates: Candidates, graph: StopGraph, key: Array
) -> Plan:
    """The plan of one scene by exact pick times; objects that it doesn't serve have their reasons."""
    one = jax.tree.map(lambda x: x[None], (scene, candidates.pick_time, key))
    stops = program.plan_stops(made_for, one[0], graph, one[1], one[2])
    reachable = jnp.any(jnp.isfinite(candidates.pick_time), axis=0)
    reason = jnp.where(reachable, int(Reason.UNREACHABLE), candidates.reason)
    return _as_plan(scene, jax.tree.map(lambda x: x[0], stops), graph, reason)


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
