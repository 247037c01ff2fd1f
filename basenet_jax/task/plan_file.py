"""Plan files, `basenet-plan/1`: what a robot, or a person, needs of a plan."""

import dataclasses
import os
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from msgspec import UNSET, UnsetType, to_builtins

from basenet_jax.atomic import write_atomically
from basenet_jax.config import UncertaintyConfig, WorldConfig
from basenet_jax.documents.config_file import ConfigFileError, differences, overlay
from basenet_jax.documents.fields import DocumentError, convert, describe, field_error, shortest
from basenet_jax.documents.text_files import read_json, to_json
from basenet_jax.robot.reading import load_robot, robot_name
from basenet_jax.task.drives import DockedDrives, make_drives
from basenet_jax.task.manoeuvre import Leg, Manoeuvre
from basenet_jax.task.picking import Reason
from basenet_jax.task.plan import Outcome, Plan
from basenet_jax.task.plan_fields import (
    ALLOWED,
    FORMAT,
    ArmFields,
    LegFields,
    PlanFields,
    StepFields,
    TotalsFields,
    UncertaintyFields,
    WorldFields,
)
from basenet_jax.world.scene import NamedScene

REASONS = {reason.name.lower(): reason for reason in Reason if reason != Reason.NONE}


class PlanFileError(ValueError):
    """A file that holds no plan of the scene; the message names the file, the field, what was found and allowed."""


def save_plan(
    path: str | os.PathLike[str],
    scene: NamedScene,
    plan: Plan,
    outcome: Outcome,
    *,
    planner: str,
    planning_time_s: float,
    compile_time_s: float,
    world: WorldConfig = WorldConfig(),
    drive_times: str | None = None,
    uncertainty: UncertaintyConfig | None = None,
    least_reliability: float | None = None,
) -> None:
    """Writes a plan file, whole or not at all. Its decimals give back the same float32 values.

    Args:
        path: of the file; the folder must be there.
        scene: the scene that was planned.
        plan: one plan, not a batch.
        outcome: of executing it.
        planner: its maker's name.
        planning_time_s: what making it took (s), compiled ahead of time.
        compile_time_s: what compiling took (s).
        world: that it was planned and executed in; what differs from the default drives and picks is written.
        drive_times: where the outcome's are from (`DriveTimes.source`), if not from the world's own drives.
        uncertainty: that the outcome's reliabilities are of, where it has some.
        least_reliability: what was asked of the planner; None: it looked at no errors.

    Raises:
        OSError: the file can't be written.
        ValueError: the outcome holds an infinite number.
    """
    plan, outcome = jax.device_get((plan, outcome))
    drives = {} if drive_times else _manoeuvres(scene, plan, outcome, world)
    steps = [_step(scene, plan, outcome, int(step), drives) for step in np.flatnonzero(outcome.is_step)]
    totals = TotalsFields(
        objects=len(steps),
        grasped=int(outcome.grasped),
        navigation_s=shortest(outcome.navigation),
        picking_s=shortest(outcome.picking),
        execution_s=shortest(outcome.execution),
    )
    content = PlanFields(
        planner=planner,
        robot=robot_name(scene.robot),
        world=WorldFields(**changes) if (changes := _changes(world, WorldConfig())) else UNSET,
        drive_times=drive_times or UNSET,
        uncertainty=UNSET if uncertainty is None else _uncertainty(uncertainty, least_reliability),
        planning_time_s=shortest(planning_time_s),
        compile_time_s=shortest(compile_time_s),
        steps=steps,
        totals=totals,
    )
    write_atomically(path, to_json(content))


def load_plan(path: str | os.PathLike[str], scene: NamedScene, world: WorldConfig = WorldConfig()) -> Plan:
    """Reads the plan of a scene: the order and the base poses. The outcome is for `execute` to say.

    Args:
        path: of the file.
        scene: that was planned.
        world: that the plan is going to be executed in; `load_plan_world` reads the one that it was made in.

    Returns:
        The plan in float32, unbatched, with the scene's slots.

    Raises:
        PlanFileError: the file can't be read, or isn't a plan of that scene, or was made in another world.
    """
    content, own = _read(path)
    try:
        _check(content, scene)
        _check_world(own, world)
    except DocumentError as error:
        raise PlanFileError(f"{path}: {error}") from None
    slots = scene.arrays.mask.shape[-1]
    index, served = np.full(slots, -1, np.int32), np.zeros(slots, bool)
    pose, reason = np.zeros((slots, 3), np.float32), np.zeros(slots, np.int32)
    for number, step in enumerate(content.steps):
        index[number] = scene.names.index(step.object)
        served[number] = step.base_pose is not None
        pose[number] = step.base_pose or (0.0, 0.0, 0.0)
        reason[number] = 0 if step.base_pose else REASONS[str(step.reason)]
    return Plan(*(jnp.asarray(leaf) for leaf in (index, pose, served, reason)))


def load_plan_world(path: str | os.PathLike[str]) -> WorldConfig:
    """Reads the world, as far as drives and picks go, that the plan of a file was made and executed in.

    Raises:
        PlanFileError: the file can't be read, or holds no plan.
    """
    return _read(path)[1]


