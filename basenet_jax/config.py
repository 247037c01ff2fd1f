"""Every number of the world, the task and the planners, in frozen dataclasses with units in their names.

Each checks itself when it is made: see `Settings`. What stands below a field is its help on the command line.
Sources of the defaults: the BaSeNet paper (arXiv 2406.08653), its authors' public release, Universal Robots; the
rest are choices of this project.
"""

import itertools
import math
from dataclasses import dataclass, field
from typing import Annotated, Literal, TypeAlias

from basenet_jax.settings import Count, Natural, NotNegative, Positive, Range, Seed, Settings, setting_error

MAX_OBJECTS = 50  # of a scene
PLACES_AT_ONCE = 32  # tried for an object in one round
_TableSide = Annotated[float, Range(0.1, 3)]  # as in scene files
_MOST_POSES = 1_000_000  # of a grid: what is computed for each of them and each object still fits a laptop's memory


@dataclass(frozen=True)
class TableConfig(Settings):
    """The table: its centre is the world's origin on the floor, solid from the floor to its top."""

    length_m: _TableSide = 2.0
    """Along x (paper)."""
    width_m: _TableSide = 0.8
    """Along y (paper)."""
    height_m: Annotated[float, Range(0.01, 3)] = 0.75
    """Of its top over the floor."""


@dataclass(frozen=True)
class DockedConfig(Settings):
    """How the base drives in rooms, true to its footprint: undock, turn, drive along a road, turn, dock."""

    clearance_m: Annotated[float, Range(0, 1)] = 0.05
    """What the footprint keeps clear of while it moves."""
    undock_m: Annotated[float, Range(0, 100)] = 4.0
    """The longest straight piece from a stop to where the base may turn."""
    road_slack_m: Annotated[float, Range(0, 0.1)] = 0.001
    """Points and roads are tested against boxes grown by so much less, so that what touches a corner is free."""


@dataclass(frozen=True)
class NavigationConfig(Settings):
    """How the base drives from pose to pose."""

    drives: Literal["by-room", "point", "docked"] = "by-room"
    """Of a point round one table (the paper's world), docked (true to the footprint), or by the room: of a point where
    it has one table and nothing else."""
    reverse: bool = True
    """Whether the base may drive in reverse; without, only stops that it leaves and comes to nose first can be had. A
    base that drives in any direction has no reverse."""
    docked: DockedConfig = field(default_factory=DockedConfig)
    """Of docked drives; what follows is of those of a point."""
    path_slack_m: Annotated[float, Range(0, 0.1)] = 0.001
    """The path stays out of the table grown by half the base's shorter side, less this: then every base pose that is
    clear of the table lies outside, whatever the robot (0.249 m for the packaged ones)."""
    via_clearance_m: Annotated[float, Range(0, 10)] = 0.20
    """Via points are the corners of the table grown by half that side and this (0.45 m)."""
    straight: bool = False
    """The paper's simplest reading: one drive and one turn, through anything."""
    same_pose: Annotated[float, Range(0, 0.01, above=True)] = 1e-6
    """Below so many m or rad nothing is driven, and a segment has no direction."""


Switch: TypeAlias = Literal["by-room", "on", "off"]  # by the room: on where its file says `clutter`


