"""ROS maps: cells as map_server reads them, boxes that cover what is closed, and words for what is wrong."""

import io
import math
import re
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from basenet_jax.documents.fields import DocumentError
from basenet_jax.world.furniture import FLAT_M
from basenet_jax.world.occupancy_map import OccupancyMap, check_on_map, map_boxes, read_map
from tests.oracles import occupancy_map as oracle
from tests.shared_data import shared_file

FIELDS = {
    "image": "map.png",
    "resolution": 0.05,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.25,
}


def write(folder, fields, image=None):
    """A map in a folder; the image is an array of grey, grey and alpha, colours, or colours and alpha."""
    lines = [f"{key}: {value}" for key, value in fields.items()]
    (folder / "map.yaml").write_text("\n".join(lines) + "\n")
    if image is not None:
        Image.fromarray(image).save(folder / "map.png")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("maps")


LEVELS = np.arange(256, dtype=np.uint8).reshape(16, 16)
ALPHA = np.random.default_rng(1).choice([0, 1, 100, 254, 255], (16, 16)).astype(np.uint8)
COLORS = np.random.default_rng(2).integers(0, 256, (16, 16, 3), np.uint8)
IMAGES = {"grey": LEVELS, "grey and alpha": np.dstack([LEVELS, ALPHA]), "color": COLORS}


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, "true"])
@pytest.mark.parametrize("kind", IMAGES)
@pytest.mark.parametrize("free_thresh", [0.25, 0.196])
def test_cells_are_map_servers(folder, mode, negate, kind, free_thresh):
    """What it publishes as free is free, but for the grey of unknown cells; raw values are free by the threshold."""
    write(folder, FIELDS | {"mode": mode, "negate": negate, "free_thresh": free_thresh}, IMAGES[kind])
    pixels = np.asarray(Image.open(folder / "map.png").convert("RGBA")).tolist()
    rule = {"mode": mode, "negate": negate != 0, "occupied_thresh": 0.65, "free_thresh": free_thresh}
    expected = np.zeros((16, 16), bool)
    for row in range(16):
        for column in range(16):
            red, green, blue, alpha = pixels[row][column]
            value = oracle.cell_value(red, green, blue, alpha if "alpha" in kind else None, **rule)
            free = 0 <= value < 100 * free_thresh if mode == "raw" else value == oracle.FREE
            unknown = mode == "trinary" and kind == "grey" and red == 205
            expected[15 - row, column] = not free or unknown  # rows of cells go up
    found = read_map("map.yaml", folder)
    np.testing.assert_array_equal(found.closed, expected)
    assert (found.resolution, found.origin) == (0.05, (-1.0, 2.0, 0.0))


def test_unknown_cells_that_nav2_saves_stay_closed(folder):
    """map_saver writes 0, 205 and 254 for occupied, unknown and free, and by default a free_thresh of 0.25."""
    write(folder, FIELDS, np.array([[0, 205, 254]], np.uint8))
    assert read_map("map.yaml", folder).closed.tolist() == [[True, True, False]]


@pytest.mark.parametrize("text", ["P2\n# by hand\n3 1\n255\n0 205 254\n", "P2 3 1 100 0 80 100"])
def test_plain_pgm_is_read(folder, text):
    (folder / "map.pgm").write_text(text)
    write(folder, FIELDS | {"image": "map.pgm", "free_thresh": 0.196})
    assert read_map("map.yaml", folder).closed.tolist() == [[True, True, False]]


def test_other_keys_are_left_alone_and_paths_lead_down(folder):
    below = folder / "maps"
    below.mkdir()
    write(below, FIELDS | {"image": "../map.png", "floor_name": "first"})
    write(folder, FIELDS, np.zeros((2, 3), np.uint8))
    assert read_map("maps/map.yaml", folder).closed.shape == (2, 3)


@settings(max_examples=50)
@given(
    closed=st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=1, max_size=5),
    origin=st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-4, 4)),
    resolution=st.floats(0.01, 1),
)
def test_boxes_stand_where_the_cells_are(closed, origin, resolution):
    """The middle of each cell, and of those of a frame, is in a box just if it is closed; likewise near its corners."""
    boxes = map_boxes(OccupancyMap(np.array(closed), resolution, origin))
    framed = np.pad(np.array(closed), 1, constant_values=True)
    for row, column in np.ndindex(framed.shape):
        for right, up in [(0.5, 0.5), (0.05, 0.05), (0.95, 0.05), (0.95, 0.95)]:
            along, across = resolution * (column - 1 + right), resolution * (row - 1 + up)
            x = origin[0] + math.cos(origin[2]) * along - math.sin(origin[2]) * across
            y = origin[1] + math.sin(origin[2]) * along + math.cos(origin[2]) * across
            inside = [
                oracle.inside_box((x, y), *box)
                for box in zip(boxes.pose.tolist(), boxes.half_size.tolist(), strict=True)
            ]
            assert any(inside) == framed[row, column]
    assert np.all(boxes.blocks_base)
    assert not np.any(boxes.blocks_arm)
    assert set(boxes.low.tolist()) == {0.0}
    np.testing.assert_allclose(boxes.high, FLAT_M)


