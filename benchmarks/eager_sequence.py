"""REINFORCE with a greedy-rollout baseline in eager PyTorch, for the comparison in `sequence_training` only.

The same episodes as `policies.pickup` and `learning.reinforce` play: the sequence policy chooses an object, the frozen
base-pose policy says where to park, the drive is costed by the rules of `task.navigation`. Everything is batched over
episodes, and a Python loop goes over the steps, as in the usual PyTorch code for such problems. Gradients are taken
through the recorded log probabilities of whole episodes.
"""

# pyright: reportMissingImports=false
# (PyTorch need not be installed.)

import copy
import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from basenet_jax.config import WorldConfig
from basenet_jax.learning.config import ReinforceConfig
from basenet_jax.policies.base_pose import BasePosePolicy
from basenet_jax.robot.model import Robot
from basenet_jax.world.scene import Scene
from benchmarks.eager_networks import BasePose, GraspSequence, Params, wrap


class Scenes(NamedTuple):
    """B scenes of M objects."""

    grasps: Tensor  # (B, M, 4)
    mask: Tensor  # (B, M)
    robot_start: Tensor  # (B, 3)


def as_tensors(scenes: Scene) -> Scenes:
    """What episodes need of a batch of our scenes."""
    return Scenes(*(torch.tensor(np.asarray(x)) for x in (scenes.first_grasp, scenes.mask, scenes.robot_start)))


@dataclass
class Episodes:
    """How a batch of episodes went."""

    cost: Tensor  # (B,) s, with the time for every object not driven to
    log_probability: Tensor  # (B,) of all choices together
    choices: Tensor  # (B, M)


class EagerReinforce:
    """The learner: `update` takes a batch of scenes through one gradient step.

    Args:
        robot: its base's size, speeds and accelerations count.
        base_pose: frozen, in the object's frame.
        params: of our sequence policy; the first parameters of policy and baseline.
        config: of the learner.
        world: of the default table.
    """

    def __init__(
        self, robot: Robot, base_pose: BasePosePolicy, params: Params, config: ReinforceConfig, world: WorldConfig
    ):
        """Makes networks and optimiser."""
        self.config = config
        self.policy = GraspSequence(config.features, config.layers).load(params)
        self.baseline = copy.deepcopy(self.policy)
        self.base_pose, self.drives = BasePose(base_pose), Drives(robot, world)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=config.learning_rate)

    def update(self, scenes: Scenes) -> float:
        """One gradient step; returns the mean cost (s)."""
        with torch.no_grad():
            expected = self.play(self.baseline, scenes, greedy=True).cost
        episodes = self.play(self.policy, scenes, greedy=False)
        self.optimizer.zero_grad()
        self.loss(episodes, episodes.cost - expected).backward()
        self.optimizer.step()
        return float(episodes.cost.mean())

    def loss(self, episodes: Episodes, advantage: Tensor) -> Tensor:
        """What REINFORCE descends."""
        return self.config.navigation_weight * (advantage * episodes.log_probability).mean()

    def play(self, policy: GraspSequence, scenes: Scenes, *, greedy: bool) -> Episodes:
        """Plays whole episodes."""
        count, slots = scenes.mask.shape
        rows = torch.arange(count)
        pose, remaining, ended = scenes.robot_start, scenes.mask.clone(), torch.zeros(count, dtype=torch.bool)
        cost, log_probability = torch.zeros(count), torch.zeros(count)
        choices = []
        for _ in range(slots):
            active = remaining.any(dim=1)
            logits = policy(scenes.grasps, pose, remaining)
            logits = torch.where((active & ~ended)[:, None], logits, torch.where(remaining, 0.0, -1e9))
            distribution = torch.distributions.Categorical(logits=logits)
            choice = logits.argmax(dim=1) if greedy else distribution.sample()
            log_probability = log_probability + torch.where(active & ~ended, distribution.log_prob(choice), 0.0)
            with torch.no_grad():
                goal = self.base_pose(scenes.grasps[rows, choice], pose)
                drive = self.drives.duration(pose, goal)
                ended = ended | (active & (self.drives.collides(goal) | ~torch.isfinite(drive)))
                executed = active & ~ended
                cost = cost + torch.where(executed, drive, self.config.failure_time_s * active)
                pose = torch.where(executed[:, None], goal, pose)
                remaining = remaining.clone()
                remaining[rows, choice] = False
            choices.append(choice)
        return Episodes(cost, log_probability, torch.stack(choices, dim=1))


