"""What a training has come to: single-pick success, and whole plans beside simpler orders."""

from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table as RichTable

from basenet_jax.evaluation.orders import OrderResult, compare_orders
from basenet_jax.learning.training import Training
from basenet_jax.policies.trained import Weights


def summarise(training: Training, weights: Weights) -> dict[str, Any]:
    """Evaluates trained weights; the content of `summary.json`. Times in seconds, shares from 0 to 1."""
    config = training.config
    single = jax.jit(training.sac.evaluate)(weights.base_pose, jax.random.key(config.sac.evaluation_seed))
    summary: dict[str, Any] = {
        "preset": config.preset,
        "seed": config.seed,
        "objects": config.reinforce.objects,
        "single_pick_success": float(single["success"]),
        "single_pick": {name: float(value) for name, value in single.items()},
    }
    if weights.sequence is not None:
        network = training.reinforce(weights.base_pose).network
        summary["scenes"] = config.evaluation_scenes
        summary["orders"] = {
            str(objects): {
                order: _figures(result)
                for order, result in compare_orders(
                    training.robot,
                    weights.base_pose,
                    network,
                    weights.sequence,
                    objects=objects,
                    scenes=config.evaluation_scenes,
                    world=config.world,
                ).items()
            }
            for objects in config.evaluation_objects
        }
    return summary


def print_summary(summary: dict[str, Any]) -> None:
    """Prints a summary as tables on stdout."""
    console = Console()
    console.print(f"single-pick success: {100 * summary['single_pick_success']:.2f} %")
    if "orders" not in summary:
        return
    table = RichTable(title=f"{summary['scenes']} random scenes, base poses of the learned policy (mean ± sd)")
    for column in ("objects", "order", "grasped %", "N (s)", "G (s)", "N + G (s)"):
        table.add_column(column, justify="left" if column == "order" else "right")
    for objects, orders in summary["orders"].items():
        for order, figures in orders.items():
            times = (figures[name] for name in ("navigation_s", "grasping_s", "execution_s"))
            cells = (f"{time['mean']:.1f} ± {time['sd']:.1f}" for time in times)
            table.add_row(objects, order, f"{100 * figures['grasped']['mean']:.1f}", *cells)
        table.add_section()
    console.print(table)


def _figures(result: OrderResult) -> dict[str, dict[str, float]]:
    names = ("grasped", "navigation_s", "grasping_s", "execution_s")
    return {
        name: {"mean": float(np.mean(values)), "sd": float(np.std(values, ddof=1)) if len(values) > 1 else 0.0}
        for name, values in zip(names, result, strict=True)
    }
