"""Our default planner: the learned policy over candidate stops, in one greedy rollout or as the best of many.

Unlike the paper's, it shares a stop between all objects that are picked well from there, and weighs a drive against
slower picks; see `policies.stop_policy`.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Bool, Float, Int

from basenet_jax.compilation import Stored
from basenet_jax.config import PickConfig, WorldConfig
from basenet_jax.devices import Devices, use_devices
from basenet_jax.planners.candidates import Candidates, check_candidates, estimate_times, join, only_reachable
from basenet_jax.planners.chance import likely_times, reliable
from basenet_jax.planners.greedy_stops import greedy_route
from basenet_jax.planners.optimistic import TOLERANCE_S, Settled, settle, stop_scene
from basenet_jax.planners.options import GreedyStopsOptions, SampleOptions, StopsOptions
from basenet_jax.planners.protocol import PlannerSetup, in_parts, no_plan
from basenet_jax.policies.stop_policy import StopPolicy, StopScene, make_scene
from basenet_jax.policies.stop_rollout import StopPlan, cheapest, choose_best, plan_of, plans_of, play, repeated, sample
from basenet_jax.policies.trained import load_stops
from basenet_jax.robot.model import Robot
from basenet_jax.task.picking import Reason, Rules
from basenet_jax.task.plan import Outcome, Plan, compiled_execute
from basenet_jax.task.prepared_world import PreparedWorld, compiled_first_drives, prepare_world
from basenet_jax.task.reliability import Chance, actual_picks, compiled_plan_reliability
from basenet_jax.task.stop_problem import BATCH_AXES as PROBLEM_AXES
from basenet_jax.task.stop_problem import StopProblem, make_problem
from basenet_jax.world.boxes import Room
from basenet_jax.world.scene import Scene

_PAIRS = 1536  # of stop and object: all those of ten objects and the aligned stops in reach
_PAIRS_AT_ONCE = 4 * _PAIRS  # of several scenes, estimated in one round
_SCENES_AT_ONCE = 16  # planned in one round
_WORTH = GreedyStopsOptions().seconds_per_object
_BUCKET = 256  # poses of the grid that join a room's stops are a multiple of this
_BATCH = 256  # scenes of one call of the compiled program on each device; more go in several calls


class BaSeNet:
    """Parks at stops in line with the table, in the order and number that the learned policy finds best.

    Where they can't serve an object, the grid's poses join them.
    """

    def __init__(
        self,
        setup: PlannerSetup,
        options: StopsOptions = StopsOptions(),
        *,
        policy: StopPolicy | None = None,
        params: Any = None,
    ):
        """Prepares the stops.

        Args:
            setup: robot, table, world and grid.
            options: `SampleOptions` have it play rollouts drawn from the policy beside the greedy one, and take the
                best by its cost.
            policy: the network of the parameters, if these are given: by default the presets'.
            params: of the network; by default both are those of the options' weights.

        Raises:
            ValueError: the weights are missing, damaged, not of the network that their file describes or for another
                robot; the message names the file.
        """
        self._setup, self._devices = setup, use_devices(options.devices or jax.local_device_count())
        if params is None:
            policy, params = load_stops(options.weights, setup.robot.name)
        self._made_for = _MadeFor(setup.robot, setup.room, params, setup.chance)
        samples = options.samples if isinstance(options, SampleOptions) else 0
        self._program = _Program(policy or StopPolicy(), samples, setup.world)
        self._cluttered = Rules.of(setup.world.pick, setup.room).object_in_the_way
        self._prepared = setup.aligned_stops(options.aligned)

    @property
    def stops(self) -> Float[Array, "K 3"]:
        """The aligned stops, (x, y, heading) in W."""
        return self._prepared.poses

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`; the key is ignored by a single greedy rollout.

        What `settle` does for a batch in one program is done here by small ones, which compile side by side and are
        shared with whoever judges plans. Where objects are in each other's way, nothing is estimated: nearly every
        plan would wait for what stands before something.
        """
        if self._cluttered:
            return self._plan_checked(scene, key)
        made_for = self._made_for
        problem = _estimate(made_for.robot, self._prepared, scene, made_for.chance, config=self._program.world.pick)
        proposal = self._settle(scene, problem, _play_greedily)
        if self._program.samples and bool(proposal.complete):
            problem = dataclasses.replace(problem, pick_time=proposal.pick_time)
            visited = _sample(self._made_for.params, scene, problem, key, program=self._program)
            proposal = self._settle(scene, problem, _take_cheapest, visited)
        return proposal.plan if bool(proposal.complete) else self._plan_everywhere(scene, key)

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """What makes the programs for scenes of this shape ready, to be run by `compilation.together`."""
        program, made_for, prepared = self._program, self._made_for, self._prepared
        if self._cluttered:
            return self._preparations_in_clutter(scene)
        stops, slots = len(prepared.poses), len(scene.mask)
        costs: Any = (np.zeros((stops, slots), np.float32), np.zeros(stops, np.float32), np.asarray(scene.mask))
        problem = make_problem(prepared.poses, prepared.drive, *costs, numpy=np)
        known = _nothing_known(problem)
        judged = (made_for.robot, scene, no_plan(scene), self._setup.docked)
        tasks = [
            partial(compiled_execute.prepare, *judged, config=program.world),
            partial(_play_greedily.prepare, made_for.params, scene, problem, known, program=program),
            partial(_estimate.prepare, made_for.robot, prepared, scene, made_for.chance, config=program.world.pick),
        ]
        if made_for.chance is not None:
            errors, actual = made_for.chance.errors, actual_picks(program.world.pick, made_for.chance.uncertainty)
            sure = (made_for.robot, scene, no_plan(scene), errors)
            tasks.append(partial(compiled_plan_reliability.prepare, *sure, config=actual))
        if program.samples:
            visited = np.zeros((program.samples + 1, slots), np.int32)
            shown = (made_for.params, scene, problem)
            tasks += [
                partial(_sample.prepare, *shown, jax.random.key(0), program=program),
                partial(_take_cheapest.prepare, *shown, known, visited, program=program),
            ]
        return tasks

    def _settle(self, scene: Scene, problem: StopProblem, choose: Stored, *shown: Array) -> "_Proposal":
        """A proposal whose picks take what they were thought to, says the judge; or that doesn't serve everything."""
        known = _nothing_known(problem)
        while True:
            proposal = choose(self._made_for.params, scene, problem, known, *shown, program=self._program)
            outcome = compiled_execute(
                self._made_for.robot, scene, proposal.plan, self._setup.docked, config=self._program.world
            )
            outcome = self._only_reliable(scene, proposal.plan, outcome)
            complete, known, holds = jax.device_get(_compare(proposal, outcome))
            if holds or not complete:
                return proposal
            problem = dataclasses.replace(problem, pick_time=proposal.pick_time)

    def _only_reliable(self, scene: Scene, plan: Plan, outcome: Outcome) -> Outcome:
        """The outcome as if picks that aren't reliable enough weren't feasible."""
        chance = self._made_for.chance
        if chance is None:
            return outcome
        actual = actual_picks(self._program.world.pick, chance.uncertainty)
        sure = chance.holds(compiled_plan_reliability(self._made_for.robot, scene, plan, chance.errors, config=actual))
        return dataclasses.replace(outcome, feasible=outcome.feasible & sure)

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """Plans a batch of scenes in one program, or one by one in clutter; see `BatchPlanner`."""
        keys = jax.random.split(key, len(scenes.mask))
        if self._cluttered:
            rows = [jax.tree.map(lambda x, row=row: x[row], (scenes, keys)) for row in range(len(keys))]
            return jax.tree.map(lambda *plans: jnp.stack(plans), *(self._plan_checked(*row) for row in rows))

        def plan_part(scenes: Scene, keys: Array) -> tuple[Plan, Array]:
            return _plan_apart(self._devices, self._program, self._made_for, scenes, self._prepared, keys)

        plan, complete = in_parts(plan_part, scenes, keys, devices=self._devices, most=_BATCH)
        for index in np.flatnonzero(~np.asarray(complete)).tolist():
            scene, own_key = jax.tree.map(lambda x, index=index: x[index], (scenes, keys))
            anew = self._plan_everywhere(scene, own_key)
            plan = jax.tree.map(lambda all, one, index=index: all.at[index].set(one), plan, anew)
        return plan

    def _plan_everywhere(self, scene: Scene, key: Array) -> Plan:
        """A plan over the aligned stops, checked in full, and the grid's poses where these serve what the stops don't.

        The drives between all of them are millions, which are costed for nothing where the grid doesn't help. In rooms,
        whose drives are dear, only those of the grid's poses join that serve something that the stops don't.
        """
        aligned, grid = self._check(scene, self._prepared), self._check(scene, self._setup.grid_stops)
        both, missed = join(aligned, grid), ~jnp.any(aligned.serves, axis=0)
        helps = np.asarray(jnp.any(both.serves & missed, axis=1))
        if np.any(helps):
            if self._setup.docked is not None:
                both = both.rows(_with_all_of(len(aligned.base_pose), np.flatnonzero(helps)))
            return self._play(scene, both, self._prepare(both.base_pose), key)
        return self._play(scene, dataclasses.replace(aligned, reason=both.reason), self._prepared, key)

    def _plan_checked(self, scene: Scene, key: Array) -> Plan:
        """A plan over the aligned stops, all of whose picks are checked in full beforehand."""
        aligned = self._check(scene, self._prepared)
        if bool(jnp.all(jnp.any(aligned.serves, axis=0) | ~scene.mask)):
            return self._play(scene, aligned, self._prepared, key)
        return self._plan_everywhere(scene, key)

    def _check(self, scene: Scene, stops: PreparedWorld) -> Candidates:
        setup = self._setup
        candidates = check_candidates(setup.robot, scene, stops.poses, world=setup.world, pairs_at_once=_PAIRS)
        if setup.docked is None:
            return candidates
        return only_reachable(candidates, compiled_first_drives(setup.robot, stops, scene.robot_start))

    def _play(self, scene: Scene, candidates: Candidates, prepared: PreparedWorld, key: Array) -> Plan:
        setup = self._setup
        if setup.chance is not None:
            candidates = reliable(setup.robot, scene, candidates, setup.chance, world=setup.world)
        problem = _problem_of(setup.robot, prepared, scene, candidates)
        nothing = _nothing_known(problem)
        if self._program.samples:
            visited = _sample(self._made_for.params, scene, problem, key, program=self._program)
            return _take_cheapest(self._made_for.params, scene, problem, nothing, visited, program=self._program).plan
        if self._cluttered:
            return _play_beside_rule(self._made_for.params, scene, problem, program=self._program).plan
        return _play_greedily(self._made_for.params, scene, problem, nothing, program=self._program).plan

    def _preparations_in_clutter(self, scene: Scene) -> Sequence[Callable[[], object]]:
        setup, prepared = self._setup, self._prepared
        judged = (setup.robot, scene, no_plan(scene), setup.docked)
        tasks = [
            partial(compiled_execute.prepare, *judged, config=setup.world),
            partial(
                check_candidates.prepare, setup.robot, scene, prepared.poses, world=setup.world, pairs_at_once=_PAIRS
            ),
        ]
        if setup.docked is not None:
            tasks.append(partial(compiled_first_drives.prepare, setup.robot, prepared, scene.robot_start))
        return tasks

    def _prepare(self, poses: Float[Array, "K 3"]) -> PreparedWorld:
        return prepare_world(self._setup.robot, self._setup.drives, poses)


