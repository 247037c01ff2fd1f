"""The table of bugs fits the package, and the runner tells a caught bug from one that survives."""

import pytest

from tests.planted_bugs import BUGS, ROOT, Bug, place_of, try_bug


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_a_bugs_text_stands_once_and_its_tests_are_there(bug):
    path = place_of(bug.old, ROOT)
    compile(path.read_text(encoding="utf-8").replace(bug.old, bug.new), path, "exec")
    assert bug.new != bug.old
    assert [each for each in bug.tests if not (ROOT / each).exists()] == []


def test_names_are_their_own():
    assert len({bug.name for bug in BUGS}) == len(BUGS)


@pytest.fixture
def tree(tmp_path):
    """A package of one line, and tests of it."""
    (tmp_path / "basenet_jax").mkdir()
    (tmp_path / "basenet_jax" / "sum.py").write_text("def add(a, b):\n    return a + b\n")
    (tmp_path / "tests").mkdir()
    test = "from basenet_jax.sum import add\n\n\ndef test_{name}():\n    assert add({a}, {b}) == {sum}\n"
    (tmp_path / "tests" / "test_zero.py").write_text(test.format(name="zero", a=0, b=0, sum=0))
    (tmp_path / "tests" / "test_two.py").write_text(test.format(name="two", a=2, b=1, sum=3))
    (tmp_path / "tests" / "test_wrong.py").write_text(test.format(name="wrong", a=1, b=1, sum=3))
    return tmp_path


@pytest.mark.parametrize(
    ("test", "by"), [("tests/test_two.py", "tests/test_two.py::test_two"), ("tests/test_zero.py", None)]
)
def test_the_test_that_fails_is_named_and_the_tree_is_left_as_it_was(tree, test, by):
    before = (tree / "basenet_jax" / "sum.py").read_text()
    result = try_bug(Bug("sign", "a + b", "a - b", (test,)), tree, whole=False)
    assert (result["caught"], result["by"], result["file"]) == (by is not None, by, "basenet_jax/sum.py")
    assert (tree / "basenet_jax" / "sum.py").read_text() == before


def test_a_test_that_fails_anyway_catches_nothing(tree):
    with pytest.raises(ValueError, match="test_wrong fails without any bug"):
        try_bug(Bug("sign", "a + b", "a - b", ("tests/test_wrong.py",)), tree, whole=False)


def test_a_text_that_is_missing_or_stands_twice_is_refused(tree):
    with pytest.raises(ValueError, match="nowhere"):
        place_of("a * b", tree)
    (tree / "basenet_jax" / "again.py").write_text("def add(a, b):\n    return a + b\n")
    with pytest.raises(ValueError, match=r"sum\.py"):
        place_of("a + b", tree)
