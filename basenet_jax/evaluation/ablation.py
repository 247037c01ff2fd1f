"""What the paper's ablations come to: final figures of every seed, learning curves, and where base poses are put."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from basenet_jax.learning.ablation import VARIANTS, Ablation, Study, layer_of
from basenet_jax.policies.base_pose import base_pose_from_action, pose_in_frame

BASE_POSE_OBJECTS = 1_000  # random ones, as in the paper
FIGURES = {  # of each study: what the curves show, and how it is called
    "base-frame": {"success": "single picks that succeed", "navigation_time": "navigation time (s)"},
    "baseline": {"navigation_time": "navigation time (s)", "driven_to": "objects driven to"},
    "attention": {"navigation_time": "navigation time (s)", "driven_to": "objects driven to"},
}


class BasePoses(NamedTuple):
    """Where one seed's policies put the base for random objects; B of them."""

    pose: Float[np.ndarray, "B 3"]  # (x, y, heading) in the frame of the variant: the object's, or W
    success: Bool[np.ndarray, " B"]
    success_of_seeds: list[float]  # share, of every seed

    @property
    def share(self) -> float:
        """Share of picks that succeed, over all seeds."""
        return float(np.mean(self.success_of_seeds))


def read_curves(metrics: Path, studies: tuple[Study, ...]) -> dict[str, dict[str, dict[str, np.ndarray]]]:
    """By study, variant and figure: values of shape (seeds, intervals), from a run directory's `metrics.jsonl`."""
    records = [json.loads(line) for line in metrics.read_text(encoding="utf-8").splitlines()]
    return {
        study: {
            variant: {
                figure: _values([record for record in records if record["layer"] == layer_of(study, variant)], figure)
                for figure in FIGURES[study]
            }
            for variant in VARIANTS[study]
        }
        for study in studies
    }


def final_figures(curves: dict[str, dict[str, dict[str, np.ndarray]]]) -> dict[str, Any]:
    """The last interval's figures: mean, least and most over the seeds, and each seed's. JSON-able."""
    return {
        study: {
            variant: {
                figure: {
                    "mean": float(values[:, -1].mean()),
                    "min": float(values[:, -1].min()),
                    "max": float(values[:, -1].max()),
                    "seeds": values[:, -1].tolist(),
                }
                for figure, values in figures.items()
            }
            for variant, figures in variants.items()
        }
        for study, variants in curves.items()
    }


def base_poses(ablation: Ablation, states: dict[str, Any], seed: int) -> dict[str, BasePoses]:
    """By variant of the study of frames: base poses for the same random objects and robots.

    Args:
        ablation: that was trained.
        states: what its training returned.
        seed: of the objects, apart from those of training.
    """
    results = {}
    for variant in VARIANTS["base-frame"]:
        learner = ablation.sac(variant)
        state = states[layer_of("base-frame", variant)]

        def play(state: Any, learner: Any = learner) -> tuple[jax.Array, jax.Array]:
            keys = jax.random.split(jax.random.key(seed), BASE_POSE_OBJECTS)
            start = jax.vmap(learner.evaluation_env.reset)(keys)
            grasp, policy = start.info["grasp"], learner.policy(state)
            action = policy.action(grasp, start.info["robot_pose"])
            trial = learner.evaluation_env.park(start, base_pose_from_action(action, grasp, policy.frame))
            return pose_in_frame(action, policy.frame), trial.success

        local, success = jax.device_get(jax.jit(jax.vmap(play))(state))
        results[variant] = BasePoses(local[0], success[0], success.mean(axis=1).tolist())
    return results


def as_markdown(final: dict[str, Any], poses: dict[str, BasePoses] | None, command: str) -> str:
    """The figures as one table per study: mean over the seeds, least and most in brackets."""
    lines = [f"`{command}`", ""]
    for study, variants in final.items():
        names = FIGURES[study]
        lines += [f"**{study}**", "", "| variant | " + " | ".join(names.values()) + " |"]
        lines += ["|---" * (1 + len(names)) + "|"]
        for variant, figures in variants.items():
            cells = (f"{each['mean']:.3f} ({each['min']:.3f} to {each['max']:.3f})" for each in figures.values())
            lines.append(f"| {variant} | " + " | ".join(cells) + " |")
        lines.append("")
    for variant, each in (poses or {}).items():
        shares = each.success_of_seeds
        low, high = 100 * min(shares), 100 * max(shares)
        lines.append(
            f"- {BASE_POSE_OBJECTS} random objects, {variant}: {100 * each.share:.1f} % of picks succeed "
            f"({low:.1f} to {high:.1f})"
        )
    return "\n".join([*lines, ""])


def _values(records: list[dict[str, Any]], figure: str) -> Float[np.ndarray, "seeds intervals"]:
    seeds = sum(name.startswith(f"{figure}/") for name in records[0])
    return np.array([[record[f"{figure}/{seed}"] for record in records] for seed in range(seeds)])
