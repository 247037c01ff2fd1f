"""The fields of the plan file, `basenet-plan/1`."""

from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType, field

from basenet_jax.world.scene import MAX_OBJECTS

FORMAT = "basenet-plan/1"

_Duration = Annotated[float, Meta(ge=0, le=1e9)]
_Count = Annotated[int, Meta(ge=0, le=MAX_OBJECTS)]
_Share = Annotated[float, Meta(ge=0, le=1)]
_Spread = Annotated[float, Meta(ge=0, le=1e9)]
_Coordinate = Annotated[float, Meta(ge=-1000, le=1000)]


class ArmFields(Struct, forbid_unknown_fields=True):
    """Joint angles (rad) at the pre-grasp and at the grasp."""

    pre_grasp: list[float]
    grasp: list[float]


class LegFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """A turn on the spot (rad, counter-clockwise) or a straight piece (m, negative in reverse), from rest to rest."""

    turn: float | UnsetType = UNSET
    straight: float | UnsetType = UNSET
    direction: float | UnsetType = UNSET  # rad, of a straight piece in the base's frame, unless it is the heading
    time_s: _Duration


class StepFields(Struct, forbid_unknown_fields=True):
    """One step: where the base parks for an object, and what comes of it. Nulls where there is nothing to say."""

    object: str
    base_pose: tuple[_Coordinate, _Coordinate, _Coordinate] | None  # (x, y, heading) in W
    feasible: bool
    reason: str | None  # a `Reason`'s name in small letters
    navigation_time_s: _Duration
    pick_time_s: _Duration
    arm: ArmFields | None
    least_singular_value: Annotated[float, Meta(ge=0)] | None = None  # m and rad; older files have none
    grasp_index: Annotated[int, Meta(ge=0)] | UnsetType = UNSET  # of a room's object: which of its grasps, as written
    manoeuvre: list[LegFields] | UnsetType = UNSET  # of a docked drive from the pose before
    staging_pose: tuple[_Coordinate, _Coordinate, _Coordinate] | UnsetType = UNSET  # whence it goes straight to the end
    reliability: _Share | UnsetType = UNSET  # of the draws of errors, those in which the pick is feasible


class TotalsFields(Struct, forbid_unknown_fields=True):
    """What executing the whole plan comes to."""

    objects: _Count
    grasped: _Count
    navigation_s: _Duration
    picking_s: _Duration
    execution_s: _Duration


class WorldFields(Struct, forbid_unknown_fields=True, omit_defaults=True):
    """In what the world's settings differ from the defaults."""

    navigation: dict[str, Any] = field(default_factory=dict)
    pick: dict[str, Any] = field(default_factory=dict)


class UncertaintyFields(Struct, forbid_unknown_fields=True):
    """The errors that reliabilities are of, and what was asked for."""

    sd_xy_m: _Spread
    sd_heading_rad: _Spread
    sd_object_m: _Spread
    sd_object_rad: _Spread
    draws: Annotated[int, Meta(ge=1)]
    base_clearance_m: _Spread
    seed: Annotated[int, Meta(ge=0)]
    least_reliability: _Share | None  # that the planner kept to where it could; null: it looked at no errors


class PlanFields(Struct, forbid_unknown_fields=True, kw_only=True):
    """The whole file."""

    format: str = FORMAT
    planner: str
    robot: str
    world: WorldFields | UnsetType = UNSET  # not there: the default one
    drive_times: str | UnsetType = UNSET  # where the drive times are from, if they aren't the world's own
    uncertainty: UncertaintyFields | UnsetType = UNSET  # not there: no reliability was computed
    planning_time_s: _Duration
    compile_time_s: _Duration
    steps: Annotated[list[StepFields], Meta(max_length=MAX_OBJECTS)]
    totals: TotalsFields


_SPREADS = ("sd_xy_m", "sd_heading_rad", "sd_object_m", "sd_object_rad", "base_clearance_m")
_SECONDS = "is a number from 0 on (s)"

# By path, for messages.
ALLOWED = {
    "format": f"is {FORMAT!r}",
    "planner": "is a planner's name",
    "robot": "is a robot's name",
    "world": "is a mapping of the settings that differ, navigation and pick, or no such key",
    "drive_times": "is a text, or no such key",
    "uncertainty": "is a mapping of the errors that reliabilities are of, or no such key",
    **{f"uncertainty.{name}": "is a number from 0 on" for name in _SPREADS},
    "uncertainty.draws": "is a whole number from 1 on",
    "uncertainty.seed": "is a whole number from 0 on",
    "uncertainty.least_reliability": "is a number from 0 to 1, or null",
    "world.navigation": "is a mapping of settings",
    "world.pick": "is a mapping of settings",
    "planning_time_s": _SECONDS,
    "compile_time_s": _SECONDS,
    "steps": f"is a list of up to {MAX_OBJECTS} steps",
    "steps[]": "is a mapping that describes one step",
    "steps[].object": "is the name of one of the scene's objects",
    "steps[].base_pose": "is [x, y, heading], three numbers (m, m, rad), or null",
    "steps[].base_pose[]": "is a number from -1000 to 1000 (m or rad)",
    "steps[].feasible": "is true or false",
    "steps[].reason": "is a text or null",
    "steps[].navigation_time_s": _SECONDS,
    "steps[].pick_time_s": _SECONDS,
    "steps[].arm": "is a mapping of joint angles, or null",
    "steps[].least_singular_value": "is a number from 0 on (m and rad), or null",
    "steps[].grasp_index": "is a whole number from 0 on, or no such key",
    "steps[].staging_pose": "is [x, y, heading], three numbers (m, m, rad), or no such key",
    "steps[].staging_pose[]": "is a number from -1000 to 1000 (m or rad)",
    "steps[].reliability": "is a number from 0 to 1, or no such key",
    "steps[].manoeuvre": "is a list of legs, or no such key",
    "steps[].manoeuvre[]": "is a mapping of time_s and turn or straight",
    "steps[].manoeuvre[].time_s": _SECONDS,
    "steps[].manoeuvre[].turn": "is a number (rad)",
    "steps[].manoeuvre[].straight": "is a number (m)",
    "steps[].manoeuvre[].direction": "is a number (rad)",
    "steps[].arm.pre_grasp": "is a list of joint angles (rad)",
    "steps[].arm.grasp": "is a list of joint angles (rad)",
    "totals": "is a mapping of counts and times",
    "totals.objects": "is a whole number",
    "totals.grasped": "is a whole number",
    "totals.navigation_s": _SECONDS,
    "totals.picking_s": _SECONDS,
    "totals.execution_s": _SECONDS,
}
