"""The stop policy: where to park next, among candidate stops with known pick times, or that it is enough.

A stop may serve several objects, and an object may be reached again from a better stop later, so the state is not which
objects are left but the least pick time of each among the stops visited so far (infinite: not served yet). The network
starts as a rule, the one of greedy stops extended to such states, and learns what to add to its scores.
"""

from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import struct
from basenet_jax.policies.graph_attention import FirstLayer, Layer, dense
from basenet_jax.policies.grasp_sequence import object_features, robot_features
from basenet_jax.task.stop_problem import BATCH_AXES as PROBLEM_AXES
from basenet_jax.task.stop_problem import StopProblem

_SECONDS = 0.25  # brings times to the order of one
_USUAL = 10.0  # s, a pick time
_BASES = 5


@struct.dataclass
class StopScene:
    """A problem with where things are, which the network reads and planners of sequences don't ask."""

    problem: StopProblem
    access: Float[Array, "*batch K M"]  # see `access_time`
    robot_start: Float[Array, "*batch 3"]  # in W
    grasps: Float[Array, "*batch M 4"]  # tool0's x, y, z, yaw in W


_EACH: Any = 0
BATCH_AXES = StopScene(problem=PROBLEM_AXES, access=_EACH, robot_start=_EACH, grasps=_EACH)  # of a batch, for `vmap`


class StopState(NamedTuple):
    """Where an episode stands; batches along leading axes."""

    robot_pose: Float[Array, "*batch 3"]
    drive: Float[Array, "*batch K"]  # s, from there to all stops
    best: Float[Array, "*batch M"]  # s, least pick time among the stops visited; infinite: not served yet
    spare: Float[Array, "*batch"]  # stops that may be visited beside one for each object not served


def access_time(drive: Float[Array, "K K"], pick_time: Float[Array, "K M"]) -> Float[Array, "K M"]:
    """Least time (s) from each stop to have each object picked, beyond its least pick time: a drive and slower picking.

    Infinite for objects that no stop serves.
    """
    least = jnp.min(pick_time, axis=0)
    excess = jnp.where(jnp.isfinite(pick_time), pick_time - least, jnp.inf)
    return jax.lax.map(lambda column: jnp.min(drive + column, axis=1), excess.T).T


def make_scene(
    problem: StopProblem, robot_start: Float[Array, "*batch 3"], grasps: Float[Array, "*batch M 4"]
) -> StopScene:
    """A problem, or a batch, as the policy sees it."""
    access = jnp.vectorize(access_time, signature="(k,k),(k,m)->(k,m)")(problem.drive, problem.pick_time)
    return StopScene(problem, access, robot_start, grasps)


class StopPolicy(nn.Module):
    """Graph attention over the objects, a sum over what each stop has to offer, and an MLP of two layers."""

    features: int = 48
    layers: int = 2
    considered: int = 64  # only so many stops, the best by the rule, are looked at: most others are hopeless

    @nn.compact
    def __call__(self, scene: StopScene, state: StopState) -> tuple[Float[Array, "*batch K"], Float[Array, "*batch"]]:
        """Logits of a categorical distribution over the stops and, apart, of the choice to end.

        Minus infinity: not allowed. Always allowed is a stop that serves another object or, if there is none, to end.
        """
        problem = scene.problem
        everywhere = _Views(scene, state, problem.pick_time, scene.access, state.drive)
        allowed, may_end = _allowed(everywhere, state)
        rule = jnp.where(allowed, RulePrior(name="rule")(everywhere), -jnp.inf)
        prior, stops = jax.lax.top_k(rule, min(self.considered, rule.shape[-1]))
        views = _Views(
            scene,
            state,
            jnp.take_along_axis(problem.pick_time, stops[..., None], axis=-2),
            jnp.take_along_axis(scene.access, stops[..., None], axis=-2),
            jnp.take_along_axis(state.drive, stops, axis=-1),
            least=everywhere.least,
        )
        nodes = everywhere.node_features()
        nodes = FirstLayer(self.features)(nodes, robot_features(state.robot_pose), problem.mask)
        for _ in range(self.layers - 1):
            nodes = Layer(self.features)(nodes, problem.mask)
        nodes = jnp.where(problem.mask[..., None], nodes, 0.0)
        context = dense(self.features, "context")(jnp.sum(nodes, axis=-2))
        hidden = self._offers(nodes, views) + context[..., None, :]
        hidden = hidden + dense(self.features, "stop")(_stop_features(problem.poses[stops], views))
        hidden = nn.relu(dense(self.features)(nn.relu(hidden)))
        score = nn.Dense(1, kernel_init=nn.initializers.zeros, name="score")(hidden)[..., 0]
        end = nn.Dense(1, kernel_init=nn.initializers.zeros, name="end")(nn.relu(context))[..., 0]
        logits = jnp.put_along_axis(jnp.full_like(rule, -jnp.inf), stops, prior + score, axis=-1, inplace=False)
        return logits, jnp.where(may_end, end, -jnp.inf)

    def _offers(self, nodes: Array, views: "_Views") -> Float[Array, "*batch K features"]:
        """Sums over the objects of linear maps of their embeddings, each weighted by what the stop means for it.

        As one matrix product this costs far less than a network for every pair of stop and object.
        """
        maps = dense(_BASES * self.features, "offers", use_bias=False)(nodes)
        maps = maps.reshape(*maps.shape[:-2], -1, self.features)  # object and basis in one axis
        bases = views.bases()
        return bases.reshape(*bases.shape[:-2], -1) @ maps


