"""What the learned order is worth: beside the nearest object first and random order, on the same scenes.

All orders park where the same learned base-pose policy says, so only the order differs. Besides each order's figures
stand paired differences, learned - other, scene by scene: on all scenes, and on those where both orders grasp every
object (elsewhere a plan that gives up early drives less). Scenes are drawn from seeds that training never uses.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.table import Table

from basenet_jax.evaluation.orders import EVALUATION_SEED, OrderResult, compare_orders
from basenet_jax.learning.config import TrainConfig
from basenet_jax.learning.training import Training
from benchmarks.harness import QUICK_OBJECTS, Options, Report, parse
from benchmarks.paired import CONFIDENCE, paired_difference
from benchmarks.trained import Trained, load_basenet, untrained_basenet

NAME = "orders"
OURS, OTHERS = "learned", ("nearest", "random")
QUANTITIES = {"N": "navigation", "G": "grasping", "N+G": "execution"}


@dataclass(frozen=True)
class OrderOptions(Options):
    """Options, and what to compare on how many scenes; timing repeats don't matter here."""

    weights: Path | None = None
    """A run's weights/basenet.weights; only --quick does without, with untrained networks."""
    scenes: int = 1_000
    """Scenes for each number of objects."""
    objects: tuple[int, ...] = (5, 10)
    """Numbers of objects in a scene."""
    chunk: int = 500
    """Scenes at a time, which bounds memory; each chunk has its own seed."""
    seed: int = EVALUATION_SEED
    """Of the first chunk; the others count up from it."""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measures, prints a table and writes the results."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = parse(OrderOptions, NAME, __doc__, arguments)
    if options.weights is None and not options.quick:
        raise SystemExit("orders: needs --weights PATH, a run's weights/basenet.weights")
    report = Report(NAME, options, arguments)
    trained = _trained(options)
    numbers, scenes = ((QUICK_OBJECTS,), 4) if options.quick else (options.objects, options.scenes)
    results, seeds = [], _chunks(scenes, options)
    for objects in numbers:
        results += _compare(trained, objects, seeds, options.seed)
    chunks = [{"seed": seed, "scenes": count} for seed, count in seeds.items()]
    return report.finish(
        results, table=_table(results, scenes), weights=trained.source, chunks=chunks, confidence=CONFIDENCE
    )


def _trained(options: OrderOptions) -> Trained:
    if options.weights is None:
        return untrained_basenet(Training(TrainConfig()), jax.random.key(options.seed))
    try:
        return load_basenet(options.weights)
    except ValueError as error:
        raise SystemExit(f"orders: {error}") from error


def _chunks(scenes: int, options: OrderOptions) -> dict[int, int]:
    """The number of scenes by seed."""
    starts = range(0, scenes, options.chunk)
    return {options.seed + i: min(options.chunk, scenes - start) for i, start in enumerate(starts)}


def _compare(trained: Trained, objects: int, seeds: dict[int, int], bootstrap_seed: int) -> list[dict[str, Any]]:
    """One row of results per order, then one per pair of orders."""
    training, weights = trained.training, trained.weights
    network = training.reinforce(weights.base_pose).network
    settings = {"objects": objects, "world": training.config.world}
    chunks = [
        compare_orders(
            training.robot, weights.base_pose, network, weights.sequence, scenes=count, seed=seed, **settings
        )
        for seed, count in seeds.items()
    ]
    orders = {
        name: OrderResult(*(np.concatenate(parts) for parts in zip(*(chunk[name] for chunk in chunks), strict=True)))
        for name in chunks[0]
    }
    rows = [{"objects": objects, "order": name, **_figures(result)} for name, result in orders.items()]
    for other in OTHERS:
        differences = _differences(orders[OURS], orders[other], bootstrap_seed)
        rows.append({"objects": objects, "difference": f"{OURS} - {other}", **differences})
    return rows


def _figures(result: OrderResult) -> dict[str, Any]:
    """Share of objects grasped, share of scenes where all are, and mean and sd of the times (s)."""
    times = {name: getattr(result, field) for name, field in QUANTITIES.items()}
    return {
        "grasped_share": float(result.grasped.mean()),
        "complete_share": float(np.mean(result.grasped == 1.0)),
        "times_s": {name: {"mean": float(t.mean()), "sd": float(t.std(ddof=1))} for name, t in times.items()},
    }


def _differences(ours: OrderResult, theirs: OrderResult, seed: int) -> dict[str, Any]:
    """Paired differences of the times (s), on all scenes and where both orders grasp everything."""
    complete = (ours.grasped == 1.0) & (theirs.grasped == 1.0)
    subsets = {"all_scenes_s": np.ones_like(complete), "both_complete_s": complete}
    return {"both_complete_share": float(complete.mean())} | {
        subset: {
            name: paired_difference(getattr(ours, field)[chosen], getattr(theirs, field)[chosen], seed=seed)
            for name, field in QUANTITIES.items()
        }
        for subset, chosen in subsets.items()
    }


def _table(results: list[dict[str, Any]], scenes: int) -> Table:
    table = Table(
        title=f"Orders on {scenes} scenes: times (s) as mean ± sd, differences with {CONFIDENCE:.0%} intervals"
    )
    for column in ("objects", "order", "scenes", "grasped %", *QUANTITIES):
        table.add_column(column, justify="left" if column == "order" else "right")
    for row in results:
        if "order" in row:
            times = (f"{time['mean']:.2f} ± {time['sd']:.2f}" for time in row["times_s"].values())
            table.add_row(str(row["objects"]), row["order"], "all", f"{100 * row['grasped_share']:.1f}", *times)
            continue
        share = f"{100 * row['both_complete_share']:.1f} % of scenes"
        for name, which in (("all_scenes_s", "all"), ("both_complete_s", f"both complete ({share})")):
            cells = (_interval(difference) for difference in row[name].values())
            table.add_row(str(row["objects"]), row["difference"], which, "", *cells)
    return table


def _interval(difference: dict[str, Any]) -> str:
    if difference["t"] is None:
        return "-"
    lower, upper = difference["t"]
    return f"{difference['mean']:+.2f} [{lower:+.2f}, {upper:+.2f}]"


if __name__ == "__main__":
    main()
