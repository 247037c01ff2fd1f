"""Imports run one way, from the ground up; and no file knows the machine it was written on."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "basenet_jax"

# From the ground up: a module may import its own line and the lines above.
LAYERS = (
    (
        "config",
        "settings",
        "atomic",
        "cache_files",
        "compilation",
        "devices",
        "offscreen",
        "progress",
        "rounds",
        "signals",
        "struct",
        "weights_file",
    ),
    ("documents",),
    ("trigonometry",),
    ("geometry",),
    ("robot",),
    ("world",),
    ("task",),
    ("exports",),
    ("policies",),
    ("planners",),
    ("learning",),
    ("evaluation",),
    ("plots",),
    ("api",),
    ("batch",),
    ("viewer",),
    ("command_line",),
    ("commands",),
    ("train", "ablate", "evaluate", "plan", "generate", "convert", "view"),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}

# Home and scratch directories of Linux, macOS and Windows; `[/]` keeps this file from matching itself.
MACHINE_PATH = re.compile(r"(?<![\w.])[/](?:home|root|work|tmp|Users|mnt|var/folders)[/][\w.]|\b[A-Z]:\\\w")


# What `python -m basenet_jax.robot` runs stands in that folder, and is nothing but a door to the command's own module.
DOORS = {"basenet_jax.robot.__main__": "basenet_jax.commands.robot"}


def part_of(module: str) -> str:
    """`robot` for `basenet_jax.robot.model`."""
    return [*module.split("."), ""][1]


def imported_modules(tree: ast.AST, package: str):
    """All modules of this package that a file imports, anywhere in it; `package` is the file's own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: -node.level + 1 or None] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{base}.{alias.name}" if base == "basenet_jax" else base for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "basenet_jax" and "." in name)


def upward_imports(source: str, module: str, is_package: bool = False) -> list[str]:
    """Imports of higher layers in a module's source, those for type checkers too."""
    package = module if is_package else module.rpartition(".")[0]
    level = LEVEL[part_of(module)]
    upward = [name for name in imported_modules(ast.parse(source), package) if LEVEL.get(part_of(name), 99) > level]
    return [name for name in upward if DOORS.get(module) != name]


def circle(sources: dict[str, str]) -> list[str]:
    """Modules of which each imports the next, and the last the first: here or there, or for type checkers alone.

    Args:
        sources: by module; a package by its own name.
    """
    packages = {module.rpartition(".")[0] for module in sources}
    imports = {}
    for module, source in sources.items():
        package = module if module in packages else module.rpartition(".")[0]
        imports[module] = [name for name in named_modules(ast.parse(source), package) if name in sources]
    done: set[str] = set()
    for start in sources:
        trail = [start]
        while trail:
            following = next((name for name in imports[trail[-1]] if name not in done), None)
            if following is None:
                done.add(trail.pop())
            elif following in trail:
                return trail[trail.index(following) :]
            else:
                trail.append(following)
    return []


def named_modules(tree: ast.AST, package: str):
    """What `imported_modules` yields and, of `from a.b import c`, `a.b.c` too, which may be a module."""
    yield from imported_modules(tree, package)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for base in imported_modules(node, package):
                yield from (f"{base}.{alias.name}" for alias in node.names)


def package_files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


@pytest.mark.parametrize("path", package_files(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_run_one_way(path):
    module = module_of(path)
    assert part_of(module) in LEVEL, f"{module} has no place in LAYERS"
    assert not upward_imports(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")


@pytest.mark.parametrize(
    ("source", "module", "wrong"),
    [
        ("from basenet_jax.task.picking import pick", "basenet_jax.robot.ik", ["basenet_jax.task.picking"]),
        ("import basenet_jax.learning.sac as sac", "basenet_jax.policies.base_pose", ["basenet_jax.learning.sac"]),
        ("from basenet_jax import plots", "basenet_jax.world.scene", ["basenet_jax.plots"]),
        ("def f():\n    from ..task import picking", "basenet_jax.world.scene", ["basenet_jax.task"]),
        ("from basenet_jax import nowhere", "basenet_jax.train", ["basenet_jax.nowhere"]),
        ("from basenet_jax.plots import f", "basenet_jax.robot.__main__", ["basenet_jax.plots"]),
        ("from basenet_jax.commands.robot import f", "basenet_jax.robot.__main__", []),
        ("if TYPE_CHECKING:\n    from basenet_jax import api", "basenet_jax.robot.ik", ["basenet_jax.api"]),
        ("from .scene import Table\nfrom ..robot import model\nimport jax", "basenet_jax.world.clearance", []),
    ],
)
def test_upward_imports_are_found(source, module, wrong):
    assert upward_imports(source, module) == wrong


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def test_no_modules_import_one_another():
    assert not circle({module_of(path): path.read_text(encoding="utf-8") for path in package_files()})


@pytest.mark.parametrize(
    ("sources", "found"),
    [
        ({"a.x": "from basenet_jax.a import y", "a.y": "import jax"}, []),
        ({"a.x": "from basenet_jax.a import y", "a.y": "def f():\n    from basenet_jax.a.x import f"}, ["a.x", "a.y"]),
        (
            {"plan": "import basenet_jax.out", "out": "if TYPE_CHECKING:\n    from basenet_jax.plan import A"},
            ["plan", "out"],
        ),
        (
            {"a": "from .x import f", "a.x": "from .y import g", "a.y": "from basenet_jax.a import f"},
            ["a", "a.x", "a.y"],
        ),
    ],
)
def test_circles_are_found(sources, found):
    sources = {f"basenet_jax.{name}": source for name, source in sources.items()}
    assert circle(sources) == [f"basenet_jax.{name}" for name in found]


@pytest.mark.parametrize(("door", "command"), DOORS.items())
def test_a_door_does_nothing_else(door, command):
    tree = ast.parse((ROOT / door.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8"))
    assert list(imported_modules(tree, door)) == [command]
    assert not any(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in ast.walk(tree))


def tracked_files() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.decode().split("\0") if name]


def test_no_file_holds_a_machine_path():
    found = []
    for path in tracked_files():
        try:
            text = path.read_text(encoding="utf-8")
        except (UnicodeDecodeError, OSError):  # binary, or removed from the working tree
            continue
        found += [f"{path.relative_to(ROOT)}: {match.group()}" for match in MACHINE_PATH.finditer(text)]
    assert not found


@pytest.mark.parametrize(
    "text", ["see {}home/ann/x", '"{}tmp/plan.json"', "{}Users/ann", "C:{}ann".replace("{}", "\\")]
)
def test_machine_paths_are_found(text):
    assert MACHINE_PATH.search(text.replace("{}", "/"))


@pytest.mark.parametrize("text", ["docs/home/page", "https://example.org/home/", "a/tmp/b", "{home}/x", "home/main"])
def test_other_paths_are_not(text):
    assert not MACHINE_PATH.search(text)