def _read(path: str | os.PathLike[str]) -> tuple[PlanFields, WorldConfig]:
    try:
        content = convert(read_json(path), PlanFields, format_name=FORMAT, allowed=ALLOWED)
        changes = {} if isinstance(content.world, UnsetType) else to_builtins(content.world)
        return content, overlay(WorldConfig(), changes, f"{path}: world")
    except DocumentError as error:
        raise PlanFileError(f"{path}: {error}") from None
    except ConfigFileError as error:
        raise PlanFileError(str(error)) from None


def reason_name(reason: Any) -> str | None:
    """A `Reason` as plan files spell it, such as "out_of_reach"; None for none."""
    return Reason(int(reason)).name.lower() if int(reason) else None


def _manoeuvres(scene: NamedScene, plan: Plan, outcome: Outcome, world: WorldConfig) -> dict[int, Manoeuvre]:
    """The docked drives of the steps that have one."""
    robot, found = load_robot(scene.robot), {}
    drives = make_drives(robot, jax.device_get(scene.arrays.room), world.navigation)
    before = np.asarray(scene.arrays.robot_start, float)
    for step in np.flatnonzero(outcome.navigation_time > 0) if isinstance(drives, DockedDrives) else ():
        pose = np.asarray(plan.base_pose[step], float)
        found[int(step)] = drives.manoeuvre(robot, before, pose)
        before = pose
    return found


def _leg(leg: Leg) -> LegFields:
    given = {name: value for name in ("turn", "straight", "direction") if (value := getattr(leg, name)) != 0.0}
    return LegFields(**given, time_s=leg.time_s)


def _uncertainty(uncertainty: UncertaintyConfig, least: float | None) -> UncertaintyFields:
    return UncertaintyFields(**dataclasses.asdict(uncertainty), least_reliability=least)


def _step(scene: NamedScene, plan: Plan, outcome: Outcome, step: int, drives: dict[int, Manoeuvre]) -> StepFields:
    drive = drives.get(step, Manoeuvre(()))
    feasible, joints, least = bool(outcome.feasible[step]), outcome.joints[step], outcome.least_singular_value
    return StepFields(
        object=scene.names[int(plan.object_index[step])],
        base_pose=tuple(shortest(plan.base_pose[step])) if plan.served[step] else None,
        feasible=feasible,
        reason=reason_name(outcome.reason[step]),
        navigation_time_s=shortest(outcome.navigation_time[step]),
        pick_time_s=shortest(outcome.pick_time[step]),
        arm=ArmFields(pre_grasp=shortest(joints[0]), grasp=shortest(joints[-1])) if feasible else None,
        least_singular_value=shortest(least[step]) if feasible and least is not None else None,
        grasp_index=UNSET if not feasible or scene.kept_grasps is None else _grasp_index(scene, plan, outcome, step),
        manoeuvre=[_leg(leg) for leg in drive.legs] if drive.legs else UNSET,
        reliability=UNSET if outcome.reliability is None else shortest(outcome.reliability[step]),
        staging_pose=UNSET if (staging := drive.staging_pose) is None else tuple(staging.tolist()),
    )


def _grasp_index(scene: NamedScene, plan: Plan, outcome: Outcome, step: int) -> int:
    """Which of the object's grasps, in the order of its file, of which planning keeps some."""
    assert scene.kept_grasps is not None
    return scene.kept_grasps[int(plan.object_index[step])][int(outcome.grasp[step])]


def _changes(world: WorldConfig, base: WorldConfig) -> dict[str, Any]:
    """Those of drives and picks; tables are the scene's, and how scenes are drawn is nothing to a plan."""
    return {name: own for name, own in differences(world, base).items() if name in ("navigation", "pick")}


def _check_world(own: WorldConfig, world: WorldConfig) -> None:
    """That the file's world is the one that its plan is going to be executed in."""
    wanted = _changes(world, own)
    for section, changes in _changes(own, world).items():
        name, value = next(iter(changes.items()))
        raise field_error(
            f"world.{section}.{name}", describe(value), f"is {describe(wanted[section][name])}, as where it is executed"
        )


def _check(plan: PlanFields, scene: NamedScene) -> None:
    """That it is a plan of this scene: each object once, those that no pose serves last."""
    if plan.robot != (name := robot_name(scene.robot)):
        raise field_error("robot", describe(plan.robot), f"is the scene's, {name!r}")
    names = [step.object for step in plan.steps]
    for number, step in enumerate(plan.steps):
        path = f"steps[{number}]"
        if step.object not in scene.names:
            raise field_error(f"{path}.object", describe(step.object), f"are the scene's: {', '.join(scene.names)}")
        if (first := names.index(step.object)) < number:
            raise field_error(f"{path}.object", f"{step.object!r}, the object of steps[{first}]", "is each object once")
        if step.base_pose is not None and any(earlier.base_pose is None for earlier in plan.steps[:number]):
            raise field_error(f"{path}.base_pose", "a pose after a step with none", "are steps without a pose last")
        _check_reason(step, path)
    if missing := [name for name in scene.names if name not in names]:
        raise field_error("steps", f"no step for {missing[0]!r}", "is one step for each object of the scene")


def _check_reason(step: StepFields, path: str) -> None:
    if step.feasible and (step.base_pose is None or step.arm is None or step.reason is not None):
        raise field_error(f"{path}.feasible", "true", "is true only with base_pose and arm, and with reason null")
    if not step.feasible and step.reason not in REASONS:
        raise field_error(f"{path}.reason", describe(step.reason), f"are {', '.join(REASONS)} where not feasible")
