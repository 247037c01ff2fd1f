"""The panel beside the picture: its parts, and what they show. What they do is the business of `controls`."""

from collections.abc import Sequence

import viser

from basenet_jax.planners.registry import PLANNERS
from basenet_jax.viewer import words
from basenet_jax.viewer.asking import Answer
from basenet_jax.viewer.drawing import PLAN_COLORS, css
from basenet_jax.viewer.furnishing import NEW
from basenet_jax.viewer.planned import Shown
from basenet_jax.world.scene import OBJECT_CLASSES

NO_PLANNER = "none"
SPEEDS = {"as in life": 1.0, "4 x faster": 4.0, "8 x faster": 8.0, "16 x faster": 16.0, "32 x faster": 32.0}
_NO_NAMES: tuple[str, ...] = (words.NOTHING, words.START)  # to select
_STEP_S = 0.1  # of the timeline's slider


class Panel:
    """All parts of the panel, from top to bottom.

    Args:
        gui: to build in.
        planners: those chosen at first, one or two.
    """

    def __init__(self, gui: viser.GuiApi, planners: Sequence[str]):
        self._gui = gui
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        gui.set_panel_label("basenet_jax")
        self._status = gui.add_html("", visible=False)
        self._figures = gui.add_html("")
        with gui.add_folder("What can be picked from here", visible=False) as self._asking:  # seen without scrolling
            self._answer = gui.add_html("")
            self.forget = gui.add_button("Forget the question")
        gui.add_html(words.hints())
        self._add_planners(planners)
        self._add_timeline()
        self._add_objects()
        self._add_files()
        self.shadows = gui.add_checkbox("shadows", False, hint="Slower to draw without a graphics card.")

    def show_status(self, text: str) -> None:
        """What takes long now."""
        self._status.content = words.paragraph(f"⏳ {text} …")
        self._status.visible = bool(text)

    def show_figures(self, plans: Sequence[Shown]) -> None:
        """Times of the plans, and what they leave and why."""
        self._figures.content = words.figures(plans, [css(color) for color in PLAN_COLORS])

    def show_answer(self, answer: Answer | None) -> None:
        """What can be picked from the place that was asked about."""
        self._answer.content = "" if answer is None else words.answer(answer)
        self._asking.visible = answer is not None

    def show_names(self, objects: Sequence[str], furniture: Sequence[str]) -> None:
        """Names to select; where there is furniture, more can be added."""
        options = (*_NO_NAMES, *objects, *furniture)
        if self.selected.options != options:
            self.selected.options = options
        self.piece.visible = self.add_piece.visible = bool(furniture)

    def show_selected(self, name: str | None) -> None:
        """What is selected."""
        self.selected.value = name or words.NOTHING
        self.remove.disabled = name is None or name == words.START

    def show_time(self, time_s: float, *, playing: bool) -> None:
        """Where the timeline is, and whether it goes on."""
        self.time.value = round(time_s, 1)
        self.play.label = "Pause" if playing else "Play"

    def show_doing(self, text: str) -> None:
        """What the robot does now."""
        if text:
            self._doing.content = words.paragraph(text)
        self._doing.visible = bool(text)

    def show_end(self, end_s: float) -> None:
        """How long the timeline is."""
        self.time.max = max(_STEP_S, round(end_s + _STEP_S / 2, 1))
        self.play.disabled = self.time.disabled = end_s == 0.0

    def _add_planners(self, planners: Sequence[str]) -> None:
        second = planners[1] if len(planners) > 1 else NO_PLANNER
        names = tuple(PLANNERS)
        self.planner = self._gui.add_dropdown("planner", names, initial_value=planners[0])
        self.second = self._gui.add_dropdown("compare with", (NO_PLANNER, *names), initial_value=second)

    def _add_timeline(self) -> None:
        self.play = self._gui.add_button("Play")
        self.time = self._gui.add_slider("time (s)", 0.0, 1.0, _STEP_S, 0.0)
        self._doing = self._gui.add_html("", visible=False)
        self.speed = self._gui.add_dropdown("speed", tuple(SPEEDS), initial_value="8 x faster")

    def _add_objects(self) -> None:
        with self._gui.add_folder("Objects"):
            self.selected: viser.GuiDropdownHandle[str] = self._gui.add_dropdown("selected", _NO_NAMES)
            self.remove = self._gui.add_button("Remove what is selected", disabled=True)
            self.kind = self._gui.add_dropdown("class", tuple(kind.name for kind in OBJECT_CLASSES))
            self.add = self._gui.add_button("Add an object of this class")
            self.piece = self._gui.add_dropdown("furniture", tuple(NEW), visible=False)
            self.add_piece = self._gui.add_button("Add this furniture", visible=False)

    def _add_files(self) -> None:
        with self._gui.add_folder("Files", expand_by_default=False) as self.files:  # pages add their own to open files
            self.random = self._gui.add_button("Another random scene")
            self.download_scene = self._gui.add_button("Save the scene")
            self.download_plan = self._gui.add_button("Save the plan")
