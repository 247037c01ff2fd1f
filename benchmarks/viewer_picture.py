"""The README's picture of the viewer: its page in a headless browser, in the middle of a plan, drawn into docs/."""

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
    from basenet_jax.viewer.session import Choices

    options = tyro.cli(Options, args=arguments, prog="python -m benchmarks.viewer_picture", description=__doc__)
    enable_cache()
    viewer = Viewer(
        bn.sample_scene(jax.random.key(options.seed), objects=options.objects), Choices(tuple(options.planners))
    )
    viewer.server.initial_camera.position = (0.6, 4.4, 3.4)
    viewer.server.initial_camera.look_at = (-0.4, 0.5, 0.3)  # the panel covers the right side
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