def _with_all_of(first: int, further: Int[np.ndarray, " F"]) -> Int[np.ndarray, " K"]:
    """The first so many rows and some of the others, filled up with copies so that few numbers of them are compiled."""
    some = further[further >= first]
    return np.concatenate([np.arange(first), np.resize(some, len(some) + -len(some) % _BUCKET)])


class _MadeFor(NamedTuple):
    """What stays the same from call to call."""

    robot: Robot
    room: Room
    params: Any  # of the policy
    chance: Chance | None  # how sure picks are to be


class _Known(NamedTuple):
    """Pick times that the judge found, of M pairs of stop and object; a stop past the last: none."""

    stop: ArrayLike  # Int[" M"]
    slot: ArrayLike  # likewise
    time: ArrayLike  # s; infinite where the pick isn't feasible


class _Proposal(NamedTuple):
    """A plan of one scene, and what it was made on; arrays with an axis of M are by step."""

    plan: Plan
    complete: Bool[Array, ""]  # whether every object is served
    stop: Int[Array, " M"]
    thought: Float[Array, " M"]  # s, pick times
    pick_time: Float[Array, "K M"]  # s, of all pairs, with those that are known


@dataclass(frozen=True)
class _Program:
    """What the compiled programs are made for."""

    policy: StopPolicy
    samples: int  # rollouts drawn beside the greedy one
    world: WorldConfig


