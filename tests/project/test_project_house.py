"""The house itself: floors, sizes, and what must never stand in a committed file."""

from __future__ import annotations

import ast
import re
import subprocess
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import noctule

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "noctule"

# A room uses the rooms of its own number or lower; see "One way through the house" in the documentation.
FLOORS = {
    "errors": 0,
    "settings": 0,
    "geometry": 1,
    "compiled": 1,
    "camera": 2,
    "messages": 2,
    "control": 2,
    "vision": 3,
    "estimation": 3,
    "devices": 3,
    "localization": 4,
    "simulation": 4,
    "pilots": 5,
    "flight": 6,
    "cockpit": 7,
    "reports": 7,
    "campaign": 7,
    "experiments": 7,
    "cli": 8,
    "__init__": 0,
    "__main__": 9,
}
LIBRARIES = {"vision", "estimation", "control"}  # usable alone: they do not know each other
GENERATED = "*_pb2.py*"
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if not path.match(GENERATED))
TESTS = sorted((ROOT / "tests").rglob("*.py"))


def tracked() -> list[Path]:
    """Return every file of the repository that git would commit."""
    done = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        pytest.skip(f"this is no git checkout: {done.stderr.strip()}")
    return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> Iterator[str]:
    """Yield the full name of every module that `path` imports, inside functions too."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import; write it in full"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def rooms_used(path: Path) -> set[str]:
    found = {name.split(".")[1] for name in imported(path) if name.startswith("noctule.")}
    return {name for name in found if name in FLOORS} - {room(path)}


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_every_room_uses_only_its_own_floor_and_those_below(path):
    here = room(path)
    assert here in FLOORS, f"{here} has no floor; give it one here and in docs/architecture.md"
    above = {name for name in rooms_used(path) if FLOORS[name] > FLOORS[here]}
    assert not above
    assert here not in LIBRARIES or not rooms_used(path) & LIBRARIES


def test_no_rooms_import_each_other_in_a_circle():
    uses: dict[str, set[str]] = {}
    for path in MODULES:
        uses.setdefault(room(path), set()).update(rooms_used(path))
    order = list(TopologicalSorter(uses).static_order())
    assert order.index("geometry") < order.index("cli")


@pytest.mark.parametrize("path", [p for p in MODULES if room(p) in LIBRARIES | {"pilots"}], ids=relative)
def test_libraries_and_pilots_have_no_input_output_no_clocks_and_no_threads(path):
    forbidden = {
        "time",
        "datetime",
        "threading",
        "multiprocessing",
        "asyncio",
        "socket",
        "os",
        "io",
        "pathlib",
    }
    assert not {name.split(".")[0] for name in imported(path)} & forbidden
    calls = [n.func for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.Call)]
    assert not {c.id for c in calls if isinstance(c, ast.Name)} & {"open", "print", "input"}


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_no_module_is_longer_than_300_lines(path):
    assert len(path.read_text("utf-8").splitlines()) <= 300


def test_there_are_at_least_seven_lines_of_test_for_ten_of_source():
    source, test = (sum(len(p.read_text("utf-8").splitlines()) for p in group) for group in (MODULES, TESTS))
    assert test >= 0.7 * source


def test_only_geometry_wraps_angles():
    turn = r"\(?\s*(2(\.0)?\s*\*\s*(np|math)\.pi|(np|math)\.tau)"
    by_hand = re.compile(rf"%\s*{turn}|\bnp\.(remainder|fmod)\([^\n]*,\s*{turn}")
    found = [relative(p) for p in MODULES if by_hand.search(p.read_text("utf-8"))]
    assert found == ["src/noctule/geometry.py"]


def calls(path: Path) -> Iterator[tuple[str, ast.Call | None]]:
    """Yield (dotted name, call) of every call and bare decorator in a file."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield from ((ast.unparse(d), None) for d in node.decorator_list if not isinstance(d, ast.Call))


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_nothing_is_unpickled_from_files(path):
    unsafe = {"pickle", "cloudpickle", "dill", "shelve", "marshal"}
    assert not {name.split(".")[0] for name in imported(path)} & unsafe
    for name, call in calls(path):
        assert name != "joblib.load"
        allowed = [k.value for k in call.keywords if k.arg == "allow_pickle"] if call is not None else []
        assert all(isinstance(v, ast.Constant) and v.value is False for v in allowed)


@pytest.mark.parametrize("path", TESTS, ids=relative)
def test_every_skip_gives_a_reason(path):
    for name, call in calls(path):
        short = name.removeprefix("pytest.").removeprefix("mark.")
        if short not in {"skip", "skipif", "xfail", "importorskip"} or not name.startswith("pytest."):
            continue
        assert call is not None, f"{name} without a reason"
        words = [k.value for k in call.keywords if k.arg == "reason"]
        words += call.args if name == "pytest.skip" else []
        assert words, f"{name} without a reason"
        assert not (isinstance(words[0], ast.Constant) and len(str(words[0].value)) < 8)


# Written in two halves, so that this file does not hold what it looks for.
FORBIDDEN = [
    "pypi" + ".org",
    "pythonhosted" + ".org",
    "registry.npmjs" + ".org",
    "deb.debian" + ".org",
    "archive.ubuntu" + ".com",
    "/root" + "/",
    "/work" + "/",
    "/opt" + "/",
    "extra-index" + "-url",
]


def test_no_committed_file_names_a_registry_or_a_folder_of_some_machine():
    found = [
        f"{relative(path)}: {word}"
        for path in tracked()
        for word in FORBIDDEN
        if word.encode() in path.read_bytes()
    ]
    assert found == []


SOURCE = {".py", ".pyi", ".toml", ".md", ".html", ".proto", ".txt", ".in", ".css", ".js", ".yml", ".typed"}


def test_every_bundled_file_that_is_no_source_text_has_its_licence_in_notice():
    notice = (ROOT / "NOTICE").read_text("utf-8")
    plain = {".gitignore", "LICENSE", "NOTICE", "py.typed"}
    bundled = [
        relative(path)
        for path in tracked()
        if path.suffix not in SOURCE and path.name not in plain and path.parent.name not in {"script", ".ci"}
    ]
    assert [name for name in bundled if name not in notice] == []
    named = re.findall(r"^- (\S+):", notice, flags=re.MULTILINE)
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_no_committed_file_is_larger_than_a_megabyte():
    assert [relative(path) for path in tracked() if path.stat().st_size > 1_000_000] == []


def test_the_readme_opens_with_one_sentence_a_picture_and_the_two_commands():
    lines = [line for line in (ROOT / "README.md").read_text("utf-8").splitlines() if line.strip()]
    assert lines[0] == "# Noctule"
    assert lines[1].count(".") == 1
    assert lines[1].endswith(".")
    picture = re.fullmatch(r"!\[.+\]\((.+)\)", lines[2])
    assert picture is not None
    assert (ROOT / picture[1]).is_file()
    assert lines[3] == "```sh"
    commands = [line.split("#")[0].strip() for line in lines[4 : lines.index("```")]]
    assert commands == ["script/fly", "script/test"]


def test_the_licence_is_apache_2_and_whole():
    text = (ROOT / "LICENSE").read_text("utf-8")
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text


def test_the_version_is_said_once():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["version"] == noctule.__version__
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=relative)
def test_every_page_of_the_documentation_is_in_its_menu(page):
    menu = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert str(page.relative_to(ROOT / "docs")) in menu
