"""The viewer in a real browser: headless Chromium, driven by Playwright, the mouse being moved as a hand would."""

import io
import json
import time
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect, sync_playwright

from basenet_jax import api
from basenet_jax.planners import registry
from basenet_jax.planners.greedy_stops import greedy_stops
from basenet_jax.planners.protocol import PlanningError
from basenet_jax.task.plan import compiled_execute
from basenet_jax.viewer.app import Viewer
from basenet_jax.viewer.furnishing import pieces
from basenet_jax.viewer.pointing import Target
from basenet_jax.viewer.session import Choices
from basenet_jax.world.scene_file import load_scene
from benchmarks.browser import ARGUMENTS, drag, find_chromium, where_seen
from tests.scene_texts import TEXT
from tests.viewer import WATCHDOG_S

pytestmark = pytest.mark.browser
expect.set_options(timeout=1000 * WATCHDOG_S)

PLANNER = "greedy-stops"  # compiles sooner than others
# Chromium objects to how viser's own client keeps the page from scrolling while something is dragged.
NOT_OURS = "Unable to preventDefault inside passive event listener invocation."
WIDTH, HEIGHT = 1280, 640  # pixels; so wide that the panel hides nothing that is dragged


@pytest.fixture(scope="module")
def browser():
    try:
        program = find_chromium()
    except RuntimeError as error:
        pytest.skip(str(error))
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=list(ARGUMENTS), timeout=1000 * WATCHDOG_S)
        yield started
        started.close()


@pytest.fixture(scope="module")
def running(scene):
    viewer = Viewer(scene, Choices((PLANNER,)))
    viewer.server.initial_camera.position = (0.6, -4.0, 4.5)
    viewer.server.initial_camera.look_at = (0.8, 0.0, 0.0)
    assert viewer.session.wait_idle(WATCHDOG_S)
    yield viewer
    assert viewer.session.wait_idle(WATCHDOG_S)
    assert viewer.close()


@pytest.fixture
def viewer(running, scene):
    """With its first scene, and nothing selected or asked."""
    running.session.choose(PLANNER)
    running.session.replace_scene(scene)
    running.session.ask(None)
    running.page.select(None)
    assert running.session.wait_idle(WATCHDOG_S)
    return running


@pytest.fixture(scope="module")
def errors():
    """What tabs complain of."""
    return []


def open_tab(browser, viewer, errors):
    """Another tab of the browser with the viewer in it, once the mouse hits what is there."""
    tab = open_panel(browser, viewer, errors)
    wait_until_drawn(viewer, tab)
    return tab


def open_panel(browser, viewer, errors):
    """Another tab, once its panel is there."""
    tab, others = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}), len(viewer.server.get_clients())
    tab.set_default_timeout(1000 * WATCHDOG_S)
    tab.on("console", lambda message: message.type == "error" and errors.append(message.text))
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("requestfailed", lambda request: errors.append(request.url))
    tab.goto(viewer.url)
    expect(tab.get_by_text("N + G")).to_be_visible()
    wait_for(lambda: len(viewer.server.get_clients()) == others + 1)
    return tab


@pytest.fixture(scope="module")
def first_tab(browser, running, errors):
    return open_tab(browser, running, errors)


@pytest.fixture
def page(first_tab, viewer, errors):
    """The first tab, with the first scene; nothing may go wrong in it."""
    wait_until_drawn(viewer, first_tab)
    errors.clear()
    yield first_tab
    assert not [error for error in errors if error != NOT_OURS]


def wait_for(condition):
    end = time.monotonic() + WATCHDOG_S
    while not condition():
        assert time.monotonic() < end, "it never happens"
        time.sleep(0.02)


