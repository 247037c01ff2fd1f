"""Drives true to the footprint: how long a room takes to prepare, and whether the drives found touch anything.

Timed are, for a room of 12 boxes with 400 stops along their sides and for a map of 400 x 400 cells (rooms with doors
and furniture): the roadmap, all drives between the stops, those from one stop to all, and drives found with their legs.
Gone along, at 2 cm and 2 degrees, are drives in random rooms of 1 to 9 boxes between random poses: each footprint is
compared with each box in NumPy, in float64, by the separating axes of their corners. `clearance_m` is the least there
is. Planned with are 0.05 m less 1 mm; turns are looked at in steps.
"""

import dataclasses
import sys
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from rich.table import Table

from basenet_jax.robot.model import Robot
from basenet_jax.robot.reading import load_robot
from basenet_jax.task.docked_drives import drive_matrix
from basenet_jax.task.docked_manoeuvre import find_manoeuvre
from basenet_jax.task.drive_space import DriveSpace, footprint_fits
from basenet_jax.task.manoeuvre import Manoeuvre
from basenet_jax.task.roadmap import Roadmap, make_roadmap
from basenet_jax.trigonometry import sin_cos
from basenet_jax.world.boxes import Boxes, Room
from benchmarks.docked_rooms import PARKING_M, office, random_room, stops_along, twelve_boxes
from benchmarks.harness import Options, Report, parse
from benchmarks.timing import measure_plain

NAME = "docked_drives"
STOPS, QUICK_STOPS = 400, 24
POSES, DRIVES = 8, 6  # in each random room

Row = dict[str, Any]


@dataclass(frozen=True)
class RoomOptions(Options):
    """And of how many rooms."""

    rooms: int = 1_000
    """Random rooms in which drives are gone along."""


def main(arguments: list[str] | None = None) -> Row:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(RoomOptions, NAME, __doc__, arguments)
    report = Report(NAME, options, arguments)
    robot, rng = load_robot(), np.random.default_rng(options.seed)
    stops = QUICK_STOPS if options.quick else STOPS
    results = [_prepare("12 boxes", robot, twelve_boxes(rng), stops, options.repeats)]
    if not options.quick:
        results.append(_prepare("map, 400 x 400 cells", robot, office(rng), stops, options.repeats))
    count = min(options.rooms, 3) if options.quick else options.rooms
    for name, base in (("differential", robot), ("omnidirectional", dataclasses.replace(robot, omnidirectional=True))):
        results.append(_go_along(name, base, rng, count))
    table = Table(title="Docked drives")
    columns = ("what", "boxes", "vias", "stops", "roadmap_s", "matrix_s", "drives", "touching", "clearance_m")
    for column in columns:
        table.add_column(column)
    for row in results:
        table.add_row(*(_cell(row.get(column)) for column in columns))
    return report.finish(results, table=table)


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        value = value["median"]
    return f"{value:.4f}" if isinstance(value, float) else "" if value is None else str(value)


def _prepare(what: str, robot: Robot, room: Room, count: int, repeats: int) -> Row:
    """Times of preparing a room, warm: everything was compiled in a run before."""
    roadmap = make_roadmap(robot, room)
    stops = _parked(roadmap, stops_along(robot, room.boxes))
    stops = stops[np.linspace(0, len(stops) - 1, count).astype(int)]
    timed: Row = {"roadmap_s": measure_plain(lambda: make_roadmap(robot, room), repeats=repeats)}
    base, placed = jax.device_put((robot, roadmap))
    timed["matrix_s"] = measure_plain(lambda: drive_matrix(base, placed, stops, stops), repeats=repeats)
    timed["one_row_s"] = measure_plain(lambda: drive_matrix(base, placed, stops[:1], stops), repeats=repeats)
    pairs = np.random.default_rng(0).integers(len(stops), size=(20, 2))
    reachable = np.isfinite(drive_matrix(base, placed, stops, stops))

    def find_some() -> None:
        for i, j in (pair for pair in pairs if reachable[*pair]):
            find_manoeuvre(robot, roadmap, stops[i], stops[j])

    timed[f"{sum(reachable[*pair] for pair in pairs)}_manoeuvres_s"] = measure_plain(find_some, repeats=repeats)
    facts = {"what": what, "boxes": len(room.boxes.low), "vias": int(roadmap.is_via.sum()), "stops": len(stops)}
    shares = {"reachable_share": float(reachable.mean()), "neighbours_at_most": roadmap.neighbour.shape[1]}
    return {**facts, **shares, **{name: timing.summary()["run_s"] for name, timing in timed.items()}}


