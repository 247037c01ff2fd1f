"""Base-pose sequence planning for mobile manipulators, trained and solved in JAX.

The public names are loaded when they are first used, so that importing the package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from basenet_jax.api import ScenePlanner as ScenePlanner
    from basenet_jax.api import drive_poses as drive_poses
    from basenet_jax.api import execute as execute
    from basenet_jax.api import export_plan as export_plan
    from basenet_jax.api import make_plan as make_plan
    from basenet_jax.api import make_planner as make_planner
    from basenet_jax.api import plot_plan as plot_plan
    from basenet_jax.api import replan as replan
    from basenet_jax.api import sample_scene as sample_scene
    from basenet_jax.batch import plan_batch as plan_batch
    from basenet_jax.batch import sample_scenes as sample_scenes
    from basenet_jax.config import WorldConfig as WorldConfig
    from basenet_jax.learning.base_pose_env import BasePoseEnv as BasePoseEnv
    from basenet_jax.learning.config import TrainConfig as TrainConfig
    from basenet_jax.learning.config import make_preset as make_preset
    from basenet_jax.planners.protocol import PlanningError as PlanningError
    from basenet_jax.robot.ik import solve_ik as solve_ik
    from basenet_jax.robot.kinematics import forward_kinematics as forward_kinematics
    from basenet_jax.robot.kinematics import geometric_jacobian as geometric_jacobian
    from basenet_jax.robot.model import Robot as Robot
    from basenet_jax.robot.reading import load_robot as load_robot
    from basenet_jax.task.drive_times import DriveTimes as DriveTimes
    from basenet_jax.task.drive_times import load_drive_times as load_drive_times
    from basenet_jax.task.drive_times import save_drive_times as save_drive_times
    from basenet_jax.task.drive_times import tabulate_drives as tabulate_drives
    from basenet_jax.task.free_ik import collision_free_ik as collision_free_ik
    from basenet_jax.task.navigation import navigation_time as navigation_time
    from basenet_jax.task.picking import Reason as Reason
    from basenet_jax.task.picking import pick as pick
    from basenet_jax.task.plan import Outcome as Outcome
    from basenet_jax.task.plan import Plan as Plan
    from basenet_jax.task.plan_file import PlanFileError as PlanFileError
    from basenet_jax.task.plan_file import load_plan as load_plan
    from basenet_jax.task.plan_file import load_plan_world as load_plan_world
    from basenet_jax.task.plan_file import save_plan as save_plan
    from basenet_jax.world.boxes import Boxes as Boxes
    from basenet_jax.world.generate import draw_scene as draw_scene
    from basenet_jax.world.grasps import Grasps as Grasps
    from basenet_jax.world.grasps import top_down as top_down
    from basenet_jax.world.scene import NamedScene as NamedScene
    from basenet_jax.world.scene import Room as Room
    from basenet_jax.world.scene import Scene as Scene
    from basenet_jax.world.scene_file import SceneFileError as SceneFileError
    from basenet_jax.world.scene_file import load_scene as load_scene
    from basenet_jax.world.scene_file import save_scene as save_scene

_MODULES = {
    "BasePoseEnv": "learning.base_pose_env",
    "Boxes": "world.boxes",
    "DriveTimes": "task.drive_times",
    "Grasps": "world.grasps",
    "NamedScene": "world.scene",
    "Outcome": "task.plan",
    "Plan": "task.plan",
    "PlanFileError": "task.plan_file",
    "PlanningError": "planners.protocol",
    "Reason": "task.picking",
    "Robot": "robot.model",
    "Scene": "world.scene",
    "SceneFileError": "world.scene_file",
    "ScenePlanner": "api",
    "Room": "world.boxes",
    "TrainConfig": "learning.config",
    "WorldConfig": "config",
    "collision_free_ik": "task.free_ik",
    "draw_scene": "world.generate",
    "drive_poses": "api",
    "execute": "api",
    "export_plan": "api",
    "forward_kinematics": "robot.kinematics",
    "geometric_jacobian": "robot.kinematics",
    "load_drive_times": "task.drive_times",
    "load_plan": "task.plan_file",
    "load_plan_world": "task.plan_file",
    "load_robot": "robot.reading",
    "load_scene": "world.scene_file",
    "make_plan": "api",
    "make_planner": "api",
    "make_preset": "learning.config",
    "navigation_time": "task.navigation",
    "pick": "task.picking",
    "plan_batch": "batch",
    "plot_plan": "api",
    "replan": "api",
    "sample_scene": "api",
    "sample_scenes": "batch",
    "save_drive_times": "task.drive_times",
    "save_plan": "task.plan_file",
    "save_scene": "world.scene_file",
    "solve_ik": "robot.ik",
    "tabulate_drives": "task.drive_times",
    "top_down": "world.grasps",
}

__all__ = [
    "BasePoseEnv",
    "Boxes",
    "DriveTimes",
    "Grasps",
    "NamedScene",
    "Outcome",
    "Plan",
    "PlanFileError",
    "PlanningError",
    "Reason",
    "Robot",
    "Room",
    "Scene",
    "SceneFileError",
    "ScenePlanner",
    "TrainConfig",
    "WorldConfig",
    "collision_free_ik",
    "draw_scene",
    "drive_poses",
    "execute",
    "export_plan",
    "forward_kinematics",
    "geometric_jacobian",
    "load_drive_times",
    "load_plan",
    "load_plan_world",
    "load_robot",
    "load_scene",
    "make_plan",
    "make_planner",
    "make_preset",
    "navigation_time",
    "pick",
    "plan_batch",
    "plot_plan",
    "replan",
    "sample_scene",
    "sample_scenes",
    "save_drive_times",
    "save_plan",
    "save_scene",
    "solve_ik",
    "tabulate_drives",
    "top_down",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULES])
