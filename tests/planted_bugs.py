"""Small bugs, planted one at a time, to see which of them the tests catch.

`python -m tests.planted_bugs` plants each in a clone of what is committed, runs the tests that should catch it until
the first fails, and checks that this one passes without the bug. `--whole` goes on with the whole fast suite where
none fails; `--where TREE` takes another checkout's code and tests; `--out FILE` keeps the results, and goes on from
those that it holds of the same commit.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LIMIT_S = 1800  # of one run of tests: a bug may make a loop that never ends


@dataclass(frozen=True)
class Bug:
    """A change to the one place of the package where a text stands, and the tests that should fail by it."""

    name: str
    old: str
    new: str
    tests: tuple[str, ...]


def _bug(name: str, old: str, new: str, *tests: str) -> Bug:
    return Bug(name, old, new, tuple(f"tests/{each}" for each in tests))


BUGS = (
    # Kernels.
    _bug(
        "the reach leaves out a link",
        "radius = jnp.sum(lengths[1:])",
        "radius = jnp.sum(lengths[2:])",
        "robot/test_kinematics.py",
        "task/test_reach.py",
        "planners/test_candidates.py",
    ),
    _bug(
        "joints turn about axes through the arm's foot",
        "lever = tuple(chain.tool.origin[k] - chain.origins[k] for k in range(3))",
        "lever = tuple(chain.tool.origin[k] - (chain.origins[k] if k < 2 else 0.0) for k in range(3))",
        "robot/test_kinematics.py",
    ),
    _bug(
        "inverse kinematics steps over the joints' limits",
        "jnp.clip(joints + shrink * change, lower, upper)",
        "jnp.clip(joints + shrink * change, lower - 0.1, upper + 0.1)",
        "robot/test_ik.py",
    ),
    _bug(
        "a large step isn't shrunk by its largest joint",
        "jnp.max(jnp.abs(change), axis=0), max_step)",
        "jnp.abs(change), max_step)",
        "robot/test_ik.py",
    ),
    _bug(
        "an arm stretched too far counts as reaching",
        "ClosedForm(joints, cylinder_shortfall + elbow_shortfall)",
        "ClosedForm(joints, cylinder_shortfall)",
        "robot/test_ur.py",
    ),
    _bug(
        "moves that cruise ramp up for nothing",
        "jnp.maximum(distance - ramps, 0.0) / speed",
        "jnp.maximum(distance - 1.5 * ramps, 0.0) / speed",
        "robot/test_timing.py",
    ),
    _bug(
        "a smoothed law is a little ahead of its acceleration",
        "(x * x - x * over_s) / 2.0 + over_s * over_s / 6.0",
        "(x * x - x * over_s) / 2.0 + over_s * over_s / 4.0",
        "robot/test_time_law.py",
    ),
    _bug(
        "bounding boxes are a radius too small",
        "2.0 * (h + radius + _ROUNDING)",
        "(2.0 * h + radius + _ROUNDING)",
        "world/test_clearance.py",
    ),
    _bug(
        "capsules that hang on one link forget its second one",
        "owner == link]",
        "owner == link][:1]",
        "world/test_clearance.py",
    ),
    _bug(
        "overlap along the base's width mixes up the other's sides",
        "- width - other_length * sine_size - other_width * cosine_size",
        "- width - other_length * cosine_size - other_width * sine_size",
        "test_geometry.py",
    ),
    _bug(
        "a relative pose keeps the frame's heading",
        "[cosine * x + sine * y, cosine * y - sine * x, wrap_angle(pose[..., 2] - frame[..., 2])]",
        "[cosine * x + sine * y, cosine * y - sine * x, wrap_angle(pose[..., 2])]",
        "test_geometry.py",
    ),
    # What driving and picking cost.
    _bug(
        "drives keep half the base's longer side away",
        "jnp.min(robot.footprint_half_size) - config.path_slack_m",
        "jnp.max(robot.footprint_half_size) - config.path_slack_m",
        "task/test_navigation.py",
        "task/test_navigation_properties.py",
    ),
    _bug(
        "clockwise ways go along edges backwards",
        "(following, via, edge.direction + jnp.pi)",
        "(following, via, edge.direction)",
        "task/test_navigation.py",
        "task/test_navigation_properties.py",
    ),
    _bug(
        "the way back to home isn't timed",
        "always = joint_move_duration(robot, jnp.asarray(robot.stow), robot.home) + config.close_s",
        "always = config.close_s",
        "task/test_picking.py",
        "task/test_picking_rules.py",
    ),
    _bug(
        "moves are checked at home instead of near the pre-grasp",
        "np.arange(1, config.swept_points + 1) / (config.swept_points + 1)",
        "np.arange(config.swept_points) / (config.swept_points + 1)",
        "task/test_picking_rules.py",
        "task/test_picking.py",
        "task/test_picking_properties.py",
    ),
    _bug(
        "a symmetric gripper is never turned",
        "return 2 if config.gripper_symmetric else 1",
        "return 1",
        "task/test_picking.py",
        "task/test_picking_rules.py",
        "task/test_arm_solutions.py",
    ),
    _bug(
        "the step that ends an episode wasn't executed",
        "jnp.cumsum(fails, axis=-1) - fails > 0",
        "jnp.cumsum(fails, axis=-1) > 0",
        "task/test_plan.py",
    ),
    _bug(
        "drives cost though the base collides",
        "navigation_time=jnp.where(executed, drive, 0.0)",
        "navigation_time=jnp.where(drives & ~ended, drive, 0.0)",
        "task/test_plan.py",
    ),
    # Planners.
    _bug(
        "exact planning never picks the first object last",
        "np.arange(1, 2**count - 1)",
        "np.arange(1, 2**count - 2)",
        "planners/test_exact_sequence.py",
    ),
    _bug(
        "minimum base poses: at a stop the nearest object comes first",
        "np.lexsort((distance, candidates.pick_time[stop, served]))",
        "np.lexsort((candidates.pick_time[stop, served], distance))",
        "planners/test_mbp.py",
    ),
    _bug(
        "minimum base poses: nearest to the start instead of the stop before",
        "_Tour(tour.length + 1, best, remaining, visited)",
        "_Tour(tour.length + 1, tour.at, remaining, visited)",
        "planners/test_mbp.py",
    ),
    _bug(
        "stops that are kept serve every room",
        "(base_identity(robot), fingerprint(room), aligned,",
        "(base_identity(robot), aligned,",
        "planners/test_prepared_stops.py",
    ),
    _bug(
        "what is in the way is tried by the arm alone",
        'for each in ("blocks_base", "blocks_arm")',
        'for each in ("blocks_arm",)',
        "planners/test_explanation.py",
    ),
    _bug(
        "a road's vias stand the wrong way round",
        "order = jnp.maximum(done.found - 1 - jnp.arange(MOST_VIAS), 0)",
        "order = jnp.minimum(jnp.arange(MOST_VIAS), done.found - 1)",
        "task/test_near_drives.py",
    ),
    _bug(
        "a reversed section forgets a drive",
        "(ahead[j + 1] - ahead[i - 1])",
        "(ahead[j + 1] - ahead[i])",
        "planners/test_stop_search.py",
    ),
    _bug(
        "a stop goes where the detour's drives are least",
        "costs.drive[stop, there] - costs.drive[here, there])",
        "costs.drive[stop, there])",
        "planners/test_stop_search.py",
    ),
    _bug(
        "an idle stop takes another's only object",
        "(load(here)[here] > 1)",
        "(load(here)[here] > 0)",
        "planners/test_stop_search.py",
    ),
    _bug(
        "the first stop's picks cost nothing in refinement",
        "jax.lax.scan(forward, first + at[0], (between, at[1:]))",
        "jax.lax.scan(forward, first, (between, at[1:]))",
        "planners/test_refinement.py",
    ),
    _bug(
        "a rigid motion turns about the table's centre in part",
        "y * (turn_cosine - 1)]",
        "y * turn_cosine]",
        "planners/test_refinement.py",
    ),
    _bug(
        "in a batch all scenes have the first one's objects",
        "flat[scene * slots + slot]",
        "flat[slot]",
        "planners/test_optimistic.py",
        "planners/test_candidates.py",
    ),
    _bug(
        "the grid's last lines are missing",
        "(np.arange(-count, count + 1) * grid.step_m for count in counts)",
        "(np.arange(-count, count) * grid.step_m for count in counts)",
        "planners/test_candidates.py",
    ),
    _bug(
        "the reachability map's headings are rounded down",
        "turn = jnp.round(in_tool[..., 2] * (turns / (2.0 * jnp.pi)))",
        "turn = jnp.floor(in_tool[..., 2] * (turns / (2.0 * jnp.pi)))",
        "planners/test_reachability.py",
        "planners/test_map_candidates.py",
    ),
    _bug(
        "the map of any grasp takes the base's middle for the arm's axis",
        "base_pose[..., 1] + sine * grasp_map.axis[0] + cosine * grasp_map.axis[1] - y",
        "base_pose[..., 1] - y",
        "planners/test_grasp_map.py",
    ),
    _bug(
        "heights in the map of any grasp are rounded down",
        "row = jnp.round(height / shape.step_m) - shape.lowest",
        "row = jnp.floor(height / shape.step_m) - shape.lowest",
        "planners/test_grasp_map.py",
    ),
    _bug(
        "a plan holds however long its picks take",
        "(jnp.abs(exact - thought) <= TOLERANCE_S)",
        "jnp.isfinite(exact)",
        "planners/test_optimistic.py",
        "planners/test_basenet.py",
    ),
    _bug(
        "stops in line take the base for a square",
        "along * length + along[::-1] * width",
        "along * length + along[::-1] * length",
        "planners/test_aligned_stops.py",
    ),
    # Policies.
    _bug(
        "an object attends to itself",
        "neighbours = remaining[..., None, :] & ~jnp.eye(count, dtype=bool)",
        "neighbours = remaining[..., None, :] & jnp.ones((count, count), bool)",
        "policies/test_graph_attention.py",
    ),
    _bug(
        "attention's vector learns from the queries alone",
        'jnp.einsum("...k,...k->k", by_queries, queries) + jnp.einsum("...k,...k->k", by_values, values)',
        'jnp.einsum("...k,...k->k", by_queries, queries)',
        "policies/test_graph_attention.py",
    ),
    _bug(
        "the grasp's frame isn't turned with the object",
        "return compose(grasp_frame(grasp), pose) if",
        "return pose.at[..., :2].add(grasp[..., :2]) if",
        "policies/test_base_pose.py",
    ),
    _bug(
        "the policy sees the robot's heading in W twice",
        "angles = (frame[..., 2], robot_pose[..., 2], robot_there[..., 2])",
        "angles = (frame[..., 2], robot_pose[..., 2], robot_pose[..., 2])",
        "policies/test_base_pose.py",
    ),
    _bug(
        "after an idle stop the drive begins at the start",
        "return jnp.where(stop == END, before, stop), jnp.where(stop == END, 0.0, leg)",
        "return stop, jnp.where(stop == END, 0.0, leg)",
        "policies/test_stop_rollout.py",
    ),
    _bug(
        "a visit costs none of the spare ones",
        "spare=state.spare - 1 + jnp.sum(served, axis=-1)",
        "spare=state.spare + jnp.sum(served, axis=-1)",
        "policies/test_stop_rollout.py",
        "policies/test_stop_policy.py",
    ),
    # Learners.
    _bug(
        "the temperature steers away from its target",
        "surplus = -distribution.log_prob(logits, raw) - target_entropy",
        "surplus = -distribution.log_prob(logits, raw) + target_entropy",
        "learning/test_sac.py",
    ),
    _bug(
        "critics learn unscaled rewards",
        "value - self.config.reward_scale * memory.reward[:, None]",
        "value - memory.reward[:, None]",
        "learning/test_sac.py",
    ),
    _bug(
        "the reward for grasping fast counts the drive too",
        "reward.grasping / (1.0 + picks.time)",
        "reward.grasping / (1.0 + drive + picks.time)",
        "learning/test_base_pose_env.py",
    ),
    _bug(
        "the baseline's t-test has a degree of freedom too many",
        "jax.scipy.special.betainc(0.5 * (count - 1), 0.5,",
        "jax.scipy.special.betainc(0.5 * count, 0.5,",
        "learning/test_reinforce.py",
    ),
    _bug(
        "the baseline is replaced by a worse policy",
        "baseline=pick(state.params, state.baseline)",
        "baseline=pick(state.baseline, state.params)",
        "learning/test_reinforce.py",
    ),
    _bug(
        "dear episodes are made likelier",
        "weight = self.config.navigation_weight * advantage",
        "weight = -self.config.navigation_weight * advantage",
        "learning/test_reinforce.py",
    ),
    _bug(
        "choices are weighted by another episode",
        "own = jnp.where(counts, weight[episode] / episodes, 0.0)",
        "own = jnp.where(counts, weight[choice // slots] / episodes, 0.0)",
        "learning/test_policy_gradient.py",
    ),
    _bug(
        "imitated problems are turned, their answers not",
        "jnp.where(answers == END, END, jnp.asarray(self.half_turn)[answers])",
        "answers",
        "learning/test_stop_learning.py",
    ),
    _bug(
        "one checkpoint more than asked for is kept",
        "number < step and kept < keep and",
        "number < step and kept <= keep and",
        "learning/test_checkpoint.py",
    ),
    # Files.
    _bug(
        "objects may stand half a table beside it",
        "if abs(item.pose[axis]) > side / 2:",
        "if abs(item.pose[axis]) > side:",
        "world/test_scene_file.py",
    ),
    _bug(
        "a plan file's grasp is the waypoint above it",
        "grasp=shortest(joints[-1])",
        "grasp=shortest(joints[-2])",
        "task/test_plan_file.py",
    ),
    _bug(
        "numbers without a sign in the exponent are text",
        "(?:[eE][-+]?[0-9]+)?",
        "(?:[eE][-+][0-9]+)?",
        "world/test_scene_file.py",
    ),
    _bug(
        "a weights file's checksum isn't compared",
        "if hashlib.sha256(body).hexdigest().encode() != checksum:",
        "if len(checksum) != 64:",
        "test_weights_file.py",
    ),
    _bug(
        "exported base goals are turned the wrong way",
        "pose[..., :2] @ rotation.T + np.array([x, y])",
        "pose[..., :2] @ rotation + np.array([x, y])",
        "exports/test_schedule.py",
    ),
    # Viewer.
    _bug(
        "objects can be dragged beside the table",
        "seen = np.clip(in_frame(top, np.asarray(pose[:2], float)), -half, half)",
        "seen = np.clip(in_frame(top, np.asarray(pose[:2], float)), -2 * half, 2 * half)",
        "viewer/test_editing.py",
    ),
    _bug(
        "a new object is put where it is nearest to others",
        "for index in np.argsort(-gap, kind=",
        "for index in np.argsort(gap, kind=",
        "viewer/test_editing.py",
    ),
    _bug(
        "objects on a surface that is turned keep their yaw",
        "poses[carried, 2] += after[2] - before[2]",
        "poses[carried, 2] += 0.0",
        "viewer/test_furnishing.py",
    ),
    _bug(
        "the viewer obeys pages of other servers on this machine",
        "if origins and urlsplit(origins[0]).netloc.lower() != hosts[0].lower():",
        "if origins and _hostname(urlsplit(origins[0]).netloc) != _hostname(hosts[0]):",
        "viewer/test_serving.py",
    ),
    _bug(
        "the timeline plays at life's speed whatever is chosen",
        "self.time_s += FRAME_S * self.speed",
        "self.time_s += FRAME_S",
        "viewer/test_timeline.py",
    ),
    _bug(
        "the slowest of equal headings is shown",
        "np.lexsort((np.sum(picks.time * feasible, axis=1), collides,",
        "np.lexsort((-np.sum(picks.time * feasible, axis=1), collides,",
        "viewer/test_asking.py",
    ),
    _bug(
        "objects on the deck stand in one another",
        "row, column = divmod(index, columns)",
        "row, column = divmod(index, rows)",
        "viewer/test_execution.py",
    ),
)


def place_of(old: str, tree: Path) -> Path:
    """The file of the package in which a text stands once, and nowhere else.

    Raises:
        ValueError: it stands nowhere, or more than once.
    """
    files = sorted((tree / "basenet_jax").rglob("*.py"))
    counts = {path: count for path in files if (count := path.read_text(encoding="utf-8").count(old))}
    if sum(counts.values()) != 1:
        found = {path.relative_to(tree).as_posix(): count for path, count in counts.items()}
        raise ValueError(f"{old!r}: found {found or 'nowhere'}, needs one place in the package")
    return next(iter(counts))


def try_bug(bug: Bug, clone: Path, *, whole: bool) -> dict[str, Any]:
    """Whether the tests of a clone catch a bug, and which one does first; the clone is left as it was.

    Raises:
        ValueError: the text, or every test named, is missing there; or the test that failed does so without the bug.
        RuntimeError: pytest was stopped by something other than a failing test.
    """
    tests = [each for each in bug.tests if (clone / each).exists()]
    if not tests:
        raise ValueError(f"{bug.name}: none of {', '.join(bug.tests)} is in the tree")
    path, start = place_of(bug.old, clone), time.perf_counter()
    source = path.read_text(encoding="utf-8")
    path.write_text(source.replace(bug.old, bug.new), encoding="utf-8")
    try:
        failed, among = _first_failure(clone, tests), tests
        if failed is None and whole:
            failed, among = _first_failure(clone, ["tests"]), ["tests"]
    finally:
        path.write_text(source, encoding="utf-8")
    if failed not in (None, "none ended") and _first_failure(clone, [failed]):
        raise ValueError(f"{bug.name}: {failed} fails without any bug")
    return {
        "what": bug.name,
        "file": path.relative_to(clone).as_posix(),
        "tests": among,
        "caught": failed is not None,
        "by": failed,
        "wall_s": round(time.perf_counter() - start, 1),
    }


def _first_failure(clone: Path, tests: list[str]) -> str | None:
    """The first fast test that fails; None if all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "--tb=no", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(clone), "COLUMNS": "1000"}
    try:
        run = subprocess.run(
            command, cwd=clone, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return "none ended"
    if run.returncode == 0:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) (tests.+?)(?: - .*)?$", run.stdout, re.MULTILINE)
    if run.returncode != 1 or failed is None:
        ended = f"ended with {run.returncode}\n{run.stdout[-2000:]}{run.stderr[-2000:]}"
        raise RuntimeError(f"{' '.join(command)}: {ended}")
    return failed[1]