def _go_along(what: str, robot: Robot, rng: np.random.Generator, count: int) -> Row:
    """Drives of random rooms, gone along in small steps."""
    clearances, off_by, unreachable, steps = [], [0.0], 0, 0
    for _ in range(count):
        room = random_room(rng)
        roadmap = make_roadmap(robot, room)
        low, high = np.split(np.asarray(room.floor), 2)
        poses = _parked(roadmap, rng.uniform((*low, -np.pi), (*high, np.pi), (200, 3)))[:POSES]
        times = drive_matrix(robot, roadmap, poses, poses)
        for i, j in rng.integers(len(poses), size=(DRIVES, 2)):
            if not np.isfinite(times[i, j]):
                unreachable += 1
                continue
            drive = find_manoeuvre(robot, roadmap, poses[i], poses[j])
            off_by.append(abs(drive.time_s - float(times[i, j])))
            along = _along(drive)
            steps += len(along)
            clearances.append(float(_gaps(along, np.asarray(robot.footprint_half_size), room.boxes).min(initial=9.0)))
    facts = {"what": what, "rooms": count, "drives": len(clearances), "unreachable": unreachable, "steps": steps}
    least = {"touching": int(np.sum(np.array(clearances) <= 0.0)), "clearance_m": min(clearances)}
    return {**facts, **least, "time_off_by_s": max(off_by)}


def _parked(roadmap: Roadmap, poses: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "M 3"]:
    """The poses at which the base may stand."""
    return poses[np.asarray(_stands(roadmap.space, poses))]


@jax.jit
def _stands(space: DriveSpace, pose: Array) -> Array:
    space = dataclasses.replace(space, clearance=jnp.asarray(PARKING_M))
    sine, cosine = sin_cos(pose[:, 2])
    return footprint_fits(space, (pose[:, 0], pose[:, 1]), (cosine, sine))


def _along(drive: Manoeuvre) -> Float[np.ndarray, "steps 3"]:
    parts = [np.zeros((0, 3))]
    for leg in drive.legs:
        steps = 2 + int(max(abs(leg.turn) / np.radians(2.0), abs(leg.straight) / 0.02))
        parts.append(np.linspace(leg.before, leg.after, steps))
    return np.concatenate(parts)


def _gaps(poses: Float[np.ndarray, "N 3"], half: np.ndarray, boxes: Boxes) -> Float[np.ndarray, "N B"]:
    """By how much (m) an edge's normal separates a footprint from each box."""
    one = _corners(poses, half)[:, None]
    other = _corners(np.asarray(boxes.pose, float), np.asarray(boxes.half_size, float))[None]
    gaps = []
    for yaw in (poses[:, None, 2], np.asarray(boxes.pose, float)[None, :, 2]):
        for angle in (yaw, yaw + np.pi / 2):
            axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[..., None, :]
            a, b = (np.sum(corners * axis, axis=-1) for corners in (one, other))
            gaps += [a.min(axis=-1) - b.max(axis=-1), b.min(axis=-1) - a.max(axis=-1)]
    return np.max(np.broadcast_arrays(*gaps), axis=0)


def _corners(pose: np.ndarray, half: np.ndarray) -> Float[np.ndarray, "N 4 2"]:
    x, y = (np.array([1, -1, -1, 1]) * half[..., :1], np.array([1, 1, -1, -1]) * half[..., 1:])
    cosine, sine = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
    return np.stack([pose[:, :1] + cosine * x - sine * y, pose[:, 1:2] + sine * x + cosine * y], axis=-1)


if __name__ == "__main__":
    main()