@partial(Stored, static=("config",))
def _estimate(
    robot: Robot, prepared: PreparedWorld, scene: Scene, chance: Chance | None, *, config: PickConfig
) -> StopProblem:
    """The problem with estimated pick times."""
    times = estimate_times(robot, prepared.poses, scene.grasps, scene.mask, config, pairs_at_once=_PAIRS)
    first_drive = prepared.first_drives(robot, scene.robot_start[None])[0]
    if chance is not None:
        times = likely_times(robot, scene, prepared.poses, times, first_drive, chance, config)
    return make_problem(prepared.poses, prepared.drive, times, first_drive, scene.mask)


@jax.jit
def _problem_of(robot: Robot, prepared: PreparedWorld, scene: Scene, candidates: Candidates) -> StopProblem:
    """The problem with pick times that were checked, at the candidates that the world was prepared for."""
    first_drive = prepared.first_drives(robot, scene.robot_start[None])[0]
    costs = (candidates.pick_time, first_drive, scene.mask, candidates.reason)
    return make_problem(prepared.poses, prepared.drive, *costs, clutter=candidates.clutter)


@partial(Stored, static=("program",))
def _play_greedily(params: Any, scene: Scene, problem: StopProblem, known: _Known, *, program: _Program) -> _Proposal:
    problem = _corrected(scene, problem, known)
    one = repeated(make_scene(problem, scene.robot_start, scene.first_grasp), 1)
    return _propose(scene, problem, plan_of(problem, play(program.policy, params, one, choose_best)[0]))


