"""How a move comes along between its start and its end: trapezoidal speed profiles as functions of time.

In float64 and on the host: this is what robots are told to do, `robot.timing` is what planners cost in bulk.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from basenet_jax.robot.model import Robot

_APART_S = 1e-9  # clocks count nanoseconds
_STILL = 1e-12  # rad or m: less is rounding


class Progress(NamedTuple):
    """Of a move, at each of a number of times: the share that is done, and its first two derivatives."""

    share: Float[np.ndarray, "*times"]  # 0 to 1
    speed: Float[np.ndarray, "*times"]  # 1/s
    acceleration: Float[np.ndarray, "*times"]  # 1/s^2; where it jumps, the value from there on


@dataclass(frozen=True)
class TimeLaw:
    """A move from rest to rest: speed up evenly, cruise, slow down evenly.

    Smoothed, the law is the moving average of that one over `smoothing_s`, which it takes longer. An average keeps
    every limit that is kept without it, but its acceleration no longer jumps: it is linear between the `switches`.
    """

    ramp_s: float  # positive; of speeding up, and of slowing down
    cruise_s: float
    smoothing_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Of the whole move."""
        return self.ramp_s + self.cruise_s + self.ramp_s + self.smoothing_s

    def times(self, factor: float) -> "TimeLaw":
        """The same move, taking so many times as long."""
        return TimeLaw(self.ramp_s * factor, self.cruise_s * factor, self.smoothing_s * factor)

    @property
    def switches(self) -> Float[np.ndarray, " n"]:
        """Times (s) in order between which the position is one polynomial, of degree 2 (3 where smoothed)."""
        knots, _ = self._jumps()
        knots = np.sort(np.concatenate([knots, knots + self.smoothing_s]))
        return knots[np.append(np.diff(knots) > _APART_S, True)]

    def at(self, time: ArrayLike) -> Progress:
        """The progress at times (s) since the move began, any shape; before it nothing is done, after it all."""
        time = np.clip(np.asarray(time, float), 0.0, self.duration_s)
        knots, signs = self._jumps()
        since = time[..., None] - knots
        # With this acceleration a share of 1 is reached in the end. Each knot makes it jump; integrals of a jump are
        # powers of the time since.
        scale = 1.0 / (self.ramp_s * (self.ramp_s + self.cruise_s))

        def integral(times: int) -> np.ndarray:
            return scale * (_averaged_power(since, times, self.smoothing_s) @ signs)

        ended = time == self.duration_s
        share, speed = np.clip(integral(2), 0.0, 1.0), np.maximum(integral(1), 0.0)
        return Progress(np.where(ended, 1.0, share), np.where(ended, 0.0, speed), integral(0))

    def sample_times(self, rate_hz: float) -> Float[np.ndarray, " n"]:
        """Times (s) from beginning to end: all switches, and between them as many at an even rate.

        A cubic or quintic spline through position, speed and acceleration at these times is the law itself where it is
        smoothed; a cubic through position and speed is in any case.
        """
        switches = self.switches
        even = np.arange(0.0, self.duration_s, 1.0 / rate_hz)
        apart = np.min(np.abs(even[:, None] - switches), axis=1) > 0.1 / rate_hz
        return np.sort(np.concatenate([switches, even[apart]]))

    def _jumps(self) -> tuple[np.ndarray, np.ndarray]:
        """When the acceleration jumps (begins to change, where smoothed), and with which sign."""
        return np.cumsum([0.0, self.ramp_s, self.cruise_s, self.ramp_s]), np.array([1.0, -1.0, -1.0, 1.0])


def _averaged_power(since: np.ndarray, power: int, over_s: float) -> np.ndarray:
    """`max(x, 0)^k / k!` for k = 0, 1 or 2, averaged over the last `over_s` before x (s); for k = 0 it is 1 at x = 0.

    Written out, since the average as a difference of higher powers loses all digits where x is much longer.
    """
    x = np.maximum(since, 0.0)
    if over_s == 0.0:
        return np.where(since >= 0.0, x**power / math.factorial(power), 0.0)
    whole = (1.0, x - over_s / 2.0, (x * x - x * over_s) / 2.0 + over_s * over_s / 6.0)[power]
    return np.where(x >= over_s, whole, x ** (power + 1) / (math.factorial(power + 1) * over_s))


def fastest_law(speed: float, acceleration: float, smoothing_s: float = 0.0) -> TimeLaw:
    """The fastest trapezoidal law within limits of the progress (1/s, 1/s^2)."""
    ramp = min(speed / acceleration, math.sqrt(1.0 / acceleration))
    return TimeLaw(ramp, max(1.0 / (ramp * acceleration) - ramp, 0.0), smoothing_s)


def joint_move_law(
    robot: Robot, start: Float[np.ndarray, " dof"], goal: Float[np.ndarray, " dof"], smoothing_s: float = 0.0
) -> TimeLaw | None:
    """The law that all joints follow together, so that the arm moves in a straight line in joint space.

    The joint that needs the longest sets the duration, as in `joint_move_duration`. Where one joint is held up by its
    speed and another by its acceleration, the one law has to respect both, and takes somewhat longer than that.

    Args:
        robot: its joints' limits count.
        start: joints, rad (m for sliding ones).
        goal: likewise.
        smoothing_s: see `TimeLaw`.

    Returns:
        None where nothing moves.
    """
    distance = np.abs(np.asarray(goal, float) - np.asarray(start, float))
    moving = distance > _STILL
    if not moving.any():
        return None
    speed = np.min(np.asarray(robot.joint_speed)[moving] / distance[moving])
    acceleration = np.min(np.asarray(robot.joint_acceleration)[moving] / distance[moving])
    return fastest_law(float(speed), float(acceleration), smoothing_s)