class RulePrior(nn.Module):
    """Least drive - worth of what is served + weight of the object farthest from the stop, by a temperature.

    The worth of an object not served yet is a constant less its excess pick time; of another, the pick time saved.
    """

    worth: float = 4.0  # s
    farthest: float = 1.0
    sharpness: float = 1.5  # 1/s

    @nn.compact
    def __call__(self, views: "_Views") -> Float[Array, "*batch K"]:
        """Logits of the stops; to end has zero."""
        worth, farthest, sharpness = (
            self.param(name, nn.initializers.constant(value), ())
            for name, value in (("worth", self.worth), ("farthest", self.farthest), ("sharpness", self.sharpness))
        )
        served = jnp.where(views.first, worth - views.excess, 0.0) + views.saved
        cost = views.drive - jnp.sum(served, axis=-1) + farthest * views.farthest
        return -sharpness * cost


class _Views:
    """What a state means for every pair of stop and object; no number is infinite. Times in s."""

    def __init__(
        self,
        scene: StopScene,
        state: StopState,
        pick: Float[Array, "*batch K M"],
        access: Float[Array, "*batch K M"],
        drive: Float[Array, "*batch K"],
        least: Float[Array, "*batch M"] | None = None,
    ):
        """Of some stops, with what concerns them; `least`, each object's least pick time, is over these by default."""
        best, mask = state.best[..., None, :], scene.problem.mask[..., None, :]
        serves, waiting = jnp.isfinite(pick) & mask, mask & ~jnp.isfinite(best)
        self.scene = scene
        self.least = _least(jnp.where(mask, pick, 0.0)) if least is None else least
        self.drive = _finite(drive)
        self.waiting = waiting[..., 0, :]  # objects not served yet
        self.improvable = jnp.where(mask & ~waiting, _finite(best) - self.least[..., None, :], 0.0)[..., 0, :]
        self.stops = jnp.sum(serves, axis=-2)  # that serve the object
        self.first = serves & waiting
        self.excess = jnp.where(serves, pick - self.least[..., None, :], 0.0)
        self.saved = jnp.where(serves & ~waiting, jnp.maximum(_finite(best) - _finite(pick), 0.0), 0.0)
        self.access = jnp.where(waiting, _finite(access), 0.0)
        self.farthest = jnp.max(self.access, axis=-1)

    def node_features(self) -> Float[Array, "*batch M inputs"]:
        """The grasp, and how the object stands."""
        extra = [self.waiting, _SECONDS * self.improvable, _SECONDS * (self.least - _USUAL), 0.01 * self.stops]
        grasps = jnp.where(self.scene.problem.mask[..., None], self.scene.grasps, 0.0)
        return jnp.concatenate([object_features(grasps), jnp.stack(extra, axis=-1)], axis=-1)

    def bases(self) -> Float[Array, "*batch K M bases"]:
        """What a stop means for an object, in a few numbers."""
        first = self.first.astype(self.excess.dtype)
        parts = [first, first * jnp.exp(-self.excess), first * _SECONDS * self.excess]
        return jnp.stack([*parts, _SECONDS * self.saved, _SECONDS * self.access], axis=-1)


def _least(pick: Float[Array, "*batch K M"]) -> Float[Array, "*batch M"]:
    """Least pick times; a usual one for objects that nothing can serve yet, since other objects are in the way."""
    least = jnp.min(pick, axis=-2)
    return jnp.where(jnp.isfinite(least), least, _USUAL)


def _stop_features(poses: Float[Array, "*batch C 3"], views: _Views) -> Float[Array, "*batch C inputs"]:
    times = [views.drive, views.farthest, jnp.sum(views.access, -1) * 0.2, jnp.sum(views.saved, -1)]
    times += [jnp.sum(jnp.where(views.first, views.excess, 0.0), -1)]
    left = jnp.sum(views.waiting, axis=-1, keepdims=True) - jnp.sum(views.first, axis=-1)
    scaled = [_SECONDS * time for time in times] + [0.3 * jnp.sum(views.first, -1), 0.3 * left, left == 0]
    return jnp.concatenate([jnp.stack(scaled, axis=-1), robot_features(poses)], axis=-1)


def _allowed(views: _Views, state: StopState) -> tuple[Bool[Array, "*batch K"], Bool[Array, "*batch"]]:
    """Stops that serve another object, or save time while there is a visit to spare; and whether to end is allowed."""
    reachable = jnp.isfinite(state.drive)
    first = jnp.any(views.first, axis=-1) & reachable
    saves = jnp.any(views.saved > 0, axis=-1) & reachable & (state.spare > 0)[..., None]
    return first | saves, ~jnp.any(first, axis=-1)


def _finite(time: Array) -> Array:
    """The time, or 0 where it is infinite: such entries are masked, and gradients must not see them."""
    return jnp.where(jnp.isfinite(time), time, 0.0)
