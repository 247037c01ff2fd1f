"""What a training has come to: single-pick success, and whole plans beside simpler orders."""

from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table as RichTable

from basenet_jax.evaluation.orders import OrderResult, compare_orders, judge_planner
from basenet_jax.learning.reinforce import sequence_network
from basenet_jax.learning.stop_learning import stop_network
from basenet_jax.learning.training import Trained, Training
from basenet_jax.planners.basenet import BaSeNet
from basenet_jax.planners.protocol import PlannerSetup
from basenet_jax.world.boxes import Room

_LABELS = {"nearest": "nearest first *", "random": "random order *"}


def summarise(training: Training, trained: Trained) -> dict[str, Any]:
    """Evaluates trained layers; the content of `summary.json`. Times in seconds, shares from 0 to 1."""
    config = training.config
    summary: dict[str, Any] = {"preset": config.preset, "seed": config.seed, "objects": config.reinforce.objects}
    if trained.base_pose is not None:
        single = jax.jit(training.sac.evaluate)(trained.base_pose, jax.random.key(config.sac.evaluation_seed))
        summary["single_pick_success"] = float(single["success"])
        summary["single_pick"] = {name: float(value) for name, value in single.items()}
    if trained.sequence is not None or trained.stops is not None:
        summary["scenes"] = config.evaluation_scenes
        planner = _planner(training, trained)
        summary["plans"] = {
            str(objects): _plans(training, trained, planner, objects) for objects in config.evaluation_objects
        }
    return summary


def print_summary(summary: dict[str, Any]) -> None:
    """Prints a summary as tables on stdout."""
    console = Console()
    if "single_pick_success" in summary:
        console.print(f"single-pick success: {100 * summary['single_pick_success']:.2f} %")
    if "plans" not in summary:
        return
    note = "* with the base poses of basenet-paper" if "single_pick_success" in summary else None
    table = RichTable(title=f"{summary['scenes']} random scenes (mean ± sd)", caption=note, pad_edge=False)
    for column in ("objects", "plans by", "grasped %", "N (s)", "G (s)", "N + G (s)"):
        table.add_column(column, justify="left" if column == "plans by" else "right", no_wrap=True)
    for objects, plans in summary["plans"].items():
        for name, figures in plans.items():
            times = (figures[quantity] for quantity in ("navigation_s", "grasping_s", "execution_s"))
            cells = (f"{time['mean']:.1f} ± {time['sd']:.1f}" for time in times)
            table.add_row(objects, _LABELS.get(name, name), f"{100 * figures['grasped']['mean']:.1f}", *cells)
        table.add_section()
    console.print(table)


def _planner(training: Training, trained: Trained) -> BaSeNet | None:
    """The planner of the stop policy, if that is trained."""
    if trained.stops is None:
        return None
    world = training.config.world
    setup = PlannerSetup(training.robot, Room.from_config(world.table), world)
    return BaSeNet(setup, policy=stop_network(training.config.stops), params=trained.stops)


def _plans(
    training: Training, trained: Trained, planner: BaSeNet | None, objects: int
) -> dict[str, dict[str, dict[str, float]]]:
    """Figures of the planners whose layers are trained, and of simpler orders beside the paper's."""
    config = training.config
    slots = max(config.evaluation_objects)  # the same for all, so that nothing is compiled twice
    which: dict[str, Any] = {
        "objects": objects,
        "scenes": config.evaluation_scenes,
        "slots": slots,
        "world": config.world,
    }
    results: dict[str, OrderResult] = {}
    if planner is not None:
        results["basenet"] = judge_planner(planner, training.robot, **which)
    if trained.sequence is not None and trained.base_pose is not None:
        network = sequence_network(config.reinforce)
        orders = compare_orders(training.robot, trained.base_pose, network, trained.sequence, **which)
        results |= {"basenet-paper": orders.pop("learned")} | orders
    return {name: _figures(result) for name, result in results.items()}


def _figures(result: OrderResult) -> dict[str, dict[str, float]]:
    names = ("grasped", "navigation_s", "grasping_s", "execution_s")
    return {
        name: {"mean": float(np.mean(values)), "sd": float(np.std(values, ddof=1)) if len(values) > 1 else 0.0}
        for name, values in zip(names, result, strict=True)
    }
