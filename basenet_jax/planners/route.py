"""Plans seen as routes: stops, and which objects are picked at each."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from basenet_jax.planners.protocol import assemble_plan
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene


class Route(NamedTuple):
    """Where the base stops, and from which stop each object is picked."""

    stops: Float[Array, "M 3"]  # (x, y, heading) in W, in order; those after the last used one don't matter
    stop_of: Int[Array, " M"]  # by slot; -1: not picked
    turn: Int[Array, " M"]  # by slot: the lower come first of those that are picked at one stop


def as_route(plan: Plan) -> Route:
    """The route of a plan with at least one served step: steps from one pose in a row are one stop."""
    served, slot, pose = (np.asarray(leaf) for leaf in (plan.served, plan.object_index, plan.base_pose))
    count = int(served.sum())  # served steps come first
    arrives = np.ones(count, bool)
    arrives[1:] = np.any(pose[1:count] != pose[: count - 1], axis=-1)
    stop = np.cumsum(arrives) - 1
    stops = np.resize(pose[:count][arrives], pose.shape)
    stops[stop[-1] + 1 :] = stops[stop[-1]]
    stop_of = np.full(len(slot), -1)
    stop_of[slot[:count]] = stop
    turn = np.zeros(len(slot), stop_of.dtype)
    turn[slot[:count]] = np.arange(count)
    return Route(jnp.asarray(stops), jnp.asarray(stop_of), jnp.asarray(turn))


def as_plan(scene: Scene, route: Route, reason: Int[np.ndarray, " M"]) -> Plan:
    """The plan of a route; objects that are not on it come last.

    Args:
        scene: unbatched.
        route: its stops without objects are passed by.
        reason: by slot, why an object is not on the route.
    """
    stops, stop_of, turn = (np.asarray(leaf) for leaf in route)
    order = np.lexsort((turn, stop_of))
    order = order[stop_of[order] >= 0]
    return assemble_plan(scene, order, stops[stop_of[order]], reason)


def reason_by_slot(plan: Plan) -> Int[np.ndarray, " M"]:
    """A plan's reasons in the order of slots."""
    slot, reason = np.asarray(plan.object_index), np.asarray(plan.reason)
    result = np.zeros_like(reason)
    result[slot[slot >= 0]] = reason[slot >= 0]
    return result