def png_header(width, height, depth=8, kind=0):
    """A PNG file that says it is so large, and holds nothing."""
    header = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"")))
    packed = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def png(array, **options):
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG", **options)
    return stream.getvalue()


WRONG_FIELDS = [
    ("resolution", 0, "resolution: found 0, allowed is a number from 0.001 to 10 (m)"),
    ("resolution", ".nan", "resolution: found nan, allowed are finite numbers"),
    ("resolution", "wide", "resolution: found 'wide', allowed is a number"),
    ("origin", [0, 0], "origin: found [0, 0], allowed is [x, y, yaw]"),
    ("origin", [0, 0, 90.0], "origin[2]: found 90.0, allowed is a number from -1000 to 1000 (m), and the angle from"),
    ("origin", [0, 1e9, 0], "origin[1]: found 1000000000.0, allowed is a number from -1000"),
    ("negate", 2, "negate: found 2, allowed is 0 or 1"),
    ("occupied_thresh", 65, "occupied_thresh: found 65, allowed is a number from 0 to 1"),
    ("free_thresh", 0.65, "free_thresh: found 0.65, where occupied_thresh is 0.65, allowed are numbers below"),
    ("mode", "grey", "mode: found 'grey', allowed is trinary, scale or raw"),
    ("image", 7, "image: found 7, allowed is the image's name"),
    ("image", "none.png", "image: found 'none.png', allowed are files in the scene file's folder or below"),
    ("image", "../secret.png", "image: found '../secret.png', allowed are files in the scene file's folder or below"),
    ("image", "/etc/hostname", "image: found '/etc/hostname', allowed are files in the scene file's folder"),
    ("image", "link.png", "image: found 'link.png', allowed are files in the scene file's folder"),
    ("image", '"map\\0.png"', "image: found 'map\\x00.png', allowed are files"),
    ("image", ".", "image: found '.', allowed are files"),
]


@pytest.mark.parametrize(("key", "value", "said"), WRONG_FIELDS, ids=range(len(WRONG_FIELDS)))
def test_what_is_wrong_with_the_yaml_is_said(tmp_path, key, value, said):
    own = tmp_path / "scenes"
    own.mkdir()
    Image.fromarray(LEVELS).save(tmp_path / "secret.png")
    (own / "link.png").symlink_to(tmp_path / "secret.png")
    write(own, FIELDS | {key: value}, LEVELS)
    with pytest.raises(DocumentError, match=f"^map: map.yaml: {re.escape(said)}"):
        read_map("map.yaml", own)


def test_each_key_but_the_mode_is_needed(folder):
    for key in FIELDS:
        write(folder, {name: value for name, value in FIELDS.items() if name != key}, LEVELS)
        with pytest.raises(DocumentError, match=f"^map: map.yaml: {key}: found nothing, allowed is "):
            read_map("map.yaml", folder)


SHORT = png(np.random.default_rng(0).integers(0, 256, (50, 50), np.uint8))[:-900]
WRONG_IMAGES = [
    (png_header(10_000, 10_000), "content: found 10000 x 10000 cells, allowed are up to 4000000"),
    (png_header(2001, 2000), "content: found 2001 x 2000 cells, allowed are up to 4000000"),
    (png_header(100_000, 100_000), "content: found more than 100 million cells, allowed are up to 4000000"),
    (b"P5 2000000 2000000 255\n", "content: found more than 100 million cells, allowed are up to 4000000"),
    (png(LEVELS.astype(np.uint16)), "content: found pixels of another kind (I;16), allowed are 8 bits a channel"),
    (b"P2 2 1 65535 0 60000", "content: found pixels of another kind (I), allowed are 8 bits a channel"),
    (png_header(4, 4, 16, 2), "content: found pixels of another kind (RGB), allowed are 8 bits a channel"),
    (png(LEVELS > 100), "content: found pixels of another kind (1), allowed are 8 bits a channel"),
    (SHORT, "content: found no image that can be decoded, allowed are whole PGM and PNG files"),
    (b"P5 16 16 255\n" + b"7" * 300, "content: found 300 bytes of pixels, allowed are 256, by the width and height in"),
    (b"P6 16 16 255\n" + b"7" * 800, "content: found 800 bytes of pixels, allowed are 768, by the width and height in"),
    (b"P5 16 16 255\nabc", "content: found no image that can be decoded, allowed are whole PGM and PNG files"),
    (b"", "content: found no image that can be decoded, allowed are whole PGM and PNG files"),
    (b"GIF89a", "content: found no image that can be decoded, allowed are whole PGM and PNG files"),
    (bytes(32 * 1024 * 1024 + 1), "content: found more than 33554432 bytes, allowed are up to 33554432"),
]