@partial(Stored, static=("program",))
def _play_beside_rule(params: Any, scene: Scene, problem: StopProblem, *, program: _Program) -> _Proposal:
    """The policy's rollout, or the route of the greedy rule where that is cheaper: in rooms it was never trained."""
    one = repeated(make_scene(problem, scene.robot_start, scene.first_grasp), 1)
    visited = jnp.concatenate([play(program.policy, params, one, choose_best), greedy_route(problem, _WORTH)[None]])
    return _propose(scene, problem, cheapest(problem, visited))


@partial(Stored, static=("program",))
def _sample(params: Any, scene: Scene, problem: StopProblem, key: Array, *, program: _Program) -> Int[Array, "S M"]:
    """The stops of the greedy rollout and of sampled ones, on these pick times."""
    own = make_scene(_corrected(scene, problem, _nothing_known(problem)), scene.robot_start, scene.first_grasp)
    return sample(program.policy, params, own, key, program.samples)


@partial(Stored, static=("program",))
def _take_cheapest(
    params: Any, scene: Scene, problem: StopProblem, known: _Known, visited: Int[Array, "S M"], *, program: _Program
) -> _Proposal:
    del params, program
    problem = _corrected(scene, problem, known)
    return _propose(scene, problem, cheapest(problem, visited))


@jax.jit
def _compare(proposal: _Proposal, outcome: Outcome) -> tuple[Bool[Array, ""], _Known, Bool[Array, ""]]:
    """Whether the proposal is complete, what the judge found of its picks, and whether that is what was thought."""
    served, exact = proposal.plan.served, jnp.where(outcome.feasible, outcome.pick_time, jnp.inf)
    stop = jnp.where(served, proposal.stop, len(proposal.pick_time))
    holds = jnp.all(~served | (jnp.abs(exact - proposal.thought) <= TOLERANCE_S))
    return proposal.complete, _Known(stop, proposal.plan.object_index, exact), holds


def _corrected(scene: Scene, problem: StopProblem, known: _Known) -> StopProblem:
    """The problem with the pick times that are known; objects that no stop serves any more are left out.

    In clutter all are known beforehand.
    """
    if problem.clutter is not None:
        return problem
    times = problem.pick_time.at[known.stop, known.slot].set(jnp.asarray(known.time), mode="drop")
    reason = jnp.where(problem.mask, int(Reason.OUT_OF_REACH), problem.reason)
    return make_problem(problem.poses, problem.drive, times, problem.first_drive, scene.mask, reason)


def _propose(scene: Scene, problem: StopProblem, stops: StopPlan) -> _Proposal:
    plan, stop = _as_plan(scene, problem, stops)
    thought = problem.pick_time[stop, jnp.maximum(plan.object_index, 0)]
    complete = jnp.all((stops.picked_at >= 0) | ~scene.mask)
    return _Proposal(plan, complete, stop, thought, problem.pick_time)


