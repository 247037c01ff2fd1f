"""What weights files say of their networks beside the arrays: all that is static."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from basenet_jax.policies.base_pose import BaseFrame
from basenet_jax.policies.grasp_sequence import GraspSequencePolicy
from basenet_jax.policies.stop_policy import StopPolicy

_Width = Annotated[int, Meta(ge=1, le=65_536)]
_Layers = Annotated[int, Meta(ge=1, le=256)]


class BasePoseNetwork(Struct, forbid_unknown_fields=True, frozen=True):
    """Of a `BasePosePolicy`."""

    frame: BaseFrame = "object"
    hidden: Annotated[tuple[_Width, ...], Meta(min_length=1, max_length=256)] = (256, 256, 256)


class SequenceNetwork(Struct, forbid_unknown_fields=True, frozen=True):
    """Of a `GraspSequencePolicy`."""

    features: _Width = 64
    layers: _Layers = 5
    attention: bool = True

    @classmethod
    def of(cls, policy: GraspSequencePolicy) -> "SequenceNetwork":
        """What the policy is made of."""
        return cls(policy.features, policy.layers, policy.attention)

    def make(self) -> GraspSequencePolicy:
        """The policy."""
        return GraspSequencePolicy(**msgspec.structs.asdict(self))


class StopNetwork(Struct, forbid_unknown_fields=True, frozen=True):
    """Of a `StopPolicy`."""

    features: _Width = 48
    layers: _Layers = 2
    considered: Annotated[int, Meta(ge=1, le=1_000_000)] = 64

    @classmethod
    def of(cls, policy: StopPolicy) -> "StopNetwork":
        """What the policy is made of."""
        return cls(policy.features, policy.layers, policy.considered)

    def make(self) -> StopPolicy:
        """The policy."""
        return StopPolicy(**msgspec.structs.asdict(self))


class Networks(Struct, forbid_unknown_fields=True, frozen=True):
    """Of all layers; by default those of the presets, as files say nothing that were written before this was kept."""

    base_pose: BasePoseNetwork = BasePoseNetwork()
    sequence: SequenceNetwork = SequenceNetwork()
    stops: StopNetwork = StopNetwork()

    def as_metadata(self) -> dict[str, Any]:
        """What a weights file keeps of it."""
        return {"networks": msgspec.to_builtins(self)}


def read_networks(metadata: dict[str, Any]) -> Networks:
    """The networks that a weights file's metadata describe.

    Raises:
        ValueError: there are no such networks; the message says which field, what was found and what is allowed.
    """
    older = {"base_pose": {"frame": metadata.get("base_pose_frame", "object")}}
    try:
        return msgspec.convert(metadata.get("networks", older), Networks)
    except msgspec.ValidationError as error:
        raise ValueError(f"networks: {error}") from None
