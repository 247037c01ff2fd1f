"""Every number of the world, the task and the planners, in frozen dataclasses with units in their names.

Sources of the defaults: the BaSeNet paper (arXiv 2406.08653), its authors' public release, Universal Robots; the
rest are choices of this project.
"""

import math
from dataclasses import dataclass, field


@dataclass(frozen=True)
class TableConfig:
    """The table: its centre is the world's origin on the floor, solid from the floor to its top."""

    length_m: float = 2.0  # along x (paper)
    width_m: float = 0.8  # along y (paper)
    height_m: float = 0.75


@dataclass(frozen=True)
class NavigationConfig:
    """How the base drives from pose to pose."""

    # The driven polyline stays out of the table grown by half the base's shorter side, less this: then every base pose
    # that is clear of the table lies outside, whatever the robot (0.249 m for the packaged ones).
    path_slack_m: float = 0.001
    via_clearance_m: float = 0.20  # via points: corners of the table grown by half that side and this (0.45 m)
    straight: bool = False  # True: the paper's simplest reading, one drive and one turn through anything
    same_pose: float = 1e-6  # m or rad below which nothing is driven, and a segment has no direction


@dataclass(frozen=True)
class PickConfig:
    """The pick cycle, and when it is feasible."""

    pregrasp_height_m: float = 0.10
    descent_heights_m: tuple[float, ...] = (0.075, 0.05, 0.025)  # checked between pre-grasp and grasp
    close_s: float = 1.0
    open_s: float = 1.0
    gripper_symmetric: bool = True  # a parallel gripper may turn every grasp by pi
    base_clearance_m: float = 0.10  # between base and table (release)
    touching_m: float = 1e-5  # a clearance up to this is touching
    position_tolerance_m: float = 1e-3
    orientation_tolerance_rad: float = 0.5 * math.pi / 180.0
    max_descent_step_rad: float = 0.5  # per joint, between neighbouring waypoints
    swept_points: int = 7  # checked inside the moves home -> pre-grasp and pre-grasp -> stow
    refinements: int = 1  # damped-least-squares steps on closed-form waypoints
    lattice_seeds: int = 64  # of an arm without a closed form, for each way to hold the gripper
    lattice_first_iterations: int = 8  # of all seeds, to see which lead somewhere
    lattice_kept: int = 12  # of the seeds, those nearest to their goal
    lattice_iterations: int = 16  # of these, to the pre-grasp
    lattice_chunk: int = 64  # picks at a time: the Jacobians of all their seeds stay in a CPU core's cache
    lattice_descent_iterations: int = 5  # from there to the grasp, and from each waypoint to the next
    chunk: int = 2048  # picks checked at a time at most; the largest arrays of a chunk fit a CPU core's cache
    smallest_chunk: int = 128  # of small batches


@dataclass(frozen=True)
class SceneConfig:
    """How random scenes are drawn."""

    edge_margin_m: float = 0.08
    max_footprint_radius_m: float = 0.09
    start_distance_m: tuple[float, float] = (2.5, 3.0)  # from the table's centre (paper)
    tries: int = 1024  # per object
    redraws: int = 8  # of a whole scene


@dataclass(frozen=True)
class GridConfig:
    """The grid of base poses that the classical planners choose from (paper: 10 cm, 45 degrees)."""

    step_m: float = 0.10  # x and y are integer multiples
    turns: int = 8  # headings are integer multiples of a full turn by this
    half_size_m: tuple[float, float] = (2.2, 1.6)  # the grid covers |x| and |y| up to these


@dataclass(frozen=True)
class AlignedConfig:
    """Stops in line with the table's sides."""

    step_m: float = 0.10  # along a side
    gap_m: float = 2e-4  # beyond the base's clearance from the table: touching counts as a collision


@dataclass(frozen=True)
class RefinementConfig:
    """Rounds of continuous refinement, and the alternatives drawn for every stop in each."""

    rounds: int = 16
    slides: int = 12  # along the stop's heading
    free: int = 8  # in position and heading
    rigid: int = 4  # the same motion for all stops
    first_scale: float = 0.10  # m: spread in the first round
    last_scale: float = 0.01  # and in the last
    radians_per_metre: float = 1.0  # spread of headings for that of positions


@dataclass(frozen=True)
class ExportConfig:
    """How a plan is written for a robot."""

    rate_hz: float = 50.0  # of samples; beside them stand the times at which an acceleration changes
    # Each arm move takes this longer than a trapezoidal profile. Controllers that join samples by quintic splines (as
    # ROS 2's do) pass an acceleration limit by a third where the acceleration jumps; so smoothed, it doesn't.
    smoothing_s: float = 0.01


@dataclass(frozen=True)
class WorldConfig:
    """All of the above but the grid, which is a planner's."""

    table: TableConfig = field(default_factory=TableConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)
    pick: PickConfig = field(default_factory=PickConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)