def picture_of(tab):
    """What a tab shows, as colours (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"), float)


def wait_until_still(tab):
    """Until two pictures in a row are the same, which is returned."""
    before, now = None, picture_of(tab)
    while before is None or not np.array_equal(before, now):
        before, now = now, picture_of(tab)
    return now


def wait_until_drawn(viewer, tab):
    """Until both mugs stand on the table and the robot at its start: the mouse only hits what is drawn."""
    arrays = viewer.session.scene.arrays
    x, y, _ = arrays.robot_start
    empty, floor = [-0.9, 0.3, float(arrays.room.table_height)], [x - 1.0, y - 1.0, 0.0]
    pairs = [*((top_of(viewer, name), empty) for name in viewer.session.scene.names), ([x, y, 0.5], floor)]
    wait_for(lambda: viewer.server.get_clients())

    def is_drawn():
        picture = wait_until_still(tab)
        colors = [
            [picture[v, u] for u, v in (np.round(seen(viewer, tab, p)).astype(int) for p in pair)] for pair in pairs
        ]
        return all(np.abs(a - b).max() > 15 for a, b in colors)

    wait_for(is_drawn)


def seen(viewer, page, point):
    """Where in a tab a point of the scene is; all tabs look at it alike."""
    return where_seen(next(iter(viewer.server.get_clients().values())).camera, point, page)


def top_of(viewer, name):
    arrays, slot = viewer.session.scene.arrays, viewer.session.scene.names.index(name)
    return np.array([*arrays.object_pose[slot, :2], arrays.room.table_height + arrays.object_size[slot, 2]], float)


def figures(plan):
    outcome = plan.outcome
    return [f"{float(value):.1f} s" for value in (outcome.navigation, outcome.picking, outcome.execution)]


def shows(page, texts):
    for text in texts:
        expect(page.get_by_text(text, exact=True).first).to_be_visible()


def drag_mug(viewer, page, to=(-0.6, 0.1)):
    """Drags the first mug across the table, and waits for the plan."""
    start = top_of(viewer, "mug_1")
    drag(page, seen(viewer, page, start), seen(viewer, page, [*to, start[2]]))
    wait_for(lambda: np.hypot(*(viewer.session.scene.arrays.object_pose[0, :2] - to)) < 0.03)
    assert viewer.session.wait_idle(WATCHDOG_S)


def test_the_page_shows_scene_and_plan(viewer, page):
    shows(page, [PLANNER, "2 of 2", *figures(viewer.session.plans[0])])
    picture = page.screenshot()
    assert len(picture) > 30_000, "an empty picture packs into less"


def test_dragging_an_object_changes_the_plan(viewer, page):
    before = figures(viewer.session.plans[0])
    drag_mug(viewer, page)
    after = figures(viewer.session.plans[0])
    assert after != before
    shows(page, after)
    assert viewer.page.selected == Target("mug_1")


def test_dragging_the_robot_moves_its_start(viewer, page):
    x, y, _ = viewer.session.scene.arrays.robot_start
    drag(page, seen(viewer, page, [x, y, 0.75]), seen(viewer, page, [x - 0.5, y - 0.6, 0.75]))
    wait_for(lambda: np.hypot(*(viewer.session.scene.arrays.robot_start[:2] - [x - 0.5, y - 0.6])) < 0.1)
    assert viewer.session.wait_idle(WATCHDOG_S)
    assert viewer.session.plans[0].scene is viewer.session.scene


def test_the_gizmo_of_a_clicked_object_turns_it(viewer, page):
    before = picture_of(page)
    page.mouse.click(*seen(viewer, page, top_of(viewer, "mug_1")))
    wait_for(lambda: viewer.page.selected == Target("mug_1"))
    wait_for(lambda: not np.array_equal(wait_until_still(page), before))
    gizmo = viewer.page.gizmo
    x, y, yaw = gizmo.pose
    height, radius = float(gizmo.handle.position[2]), 0.65 * gizmo.handle.scale  # of the arc: what viser's client draws
    ends = [[x + radius * np.cos(yaw + a), y + radius * np.sin(yaw + a), height] for a in (0.6, 1.4)]
    drag(page, *(seen(viewer, page, end) for end in ends))
    wait_for(lambda: abs(viewer.session.scene.arrays.object_pose[0, 2] - (yaw + 0.8)) < 0.15)
    np.testing.assert_allclose(viewer.session.scene.arrays.object_pose[0, :2], [x, y], atol=1e-3)


def test_a_click_on_the_floor_asks_what_can_be_picked_there(viewer, page):
    page.mouse.click(*seen(viewer, page, [0.35, -0.95, 0.0]))
    expect(page.get_by_text("What can be picked from here")).to_be_visible()
    expect(page.get_by_text("2 of 2 objects")).to_be_visible()
    page.get_by_role("button", name="Forget the question").click()
    expect(page.get_by_text("What can be picked from here")).to_be_hidden()


def test_the_timeline_moves_the_robot(viewer, page):
    at_rest = page.screenshot(clip={"x": 0, "y": 0, "width": 560, "height": 640})
    viewer.page.timeline.speed = 0.1  # however long a click takes, the end is far
    viewer.page.go_to(8.0)
    page.get_by_role("button", name="Play").click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    wait_for(lambda: viewer.page.timeline.time_s > 8.0)
    page.get_by_role("button", name="Pause").click()
    wait_for(lambda: not viewer.page.timeline.playing)
    wait_for(lambda: page.screenshot(clip={"x": 0, "y": 0, "width": 560, "height": 640}) != at_rest)
    assert 8.0 < viewer.page.timeline.time_s < viewer.page.timeline.end_s
    drag_from = seen(viewer, page, top_of(viewer, "mug_2"))
    drag(page, drag_from, (drag_from[0] - 40, drag_from[1]))
    wait_for(lambda: viewer.page.timeline.time_s == 0.0)


def test_a_second_tab_and_a_reload_show_the_same(viewer, browser, page, errors):
    second = open_tab(browser, viewer, errors)
    drag_mug(viewer, second)
    expected = figures(viewer.session.plans[0])
    shows(page, expected)
    shows(second, expected)
    second.reload()
    expect(second.get_by_text("N + G")).to_be_visible()
    shows(second, expected)
    second.close()
    wait_for(lambda: len(viewer.server.get_clients()) == 1)
    drag_mug(viewer, page, to=(-0.3, 0.2))
    shows(page, figures(viewer.session.plans[0]))


def test_objects_are_added_and_removed_and_nothing_compiles_again(viewer, page):
    def programs() -> list[int]:
        return [cast(Any, greedy_stops)._cache_size(), compiled_execute.count]

    compiled = programs()
    page.get_by_role("button", name="Add an object of this class").click()
    wait_for(lambda: viewer.session.scene.names == ("mug_1", "mug_2", "cracker_box_1"))
    assert viewer.session.wait_idle(WATCHDOG_S)
    shows(page, ["3 of 3"])
    page.get_by_role("button", name="Remove what is selected").click()
    wait_for(lambda: viewer.session.scene.names == ("mug_1", "mug_2"))
    shows(page, ["2 of 2"])
    assert viewer.session.wait_idle(WATCHDOG_S)
    assert programs() == compiled


def test_two_planners_side_by_side(viewer, page):
    viewer.session.choose(PLANNER, "pbg-gc")
    assert viewer.session.wait_idle(WATCHDOG_S)
    first, second = viewer.session.plans
    assert (first.maker, second.maker) == (PLANNER, "pbg-gc")
    shows(page, [PLANNER, "pbg-gc", *figures(first), *figures(second)])


@pytest.mark.parametrize(
    ("which", "name", "content", "message"),
    [
        (0, "mine.yaml", b"format: basenet-scene/1\nobjects: 7\n", "mine.yaml: objects: found 7"),
        (0, "robot.yaml", TEXT.replace("ur5e_mobile", "/etc/passwd").encode(), "a robot of your own is given by"),
        (1, "plan.json", b"[]", "plan.json: content: found []"),
    ],
)
def test_a_bad_file_gets_a_message(viewer, page, which, name, content, message):
    scene = viewer.session.scene
    file = {"name": name, "mimeType": "application/octet-stream", "buffer": content}
    page.locator("input[type=file]").nth(which).set_input_files([file])
    expect(page.get_by_text(message)).to_be_visible()
    expect(page.get_by_text("uploaded successfully")).to_be_hidden()
    assert viewer.session.scene is scene


def test_files_go_to_the_page_and_come_back(viewer, page, tmp_path):
    page.get_by_text("Files", exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the scene").click()
    download.value.save_as(tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml").names == ("mug_1", "mug_2")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the plan").click()
    download.value.save_as(tmp_path / "mine.json")
    assert json.loads((tmp_path / "mine.json").read_text())["planner"] == PLANNER
    page.locator("input[type=file]").nth(1).set_input_files(tmp_path / "mine.json")
    shows(page, ["mine.json", "from a file"])
    (tmp_path / "other.yaml").write_text(TEXT)
    page.locator("input[type=file]").nth(0).set_input_files(tmp_path / "other.yaml")
    wait_for(lambda: viewer.session.scene.names == ("mug_1", "part_7"))
    assert viewer.session.wait_idle(WATCHDOG_S)


def test_nobody_else_is_told_of_an_upload(viewer, page, browser, errors):
    """Nor how far it has come: broken off, it would grey everybody's button for good."""
    page.locator("input[type=file]").nth(0).set_input_files(
        [{"name": "mine.yaml", "mimeType": "application/yaml", "buffer": TEXT.encode()}]
    )
    wait_for(lambda: viewer.session.scene.names == ("mug_1", "part_7"))
    shared = viewer.server._websock_server.get_message_buffer().message_from_id.values()
    assert not any(type(message).__name__ == "FileTransferPartAck" for message in list(shared))
    second = open_panel(browser, viewer, errors)
    expect(second.get_by_text("mine.yaml")).to_be_hidden()
    second.close()
    wait_for(lambda: len(viewer.server.get_clients()) == 1)


