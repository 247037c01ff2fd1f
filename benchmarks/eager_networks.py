"""The two layers' networks in PyTorch, for the comparison in `sequence_training` only; parameters come from ours.

`GraspSequence` is `policies.grasp_sequence.GraspSequencePolicy` (the dense, masked GATv2 of `policies.graph_attention`)
and `BasePose` is `policies.base_pose.BasePosePolicy` in the object's frame, written as one writes modules in PyTorch.
"""

# pyright: reportMissingImports=false
# (PyTorch need not be installed.)

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import torch
from torch import Tensor, nn

from basenet_jax.policies.base_pose import ACTION_SIZE, BasePosePolicy, pose_in_frame

Params = Mapping[str, Any]  # of Flax, as nested dictionaries


class Attention(nn.Module):
    """One graph-attention layer; the first of them sees the robot, too."""

    def __init__(self, inputs: int, features: int, robot_inputs: int | None = None):
        """Fresh weights."""
        super().__init__()
        self.considered, self.others = nn.Linear(inputs, features), nn.Linear(inputs, features)
        self.robot = None if robot_inputs is None else nn.Linear(robot_inputs, features)
        self.vector = nn.Parameter(torch.randn(features) / math.sqrt(features))

    def forward(self, nodes: Tensor, remaining: Tensor, robot: Tensor | None = None) -> Tensor:
        """New embeddings (B, M, features) of objects (B, M, inputs)."""
        queries, values = self.considered(nodes), self.others(nodes)
        if self.robot is not None:
            queries = queries + self.robot(robot)[:, None]
        neighbours = remaining[:, None, :] & ~torch.eye(nodes.shape[1], dtype=torch.bool)
        hidden = nn.functional.leaky_relu(queries[:, :, None] + values[:, None], 0.2)
        scores = (hidden @ self.vector).masked_fill(~neighbours, -1e9)
        return torch.relu(queries + (torch.softmax(scores, dim=-1) * neighbours) @ values)


class GraspSequence(nn.Module):
    """Logits (B, M) over the objects; minus infinity for those that don't remain."""

    def __init__(self, features: int = 64, layers: int = 5):
        """Fresh weights."""
        super().__init__()
        inputs = [5, *[features] * (layers - 1)]
        self.layers = nn.ModuleList(
            Attention(size, features, 4 if index == 0 else None) for index, size in enumerate(inputs)
        )
        self.head = nn.Sequential(
            *(module for _ in range(2) for module in (nn.Linear(features, features), nn.ReLU())), nn.Linear(features, 1)
        )

    @property
    def attention(self) -> list[Attention]:
        """The graph-attention layers."""
        return [layer for layer in self.layers if isinstance(layer, Attention)]

    @property
    def linears(self) -> list[nn.Linear]:
        """The linear layers behind them."""
        return [module for module in self.head if isinstance(module, nn.Linear)]

    def forward(self, grasps: Tensor, robot_pose: Tensor, remaining: Tensor) -> Tensor:
        """From grasps (B, M, 4), robot poses (B, 3) and what remains (B, M)."""
        robot = torch.cat([robot_pose[:, :2], _direction(robot_pose[:, 2])], dim=-1)
        first, *others = self.attention
        nodes = first(torch.cat([grasps[..., :3], _direction(grasps[..., 3])], dim=-1), remaining, robot)
        for layer in others:
            nodes = layer(nodes, remaining)
        return self.head(nodes)[..., 0].masked_fill(~remaining, -torch.inf)

    @torch.no_grad()
    def load(self, params: Params) -> "GraspSequence":
        """Takes over the parameters of our network."""
        own = params["params"]
        attention = [own["FirstLayer_0"], *(own[f"Layer_{index}"] for index in range(len(self.layers) - 1))]
        for layer, theirs in zip(self.attention, attention, strict=True):
            for name in ("considered", "others", *(["robot"] if layer.robot is not None else [])):
                _load_linear(getattr(layer, name), theirs[name])
            layer.vector.copy_(_tensor(theirs["neighbours"]["vector"][:, 0]))
        for index, linear in enumerate(self.linears):
            _load_linear(linear, own[f"Dense_{index}"])
        return self

    def gradient(self) -> Params:
        """The parameters' gradients as our network has its parameters."""
        attention = [
            {name: _linear_gradient(getattr(layer, name)) for name in ("considered", "others")}
            | ({} if layer.robot is None else {"robot": _linear_gradient(layer.robot)})
            | {"neighbours": {"vector": _gradient(layer.vector)[:, None]}}
            for layer in self.attention
        ]
        own = {"FirstLayer_0": attention[0]}
        own |= {f"Layer_{index}": layer for index, layer in enumerate(attention[1:])}
        return {
            "params": own | {f"Dense_{index}": _linear_gradient(linear) for index, linear in enumerate(self.linears)}
        }


