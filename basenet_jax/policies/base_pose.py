"""The base-pose policy: where to park the base to grasp one object (layer 2 of the paper)."""

import itertools
from collections.abc import Sequence
from typing import Literal

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from basenet_jax import struct
from basenet_jax.geometry import compose, relative
from basenet_jax.trigonometry import atan2, sin_cos, wrap_angle

ACTION_SIZE = 4
OBSERVATION_SIZE = 15

BaseFrame = Literal["object", "table"]

# Half-widths (m) of the rectangle that the policy can place the base in: around the grasp (a UR5e reaches 0.95 m and
# stands 0.34 m from its base's centre; a longer arm gains nothing by more: from the middle of a table 0.8 m wide even
# a base of 1 m is clear at 1.0 m), or around the table.
_OBJECT_FRAME_REACH = (1.4, 1.4)
_TABLE_FRAME_REACH = (2.2, 1.6)


@struct.dataclass
class BasePosePolicy:
    """A trained policy: the paper's actor, a multilayer perceptron with ReLU, and its observations' normalisation."""

    kernels: tuple[Float[Array, "inputs outputs"], ...]
    biases: tuple[Float[Array, " outputs"], ...]
    mean: Float[Array, " observation"]
    std: Float[Array, " observation"]
    frame: BaseFrame = struct.field(pytree_node=False, default="object")

    def __call__(
        self, grasp: Float[Array, "*batch 4"], robot_pose: Float[Array, "*batch 3"]
    ) -> Float[Array, "*batch 3"]:
        """The deterministic base pose (x, y, heading in W) for a grasp (tool0's x, y, z, yaw in W)."""
        return base_pose_from_action(self.action(grasp, robot_pose), grasp, self.frame)

    def action(self, grasp: Float[Array, "*batch 4"], robot_pose: Float[Array, "*batch 3"]) -> Float[Array, "*batch 4"]:
        """The deterministic action; see `base_pose_from_action`."""
        hidden = (observe(grasp, robot_pose) - self.mean) / self.std
        for kernel, bias in zip(self.kernels[:-1], self.biases[:-1], strict=True):
            hidden = jax.nn.relu(hidden @ kernel + bias)
        output = hidden @ self.kernels[-1] + self.biases[-1]
        return jnp.tanh(output[..., :ACTION_SIZE])


def untrained_policy(hidden: Sequence[int], frame: BaseFrame = "object") -> BasePosePolicy:
    """A policy of zeros with hidden layers of these sizes, for its shapes: see `load_weights`."""
    sizes = (OBSERVATION_SIZE, *hidden, 2 * ACTION_SIZE)  # the actor's last layer gives mean and spread
    layers = list(itertools.pairwise(sizes))
    return BasePosePolicy(
        kernels=tuple(jnp.zeros(shape) for shape in layers),
        biases=tuple(jnp.zeros(shape[1]) for shape in layers),
        mean=jnp.zeros(OBSERVATION_SIZE),
        std=jnp.ones(OBSERVATION_SIZE),
        frame=frame,
    )


def observe(grasp: Float[Array, "*batch 4"], robot_pose: Float[Array, "*batch 3"]) -> Float[Array, "*batch 15"]:
    """What the policy sees: grasp and robot in W, and robot and table's centre in the grasp's frame; no class number.

    Angles as sine and cosine; lengths in metres.
    """
    frame = grasp_frame(grasp)
    robot_there = relative(frame, robot_pose)
    table_there = relative(frame, jnp.zeros_like(frame))
    angles = (frame[..., 2], robot_pose[..., 2], robot_there[..., 2])
    turns = [part for angle in angles for part in sin_cos(angle)]
    positions = [grasp[..., :3], robot_pose[..., :2], robot_there[..., :2], table_there[..., :2]]
    return jnp.concatenate([*positions, jnp.stack(turns, axis=-1)], axis=-1)


def base_pose_from_action(
    action: Float[Array, "*batch 4"], grasp: Float[Array, "*batch 4"], frame: BaseFrame
) -> Float[Array, "*batch 3"]:
    """The base pose in W that an action in [-1, 1] means: two components of position, two of the heading's direction.

    In the object's frame (the paper's choice), position and heading are relative to the grasp's.
    """
    pose = pose_in_frame(action, frame)
    return compose(grasp_frame(grasp), pose) if frame == "object" else pose


def pose_in_frame(action: Float[Array, "*batch 4"], frame: BaseFrame) -> Float[Array, "*batch 3"]:
    """The base pose (x, y, heading) that an action means, in the frame itself: the grasp's, or the table's."""
    reach = jnp.array(_OBJECT_FRAME_REACH if frame == "object" else _TABLE_FRAME_REACH)
    heading = atan2(action[..., 3], action[..., 2])
    return jnp.concatenate([action[..., :2] * reach, heading[..., None]], axis=-1)


def grasp_frame(grasp: Float[Array, "*batch 4"]) -> Float[Array, "*batch 3"]:
    """The pose (x, y, yaw) of the grasp in W's plane."""
    return jnp.concatenate([grasp[..., :2], wrap_angle(grasp[..., 3:])], axis=-1)