@dataclass(frozen=True)
class PickConfig(Settings):
    """The pick cycle, and when it is feasible."""

    pregrasp_height_m: Annotated[float, Range(0, 1)] = 0.10
    """Of the pre-grasp above the grasp; maps of what is in reach are made with 0."""
    descent_heights_m: tuple[Positive, ...] = (0.075, 0.05, 0.025)
    """Above the grasp, falling: what is checked between pre-grasp and grasp."""
    close_s: NotNegative = 1.0
    """What closing the gripper takes."""
    open_s: NotNegative = 1.0
    """What opening it takes."""
    gripper_symmetric: bool = True
    """A parallel gripper may turn every grasp by pi."""
    base_clearance_m: Annotated[float, Range(0, 2)] = 0.10
    """Between base and table (release)."""
    touching_m: Annotated[float, Range(0, 0.01)] = 1e-5
    """A clearance up to this is touching."""
    position_tolerance_m: Annotated[float, Range(0, 0.1, above=True)] = 1e-3
    """How far from its goal the tool may end."""
    orientation_tolerance_rad: Annotated[float, Range(0, 0.5, above=True)] = 0.5 * math.pi / 180.0
    """How far from its goal the tool may be turned in the end."""
    max_descent_step_rad: Positive = 0.5
    """Of any joint, between neighbouring waypoints of the descent."""
    object_in_the_way: Switch = "by-room"
    """Whether arm and gripper must not touch objects that still stand."""
    arm_hits_itself: Switch = "by-room"
    """Whether links that aren't neighbours, and the pedestal, must not touch."""
    near_singular: Switch = "by-room"
    """Whether the arm keeps away from singular poses between pre-grasp and grasp."""
    least_singular_value: Annotated[float, Range(0, 1)] = 0.02
    """Of the tool's Jacobian (m and rad), below which a pose is near singular."""
    swept_points: Natural = 7
    """So many states are checked inside each of the moves home to pre-grasp and pre-grasp to stow."""
    refinements: Natural = 1
    """Damped-least-squares steps on closed-form waypoints."""
    last_joint_angles: Count = 16
    """Of the seventh joint, for which an arm with a closed form of seven joints is solved."""
    lattice_seeds: Count = 64
    """Of an arm without a closed form, for each way to hold the gripper."""
    lattice_first_iterations: Natural = 8
    """Of all seeds, to see which lead somewhere."""
    lattice_kept: Count = 12
    """Of the seeds, those nearest to their goal."""
    lattice_iterations: Natural = 16
    """Of these, to the pre-grasp."""
    lattice_chunk: Count = 64
    """Picks at a time: the Jacobians of all their seeds stay in a CPU core's cache."""
    lattice_descent_iterations: Count = 5
    """From there to the grasp, and from each waypoint to the next."""
    chunk: Count = 2048
    """Picks checked at a time at most; the largest arrays of a chunk fit a CPU core's cache."""
    smallest_chunk: Count = 128
    """Likewise of small batches."""

    def _check_together(self) -> None:
        heights = (self.pregrasp_height_m, *self.descent_heights_m)
        falling = all(above > below for above, below in itertools.pairwise(heights))
        self._require(falling, "descent_heights_m", f"are falling heights below pregrasp_height_m, {heights[0]:g}")


@dataclass(frozen=True)
class UncertaintyConfig(Settings):
    """What goes wrong at each parking: normal errors of where the base stands and of where objects are seen."""

    sd_xy_m: Annotated[float, Range(0, 0.5)] = 0.02
    """Standard deviation of the base's position, along its own x and y each."""
    sd_heading_rad: Annotated[float, Range(0, 0.5)] = math.pi / 180.0
    """Of its heading."""
    sd_object_m: Annotated[float, Range(0, 0.5)] = 0.005
    """Of an object's position along x and y each, as it is seen from where the base stands."""
    sd_object_rad: Annotated[float, Range(0, 0.5)] = 2.0 * math.pi / 180.0
    """Of its yaw."""
    draws: Annotated[int, Range(1, 4096)] = 64
    """Of these errors, the same for every stop and object: reliability is the share in which the pick is feasible."""
    base_clearance_m: Annotated[float, Range(0, 2)] = 0.02
    """Between the base and boxes where it really stands; stops are planned with that of picks."""
    seed: Seed = 0
    """Of the draws."""


@dataclass(frozen=True)
class SceneConfig(Settings):
    """How random scenes are drawn."""

    edge_margin_m: Annotated[float, Range(0, 1.5)] = 0.08
    """Objects' centres stay so far from the table's edges."""
    max_footprint_radius_m: Positive = 0.09
    """An object keeps a disc of half its diagonal free, of at most this radius."""
    overlap_tolerance_m: Annotated[float, Range(0, 0.05)] = 1e-3
    """By how much less than drawn objects those of a file may be apart."""
    start_distance_m: tuple[Positive, Annotated[float, Range(0, 100, above=True)]] = (2.5, 3.0)
    """Of the robot's start from the table's centre, least and most (paper)."""
    tries: Count = 1024
    """Places tried for an object; a multiple of 32."""
    redraws: Natural = 8
    """Of a whole scene whose objects found no place."""

    def _check_together(self) -> None:
        nearest, farthest = self.start_distance_m
        self._require(nearest <= farthest, "start_distance_m", "are two distances, the lesser one first")
        self._require(self.tries % PLACES_AT_ONCE == 0, "tries", f"are multiples of {PLACES_AT_ONCE}")


