"""Planners hold to what they were made for: a robot that can rest beside the table, and scenes with this table."""

from collections.abc import Callable, Sequence

import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from basenet_jax.documents.fields import DocumentError
from basenet_jax.planners.protocol import BatchPlanner, Planner, PlannerSetup, PreparedPlanner
from basenet_jax.robot.rest import check_body, check_tables
from basenet_jax.task.plan import Plan
from basenet_jax.world.scene import Scene, Table

_ROUNDING = 1e-6  # m


def hold_to(setup: PlannerSetup, planner: Planner) -> Planner:
    """The planner, but that it refuses scenes with another table than it was made for.

    Args:
        setup: that it was made for.
        planner: whose `plan_batch` and preparations it keeps.
    """
    return (_TogetherOnItsTable if isinstance(planner, BatchPlanner) else _OnItsTable)(planner, setup.table)


def check_rest(setup: PlannerSetup) -> None:
    """That the robot's arm, before and after a pick, touches neither its body nor the table.

    Raises:
        ValueError: it does, or may; the message names the robot, the joints, the link and what is allowed.
    """
    try:
        check_body(setup.robot, setup.world.pick)
        check_tables(setup.robot, float(setup.table.height), setup.world.pick)
    except DocumentError as error:
        raise ValueError(f"robot {setup.robot.name}: {error}") from None


def table_sizes(table: Table) -> Float[np.ndarray, "*batch 3"]:
    """Length, width, height (m) along the last axis."""
    table = jax.device_get(table)
    return np.concatenate([2 * np.asarray(table.half_size), np.asarray(table.height)[..., None]], axis=-1)


class _OnItsTable:
    """A planner of scenes with one table."""

    def __init__(self, planner: Planner, table: Table):
        self._planner, self._sizes = planner, table_sizes(table)

    def __call__(self, scene: Scene, key: Array) -> Plan:
        """See `Planner`."""
        self._check(scene.table)
        return self._planner(scene, key)

    def preparations(self, scene: Scene) -> Sequence[Callable[[], object]]:
        """See `PreparedPlanner`; none where the planner has none."""
        return self._planner.preparations(scene) if isinstance(self._planner, PreparedPlanner) else ()

    def _check(self, table: Table) -> None:
        found = table_sizes(table)
        if not np.all(np.abs(found - self._sizes) <= _ROUNDING):
            (length, width, height), (x, y, z) = self._sizes, np.reshape(found, (-1, 3))[0]
            allowed = f"is the planner's of {length:.3f} x {width:.3f} m, {height:.3f} m high"
            raise ValueError(f"table: found one of {x:.3f} x {y:.3f} m, {z:.3f} m high, allowed {allowed}")


class _TogetherOnItsTable(_OnItsTable):
    """A planner of batches of such scenes."""

    def plan_batch(self, scenes: Scene, key: Array) -> Plan:
        """See `BatchPlanner`."""
        self._check(scenes.table)
        assert isinstance(self._planner, BatchPlanner)
        return self._planner.plan_batch(scenes, key)
