"""Learning of the stop policy: imitation of searched plans, then REINFORCE on total time.

The search over stops serves any number of objects, and in a few milliseconds comes within some thousandths of exact
planning.

In REINFORCE several episodes are sampled for every problem, and the mean of their costs is the baseline (Kool, van Hoof
and Welling, "Buy 4 REINFORCE samples, get a baseline for free!", 2019): no second network, no rollout beside them.
"""

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Float, Int

from basenet_jax import struct
from basenet_jax.config import AlignedConfig, WorldConfig
from basenet_jax.devices import ONE_DEVICE, Devices
from basenet_jax.learning.config import StopLearningConfig
from basenet_jax.learning.stop_problems import (
    Draw,
    Library,
    draw_problem,
    half_turn_of,
    make_library,
    problem_of,
    turned_draw,
)
from basenet_jax.planners.aligned_stops import aligned_poses
from basenet_jax.planners.stop_search import MAX_STOPS, search_stops
from basenet_jax.policies.stop_policy import BATCH_AXES, StopPolicy, StopScene
from basenet_jax.policies.stop_rollout import END, choices_gradient, choose_best, choose_randomly, plans_of, play, start
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import make_drives
from basenet_jax.task.prepared_world import prepare_world
from basenet_jax.task.stop_problem import StopProblem
from basenet_jax.world.boxes import Room

Metrics = dict[str, Array]


@struct.dataclass
class StopLearningState:
    """Everything that training needs to go on."""

    params: Any
    optimizer: Any
    library: Library
    examples: Draw  # E problems, and
    answers: Int[Array, "E N"]  # their best sequences of stops, then -1
    rule_time: Array  # s, of the rule that the policy starts as, in `evaluate`
    key: Array
    update: Array


def stop_network(config: StopLearningConfig) -> StopPolicy:
    """The network of a configuration."""
    return StopPolicy(features=config.features, layers=config.layers)


