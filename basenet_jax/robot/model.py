"""The robot as one frozen pytree, made by `robot.reading` from its robot file and the model that this names."""

from jax import Array
from jaxtyping import Float

from basenet_jax import struct


@struct.dataclass
class UrFrames:
    """Frames in which an arm is like Universal Robots', though its model's are others: see `ur_frames`."""

    lengths: Float[Array, "6"]  # d1, a2, a3, d4, d5, d6 (m)
    base_rotation: Float[Array, "3 3"]  # of DH frame 0 in frame a
    base_position: Float[Array, "3"]
    flange_rotation: Float[Array, "3 3"]  # of DH frame 6 in the last link
    flange_position: Float[Array, "3"]
    sense: Float[Array, "6"]  # +1 or -1; the model's joint is sense (DH's angle - offset)
    offset: Float[Array, "6"]


@struct.dataclass
class Robot:
    """A mobile manipulator, as arrays that any kernel can be traced over.

    Leaves are float64 NumPy arrays: under jit they become float32, or stay float64 where x64 is enabled, so one
    robot serves both precisions. Pass it to jitted functions as an argument; closed over, it stays in the precision
    that it was traced in first.

    `n` joints, `m` capsules. Frame a is the arm's base frame, frame b the base's.
    """

    joint_rotation: Float[Array, "n 3 3"]  # of each joint frame (z along the axis) in the link before it
    joint_position: Float[Array, "n 3"]  # likewise, m
    tool_rotation: Float[Array, "3 3"]  # of the tool frame in the last link
    tool_position: Float[Array, "3"]
    mount_rotation: Float[Array, "3 3"]  # of frame a in frame b
    mount_position: Float[Array, "3"]
    joint_lower: Float[Array, " n"]  # rad (m for sliding joints)
    joint_upper: Float[Array, " n"]
    joint_speed: Float[Array, " n"]  # rad/s
    joint_acceleration: Float[Array, " n"]  # rad/s^2
    home: Float[Array, " n"]
    stow: Float[Array, " n"]
    capsule_start: Float[Array, "m 3"]  # in the capsule's link
    capsule_end: Float[Array, "m 3"]
    capsule_radius: Float[Array, " m"]
    body_center: Float[Array, "3"]  # of the body box, in frame b
    body_half_size: Float[Array, "3"]
    footprint_half_size: Float[Array, "2"]
    base_speed: Float[Array, "2"]  # m/s, rad/s
    base_acceleration: Float[Array, "2"]  # m/s^2, rad/s^2
    deck: Float[Array, "4"]  # centre x, y and size x, y in frame b
    name: str = struct.field(pytree_node=False)
    model_xml: str = struct.field(pytree_node=False)  # the whole robot as MJCF in primitive shapes: `robot_mjcf`
    joint_names: tuple[str, ...] = struct.field(pytree_node=False)
    prismatic: tuple[bool, ...] = struct.field(pytree_node=False)
    capsule_link: tuple[int, ...] = struct.field(pytree_node=False)  # i: after joint i; in increasing order
    closed_form: str | None = struct.field(pytree_node=False)
    self_pairs: tuple[tuple[int, int], ...] = struct.field(pytree_node=False, default=())  # capsules, see `arm_shapes`
    ur_frames: UrFrames | None = None  # where the closed form is in other frames than the joints'
    omnidirectional: bool = struct.field(pytree_node=False, default=False)  # the base moves in any direction

    @property
    def capsule_meets_body(self) -> tuple[bool, ...]:
        """Which capsules are tested against the body box: all but those of link 1, which always stands next to it."""
        return tuple(link > 1 for link in self.capsule_link)

    @property
    def dof(self) -> int:
        """Number of joints of the arm."""
        return len(self.joint_names)
