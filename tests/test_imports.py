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
    ("config", "settings", "struct", "atomic", "compilation", "devices", "offscreen", "rounds", "weights_file"),
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
    ("train", "ablate", "evaluate", "plan", "plan_outputs", "generate", "view", "__main__"),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}

# Home and scratch directories of Linux, macOS and Windows; `[/]` keeps this file from matching itself.
MACHINE_PATH = re.compile(r"(?<![\w.])[/](?:home|root|work|tmp|Users|mnt|var/folders)[/][\w.]|\b[A-Z]:\\\w")


def part_of(module: str) -> str:
    """`robot` for `basenet_jax.robot.model`; a package's `__main__` is a command."""
    return "__main__" if module.endswith(".__main__") else [*module.split("."), ""][1]


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
    """Imports of higher layers in a module's source."""
    package = module if is_package else module.rpartition(".")[0]
    level = LEVEL[part_of(module)]
    return [name for name in imported_modules(ast.parse(source), package) if LEVEL.get(part_of(name), 99) > level]


def package_files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


@pytest.mark.parametrize("path", package_files(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_run_one_way(path):
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
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
        ("from .scene import Table\nfrom ..robot import model\nimport jax", "basenet_jax.world.clearance", []),
    ],
)
def test_upward_imports_are_found(source, module, wrong):
    assert upward_imports(source, module) == wrong


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