@pytest.mark.parametrize(("data", "said"), WRONG_IMAGES, ids=range(len(WRONG_IMAGES)))
def test_what_is_wrong_with_the_image_is_said(folder, data, said):
    write(folder, FIELDS)
    (folder / "map.png").write_bytes(data)
    with pytest.raises(DocumentError, match=f"^map: map.png: {re.escape(said)}"):
        read_map("map.yaml", folder)


@pytest.mark.parametrize("name", ["nothing.yaml", "..", "/etc/hostname", "a" * 300, "a\0b", "link.yaml"])
def test_a_map_that_is_missing_or_elsewhere_is_named(tmp_path, name):
    own = tmp_path / "scenes"
    own.mkdir()
    write(tmp_path, FIELDS)
    (own / "link.yaml").symlink_to(tmp_path / "map.yaml")
    with pytest.raises(DocumentError, match=r"^map: found .*, allowed are files in the scene file's folder or below"):
        read_map(name, own)


def test_a_pgm_may_end_with_a_line_break(folder):
    write(folder, FIELDS)
    (folder / "map.png").write_bytes(b"P5 4 2 255\n" + bytes(8) + b"\n")
    assert read_map("map.yaml", folder).closed.shape == (2, 4)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_start_off_the_map_is_refused(yaw):
    occupancy = OccupancyMap(np.zeros((20, 40), bool), 0.1, (3.0, -1.0, yaw))
    turned = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    for place in ((0.1, 0.1), (3.9, 1.9), (2.0, 1.0)):
        check_on_map(np.array([*(turned @ place + (3.0, -1.0)), 0.0]), occupancy)
    for place in ((-0.1, 0.1), (4.1, 1.0), (2.0, 2.1), (2.0, -3.0)):
        with pytest.raises(
            DocumentError, match=r"robot.start: found .*, off the map, allowed are poses on it, 4 x 2 m"
        ):
            check_on_map(np.array([*(turned @ place + (3.0, -1.0)), 0.0]), occupancy)


def test_noise_is_refused():
    noise = np.random.default_rng(0).uniform(size=(200, 300)) < 0.3
    with pytest.raises(DocumentError, match=r"^map: found closed cells that 8192 rectangles don't cover, allowed are"):
        map_boxes(OccupancyMap(noise, 0.05, (0.0, 0.0, 0.0)))


@settings(max_examples=100)
@given(st.data())
def test_damaged_files_are_refused_or_read(folder, data):
    """Whatever is changed, the map is read or refused in one sentence."""
    write(folder, FIELDS, LEVELS)
    path = folder / data.draw(st.sampled_from(["map.yaml", "map.png"]))
    text = path.read_bytes()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    path.write_bytes(text[:start] + data.draw(st.binary(max_size=20)) + text[end:])
    refused = None
    try:
        map_boxes(read_map("map.yaml", folder))
    except DocumentError as error:
        refused = str(error)
    assert refused is None or re.fullmatch(r"map: map\.(yaml|png): .*", refused)


@pytest.mark.parametrize(("name", "shape"), [("depot", (307, 604)), ("hangar_map", (1231, 1007))])
def test_real_maps_are_covered_by_few_rectangles(name, shape):
    path = shared_file(f"maps/{name}.yaml")
    found = read_map(path.name, path.parent)
    assert found.closed.shape == shape
    boxes = map_boxes(found)
    corner = (boxes.pose[:, :2] - boxes.half_size - np.array(found.origin[:2])) / found.resolution + 1
    other = corner + 2 * boxes.half_size / found.resolution
    covered = np.zeros((shape[0] + 2, shape[1] + 2), bool)
    for (left, low), (right, high) in zip(np.rint(corner).astype(int), np.rint(other).astype(int), strict=True):
        covered[low:high, left:right] = True
    np.testing.assert_array_equal(covered, np.pad(found.closed, 1, constant_values=True))
    assert len(boxes.low) < 2500