class BasePose(nn.Module):
    """The frozen base-pose policy: where to park (B, 3) for grasps (B, 4) from robot poses (B, 3)."""

    def __init__(self, policy: BasePosePolicy):
        """A copy of ours.

        Raises:
            ValueError: the policy predicts in the table's frame.
        """
        super().__init__()
        if policy.frame != "object":
            raise ValueError(f"frame: found {policy.frame!r}, allowed is 'object'")
        modules: list[nn.Module] = []
        for kernel, bias in zip(policy.kernels, policy.biases, strict=True):
            linear = nn.Linear(kernel.shape[0], kernel.shape[1])
            _load_linear(linear, {"kernel": kernel, "bias": bias})
            modules += [linear, nn.ReLU()]
        self.layers = nn.Sequential(*modules[:-1]).requires_grad_(False)
        self.mean, self.std = _tensor(policy.mean), _tensor(policy.std)
        self.reach = _tensor(pose_in_frame(jnp.ones(ACTION_SIZE), policy.frame)[:2])

    def forward(self, grasp: Tensor, robot_pose: Tensor) -> Tensor:
        """The deterministic base poses."""
        frame = torch.cat([grasp[:, :2], wrap(grasp[:, 3:])], dim=-1)
        robot_there, table_there = relative(frame, robot_pose), relative(frame, torch.zeros_like(frame))
        angles = [_direction(angle) for angle in (frame[:, 2], robot_pose[:, 2], robot_there[:, 2])]
        places = [grasp[:, :3], robot_pose[:, :2], robot_there[:, :2], table_there[:, :2]]
        observation = (torch.cat([*places, *angles], dim=-1) - self.mean) / self.std
        action = torch.tanh(self.layers(observation)[:, :ACTION_SIZE])
        x, y = (action[:, :2] * self.reach).unbind(-1)
        sine, cosine = torch.sin(frame[:, 2]), torch.cos(frame[:, 2])
        heading = wrap(frame[:, 2] + torch.atan2(action[:, 3], action[:, 2]))
        return torch.stack([frame[:, 0] + cosine * x - sine * y, frame[:, 1] + sine * x + cosine * y, heading], dim=-1)


def relative(frame: Tensor, pose: Tensor) -> Tensor:
    """Poses (B, 3) as seen from frames (B, 3)."""
    sine, cosine = torch.sin(frame[:, 2]), torch.cos(frame[:, 2])
    x, y = (pose[:, :2] - frame[:, :2]).unbind(-1)
    return torch.stack([cosine * x + sine * y, cosine * y - sine * x, wrap(pose[:, 2] - frame[:, 2])], dim=-1)


def wrap(angle: Tensor) -> Tensor:
    """The same angles (rad) in [-pi, pi]."""
    return angle - 2 * math.pi * torch.round(angle / (2 * math.pi))


def _direction(angle: Tensor) -> Tensor:
    return torch.stack([torch.sin(angle), torch.cos(angle)], dim=-1)


def _tensor(array: Any) -> Tensor:
    return torch.tensor(np.asarray(array, np.float32))


def _load_linear(linear: nn.Linear, theirs: Params) -> None:
    with torch.no_grad():
        linear.weight.copy_(_tensor(theirs["kernel"]).T)
        linear.bias.copy_(_tensor(theirs["bias"]))


def _linear_gradient(linear: nn.Linear) -> Params:
    return {"kernel": _gradient(linear.weight).T, "bias": _gradient(linear.bias)}


def _gradient(parameter: Tensor) -> np.ndarray:
    assert parameter.grad is not None, "backward() comes first"
    return parameter.grad.numpy()