class _Leg(NamedTuple):
    direction: Tensor  # rad
    duration: Tensor  # s; infinite where the way enters the grown table or has no length


class Drives:
    """Navigation times and the base's collisions, batched, by the package's definitions."""

    def __init__(self, robot: Robot, world: WorldConfig):
        """For the default table."""
        self._half = 0.5 * torch.tensor([world.table.length_m, world.table.width_m])
        self._navigation, self._pick = world.navigation, world.pick
        self._footprint = torch.tensor(np.asarray(robot.footprint_half_size, np.float32))
        self._speed, self._acceleration = np.asarray(robot.base_speed), np.asarray(robot.base_acceleration)
        corners = torch.tensor([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
        narrow = self._footprint.min()
        self._path_half = self._half + narrow - self._navigation.path_slack_m
        self._vias = corners * (self._half + narrow + self._navigation.via_clearance_m)

    def duration(self, start: Tensor, goal: Tensor) -> Tensor:
        """Least times (B,) from poses (B, 3) to poses (B, 3); infinite where there is no way."""
        straight = self._leg(start[:, None, :2], goal[:, None, :2])
        out, inward = self._leg(start[:, None, :2], self._vias), self._leg(self._vias, goal[:, None, :2])
        edge = self._leg(self._vias, self._vias.roll(-1, dims=0))
        back = _Leg(edge.direction + torch.pi, edge.duration)
        next_out, next_in = (_Leg(*(x.roll(-1, dims=1) for x in leg)) for leg in (out, inward))
        ways = [[straight], [out, inward], [out, edge, next_in], [next_out, back, inward]]
        times = [self._way(way, start[:, None, 2], goal[:, None, 2], gear) for gear in (0.0, torch.pi) for way in ways]
        least = torch.cat(times, dim=1).amin(dim=1)
        turn = self._turn(goal[:, 2] - start[:, 2])
        short = torch.linalg.norm(goal[:, :2] - start[:, :2], dim=-1) <= self._navigation.same_pose
        return torch.where(short, turn, least)

    def collides(self, pose: Tensor) -> Tensor:
        """Whether the base's rectangle overlaps the grown table, by the separating axes of two rectangles."""
        x, y = pose[:, 0], pose[:, 1]
        sine, cosine = torch.sin(pose[:, 2]), torch.cos(pose[:, 2])
        (length, width), (far, wide) = self._footprint, self._half + self._pick.base_clearance_m
        s, c = sine.abs(), cosine.abs()
        gaps = [
            x.abs() - far - length * c - width * s,
            y.abs() - wide - length * s - width * c,
            (cosine * x + sine * y).abs() - length - far * c - wide * s,
            (cosine * y - sine * x).abs() - width - far * s - wide * c,
        ]
        return torch.stack(gaps).amax(dim=0) <= self._pick.touching_m

    def _way(self, legs: list[_Leg], heading: Tensor, goal_heading: Tensor, gear: float) -> Tensor:
        time = self._turn(legs[0].direction + gear - heading) + self._turn(goal_heading - legs[-1].direction - gear)
        for before, after in itertools.pairwise(legs):
            time = time + self._turn(after.direction - before.direction)
        return time + sum(leg.duration for leg in legs)

    def _leg(self, start: Tensor, end: Tensor) -> _Leg:
        along = end - start
        length = torch.linalg.norm(along, dim=-1)
        half = self._path_half
        middle, extent = 0.5 * (start + end), 0.5 * along.abs()
        cross = (middle[..., 0] * along[..., 1] - middle[..., 1] * along[..., 0]).abs() / 2
        beside = cross >= half[0] * extent[..., 1] + half[1] * extent[..., 0]
        free = beside | (middle.abs() >= half + extent).any(dim=-1)
        duration = self._trapezoid(length, 0)
        allowed = free & (length > self._navigation.same_pose)
        return _Leg(torch.atan2(along[..., 1], along[..., 0]), torch.where(allowed, duration, torch.inf))

    def _turn(self, angle: Tensor) -> Tensor:
        return self._trapezoid(wrap(angle), 1)

    def _trapezoid(self, distance: Tensor, axis: int) -> Tensor:
        distance, speed, acceleration = distance.abs(), float(self._speed[axis]), float(self._acceleration[axis])
        triangle = 2 * torch.sqrt(distance / acceleration)
        return torch.where(distance * acceleration < speed**2, triangle, distance / speed + speed / acceleration)