def main() -> None:
    """The command; see the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="parts of bugs' names (default: all bugs)")
    parser.add_argument("--where", type=Path, default=ROOT, metavar="TREE", help="a checkout (default: this one)")
    parser.add_argument("--whole", action="store_true", help="the whole fast suite where the named tests pass")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where results are kept")
    options = parser.parse_args()
    chosen = [bug for bug in BUGS if not options.names or any(part in bug.name for part in options.names)]
    if not chosen:
        parser.error(f"found no bug named like {', '.join(options.names)}")
    tree = options.where.resolve()
    report = _head(tree)
    if options.out and options.out.exists():
        kept = json.loads(options.out.read_text(encoding="utf-8"))
        if kept["commit"] != report["commit"]:
            parser.error(f"--out: {options.out} is of commit {kept['commit']['hash']}; name another file")
        report = kept
    known = {bug.name for bug in BUGS}
    done = {each["what"]: each for each in report["results"] if each["what"] in known}
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "clone"
        subprocess.run(
            ["git", "-c", "advice.detachedHead=false", "clone", "--quiet", "--shared", str(tree), str(clone)],
            check=True,
        )
        (tree / ".jax_cache").mkdir(exist_ok=True)
        (clone / ".jax_cache").symlink_to(tree / ".jax_cache")
        for bug in chosen:
            if bug.name in done and (done[bug.name]["caught"] or not options.whole):
                continue
            done[bug.name] = result = try_bug(bug, clone, whole=options.whole)
            print(f"{result['wall_s']:7.1f} s  {bug.name}: {result['by'] or 'SURVIVED'}", flush=True)
            if options.out:
                report["results"] = [done[each.name] for each in BUGS if each.name in done]
                options.out.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    results = [done[bug.name] for bug in chosen]
    print(f"{sum(each['caught'] for each in results)} of {len(results)} bugs caught")


def _head(tree: Path) -> dict[str, Any]:
    """What says where results are of."""
    from benchmarks import environment  # imports JAX

    head = subprocess.run(["git", "-C", str(tree), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    return {
        "benchmark": "planted_bugs",
        "command": environment.command("tests.planted_bugs", sys.argv[1:]),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "commit": {"hash": head.stdout.strip(), "dirty": False},  # a clone's
        "load_average_at_start": round(os.getloadavg()[0], 2),
        "hardware": environment.hardware(),
        "versions": environment.versions(),
        "results": [],
    }


if __name__ == "__main__":
    main()