@dataclass(frozen=True)
class GridConfig(Settings):
    """The grid of base poses that the classical planners choose from (paper: 10 cm, 45 degrees)."""

    step_m: Annotated[float, Range(0.005, 10)] = 0.10
    """x and y are whole multiples of it."""
    turns: Annotated[int, Range(1, 3600)] = 8
    """Headings are whole multiples of a full turn divided by this."""
    half_size_m: tuple[Annotated[float, Range(0, 100)], Annotated[float, Range(0, 100)]] = (2.2, 1.6)
    """Round one table the grid covers |x| and |y| up to these."""
    reach_m: Annotated[float, Range(0, 10)] = 1.2
    """In other rooms it covers what is so near to a surface."""

    def _check_together(self) -> None:
        x, y = (2 * math.floor(half / self.step_m) + 1 for half in self.half_size_m)
        allowed = f"are steps that make up to {_MOST_POSES} poses, not {x} x {y} places x {self.turns} turns"
        self._require(x * y * self.turns <= _MOST_POSES, "step_m", allowed)


@dataclass(frozen=True)
class AlignedConfig(Settings):
    """Stops in line with the table's sides."""

    step_m: Annotated[float, Range(0.005, 10)] = 0.10
    """From stop to stop along a side."""
    gap_m: Annotated[float, Range(0, 1, above=True)] = 2e-4
    """Beyond the base's clearance from the table, where touching counts as a collision."""
    farther_m: tuple[NotNegative, ...] = ()
    """Further lines of stops, by how much they are farther off than that one."""


@dataclass(frozen=True)
class RefinementConfig(Settings):
    """Rounds of continuous refinement, and the alternatives drawn for every stop in each."""

    rounds: Count = 16
    """How often all stops are moved."""
    slides: Natural = 12
    """Alternatives along the stop's heading."""
    free: Natural = 8
    """Alternatives in position and heading."""
    rigid: Natural = 4
    """The same motion for all stops."""
    first_scale: Positive = 0.10
    """Spread (m) in the first round."""
    last_scale: Positive = 0.01
    """Spread (m) in the last round."""
    radians_per_metre: NotNegative = 1.0
    """Spread of headings for that of positions."""


@dataclass(frozen=True)
class ExportConfig(Settings):
    """How a plan is written for a robot."""

    rate_hz: Annotated[float, Range(0, 10_000, above=True)] = 50.0
    """Of samples; beside them stand the times at which an acceleration changes."""
    smoothing_s: Annotated[float, Range(0, 10)] = 0.01
    """Each arm move takes so much longer than a trapezoidal profile. Controllers that join samples by quintic splines
    (as ROS 2's do) pass an acceleration limit by a third where the acceleration jumps; so smoothed, it doesn't."""


@dataclass(frozen=True)
class WorldConfig(Settings):
    """What is true whoever plans: table, drives, picks, and how scenes are drawn. Planners' own numbers are options."""

    table: TableConfig = field(default_factory=TableConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)
    pick: PickConfig = field(default_factory=PickConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)

    def _check_together(self) -> None:
        table, scene = self.table, self.scene
        shorter, corner = min(table.length_m, table.width_m), math.hypot(table.length_m, table.width_m) / 2
        if 2 * scene.edge_margin_m >= shorter:
            raise self._error("scene.edge_margin_m", f"are 0 to {shorter / 2:g}, half the table's shorter side")
        if scene.start_distance_m[0] <= corner:
            raise self._error("scene.start_distance_m", f"are distances beyond the table's corners, {corner:.3f}")

    def _error(self, path: str, allowed: str) -> Exception:
        section, name = path.split(".")
        return setting_error(f"WorldConfig.{path}", getattr(getattr(self, section), name), allowed)
