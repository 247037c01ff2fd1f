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
from basenet_jax.world import mujoco_scene
from basenet_jax.world.boxes import Room
from basenet_jax.world.mujoco_scene import PARKED
from basenet_jax.world.scene import MAX_OBJECTS, Scene

with contextlib.redirect_stdout(io.StringIO()):  # it reports there that the optional package warp is missing
    from mujoco import mjx

CHUNK = 4096  # states that `arm_touches` gives to MJX at a time


@struct.dataclass
class MjxScene:
    """The MJX model of a table, a robot and object slots, and what is needed to place and to query them."""

    model: Any  # mjx.Model
    blank: Any  # mjx.Data with all objects parked
    room: Room
    addresses: tuple[int, ...] = struct.field(pytree_node=False)  # of base pose and joints in qpos
    table_geoms: tuple[int, int] = struct.field(pytree_node=False)  # the table's box, the grown table
    config: PickConfig = struct.field(pytree_node=False)

    @classmethod
    def create(
        cls, robot: Robot, room: Room | None = None, slots: int = MAX_OBJECTS, config: PickConfig = PickConfig()
    ) -> "MjxScene":
        """Builds the model; call it once.

        Args:
            robot: the robot (concrete).
            table: one table; may be traced. The default config's if None.
            slots: how many objects there can be. Contacts don't involve them, so 0 is cheapest where nothing is shown.
            config: the base's clearance, and up to which distance it counts as touching.
        """
        with jax.ensure_compile_time_eval():
            first = Room.from_config(TableConfig())
            model = mujoco_scene.build_model(robot, first, np.full((slots, 3), 0.1), config=config)
            addresses = tuple(int(address) for address in mujoco_scene.state_addresses(robot, model))
            geoms = (model.geom(f"{mujoco_scene.BOX} 0").id, model.geom(f"{mujoco_scene.KEEP_OUT} 0").id)
            scene = cls(mjx.put_model(model), mjx.make_data(model), first, addresses, geoms, config)
        return scene if room is None else scene.with_table(room)

    def with_table(self, room: Room) -> "MjxScene":
        """The same with another table, which may be traced or vmapped over."""
        box, grown = self.table_geoms
        clearance = self.config.base_clearance_m
        half_height = room.table_height / 2
        sizes, positions = self.model.geom_size, self.model.geom_pos
        sizes = sizes.at[box].set(jnp.append(room.table_half_size, half_height).astype(sizes.dtype))
        sizes = sizes.at[grown, :2].set((room.table_half_size + clearance).astype(sizes.dtype))
        positions = positions.at[box, 2].set(half_height)
        return self.replace(model=self.model.replace(geom_size=sizes, geom_pos=positions), room=room)

    def place(self, scene: Scene, base_pose: Float[Array, "3"], joints: Float[Array, " dof"]) -> mjx.Data:
        """One state with frames computed, unbatched; vmap it over scenes, poses and joints.

        Args:
            scene: its objects (at most the model's slots; unused ones are parked); its table is ignored, see
                `with_table`.
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
        """Whether the footprint touches the grown table (rule 1)."""
        return self.distances(data)[0] <= self.config.touching_m

    def arm_touches(self, data: mjx.Data) -> Bool[Array, ""]:
        """Whether a capsule of arm or gripper touches the table's box or the body box (rule 4)."""
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
        table: one table, or a batch of them that broadcasts against the states.
    """
    # Of the arrays the model holds only the footprint, which this rule doesn't need.
    scene = MjxScene.create(robot.replace(footprint_half_size=np.ones(2)), slots=0)
    states = jnp.stack(jnp.broadcast_arrays(*base_pose, *joints), axis=-1)
    shape = states.shape[:-1]
    half_size = jnp.broadcast_to(room.table_half_size, (*shape, 2)).reshape(-1, 2)
    rooms = Room.of_table(half_size=half_size, height=jnp.broadcast_to(room.table_height, shape).reshape(-1))

    def touches(case: tuple[Array, Room]) -> Array:
        state, room = case
        placed = scene.with_table(room)
        return placed.arm_touches(placed.move(placed.blank, state[:3], state[3:]))

    return jax.lax.map(touches, (states.reshape(-1, states.shape[-1]), rooms), batch_size=CHUNK).reshape(shape)