def test_why_something_isn_t_done_is_told_to_who_did_it_alone(viewer, page, browser, errors):
    start = top_of(viewer, "mug_1")
    end = np.array([*viewer.session.scene.arrays.object_pose[1, :2], start[2]])
    drag(page, seen(viewer, page, start), seen(viewer, page, end))
    expect(page.get_by_text("mug_1 can't stand there, mug_2 does")).to_be_visible()
    second = open_panel(browser, viewer, errors)
    expect(second.get_by_text("mug_1 can't stand there")).to_be_hidden()
    second.close()
    wait_for(lambda: len(viewer.server.get_clients()) == 1)


def test_standing_still_the_server_sends_nothing(viewer, page, monkeypatch):
    from websockets.asyncio.server import ServerConnection

    sent = []

    async def count(self, *arguments, **options):
        del self, options
        sent.append(arguments)

    monkeypatch.setattr(ServerConnection, "send", count)
    page.wait_for_timeout(1_000)  # of watching
    assert not sent
    viewer.session.move(None, np.array([-2.0, -1.0, 0.3]))
    assert viewer.session.wait_idle(WATCHDOG_S)
    wait_for(lambda: sent)


class Nothing:
    """A planner of no plans, which compiles nothing."""

    def __init__(self, *_):
        pass

    def __call__(self, scene, key):
        raise PlanningError("nothing is planned here")


