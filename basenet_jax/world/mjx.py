"""The scene in MJX: MuJoCo's model and contacts under jit and vmap.

MJX's contacts of a capsule with a box are not exact: where the capsule's axis passes an edge of the box within 8
degrees of a face's normal, just beside the face, the contact is dropped. Against MuJoCo and the kernels of
`clearance`, which agree to 1e-8 m, MJX missed 86 of 65 thousand touching arm states of 200 thousand random ones (up to
53 mm deep, always less than the capsule's radius) and never found a touch where there is none; its contacts of the
base differ from theirs by float32's rounding only. So the kernels decide, MuJoCo has the last word, and MJX is for
comparison and for models beyond the kernels.

The import takes seconds and most uses don't need it, so no module of the package imports this one by default.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module comes without type stubs.)

import contextlib
import io
from collections.abc import Callable
from typing import Any

import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from basenet_jax import struct
from basenet_jax.config import PickConfig, TableConfig
from basenet_jax.robot.kinematics import Vector
from basenet_jax.robot.model import Robot
from basenet_jax.robot.robot_mjcf import BODY
from basenet_jax.world import mujoco_scene
from basenet_jax.world.boxes import Room, blocks
from basenet_jax.world.mujoco_scene import PARKED
from basenet_jax.world.scene import MAX_OBJECTS, Scene

with contextlib.redirect_stdout(io.StringIO()):  # it reports there that the optional package warp is missing
    from mujoco import mjx

CHUNK = 4096  # states that `arm_touches` gives to MJX at a time


@struct.dataclass
class MjxScene:
    """The MJX model of a room of B boxes, a robot and object slots, and what is needed to place and to query them."""

    model: Any  # mjx.Model
    blank: Any  # mjx.Data with all objects parked
    room: Room
    addresses: tuple[int, ...] = struct.field(pytree_node=False)  # of base pose and joints in qpos
    boxes: tuple[tuple[int, int], ...] = struct.field(pytree_node=False)  # geoms of each: the box, the grown one
    body_top: float = struct.field(pytree_node=False)  # m, of the robot's body: higher boxes don't block the base
    config: PickConfig = struct.field(pytree_node=False)

    @classmethod
    def create(
        cls, robot: Robot, room: Room | None = None, slots: int = MAX_OBJECTS, config: PickConfig = PickConfig()
    ) -> "MjxScene":
        """Builds the model; call it once.

        Args:
            robot: the robot (concrete).
            room: one room; may be traced. The default config's table if None.
            slots: how many objects there can be. Contacts don't involve them, so 0 is cheapest where nothing is shown.
            config: the base's clearance, and up to which distance it counts as touching.
        """
        count = 1 if room is None else room.boxes.low.shape[-1]
        with jax.ensure_compile_time_eval():
            table = Room.from_config(TableConfig())
            alike = table.replace(boxes=jax.tree.map(lambda x: np.repeat(x, count, axis=0), table.boxes))
            model = mujoco_scene.build_model(robot, alike, np.full((slots, 3), 0.1), config=config)
            addresses = tuple(int(address) for address in mujoco_scene.state_addresses(robot, model))
            names = [(f"{mujoco_scene.BOX} {i}", f"{mujoco_scene.KEEP_OUT} {i}") for i in range(count)]
            geoms = tuple((model.geom(own).id, model.geom(grown).id) for own, grown in names)
            body = model.geom(mujoco_scene.ROBOT + BODY)
            top = float(body.pos[2] + body.size[2])
            scene = cls(mjx.put_model(model), mjx.make_data(model), alike, addresses, geoms, top, config)
        return scene.with_room(table if room is None else room)

    def with_room(self, room: Room) -> "MjxScene":
        """The same with another room of as many boxes, which may be traced or vmapped over.

        A box that doesn't block the arm, or the base, is far below the floor to what asks for the other's contacts.
        """
        boxes, (own, grown) = room.boxes, np.array(self.boxes).T
        if boxes.low.shape[-1] != len(own):
            raise ValueError(f"room: found {boxes.low.shape[-1]} boxes, allowed are {len(own)}, as the model has")
        clearance, below = self.config.base_clearance_m, PARKED[2]
        sizes, positions, turns = self.model.geom_size, self.model.geom_pos, self.model.geom_quat
        half, middle = 0.5 * (boxes.high - boxes.low), 0.5 * (boxes.high + boxes.low)
        half_yaw = 0.5 * boxes.pose[:, 2]
        turn = jnp.zeros((len(own), 4)).at[:, 0].set(jnp.cos(half_yaw)).at[:, 3].set(jnp.sin(half_yaw))
        heights = (
            (own, jnp.where(boxes.blocks_arm, middle, below - half)),
            (grown, jnp.where(blocks(boxes, self.body_top), mujoco_scene.SLAB, below)),
        )
        for geoms, height in heights:
            at = jnp.concatenate([boxes.pose[:, :2], height[:, None]], axis=-1)
            positions = positions.at[geoms].set(at.astype(positions.dtype))
            turns = turns.at[geoms].set(turn.astype(turns.dtype))
        size = jnp.concatenate([boxes.half_size, half[:, None]], axis=-1)
        sizes = sizes.at[own].set(size.astype(sizes.dtype))
        sizes = sizes.at[grown, :2].set((boxes.half_size + clearance).astype(sizes.dtype))
        model = self.model.replace(geom_size=sizes, geom_pos=positions, geom_quat=turns)
        return self.replace(model=model, room=room)

    def place(self, scene: Scene, base_pose: Float[Array, "3"], joints: Float[Array, " dof"]) -> mjx.Data:
        """One state with frames computed, unbatched; vmap it over scenes, poses and joints.

        Args:
            scene: its objects (at most the model's slots; unused ones are parked); its room is ignored, see
                `with_room`.
            base_pose: x, y (m), heading (rad) in W.
            joints: rad.
        """
        count = scene.object_pose.shape[-2]
        half_yaw = 0.5 * scene.object_pose[:, 2]
        z = scene.surface_height + 0.5 * scene.object_size[:, 2]
        at = jnp.concatenate([scene.object_pose[:, :2], z[:, None]], axis=-1)
        turn = jnp.zeros((count, 4)).at[:, 0].set(jnp.cos(half_yaw)).at[:, 3].set(jnp.sin(half_yaw))
        at = jnp.where(scene.mask[:, None], at, jnp.array(PARKED))
        data = self.blank.replace(
            mocap_pos=self.blank.mocap_pos.at[:count].set(at), mocap_quat=self.blank.mocap_quat.at[:count].set(turn)
        )
        return self.move(data, base_pose, joints)

    def move(self, data: mjx.Data, base_pose: Float[Array, "3"], joints: Float[Array, " dof"]) -> mjx.Data:
        """The state with the robot elsewhere, frames computed."""
        state = jnp.concatenate([base_pose, joints]).astype(data.qpos.dtype)
        data = data.replace(qpos=data.qpos.at[np.array(self.addresses)].set(state))
        return _materialise(mjx.kinematics)(self.model, data)

    def distances(self, data: mjx.Data) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Distance (m) of the deepest contact of rule 1 and of rule 4: negative inside, about 1 where there is none."""
        contact = mjx.collision(self.model, data)._impl.contact
        # MJX sorts by dimension and knows it while tracing; slices let XLA drop the rule that isn't asked for.
        of_base = int(np.sum(contact.dim == mujoco_scene.BASE_DIMENSION))
        return jnp.min(contact.dist[:of_base]), jnp.min(contact.dist[of_base:])

    def base_touches(self, data: mjx.Data) -> Bool[Array, ""]:
        """Whether the footprint touches a grown box (rule 1); the floor's bounds are no matter of contacts."""
        return self.distances(data)[0] <= self.config.touching_m

    def arm_touches(self, data: mjx.Data) -> Bool[Array, ""]:
        """Whether a capsule of arm or gripper touches a box or the body box (rule 4)."""
        return self.distances(data)[1] <= 0.0


def _materialise(function: Callable) -> Callable:
    """The same function (of pytrees, without loops inside), with every vector it concatenates held in memory.

    MJX makes each quaternion along the arm by concatenating four products of the one before. XLA for CPUs fuses the
    whole chain and computes the parent anew for each component, four times as often per link: 50 ms instead of 1 us
    for six joints. An optimization barrier behind each concatenation prevents it.
    """

    def evaluate(jaxpr: Any, constants: Any, arguments: Any) -> list[Any]:
        values = dict(zip(jaxpr.constvars + jaxpr.invars, [*constants, *arguments], strict=True))

        def read(variable: Any) -> Any:
            return variable.val if isinstance(variable, jax.extend.core.Literal) else values[variable]

        for equation in jaxpr.eqns:
            inputs = [read(variable) for variable in equation.invars]
            if equation.primitive.name == "jit":
                inner = equation.params["jaxpr"]
                outputs = evaluate(inner.jaxpr, inner.consts, inputs)
            else:
                outputs = equation.primitive.bind(*inputs, **equation.params)
                outputs = outputs if equation.primitive.multiple_results else [outputs]
            if equation.primitive.name == "concatenate":
                outputs = jax.lax.optimization_barrier(outputs)
            values.update(zip(equation.outvars, outputs, strict=True))
        return [read(variable) for variable in jaxpr.outvars]

    def wrapped(*arguments: Any) -> Any:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
        outputs = evaluate(closed.jaxpr, closed.consts, jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(shape), outputs)

    return wrapped


def arm_touches(robot: Robot, base_pose: Vector, joints: Float[Array, "dof *batch"], room: Room) -> Array:
    """Rule 4 by MJX's contacts, for `pick(..., arm_check=arm_touches)`.

    Frames and shapes are those of the robot's MJCF, whatever its arrays say.

    Args:
        robot: the robot; its arrays may be traced.
        base_pose: x, y (m), heading (rad) in W, struct of arrays.
        joints: rad; its batch broadcasts against the pose's.
        room: one room, or a batch of them that broadcasts against the states.
    """
    # Of the arrays the model holds only the footprint, which this rule doesn't need.
    one = jax.tree.map(lambda x: x.reshape(-1, *x.shape[room.boxes.low.ndim - 1 :])[0], room)
    scene = MjxScene.create(robot.replace(footprint_half_size=np.ones(2)), one, slots=0)
    states = jnp.stack(jnp.broadcast_arrays(*base_pose, *joints), axis=-1)
    shape = states.shape[:-1]
    rows = states.reshape(-1, states.shape[-1])

    def touches(state: Array, placed: MjxScene) -> Array:
        return placed.arm_touches(placed.move(placed.blank, state[:3], state[3:]))

    if not room.batched:
        found = jax.lax.map(lambda state: touches(state, scene), rows, batch_size=CHUNK)
    else:
        rooms = _as_rows(room, room.boxes.low.ndim - 1, shape)
        found = jax.lax.map(lambda case: touches(case[0], scene.with_room(case[1])), (rows, rooms), batch_size=CHUNK)
    return found.reshape(shape)


def _as_rows(room: Room, own: int, batch: tuple[int, ...]) -> Room:
    """Rooms whose batch has so many axes, broadcast to a batch, one for each of its rows."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, *x.shape[own:])).reshape(-1, *x.shape[own:]), room)
