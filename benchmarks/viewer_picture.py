"""The docs' pictures of the viewer: its page in a headless browser, in the middle of a plan.

The README's is drawn by default; that of a room by `--scene docs/examples/room.yaml --planners greedy-stops --time-s 13
--ask 2.9 4.1 --out docs/pictures/viewer_room.png`.
"""

from dataclasses import dataclass
from pathlib import Path

import jax
import tyro

import basenet_jax as bn
from basenet_jax.compilation import enable_cache
from benchmarks.browser import DRAWN_MS, page_of

PATIENCE_S = 600.0  # with compiling


@dataclass(frozen=True)
class Options:
    """What is shown and where it goes."""

    out: Path = Path("docs/viewer.png")
    """The picture."""
    scene: Path | None = None
    """What is shown instead of a random scene; all of it is seen."""
    ask: tuple[float, float] | None = None
    """A place on the floor that is asked about (m)."""
    seed: int = 3
    """Of the scene."""
    objects: int = 8
    """In the scene."""
    planners: tuple[str, ...] = ("basenet", "dp")
    """One, or two side by side."""
    time_s: float = 32.0
    """Into the plan."""


def main(arguments: list[str] | None = None) -> None:
    """Takes the picture."""
    from basenet_jax.viewer.app import Viewer
    from basenet_jax.viewer.editing import pad
    from basenet_jax.viewer.session import Choices

    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.viewer_picture", description=__doc__)
    enable_cache()
    if options.scene is None:
        scene = bn.sample_scene(jax.random.key(options.seed), objects=options.objects)
    else:
        scene = pad(bn.load_scene(options.scene))
    viewer = Viewer(scene, Choices(tuple(options.planners)))
    if options.scene is None:
        viewer.server.initial_camera.position = (0.6, 4.4, 3.4)
        viewer.server.initial_camera.look_at = (-0.4, 0.5, 0.3)  # the panel covers the right side
    viewer.session.ask(options.ask)
    try:
        viewer.session.wait_idle(PATIENCE_S)
        with page_of(viewer, 1280, 760) as page:
            viewer.page.go_to(options.time_s)
            page.wait_for_timeout(DRAWN_MS)
            page.screenshot(path=options.out)
    finally:
        viewer.close()


if __name__ == "__main__":
    main()
