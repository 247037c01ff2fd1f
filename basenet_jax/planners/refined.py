"""Planning over aligned stops, then continuous refinement: better plans than the grid holds, in less time."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from basenet_jax.compilation import Stored
from basenet_jax.config import RefinementConfig, WorldConfig
from basenet_jax.planners.candidates import PAIRS_AT_ONCE as GRID_PAIRS_AT_ONCE
from basenet_jax.planners.candidates import Candidates, check_candidates, join, only_reachable
from basenet_jax.planners.chance import reliable, shortfall
from basenet_jax.planners.greedy_stops import greedy_route
from basenet_jax.planners.options import GreedyStopsOptions, RefinedOptions
from basenet_jax.planners.protocol import PlannerSetup, no_plan
from basenet_jax.planners.refinement import alternatives, reassign, refine
from basenet_jax.planners.route import Route, as_plan, as_route, reason_by_slot
from basenet_jax.planners.stop_problem import Sizes, stop_problem
from basenet_jax.planners.stop_search import MAX_STOPS, plan_steps, search_stops
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives
from basenet_jax.task.picking import Rules
from basenet_jax.task.plan import Plan, compiled_execute
from basenet_jax.task.prepared_world import PreparedWorld, compiled_first_drives, prepare_world
from basenet_jax.task.reliability import Chance
from basenet_jax.world.scene import Scene

EXACT_OBJECTS = 11  # more are searched: exact planning takes 30 ms here and doubles with every further object
SEARCH_ITERATIONS = 2000  # 50 ms at 12 objects, 150 ms at 30; more gain less than 0.1 %
_WORTH = GreedyStopsOptions().seconds_per_object
_greedy_route = jax.jit(greedy_route)
PAIRS_AT_ONCE = 1536  # of stop and object: all those of ten objects and the aligned stops in reach


class Refined:
    """Proposes structure, then moves the stops; with a time budget goes on around the best plan so far.

    Structure (which stops, which objects at which, in which order) is exact over the proposed stops for few objects,
    and searched for many. Proposed are all aligned stops, later joined by stops around the best plan's.
    """

    def __init__(self, setup: PlannerSetup, options: RefinedOptions = RefinedOptions()):
        """Prepares the aligned stops."""
        self._setup, self._budget_s, self._refinement = setup, options.budget_s, options.refinement
        self._sizes = Sizes(EXACT_OBJECTS)
        self._compiled: set[tuple[int, int]] = set()  # slots and served objects that a budget was spent on before
        self._stops = setup.aligned_stops(options.aligned)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`."""
        begin = time.perf_counter()
        plans = self.improving_plans(scene, key)
        plan = next(plans)
        took, shape = time.perf_counter() - begin, (len(scene.mask), int(np.sum(plan.served)))
        if self._budget_s and shape not in self._compiled:
            plan = next(plans)  # compiles what further rounds need, which by itself may take longer than the budget
            self._compiled.add(shape)
            took = 0.0  # what compiled says nothing of the next round
        # Another round is begun if it ends in time, should it take as long as the last one.
        while (start := time.perf_counter()) + took < begin + self._budget_s:
            plan = next(plans)
            took = time.perf_counter() - start
        return plan

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """See `PreparedPlanner`."""
        robot, world, key = self._setup.robot, self._setup.world, jax.random.key(0)
        plan, poses = no_plan(scene), self._stops.poses
        route: Any = Route(plan.base_pose, plan.object_index, plan.object_index)
        how = {"config": self._refinement, "world": world}
        return [
            partial(_refine.prepare, robot, scene, route, key, self._setup.drives, self._setup.chance, **how),
            partial(check_candidates.prepare, robot, scene, poses, world=world, pairs_at_once=PAIRS_AT_ONCE),
            partial(compiled_execute.prepare, robot, scene, plan, self._setup.docked, config=world),
        ]

    def improving_plans(self, scene: Scene, key: Array) -> Iterator[Plan]:
        """Endless plans, none worse than the one before by the judge's costs."""
        aligned, between = self._check(scene, self._stops), self._stops.known
        if not bool(jnp.all(jnp.any(aligned.serves, axis=0) | ~scene.mask)):
            # What the aligned stops can't serve, some pose of the grid may.
            aligned = join(aligned, self._check(scene, self._setup.grid_stops, GRID_PAIRS_AT_ONCE))
            between = None
        best, value, pool = None, (-1, 0.0, 0.0), aligned
        for attempt in itertools.count():
            search_key, refine_key, pool_key = jax.random.split(jax.random.fold_in(key, attempt), 3)
            start = self._propose(scene, pool, search_key, between)
            for plan in (start, self.improve(scene, start, refine_key)):
                worth = self._worth(scene, plan)
                if worth > value:
                    best, value = plan, worth
            assert best is not None  # every plan is worth more than none
            yield best
            if not np.any(best.served):
                continue
            scale = jnp.array(self._refinement.first_scale)
            around = alternatives(as_route(best).stops, pool_key, scale, self._refinement)
            nearby = prepare_world(self._setup.robot, self._setup.drives, around.reshape(-1, 3), all_pairs=False)
            pool, between = join(aligned, self._check(scene, nearby)), None

    def _propose(self, scene: Scene, pool: Candidates, key: Array, between: Array | None) -> Plan:
        """The best plan on a pool of stops, or for many objects a very good one; with their drives, if known."""
        problem = stop_problem(self._setup.robot, self._setup.drives, scene, pool, self._sizes, between=between)
        if not len(problem.slots):
            return problem.plan_nothing(scene)
        if len(problem.slots) <= EXACT_OBJECTS:
            return problem.plan(scene, *problem.best_steps())
        clutter, start = problem.problem.clutter, None
        if clutter is not None:  # the search's neighbours don't see what is in the way: it begins where all is had
            start = np.asarray(_greedy_route(problem.problem, _WORTH))[:MAX_STOPS]
        found = search_stops(*problem.costs, key, iterations=SEARCH_ITERATIONS, start=start, clutter=clutter)
        return problem.plan(scene, *plan_steps(found))

    def _check(self, scene: Scene, stops: PreparedWorld, at_once: int = PAIRS_AT_ONCE) -> Candidates:
        setup = self._setup
        candidates = check_candidates(setup.robot, scene, stops.poses, world=setup.world, pairs_at_once=at_once)
        if setup.docked is not None:
            first_drive = compiled_first_drives(setup.robot, stops, scene.robot_start)
            candidates = only_reachable(candidates, first_drive)
        if setup.chance is None:
            return candidates
        return reliable(setup.robot, scene, candidates, setup.chance, world=setup.world, fine=False)

    def improve(self, scene: Scene, plan: Plan, key: Array) -> Plan:
        """A plan with its stops moved and every object given to its best one, if that is no worse; but for rounding.

        Drives break the triangle inequality: a stop that is left without objects may have been on the shorter way.

        Args:
            scene: unbatched.
            plan: all of whose served steps are feasible.
            key: consumed.
        """
        if not np.any(plan.served):
            return plan
        setup, config = self._setup, self._refinement
        begin = (setup.robot, scene, as_route(plan), key, setup.drives, setup.chance)
        routes = _refine(*begin, config=config, world=setup.world)
        moved, given = (as_plan(scene, route, reason_by_slot(plan)) for route in routes)
        before, after = (np.asarray(route.stop_of) for route in routes)
        unsure = len(np.setdiff1d(before, after)) > 0 or Rules.of(setup.world.pick, scene.room).object_in_the_way
        return max(given, moved, key=lambda each: self._worth(scene, each)) if unsure else given

    def _worth(self, scene: Scene, plan: Plan) -> tuple[int, float, float]:
        """What a plan is worth to the judge: objects grasped, then by how much picks miss reliability, then time."""
        setup = self._setup
        outcome = jax.device_get(compiled_execute(setup.robot, scene, plan, setup.docked, config=setup.world))
        missing = 0.0
        if setup.chance is not None:
            missing = shortfall(setup.robot, scene, plan, outcome, setup.chance, setup.world.pick)
        return int(outcome.grasped), -missing, -float(outcome.execution)


@partial(Stored, static=("config", "world"))
def _refine(
    robot: Robot,
    scene: Scene,
    route: Route,
    key: Array,
    drives: Drives,
    chance: Chance | None,
    *,
    config: RefinementConfig,
    world: WorldConfig,
) -> tuple[Route, Route]:
    """The route with its stops moved, and that one with every object given to its best stop."""
    route, _ = refine(robot, scene, route, key, drives, config.rounds, config, world, chance)
    return route, reassign(robot, scene, route, world, chance)
