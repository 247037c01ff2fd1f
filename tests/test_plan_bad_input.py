"""Whatever a scene file holds, the plan command ends with 0, 2 or 3, one message, and no half-written output."""

import contextlib
import io
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from basenet_jax import api, plan
from basenet_jax.planners import registry
from basenet_jax.task.plan_file import load_plan
from basenet_jax.world.scene_file import load_scene
from tests import room_texts
from tests.scene_texts import TEXT, content, park_once

ROOT = Path(__file__).parents[1]
SLOW = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _cheap_planner():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "make_planner", lambda name, setup, options: park_once)
        api._planner.cache_clear()
        yield
    api._planner.cache_clear()


def run_and_check(data: bytes, name: str) -> int:
    """Plans a scene file of these bytes and checks all that is promised; the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, name), Path(folder, "plan.json")
        path.write_bytes(data)
        printed, said = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
            code = plan.main([str(path), "--out", str(out)])
        message = said.getvalue()
        left = {entry.name for entry in Path(folder).iterdir()}
        if code == 2:
            check_message(message, path)
            assert (printed.getvalue(), left) == ("", {name})
        else:
            assert code in (0, 3)
            assert (message != "") == (code == 3)
            assert left == {name, "plan.json"}
            load_plan(out, load_scene(path))
    return code


FIELD = r"(?:(?=[\w\[])[\w-]*(?:\[\d+\])*(?:\.[\w-]+(?:\[\d+\])*)*|line \d+)"  # or `content`


def check_message(message: str, path: Path) -> None:
    """One line: the file, the field or line, what was found and what is allowed, or what is wrong with the syntax."""
    start = re.escape(f"basenet_jax.plan: {path}: ")
    map_file = r"(?:map: hall\.(?:yaml|pgm): )?"
    wrong = rf"{start}{map_file}{FIELD}: (?:found .+, allowed (?:is|are) .+|no (?:YAML|JSON): .+)\n"
    assert re.fullmatch(wrong, message), message
    assert len(message) < 500


def paths_of(value, path=()):
    """All places in nested lists and dictionaries."""
    yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in children:
        yield from paths_of(child, (*path, key))


def at(scene, path):
    """What stands at a place."""
    for key in path:
        scene = scene[key]
    return scene


ODD = (
    st.none()
    | st.booleans()
    | st.integers(-3, 3)
    | st.integers()
    | st.floats()
    | st.sampled_from(
        [1e308, -1e-308, 10**400, float("nan"), float("inf"), "", "nan", "1e5", "mug", "[]", "\x00", "\ud800"]
    )
    | st.text(max_size=5)
)
VALUES = ODD | st.recursive(
    ODD, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner)
)


@st.composite
def mutated(draw):
    """The valid scene with one to three of its parts replaced, removed, repeated or added to."""
    scene = content()
    for _ in range(draw(st.integers(1, 3))):
        change = draw(st.sampled_from(["nudge", "nudge", "nudge", "replace", "remove", "repeat", "add"]))
        places = [path for path in paths_of(scene) if path]
        numbers = [path for path in places if isinstance(at(scene, path), float)]
        path = draw(st.sampled_from(numbers if change == "nudge" and numbers else places))
        parent, old = at(scene, path[:-1]), at(scene, path)
        if change == "replace":
            parent[path[-1]] = draw(VALUES)
        elif change == "nudge" and isinstance(old, float):
            parent[path[-1]] = old + draw(st.floats(-0.1, 0.1) | st.floats(-2, 2))
        elif change == "remove":
            del parent[path[-1]]
        elif isinstance(parent, list):
            parent.append(json.loads(json.dumps(old)))
        else:
            parent[draw(st.sampled_from(["Name", "pose ", "x", "size", "class", "grasp"]))] = draw(VALUES)
    return scene


def as_yaml(scene) -> bytes:
    return yaml.safe_dump(scene, allow_unicode=True).encode("utf-8", "surrogatepass")


@settings(max_examples=150)
@given(mutated())
@example(content())
@example(content() | {"robot": "\ud800"})
def test_changed_scenes_as_yaml(scene):
    run_and_check(as_yaml(scene), "scene.yaml")


@settings(max_examples=150)
@given(mutated())
@example(content())
def test_changed_scenes_as_json(scene):
    run_and_check(json.dumps(scene).encode(), "scene.json")


@settings(max_examples=250)
@given(st.data(), st.sampled_from(["scene.yaml", "scene.json"]))
def test_damaged_bytes(data, name):
    text = TEXT.encode() if name == "scene.yaml" else json.dumps(content()).encode()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    run_and_check(text[:start] + data.draw(st.binary(max_size=20)) + text[end:], name)


@settings(max_examples=100)
@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode), st.sampled_from(["scene.yaml", "scene.json"]))
def test_anything_at_all(data, name):
    assert run_and_check(data, name) == 2


@pytest.mark.parametrize(
    ("old", "new"), [("start: [4.2", "start: [4.0, 3.0"), ("on: bench", "on: table"), ("docked", "fast"), ("map", "m")]
)
def test_a_bad_room_is_refused_likewise(old, new):
    text = room_texts.TEXT.replace("drives:", "map: none.yaml\ndrives:") if old == "map" else room_texts.TEXT
    assert run_and_check(text.replace(old, new, 1).encode(), "room.yaml") == 2


HALL = {"image": "hall.pgm", "resolution": 0.1, "origin": [0, 0, 0], "negate": 0} | {
    "occupied_thresh": 0.65,
    "free_thresh": 0.25,
}
FREE = b"P5 100 80 255\n" + b"\xfe" * 8000


def with_map(**changes):
    return {"map": HALL | changes}


def surface(name, pose, **more):
    return {"surface": {"name": name, "pose": pose, "size": [1.0, 1.0], "height": 0.8} | more}


BAD_ROOMS = {
    "no map": {"room": {"map": "none.yaml"}},
    "map elsewhere": {"room": {"map": "../hall.yaml"}},
    "map by its whole path": {"room": {"map": "/etc/hostname"}},
    "image elsewhere": with_map(image="../hall.pgm"),
    "no resolution": with_map(resolution=0),
    "resolution of NaN": with_map(resolution=float("nan")),
    "100 megapixels": with_map() | {"image": b"P5 10000 10000 255\n"},
    "16 bits": with_map() | {"image": b"P5 100 80 65535\n" + bytes(16000)},
    "image too short": with_map() | {"image": FREE[:-10]},
    "image too long": with_map() | {"image": FREE + b"\xfe" * 100},
    "nothing known": with_map() | {"image": FREE.replace(b"\xfe", b"\xcd")},
    "start off the map": with_map(origin=[50, 50, 0]),
    "surfaces overlap": surface("over", [2.2, 3.1, 0.0]),
    "surface through the floor": surface("low", [5.5, 4.5, 0.0], thickness=0.9),
    "surface in a wall": surface("in_the_wall", [4.0, 6.2, 0.0]),
    "start in a box": {"room": {"robot": {"start": [4.0, 3.0, 0.0]}}},
    "object over two surfaces": surface("board", [1.9, 3.7, 0.0], height=1.6, thickness=0.03),
    "300 boxes": {
        "room": {"obstacles": [{"name": f"b{i}", "pose": [5, 5, 0], "size": [0.1, 0.1, 0.1]} for i in range(300)]}
    },
}


@pytest.mark.parametrize("bad", BAD_ROOMS.values(), ids=BAD_ROOMS)
def test_bad_rooms_end_with_one_message(tmp_path, capsys, bad):
    room = room_texts.content() | bad.get("room", {})
    if "map" in bad:
        room["map"] = "hall.yaml"
        (tmp_path / "hall.yaml").write_text(yaml.safe_dump(bad["map"]))
        (tmp_path / "hall.pgm").write_bytes(bad.get("image", FREE))
    room["surfaces"] += [bad["surface"]] if "surface" in bad else []
    path = tmp_path / "room.yaml"
    path.write_text(yaml.safe_dump(room))
    before = sorted(tmp_path.iterdir())
    assert plan.main([str(path), "--out", str(tmp_path / "plan.json"), "--export", str(tmp_path / "export")]) == 2
    printed, said = capsys.readouterr()
    assert (printed, sorted(tmp_path.iterdir())) == ("", before)
    check_message(said, path)


def test_the_valid_scene_is_planned_so_the_others_are_refused_for_their_changes():
    assert run_and_check(TEXT.encode(), "scene.yaml") == 0
    assert run_and_check(json.dumps(content()).encode(), "scene.json") == 0
    far = TEXT.replace("pose: [0.1, -0.2, 1.1]", "pose: [-0.9, 0.3, 1.1]")
    assert run_and_check(far.encode(), "scene.yaml") == 3


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"# \n" * (10 * 2**20 // 3), "content: found more than 65536 bytes, allowed are up to 65536"),
        (BOMB.encode(), "line 1: found the anchor or alias 'a', allowed is YAML without"),
        pytest.param(b"\x7fELF\x80", "content: found the byte 0x80 at offset 4, allowed is UTF-8 text", marks=SLOW),
        pytest.param(b"", "content: found an empty file, allowed is YAML or JSON", marks=SLOW),
    ],
    ids=["10 MB", "bomb", "binary", "empty"],
)
def test_as_a_command(tmp_path, data, said):
    path = tmp_path / "scene.yaml"
    path.write_bytes(data)
    command = [sys.executable, "-m", "basenet_jax.plan", str(path), "--out", str(tmp_path / "plan.json")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"basenet_jax.plan: {path}: {said}\n"
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene.yaml"]