def _nothing_known(problem: StopProblem) -> _Known:
    stops, slots = problem.pick_time.shape
    return _Known(np.full(slots, stops, np.int32), np.zeros(slots, np.int32), np.zeros(slots, np.float32))


@jax.jit(static_argnames="program")
def _plan_many(
    program: _Program, made_for: _MadeFor, scenes: Scene, prepared: PreparedWorld, keys: Array
) -> tuple[Plan, Bool[Array, " B"]]:
    """Plans by estimated pick times, and whether each serves every object."""
    robot, room, params, chance = made_for
    at_once = min(len(scenes.mask), _PAIRS_AT_ONCE // _PAIRS) * _PAIRS
    times = estimate_times(robot, prepared.poses, scenes.grasps, scenes.mask, program.world.pick, pairs_at_once=at_once)
    first_drive = prepared.first_drives(robot, scenes.robot_start)
    if chance is not None:
        times = jax.lax.map(
            lambda own: likely_times(robot, own[0], prepared.poses, own[1], own[2], chance, program.world.pick),
            (scenes, times, first_drive),
        )

    def play_greedily(own: StopScene) -> StopPlan:
        return plans_of(own.problem, play(program.policy, params, own, choose_best))

    def settled(scenes: Scene, first_drive: Array, times: Array, choose: Any, at_once: int) -> Settled:
        return settle(robot, room, prepared, scenes, first_drive, times, choose, program.world, chance, at_once=at_once)

    greedy = settled(scenes, first_drive, times, play_greedily, _SCENES_AT_ONCE)

    def sample_one(own: tuple[Scene, Array, Array, Array]) -> StopPlan:
        """On the times that the greedy plan left, so that the best of all is no worse than it."""
        scene, first_drive, times, key = own
        on_stops = stop_scene(prepared, scene, first_drive, times)
        visited = sample(program.policy, params, on_stops, key, program.samples)

        def take_cheapest(own: StopScene) -> StopPlan:
            return jax.vmap(cheapest, in_axes=(PROBLEM_AXES, None))(own.problem, visited)

        alone = jax.tree.map(lambda x: x[None], (scene, first_drive, times))
        plan = settled(*alone, choose=take_cheapest, at_once=1).plan
        return jax.tree.map(lambda x: x[0], plan)

    shown = (scenes, first_drive, greedy.pick_time)
    stops = jax.lax.map(sample_one, (*shown, keys)) if program.samples > 0 else greedy.plan
    problems = stop_scene(prepared, *shown).problem
    plans, _ = jax.vmap(_as_plan, in_axes=(0, PROBLEM_AXES, 0))(scenes, problems, stops)
    return plans, jnp.all((stops.picked_at >= 0) | ~scenes.mask, axis=-1)


@jax.jit(static_argnames=("devices", "program"))
def _plan_apart(
    devices: Devices, program: _Program, made_for: _MadeFor, scenes: Scene, prepared: PreparedWorld, keys: Array
) -> tuple[Plan, Bool[Array, " B"]]:
    plan = devices.apart(partial(_plan_many, program), in_axes=(None, 0, None, 0))
    return plan(made_for, scenes, prepared, keys)


def _as_plan(scene: Scene, problem: StopProblem, stops: StopPlan) -> tuple[Plan, Int[Array, " M"]]:
    """One step for each object, by its visit and turn; those not served come last. And each step's stop."""
    last = len(scene.mask)
    visit = jnp.where(stops.picked_at >= 0, stops.picked_at, jnp.where(scene.mask, last, last + 1))
    order = jnp.lexsort((stops.turn, visit))
    served = visit[order] < last
    reason = jnp.where(problem.mask, int(Reason.UNREACHABLE), problem.reason)[order]  # of those that no visit serves
    stop = jnp.maximum(stops.stops[jnp.minimum(visit[order], last - 1)], 0)
    plan = Plan(
        object_index=jnp.where(scene.mask[order], order, -1),
        base_pose=jnp.where(served[:, None], problem.poses[stop], 0.0),
        served=served,
        reason=jnp.where(served | ~scene.mask[order], int(Reason.NONE), reason),
    )
    return plan, stop
