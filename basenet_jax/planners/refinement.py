"""Continuous refinement of a route's stops in SE(2), by the judge's own costs.

Order and assignment stay; stops move. Every round draws alternatives of every stop around where it stands and finds,
by dynamic programming along the route, the best combination of all of them: exact among the drawn, and never worse
than before, since where the stops stand is among the alternatives. A round is a few hundred picks.

The slope of a trapezoidal profile is infinite at 0: turning by a degree costs a quarter of a second. So stops that are
in line must move in line. Of the alternatives some slide a stop along its heading; some move it freely; and some are
the same rigid motion for all stops, so that a whole line can shift or turn.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from basenet_jax.config import RefinementConfig, WorldConfig
from basenet_jax.planners.candidates import check_candidates
from basenet_jax.planners.chance import likely_pairs, seem_sure
from basenet_jax.planners.route import Route
from basenet_jax.robot.model import Robot
from basenet_jax.task.drives import Drives, Roads
from basenet_jax.task.pick_order import order_picks
from basenet_jax.task.picking import Rules, pick
from basenet_jax.task.reliability import Chance
from basenet_jax.trigonometry import sin_cos, wrap_angle
from basenet_jax.world.boxes import Boxes
from basenet_jax.world.scene import Scene


def refine(
    robot: Robot,
    scene: Scene,
    route: Route,
    key: PRNGKeyArray,
    drives: Drives,
    rounds: Int[Array, ""] | int,
    config: RefinementConfig = RefinementConfig(),
    world: WorldConfig = WorldConfig(),
    chance: Chance | None = None,
) -> tuple[Route, Float[Array, ""]]:
    """Moves the stops of a feasible route so that driving and picking take less time.

    Args:
        robot: the robot.
        scene: unbatched.
        route: all of its drives and picks feasible.
        key: consumed.
        drives: of the room.
        rounds: how many; the alternatives are drawn ever closer, from `config.first_scale` to `config.last_scale`.
        config: number and spread of the alternatives.
        world: of drives and picks.
        chance: how sure picks are to be at stops that are moved, as far as a glance tells; None: without error.

    Returns:
        The route, and its N + G (s).
    """

    used = jnp.arange(len(route.stops)) <= jnp.max(route.stop_of)
    # Stops move so little that the ways round the boxes stay the same; the judge has the last word.
    roads = drives.roads(robot, drives.ends(robot, jnp.concatenate([scene.robot_start[None], route.stops])))

    def improve(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        index, stops, _ = carry
        progress = index / jnp.maximum(rounds - 1, 1)
        scale = config.first_scale * (config.last_scale / config.first_scale) ** progress
        options = alternatives(stops, jax.random.fold_in(key, index), scale, config)
        picking = _picking_time(robot, scene, options, route, world, chance)
        first, between = _drive_times(robot, scene, options, drives, roads)
        between = jnp.where(used[1:, None, None], between, 0.0)
        choice, cost = cheapest_path(first, between, picking)
        return index + 1, jnp.take_along_axis(options, choice[:, None, None], axis=1)[:, 0], cost

    start = (jnp.array(0), route.stops, jnp.array(jnp.inf, route.stops.dtype))
    _, stops, cost = jax.lax.while_loop(lambda carry: carry[0] < rounds, improve, start)
    return route._replace(stops=stops), cost


def reassign(
    robot: Robot, scene: Scene, route: Route, world: WorldConfig = WorldConfig(), chance: Chance | None = None
) -> Route:
    """Gives every object of a route to the stop, among all of its used ones that serve it, where picking is fastest.

    Where objects are in each other's way, only as far as they let it.
    """
    used = jnp.arange(len(route.stops)) <= jnp.max(route.stop_of)
    if Rules.of(world.pick, scene.room).object_in_the_way:
        return _reorder(robot, scene, route, used, world, chance)
    picks = pick(robot, route.stops, scene.grasps[:, None], scene.room, world.pick)
    serves = picks.feasible & used
    if chance is not None:
        serves = likely_pairs(robot, scene, route.stops, serves.T, chance, world.pick).T
    time = jnp.where(serves, picks.time, jnp.inf)
    fastest = jnp.where(jnp.isfinite(jnp.min(time, axis=1)), jnp.argmin(time, axis=1), route.stop_of)
    return route._replace(stop_of=jnp.where(route.stop_of >= 0, fastest, -1))


def _reorder(
    robot: Robot, scene: Scene, route: Route, used: Bool[Array, " M"], world: WorldConfig, chance: Chance | None
) -> Route:
    """The picks at a route's used stops, in their order; the same route where a way to pick isn't among those kept."""
    slots = len(used)
    candidates = check_candidates(robot, scene, route.stops, world=world, pairs_at_once=slots**2)
    assert candidates.clutter is not None
    serves = candidates.serves
    if chance is not None:
        serves = likely_pairs(robot, scene, route.stops, serves, chance, world.pick)
    ways = candidates.clutter.only(serves)
    picked = scene.mask & (route.stop_of >= 0)
    order = order_picks(ways.without(scene.mask & ~picked), picked, jnp.where(used, jnp.arange(slots), -1))
    complete = jnp.all((order.visit >= 0) | ~picked)
    stop_of, turn = jnp.where(complete, order.visit, route.stop_of), jnp.where(complete, order.turn, route.turn)
    return Route(route.stops, stop_of, turn)


def alternatives(
    stops: Float[Array, "L 3"], key: PRNGKeyArray, scale: Float[Array, ""], config: RefinementConfig
) -> Float[Array, "L C 3"]:
    """Poses around every stop, the stop itself first; `scale` (m) is their spread."""
    slide_key, free_key, rigid_key = jax.random.split(key, 3)
    count = len(stops)
    sizes = jnp.array([1.0, 1.0, config.radians_per_metre]) * scale
    sine, cosine = sin_cos(stops[:, 2:])
    # Spreads differ by powers of two, so that every round has large steps and small ones.
    slides = _spread(jax.random.normal(slide_key, (count, config.slides))) * scale
    slid = jnp.stack([cosine * slides, sine * slides, jnp.zeros_like(slides)], axis=-1)
    freely = jax.random.normal(free_key, (count, config.free, 3)) * sizes
    motions = jax.random.normal(rigid_key, (config.rigid, 3)) * sizes
    center = jnp.mean(stops[:, :2], axis=0)
    turn_sine, turn_cosine = sin_cos(motions[:, 2])
    x, y = (stops[:, None, :2] - center).transpose(2, 0, 1)
    turned = jnp.stack([x * (turn_cosine - 1) - y * turn_sine, x * turn_sine + y * (turn_cosine - 1)], axis=-1)
    rigid = jnp.broadcast_to(motions, (count, config.rigid, 3)).at[..., :2].add(turned)
    changes = jnp.concatenate([jnp.zeros((count, 1, 3)), slid, freely, rigid], axis=1)
    poses = stops[:, None] + changes
    return poses.at[..., 2].set(jnp.where(changes[..., 2] == 0, poses[..., 2], wrap_angle(poses[..., 2])))


def _spread(normal: Float[Array, "L C"]) -> Float[Array, "L C"]:
    return normal * 2.0 ** -(jnp.arange(normal.shape[1]) % 4)


def _picking_time(
    robot: Robot,
    scene: Scene,
    options: Float[Array, "L C 3"],
    route: Route,
    world: WorldConfig,
    chance: Chance | None,
) -> Float[Array, "L C"]:
    """Time (s) of all picks at each alternative; infinite where one of them is not feasible, or not sure enough."""
    stop_of = route.stop_of
    neighbours = jax.tree.map(lambda x: x[:, None], _left_when_picked(scene, route))
    picks = pick(robot, options[stop_of], scene.grasps[:, None], scene.room, world.pick, neighbours=neighbours)
    possible = picks.feasible
    if chance is not None:
        stays = jnp.arange(options.shape[1]) == 0
        possible &= stays | seem_sure(robot, scene, options[stop_of], chance, world.pick)
    time = jnp.where(possible, picks.time, jnp.inf)
    return jnp.zeros(options.shape[:2]).at[stop_of].add(jnp.where(stop_of[:, None] >= 0, time, 0.0))


def _left_when_picked(scene: Scene, route: Route) -> Boxes:
    """For each object the others that still stand when it is picked, "M M"."""
    stop_of, turn = route.stop_of, route.turn
    before = (stop_of < stop_of[:, None]) | ((stop_of == stop_of[:, None]) & (turn < turn[:, None]))
    gone = ((stop_of >= 0) & before) | jnp.eye(len(turn), dtype=bool)
    boxes = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(turn), *x.shape)), scene.object_boxes)
    return dataclasses.replace(boxes, blocks_arm=boxes.blocks_arm & ~gone)


def _drive_times(
    robot: Robot, scene: Scene, options: Float[Array, "L C 3"], drives: Drives, roads: Roads
) -> tuple[Float[Array, " C"], Float[Array, "L-1 C C"]]:
    """Navigation time (s) to the alternatives of the first stop, and between those of successive stops."""
    start = drives.ends(robot, scene.robot_start[None])
    ends = jax.tree.map(
        lambda x: x.reshape(*options.shape[:2], *x.shape[1:]), drives.ends(robot, options.reshape(-1, 3))
    )
    first, first_road = jax.tree.map(lambda x: x[0], (ends, roads))
    before, after = (jax.tree.map(lambda x, rows=rows: x[rows], ends) for rows in (slice(-1), slice(1, None)))
    further = jax.tree.map(lambda x: x[1:], roads)
    between = jax.vmap(lambda *leg: drives.times_near(robot, *leg))(before, after, further)
    return drives.times_near(robot, start, first, first_road)[0], between


def cheapest_path(
    first: Float[Array, " C"], between: Float[Array, "L-1 C C"], at: Float[Array, "L C"]
) -> tuple[Int[Array, " L"], Float[Array, ""]]:
    """The alternative of each stop on the cheapest path, and its cost (s): Viterbi's algorithm.

    Args:
        first: cost of going to each alternative of the first stop.
        between: from each alternative to each of the next stop's.
        at: cost of each alternative itself.
    """

    def forward(cost: Array, leg: tuple[Array, Array]) -> tuple[Array, Array]:
        drives, here = leg
        arrival = cost[:, None] + drives
        return jnp.min(arrival, axis=0) + here, jnp.argmin(arrival, axis=0)

    cost, before = jax.lax.scan(forward, first + at[0], (between, at[1:]))
    last = jnp.argmin(cost)
    _, choice = jax.lax.scan(lambda here, came: (came[here], came[here]), last, before, reverse=True)
    return jnp.append(choice, last), cost[last]