class StopLearning:
    """The learner: `init` makes a state, `interval` trains on and evaluates."""

    def __init__(
        self,
        robot: Robot,
        config: StopLearningConfig = StopLearningConfig(),
        world: WorldConfig = WorldConfig(),
        aligned: AlignedConfig = AlignedConfig(),
        devices: Devices = ONE_DEVICE,
    ):
        """Prepares the stops, the network and its optimiser.

        Raises:
            ValueError: the batches can't be shared out to the devices.
        """
        self.robot, self.config, self.world, self.devices = robot, config, world, devices
        devices.check(config.batches)
        self.room = Room.from_config(world.table)
        poses = aligned_poses(robot, self.room, aligned, world.pick)
        self.half_turn = half_turn_of(poses)
        self.prepared = prepare_world(robot, make_drives(robot, self.room, world.navigation), poses)
        self.policy = stop_network(config)
        updates = config.updates_per_interval * config.intervals
        schedule = optax.cosine_decay_schedule(config.learning_rate, updates, config.final_learning_rate_share)
        self.optimizer = optax.chain(optax.clip_by_global_norm(config.largest_gradient), optax.adam(schedule))

    def init(self, key: Array) -> StopLearningState:
        """The first state, with its library and its examples.

        Args:
            key: consumed.
        """
        config = self.config
        library_key, network_key, example_key, search_key, key = jax.random.split(key, 5)
        library = make_library(
            self.robot,
            self.room,
            self.prepared,
            self.half_turn,
            library_key,
            config.library_objects,
            config.own_class_share,
            self.world,
        )
        examples = draw_many(example_key, library, config.examples, config.objects)
        scene = problem_of(self.prepared, library, jax.tree.map(lambda x: x[0], examples))
        params = self.policy.init(network_key, scene, start(scene))
        state = StopLearningState(
            params=params,
            optimizer=self.optimizer.init(params),
            library=library,
            examples=examples,
            answers=self._search(library, examples, search_key),
            rule_time=self._greedy_time(params, library),
            key=key,
            update=jnp.zeros((), jnp.int32),
        )
        return self.devices.everywhere(state)

    def interval(self, state: StopLearningState) -> tuple[StopLearningState, Metrics]:
        """Some updates, and the greedy policy's evaluation.

        Args:
            state: may be donated.
        """
        imitates = state.update < self.config.imitation_intervals * self.config.updates_per_interval

        def train(gradient_of: Any) -> Any:
            return lambda state: jax.lax.scan(
                lambda state, _: self._update(state, gradient_of), state, length=self.config.updates_per_interval
            )

        state, training = jax.lax.cond(imitates, train(self.imitation), train(self.reinforcement), state)
        metrics = {name: jnp.mean(values) for name, values in training.items()}
        return self.devices.everywhere((state, metrics | self.evaluate(state) | {"imitates": imitates}))

    def evaluate(self, state: StopLearningState) -> Metrics:
        """Execution time (s) of greedy rollouts on fixed problems with all objects, beside the rule's."""
        time = self._greedy_time(state.params, state.library)
        return {"execution_time": time, "ratio_to_rule": time / state.rule_time}

    def imitation(self, state: StopLearningState, key: Array) -> tuple[Any, Metrics]:
        """Gradient of the cross entropy of searched plans' stops."""
        config = self.config
        choice_key, turn_key = jax.random.split(key)
        chosen = jax.random.randint(choice_key, (config.imitations_per_update,), 0, config.examples)
        draws, answers = jax.tree.map(lambda x: x[chosen], (state.examples, state.answers))
        other = (
            turned_draw(draws, state.library),
            jnp.where(answers == END, END, jnp.asarray(self.half_turn)[answers]),
        )
        turns = jax.random.bernoulli(turn_key, shape=chosen.shape)
        draws, answers = jax.tree.map(
            lambda a, b: jnp.where(turns.reshape(-1, *(1,) * (a.ndim - 1)), a, b), other, (draws, answers)
        )
        draws, answers = self.devices.split((draws, answers))
        problems = problem_of(self.prepared, state.library, draws)
        gradient, loss, entropy = self.gradient(state.params, problems, answers, jnp.ones(len(chosen)))
        return gradient, {"loss": loss, "entropy": entropy}

    def reinforcement(self, state: StopLearningState, key: Array) -> tuple[Any, Metrics]:
        """Gradient of the expected time, by sampled episodes."""
        config = self.config
        draw_key, play_key = jax.random.split(key)
        draws = self.devices.split(draw_many(draw_key, state.library, config.problems_per_update, config.objects))
        repeated = jax.tree.map(lambda x: jnp.repeat(x, config.samples, axis=0), draws)
        problems = problem_of(self.prepared, state.library, repeated)
        visited = play(self.policy, state.params, problems, choose_randomly(play_key))
        advantage = advantages(plans_of(problems.problem, visited).cost, config.samples)
        gradient, loss, entropy = self.gradient(state.params, problems, visited, -advantage)
        return gradient, {"loss": loss, "entropy": entropy}

    def gradient(
        self, params: Any, problems: StopScene, visited: Int[Array, "B M"], weight: Float[Array, " B"]
    ) -> tuple[Any, Float[Array, ""], Float[Array, ""]]:
        """See `choices_gradient`."""
        own = self.devices.apart(partial(choices_gradient, self.policy), in_axes=(None, BATCH_AXES, 0, 0), mean=True)
        return own(params, problems, visited, weight)

    def _update(self, state: StopLearningState, gradient_of: Any) -> tuple[StopLearningState, Metrics]:
        own_key, key = jax.random.split(state.key)
        gradient, metrics = gradient_of(state, own_key)
        change, optimizer = self.optimizer.update(gradient, state.optimizer, state.params)
        params = optax.apply_updates(state.params, change)
        metrics |= {"gradient_norm": optax.tree.norm(gradient)}
        state = dataclasses.replace(state, params=params, optimizer=optimizer, key=key, update=state.update + 1)
        return state, metrics

    def _search(self, library: Library, draws: Draw, key: Array) -> Int[Array, "E N"]:
        """The stops of the best plans that are found, in order, then -1."""

        def search_all(library: Library, draws: Draw, keys: Array) -> Array:
            def search(drawn: tuple[Draw, Array]) -> Array:
                draw, key = drawn
                problem = problem_of(self.prepared, library, draw).problem
                return searched_stops(problem, key, self.config.search_iterations).astype(jnp.int32)

            return jax.lax.map(search, (draws, keys))

        keys = jax.random.split(key, len(draws.start))
        return self.devices.apart(search_all, in_axes=(None, 0, 0))(library, draws, keys)

    def _greedy_time(self, params: Any, library: Library) -> Array:
        config = self.config
        keys = jax.random.split(jax.random.key(config.evaluation_seed), config.evaluation_problems)
        draws = jax.vmap(lambda key: draw_problem(key, library, config.objects, config.objects))(keys)
        problems = problem_of(self.prepared, library, self.devices.split(draws))
        visited = play(self.policy, params, problems, choose_best)
        return jnp.mean(plans_of(problems.problem, visited).cost)


def draw_many(key: Array, library: Library, problems: int, slots: int) -> Draw:
    """A batch of problems of 1 to `slots` objects; the key is consumed."""
    count_key, draw_key = jax.random.split(key)
    counts = jax.random.randint(count_key, (problems,), 1, slots + 1)
    keys = jax.random.split(draw_key, problems)
    return jax.vmap(lambda key, count: draw_problem(key, library, count, slots))(keys, counts)


def searched_stops(problem: StopProblem, key: Array, iterations: int) -> Int[Array, " M"]:
    """The stops of a very good plan, in order, then -1.

    Args:
        problem: unbatched.
        key: consumed.
        iterations: of the search.
    """
    slots = len(problem.mask)
    pick_time = jnp.where(problem.mask, problem.pick_time, jnp.inf)
    found = search_stops(pick_time, problem.first_drive, problem.drive, key, iterations=iterations)
    return jnp.pad(found.stops, (0, max(0, slots - MAX_STOPS)), constant_values=END)[:slots]


def advantages(cost: Float[Array, " B"], samples: int) -> Float[Array, " B"]:
    """Cost (s) beyond the mean of the other episodes of the same problem, which stand in a row."""
    cost = cost.reshape(-1, samples)
    beyond = (cost - jnp.mean(cost, axis=1, keepdims=True)) * (samples / (samples - 1))
    return beyond.ravel()
