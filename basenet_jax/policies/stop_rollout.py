"""Episodes of the stop policy, what they cost, and the gradient of the choices made in them."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from basenet_jax.policies.stop_policy import BATCH_AXES, StopPolicy, StopScene, StopState
from basenet_jax.task.pick_order import order_picks
from basenet_jax.task.stop_problem import BATCH_AXES as PROBLEM_AXES
from basenet_jax.task.stop_problem import StopProblem

END = -1  # the choice to end, and padding of a sequence of stops


class StopPlan(NamedTuple):
    """The plan that a sequence of stops amounts to."""

    stops: Int[Array, "*batch M"]  # as visited; -1: padding, or a stop passed by because others pick its objects faster
    picked_at: Int[Array, "*batch M"]  # by slot: which visit, 0 to M - 1; -1: none
    cost: Float[Array, "*batch"]  # s, of all drives and picks
    turn: Int[Array, "*batch M"]  # by slot: which of the objects of one visit come first


def start(scene: StopScene) -> StopState:
    """Before the first drive."""
    problem = scene.problem
    best = jnp.full(problem.mask.shape, jnp.inf, problem.pick_time.dtype)
    return StopState(scene.robot_start, problem.first_drive, best, jnp.zeros(best.shape[:-1], best.dtype))


def now(scene: StopScene, state: StopState) -> StopScene:
    """The scene as it stands: an object is served only where nothing that is left is in the way."""
    problem = scene.problem
    if problem.clutter is None:
        return scene
    pick_time = problem.times_among(problem.mask & ~jnp.isfinite(state.best))
    return dataclasses.replace(scene, problem=dataclasses.replace(problem, pick_time=pick_time))


def visit(problem: StopProblem, state: StopState, stop: Int[Array, "*batch"]) -> StopState:
    """After driving to a stop; the same state for `END`.

    Args:
        problem: as it stands, see `now`.
        state: before.
        stop: where to.
    """
    goes, stop = stop != END, jnp.maximum(stop, 0)
    here = jnp.take_along_axis(problem.pick_time, stop[..., None, None], axis=-2)[..., 0, :]
    served = problem.mask & ~jnp.isfinite(state.best) & jnp.isfinite(here)
    after = StopState(
        robot_pose=problem.poses[stop],
        drive=problem.drive[stop],
        best=jnp.where(problem.mask, jnp.minimum(state.best, here), jnp.inf),
        # One visit is gone, and no visit need be kept for what is served now.
        spare=state.spare - 1 + jnp.sum(served, axis=-1),
    )
    return jax.tree.map(
        lambda new, old: jnp.where(goes.reshape(goes.shape + (1,) * (new.ndim - goes.ndim)), new, old), after, state
    )


# (logits of the stops, logit of END, number of the step) -> stop or END
Choose = Callable[[Array, Array, Array], Array]


def choose_best(stops: Array, end: Array, step: Array) -> Array:
    """The most probable choice."""
    del step
    return jnp.where(jnp.max(stops, axis=-1) > end, jnp.argmax(stops, axis=-1), END)


def choose_randomly(key: Array) -> Choose:
    """A choice drawn from the distribution; the key is consumed, one part for each step."""

    def choose(stops: Array, end: Array, step: Array) -> Array:
        logits = jnp.concatenate([stops, end[..., None]], axis=-1)
        choice = jax.random.categorical(jax.random.fold_in(key, step), logits, axis=-1)
        return jnp.where(choice < stops.shape[-1], choice, END)

    return choose


def play(policy: StopPolicy, params: Any, scene: StopScene, choose: Choose) -> Int[Array, "*batch M"]:
    """The stops visited, then `END`; it goes on until all episodes of the batch have ended."""
    problem = scene.problem
    slots = problem.mask.shape[-1]

    def goes_on(carry: tuple[Array, StopState, Array, Array]) -> Array:
        step, _, _, going = carry
        return (step < slots) & jnp.any(going)

    def advance(carry: tuple[Array, StopState, Array, Array]) -> tuple[Array, StopState, Array, Array]:
        step, state, visited, going = carry
        as_it_stands = now(scene, state)
        logits: Any = policy.apply(params, as_it_stands, state)
        stop = jnp.where(going, choose(logits[0], logits[1], step), END)
        visited = jax.lax.dynamic_update_index_in_dim(visited, stop.astype(visited.dtype), step, axis=-1)
        return step + 1, visit(as_it_stands.problem, state, stop), visited, going & (stop != END)

    visited = jnp.full(problem.mask.shape, END, jnp.int32)
    nothing = (jnp.array(0), start(scene), visited, jnp.any(problem.mask, axis=-1))
    return jax.lax.while_loop(goes_on, advance, nothing)[2]


def plan_of(problem: StopProblem, visited: Int[Array, " M"]) -> StopPlan:
    """The plan of one sequence of stops: each object at the visit that picks it fastest, idle visits left out.

    Where objects are in each other's way, see `order_picks`.

    Args:
        problem: unbatched.
        visited: stops in order, then -1.

    Returns:
        The plan; its cost is infinite if an object is not served or a stop can't be reached.
    """
    if problem.clutter is None:
        at = jnp.where((visited != END)[:, None], problem.pick_time[jnp.maximum(visited, 0)], jnp.inf)
        picked_at = jnp.where(problem.mask & jnp.any(jnp.isfinite(at), axis=0), jnp.argmin(at, axis=0), -1)
        turn, time = jnp.zeros_like(picked_at), jnp.min(at, axis=0)
    else:
        picked_at, turn, time = order_picks(problem.clutter, problem.mask, visited)
    used = jnp.any(picked_at == jnp.arange(len(visited))[:, None], axis=1)
    stops = jnp.where(used, visited, END)

    def drive(before: Array, stop: Array) -> tuple[Array, Array]:
        leg = jnp.where(before == END, problem.first_drive[stop], problem.drive[before, stop])
        return jnp.where(stop == END, before, stop), jnp.where(stop == END, 0.0, leg)

    _, legs = jax.lax.scan(drive, jnp.array(END, stops.dtype), stops)
    return StopPlan(stops, picked_at, jnp.sum(legs) + jnp.sum(jnp.where(problem.mask, time, 0.0)), turn)


plans_of = jax.vmap(plan_of, in_axes=(PROBLEM_AXES, 0))  # of a batch


def repeated(scene: StopScene, count: int) -> StopScene:
    """A batch of one scene so many times."""
    return jax.vmap(lambda _: scene, out_axes=BATCH_AXES)(jnp.arange(count))


def sample(policy: StopPolicy, params: Any, scene: StopScene, key: Array, samples: int) -> Int[Array, "S M"]:
    """The stops of the greedy rollout, then of some sampled ones, for one scene.

    Args:
        policy: the network.
        params: its parameters.
        scene: unbatched.
        key: consumed.
        samples: how many are played in parallel beside the greedy one; one less than S.
    """

    def choose(stops: Array, end: Array, step: Array) -> Array:
        drawn = choose_randomly(key)(stops, end, step)
        return drawn.at[0].set(choose_best(stops, end, step)[0])

    return play(policy, params, repeated(scene, samples + 1), choose)


def cheapest(problem: StopProblem, visited: Int[Array, "S M"]) -> StopPlan:
    """The cheapest of one scene's sequences of stops, as a plan."""
    plans = jax.vmap(plan_of, in_axes=(None, 0))(problem, visited)
    return jax.tree.map(lambda x: x[jnp.argmin(plans.cost)], plans)


