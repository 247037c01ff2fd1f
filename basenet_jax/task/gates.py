"""What a base pose offers to whoever drives from it, or to it: how far it may turn, and the nearest turning places."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from basenet_jax import struct
from basenet_jax.robot.model import Robot
from basenet_jax.robot.timing import straight_duration
from basenet_jax.task.drive_space import DriveSpace, Pair, first_turning_place, footprint_fits
from basenet_jax.trigonometry import sin_cos

_STEPS = 60  # of half a turn: 3 degrees each
_HALVINGS = 10  # of the step in which a turn is stopped: 0.003 degrees remain


@struct.dataclass
class Gates:
    """Of S poses, each with up to K turning places: straight ahead and behind, or along the four axes of the base.

    A base leaves a pose as it enters it, backwards.
    """

    pose: Float[Array, "S 3"]  # (x, y, heading) in W
    left: Float[
        Array, " S"
    ]  # rad, how far the base may turn counter-clockwise; infinite: all round, below 0: not at all
    right: Float[Array, " S"]  # likewise clockwise
    place: Float[Array, "S K 2"]  # m; where the base stands if it is a turning place itself
    time: Float[Array, "S K"]  # s, of the straight piece between pose and place; infinite: there is none


def one_way_times(ends: Gates, *, reverse: bool) -> tuple[Float[Array, "S K"], Float[Array, "S K"]]:
    """Times (s) to leave poses by each gate, and to come to them; infinite where that goes in reverse and may not."""
    if reverse:
        return ends.time, ends.time
    ahead, behind = ends.time[:, :1], ends.time[:, 1:]
    # Where the base stands at a turning place, the first gate leads nowhere else.
    none = jnp.full_like(ahead, jnp.inf)
    return jnp.concatenate([ahead, none], axis=1), jnp.concatenate([jnp.where(ahead == 0, 0.0, none), behind], axis=1)


def gates(robot: Robot, space: DriveSpace, pose: Float[Array, "S 3"]) -> Gates:
    """Free turns and turning places of poses.

    Args:
        robot: its base counts.
        space: where it drives.
        pose: (x, y, heading) in W.
    """
    start, heading = (pose[:, :1], pose[:, 1:2]), pose[:, 2:]
    quarters = jnp.arange(4) if robot.omnidirectional else jnp.array([0, 2])
    sine, cosine = sin_cos(heading + quarters * (0.5 * jnp.pi))
    distance = first_turning_place(space, start, (cosine, sine))
    there = jnp.where(jnp.isfinite(distance), distance, 0.0)
    way = (there * cosine, there * sine)
    left, right, fits = _what_fits(space, pose, way)
    time = straight_duration(robot, there)
    here = distance[:, 0] == 0
    once = ~here[:, None] | (quarters == 0)
    return Gates(
        pose=pose,
        left=jnp.where(here, jnp.inf, left),
        right=jnp.where(here, jnp.inf, right),
        place=jnp.stack([start[0] + way[0], start[1] + way[1]], axis=-1),
        time=jnp.where(jnp.isfinite(distance) & fits & once, time, jnp.inf),
    )


def _what_fits(space: DriveSpace, pose: Float[Array, "S 3"], way: Pair) -> tuple[Array, Array, Array]:
    """How far (rad) the base may turn left and right before it touches anything, and which straight pieces are free.

    Half a turn shows all: turned by so much, the footprint is the same. It is gone through in steps, and the step in
    which it is stopped is halved.
    """

    def fits(angle: Array, way: Pair | None = None) -> Array:
        sine, cosine = sin_cos(pose[:, 2:] + angle)
        way = way or (jnp.zeros_like(sine), jnp.zeros_like(sine))
        middle = (pose[:, :1] + way[0], pose[:, 1:2] + way[1])
        return footprint_fits(space, middle, (cosine, sine), way)

    nowhere, ahead = jnp.zeros((len(pose), _STEPS)), jnp.zeros_like(way[0])
    all_at_once = fits(
        jnp.concatenate([nowhere + jnp.arange(_STEPS) * (jnp.pi / _STEPS), ahead], axis=1),
        (jnp.concatenate([nowhere, 0.5 * way[0]], axis=1), jnp.concatenate([nowhere, 0.5 * way[1]], axis=1)),
    )
    blocked, free_ways = ~all_at_once[:, :_STEPS], all_at_once[:, _STEPS:]
    stops = [jnp.argmax(blocked, axis=1), 1 + jnp.argmax(blocked[:, ::-1], axis=1)]
    last = jnp.maximum(jnp.stack(stops, axis=1) - 1, 0) * (jnp.pi / _STEPS)
    sides = jnp.array([1.0, -1.0])

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        free, stopped = ends
        middle = 0.5 * (free + stopped)
        fine = fits(sides * middle)
        return jnp.where(fine, middle, free), jnp.where(fine, stopped, middle)

    free, _ = jax.lax.fori_loop(0, _HALVINGS, halve, (last, last + jnp.pi / _STEPS))
    free = jnp.where(blocked[:, :1], -1.0, jnp.where(blocked.any(axis=1, keepdims=True), free, jnp.inf))
    return free[:, 0], free[:, 1], free_ways
