"""Where PBG and MBP have their candidates from: the map, or for the -GC variants the full check of every pair."""

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Int

from basenet_jax.planners.candidates import Candidates, check_candidates
from basenet_jax.planners.map_store import MapStore, map_folder
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.planners.reachability import map_candidates
from basenet_jax.task.picking import Reason
from basenet_jax.world.scene import Scene


class CandidateSource:
    """Makes the candidates of scenes on the grid of a setup."""

    def __init__(self, setup: PlannerSetup, *, checked: bool):
        """Of all grid poses clear of the table.

        Args:
            setup: of the planner.
            checked: whether all pairs of pose and object are checked and timed, or looked up in the map.
        """
        self._robot, self._world = setup.robot, setup.world
        self._base_pose = jax.device_put(setup.grid_poses)
        self._maps = None if checked else MapStore(setup.robot, setup.grid, setup.world.pick, map_folder())

    def __call__(self, scene: Scene) -> Candidates:
        """The candidates of an unbatched scene; there are none at all where no grid pose is clear of the table."""
        if not len(self._base_pose):
            nothing = jnp.zeros((0, len(scene.mask)))
            reason = jnp.full(len(scene.mask), Reason.BASE_COLLIDES)
            return Candidates(self._base_pose, nothing.astype(bool), nothing, reason)
        if self._maps is None:
            return check_candidates(self._robot, scene, self._base_pose, world=self._world)
        return map_candidates(self._maps.for_scene(scene), scene, self._base_pose)


def unserved_reason(candidates: Candidates) -> Int[Array, " M"]:
    """Why an object of each slot is not served: its candidates' reason, or that none of them can be driven to."""
    return jnp.where(candidates.reason == Reason.NONE, Reason.UNREACHABLE, candidates.reason)
