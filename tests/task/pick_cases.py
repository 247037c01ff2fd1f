"""Picks to judge, and the package's and the oracle's verdicts on them."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from basenet_jax.config import PickConfig
from basenet_jax.task.picking import Pick, Reason
from basenet_jax.world.boxes import Room
from tests import compiled
from tests.oracles import picking as oracle

# A duration is a sum of joint moves over 0.1 rad and more; T's slope there is at most 1 / sqrt(1.4 * 0.1) = 2.7 s/rad
# and float32 joints err by about 1e-6 rad: 1e-5 s. Near a stretched or folded elbow an angle is the root of a length
# known to 1e-7, and errs by 3e-4 rad: 1e-3 s. (T's infinite slope at 0 never counts: the slowest joint's move does.)
FLOAT32_BOUND, FLOAT32_MEDIAN = 1e-3, 1e-5  # s

# Size and grasp (x, z, yaw) of the five classes.
CLASSES = (
    (0.21, 0.0, 0.30, 0.0),
    (0.25, 0.0, 0.35, -math.pi / 2),
    (0.175, 0.0, 0.32, math.pi / 4),
    (0.082, -0.06, 0.30, 0.0),
    (0.053, 0.08, 0.29, 0.0),
)


class Cases(NamedTuple):
    """Picks: base poses (x, y, heading), grasps (x, y, z, yaw) and tables' heights (m)."""

    base_pose: np.ndarray
    grasp: np.ndarray
    height: np.ndarray


def cases(base_pose, grasp, height: ArrayLike = 0.75) -> Cases:
    """Broadcast, and rounded to float32, so that both sides see the same numbers."""
    base_pose, grasp = np.atleast_2d(base_pose), np.atleast_2d(grasp)
    count = max(len(base_pose), len(grasp))
    parts = (base_pose, (count, 3)), (grasp, (count, 4)), (height, (count,))
    return Cases(*(np.broadcast_to(value, shape).astype(np.float32).astype(float) for value, shape in parts))


def joined(*parts: Cases) -> Cases:
    """All of them."""
    return Cases(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def random_grasps(rng, count, height=0.75):
    """Grasps of random objects of the five classes on a table of this height."""
    x, y = rng.uniform((-0.92, -0.32), (0.92, 0.32), size=(count, 2)).T
    yaw = rng.uniform(-np.pi, np.pi, count)
    tall, along, above, turned = np.array(CLASSES)[rng.integers(5, size=count)].T
    return np.column_stack([x + along * np.cos(yaw), y + along * np.sin(yaw), height + tall / 2 + above, yaw + turned])


def training_picks(rng, count):
    """Base-pose training's distribution: within 3 m, half of the draws with |x| <= 2 and |y| <= 1.5, collision-free."""
    poses = []
    while len(poses) < count:
        x, y = rng.uniform((-2.0, -1.5), (2.0, 1.5)) if len(poses) % 2 else rng.uniform(-3.0, 3.0, size=2)
        pose = (x, y, rng.uniform(-np.pi, np.pi))
        if math.hypot(x, y) <= 3.0 and oracle.base_clearance(pose) > 1e-4:
            poses.append(pose)
    return cases(np.array(poses), random_grasps(rng, count))


def near_picks(rng, count, height=0.75):
    """Base poses around objects, where most are in reach."""
    grasp = random_grasps(rng, count, height)
    bearing, distance = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.3, 1.1, count)
    x, y = grasp[:, 0] + distance * np.cos(bearing), grasp[:, 1] + distance * np.sin(bearing)
    return cases(np.column_stack([x, y, rng.uniform(-np.pi, np.pi, count)]), grasp, height)


def side_picks(rng, count, height=0.75):
    """Base poses beside the table's long sides, free of it, with an object near that side."""
    grasp = random_grasps(rng, count, height)
    side = rng.choice([-1.0, 1.0], count)
    grasp[:, 1] = side * rng.uniform(0.0, 0.35, count)
    x = np.clip(grasp[:, 0] + rng.uniform(-0.5, 0.5, count), -0.8, 0.8)
    y = side * rng.uniform(0.76, 1.1, count)
    heading = rng.choice([0.0, np.pi], count) + rng.uniform(-0.1, 0.1, count)
    return cases(np.column_stack([x, y, heading]), grasp, height)


def rooms(height):
    """One table of the usual size per height."""
    half_size = jnp.broadcast_to(jnp.array([1.0, 0.4]), (len(height), 2))
    return Room.of_table(half_size=half_size, height=jnp.asarray(height, half_size.dtype))


def judge(robot, picks: Cases, config=PickConfig()) -> Pick:
    """The package's verdicts."""
    return compiled.pick(robot, picks.base_pose, picks.grasp, rooms(picks.height), config)


def _world(picks: Cases, index, **world) -> oracle.World:
    return oracle.World(table_height=float(picks.height[index]), **world)


def expect(picks: Cases, **world) -> list[oracle.Outcome]:
    """The oracle's verdicts."""
    return [
        oracle.pick(picks.base_pose[index], picks.grasp[index], _world(picks, index, **world))
        for index in range(len(picks.grasp))
    ]


def reasons(result: Pick) -> list[str | None]:
    """The package's reasons as the oracle writes them."""
    return [None if value == Reason.NONE else Reason(value).name.lower() for value in result.reason.tolist()]


def decided_by_rounding(picks: Cases, index, **world) -> bool:
    """Whether thresholds moved a little either way change the oracle's verdict."""
    worlds = [_world(picks, index, slack=slack, **world) for slack in (-1, 1)]
    strict, generous = (oracle.pick(picks.base_pose[index], picks.grasp[index], world) for world in worlds)
    return strict.reason != generous.reason or abs(strict.time - generous.time) > FLOAT32_BOUND


def check_against_oracle(picks: Cases, result: Pick, expected, bound=FLOAT32_BOUND, doubtful=0.02, **world):
    """Same reasons, and times within the bound, but for a few picks that rounding decides."""
    time = np.array([outcome.time for outcome in expected])
    same = np.array([a == outcome.reason for a, outcome in zip(reasons(result), expected, strict=True)])
    wrong = np.flatnonzero(~same | ~(np.abs(result.time - time) <= bound))
    clear = [index for index in wrong if not decided_by_rounding(picks, index, **world)]
    assert not clear, [(index, reasons(result)[index], result.time[index], expected[index]) for index in clear[:3]]
    assert len(wrong) <= doubtful * len(time)
    np.testing.assert_array_equal(result.feasible, [reason is None for reason in reasons(result)])


def sample_picks() -> Cases:
    """390 picks: base-pose training's, and ones near tables of four heights, where rules 3 and 4 choose the branch."""
    rng = np.random.default_rng(11)
    beside = [side_picks(rng, count, height) for count, height in ((90, 0.75), (50, 0.4), (40, 1.1), (30, 0.05))]
    return joined(training_picks(rng, 120), near_picks(rng, 60), *beside)
