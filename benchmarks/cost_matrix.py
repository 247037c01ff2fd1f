"""The cost matrix that exact planning needs: all pick times between the grid's base poses and a scene's objects.

Ours is `planners.candidates.check_candidates` on the paper's grid (10 cm, 45 degrees) with ten objects: every pair at
once, in float32 on all cores. Set beside it is the same computed one pair at a time as planners do that are written
with ordinary tools (`one_at_a_time`: EAIK for inverse kinematics, MuJoCo in C for collisions, NumPy for the rest, one
core). A pair is one base pose and one object. Ours first drops the pairs that are out of the arm's sphere, some 85 %;
one at a time is measured with this and without, where EAIK finds that they are out of reach. The whole matrix one pair
at a time is not computed but extrapolated, from a random sample of all pairs. `agree` is the share of the sample in
which both say alike whether the object can be picked.
"""

import dataclasses
import sys
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from basenet_jax.evaluation.orders import random_scenes
from basenet_jax.planners.candidates import Candidates, check_candidates
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.robot.reading import load_robot
from basenet_jax.world.scene import Scene
from benchmarks.harness import Options, Report, parse, speed_table
from benchmarks.peers import installed
from benchmarks.timing import compare, measure, measure_plain, speed

NAME = "cost_matrix"
OURS = "whole matrix at once"


@dataclass(frozen=True)
class CostMatrixOptions(Options):
    """Options, and how much is costed."""

    objects: int = 10
    """In the scene."""
    sample: int = 4_000
    """Pairs that are costed one at a time."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(CostMatrixOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    options = dataclasses.replace(options, sample=300) if options.quick else options
    setup = PlannerSetup()
    batch = random_scenes(jax.random.key(options.seed), options.objects, 1)
    scene: Scene = jax.tree.map(lambda x: x[0], batch)

    def check(scene: Scene) -> Candidates:
        return check_candidates(setup.robot, scene, setup.grid_poses, world=setup.world)

    pairs = len(setup.grid_poses) * options.objects
    timing = measure(check, [(scene,)], repeats=options.repeats)
    results = [speed(OURS, "pairs/s", pairs, timing, pairs=pairs, whole_matrix_s=float(np.median(timing.runs_s)))]
    if installed("eaik", asked_by=NAME):
        expected = np.asarray(jax.jit(check)(scene).pick_time)
        results += [_one_at_a_time(setup, scene, expected, options, sphere=sphere) for sphere in (True, False)]
    table = speed_table("Cost matrix", results, "pairs", "whole_matrix_s", "agree")
    comparisons = [compare(results[0], row, at=f"{options.objects} objects") for row in results[1:]]
    facts = {"grid_poses": len(setup.grid_poses), "extrapolated": [row["what"] for row in results[1:]]}
    return report.finish(results, table=table, comparisons=comparisons, **facts)


def _one_at_a_time(
    setup: PlannerSetup, scene: Scene, expected: np.ndarray, options: CostMatrixOptions, *, sphere: bool
) -> dict[str, Any]:
    from benchmarks.one_at_a_time import OneAtATime

    costs = OneAtATime(load_robot(), setup.room, setup.world.pick, sphere=sphere)
    poses, grasps = np.asarray(setup.grid_poses, float), np.asarray(scene.first_grasp, float)
    sample = np.random.default_rng(options.seed).choice(expected.size, min(options.sample, expected.size), False)
    rows, columns = np.unravel_index(sample, expected.shape)

    def run() -> np.ndarray:
        return np.array(
            [costs.pick_time(poses[row], grasps[column]) for row, column in zip(rows, columns, strict=True)]
        )

    found, theirs = run(), expected[rows, columns]
    both = np.isfinite(found) & np.isfinite(theirs)
    timing = measure_plain(run, repeats=options.repeats)
    facts = {
        "pairs": len(sample),
        "whole_matrix_s": float(np.median(timing.runs_s)) * expected.size / len(sample),
        "agree": float(np.mean(np.isfinite(found) == np.isfinite(theirs))),
        "largest_time_difference_s": float(np.max(np.abs(found[both] - theirs[both]), initial=0.0)),
    }
    what = "one pair at a time" + ("" if sphere else ", no sphere")
    return speed(what, "pairs/s", len(sample), timing, **facts)


if __name__ == "__main__":
    main()