def choices_gradient(
    policy: StopPolicy,
    params: Any,
    scenes: StopScene,
    visited: Int[Array, "B M"],
    weight: Float[Array, " B"],
) -> tuple[Any, Float[Array, ""], Float[Array, ""]]:
    """Gradient of the mean over the batch of `weight · -log probability` of the sequences, that mean, and of entropies.

    With weight 1 this is imitation, with the advantage over a baseline REINFORCE (descending raises what the weight is
    positive for). Summed step by step, so that memory holds the activations of one step only. A choice that isn't
    allowed counts nothing: an exact plan may stop somewhere only because the way over it is shorter.

    Args:
        policy: the network.
        params: its parameters.
        scenes: a batch.
        visited: stops in order, then -1: the first of these is the choice to end.
        weight: of the sequences.

    Returns:
        Gradient; loss; the choices' entropy in nats per sequence.
    """

    def accumulate(carry: tuple) -> tuple:
        step, state, counts, gradient, sums = carry
        stop = jax.lax.dynamic_index_in_dim(visited, step, axis=-1, keepdims=False)
        as_it_stands = now(scenes, state)
        (value, entropy), own = jax.value_and_grad(_surprise, argnums=1, has_aux=True)(
            policy, params, as_it_stands, state, stop, jnp.where(counts, weight, 0.0), counts
        )
        sums += jnp.stack([value, entropy / len(visited)])
        after = visit(as_it_stands.problem, state, stop)
        return step + 1, after, counts & (stop != END), jax.tree.map(jnp.add, gradient, own), sums

    counts: Bool[Array, " B"] = jnp.any(scenes.problem.mask, axis=-1)
    nothing = (jnp.array(0), start(scenes), counts, jax.tree.map(jnp.zeros_like, params), jnp.zeros(2))
    done = jax.lax.while_loop(lambda c: (c[0] < visited.shape[-1]) & jnp.any(c[2]), accumulate, nothing)
    return done[3], *done[4]


def _surprise(
    policy: StopPolicy,
    params: Any,
    scene: StopScene,
    state: StopState,
    stop: Int[Array, " B"],
    weight: Float[Array, " B"],
    counts: Bool[Array, " B"],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Mean of the weighted -log probability of one choice, and the sum of the entropies."""
    logits: Any = policy.apply(params, scene, state)
    logs = jax.nn.log_softmax(jnp.where(counts[:, None], jnp.concatenate([logits[0], logits[1][:, None]], -1), 0.0))
    chosen = jnp.take_along_axis(logs, jnp.where(stop == END, logs.shape[-1] - 1, stop)[:, None], axis=-1)[:, 0]
    entropy = -jnp.sum(jnp.exp(logs) * jnp.where(jnp.isfinite(logs), logs, 0.0), axis=-1)
    return -jnp.mean(jnp.where(jnp.isfinite(chosen), weight * chosen, 0.0)), jnp.sum(entropy * counts)
