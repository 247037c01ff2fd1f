"""Pictures of plans and maps: data in, Matplotlib figures or images out."""

from basenet_jax.plots.comparison import PlannedScene, plot_comparison
from basenet_jax.plots.drawing import CLASS_COLORS
from basenet_jax.plots.plan import plot_plan
from basenet_jax.plots.reachability import plot_grasp_map, plot_reachability
from basenet_jax.plots.render import RenderError, Video, render_plan, render_video
from basenet_jax.plots.video import check_video, encode_video, save_video

__all__ = [
    "CLASS_COLORS",
    "PlannedScene",
    "RenderError",
    "Video",
    "check_video",
    "encode_video",
    "plot_comparison",
    "plot_grasp_map",
    "plot_plan",
    "plot_reachability",
    "render_plan",
    "render_video",
    "save_video",
]