def test_in_a_room_tables_carry_their_objects_and_objects_change_tables(browser, room, errors, monkeypatch):
    monkeypatch.setattr(registry, "make_planner", Nothing)
    api._planner.cache_clear()
    viewer = Viewer(room, Choices((PLANNER,)))
    try:
        assert viewer.session.wait_idle(WATCHDOG_S)
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        tab.set_default_timeout(1000 * WATCHDOG_S)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(viewer.url)
        expect(tab.get_by_text("nothing is planned here")).to_be_visible()
        wait_until_still(tab)
        bench, shelf = (pieces(room.furniture)[name].boxes.start for name in ("bench", "shelf_2"))

        def arrays():
            return viewer.session.scene.arrays

        def drag_to(start, end, moved):
            """Again, should not all have been drawn before."""
            before = moved()
            while np.allclose(moved(), before):
                drag(tab, seen(viewer, tab, start), seen(viewer, tab, end))
                wait_until_still(tab)
                assert viewer.session.wait_idle(WATCHDOG_S)

        corner = np.array([2.25, 2.35, 0.82])  # of the bench, where no object stands
        drag_to(corner, corner + np.array([0.3, -0.2, 0.0]), lambda: arrays().room.boxes.pose[bench, :2])
        shift = np.asarray(arrays().room.boxes.pose[bench, :2]) - (2.0, 3.1)
        np.testing.assert_allclose(shift, (0.3, -0.2), atol=0.05)
        np.testing.assert_allclose(arrays().object_pose[:2, :2], room.arrays.object_pose[:2, :2] + shift, atol=1e-3)

        mug = np.array([*arrays().object_pose[0, :2], 0.82 + room.arrays.object_size[0, 2]])
        drag_to(mug, [5.7, 0.4, mug[2] + 0.23], lambda: arrays().object_pose[0])
        assert arrays().surface_height[0] == arrays().room.boxes.high[shelf]
        np.testing.assert_allclose(arrays().object_pose[0, :2], (5.7, 0.4), atol=0.05)
        tab.close()
    finally:
        assert viewer.close()
        api._planner.cache_clear()


def test_shadows_are_a_box_to_tick(viewer, page):
    surroundings, box = viewer.page.surroundings, page.get_by_role("checkbox")
    assert not surroundings.shadows
    box.check()
    wait_for(lambda: surroundings.shadows)
    box.uncheck()
    wait_for(lambda: not surroundings.shadows)
