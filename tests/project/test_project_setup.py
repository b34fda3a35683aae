"""The pinned requirements, and what the set-up scripts say when something is missing."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("base", "dev", "docs")
SCRIPTS = ("script/fly", "script/test", "script/setup", "script/lock", ".ci/run")


def pins(kind: str) -> dict[str, str]:
    """Return name -> version and marker of every package in requirements/`kind`.txt."""
    text = (ROOT / "requirements" / f"{kind}.txt").read_text("utf-8")
    return dict(re.findall(r"^([a-z0-9][a-z0-9._-]*)==(.+?) \\$", text, flags=re.MULTILINE))


def plain(requirement: str) -> str:
    """Return the name of a requirement as the pinned files spell it."""
    return re.split(r"[<>=!~\[; ]", requirement)[0].lower().replace("_", "-")


@pytest.mark.parametrize("kind", KINDS)
def test_every_requirement_is_pinned_and_hashed_and_nothing_else_stands_there(kind):
    text = (ROOT / "requirements" / f"{kind}.txt").read_text("utf-8")
    blocks = re.split(r"\n(?=\S)", text.strip())
    whole = re.compile(r"\S+==\S+( ; [^\n]+)? \\(\n    --hash=sha256:[0-9a-f]{64}( \\)?)+(\n    #[^\n]*)*")
    assert [block for block in blocks if whole.fullmatch(block) is None] == []


def test_what_the_package_asks_for_is_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    extras = project["project"]["optional-dependencies"]
    wanted = {"base": [*project["project"]["dependencies"], *project["build-system"]["requires"]], **extras}
    for kind in KINDS:
        missing = {plain(requirement) for requirement in wanted[kind]} - set(pins(kind))
        assert not missing, f"{kind}: run script/lock"


def test_the_pinned_files_agree_with_each_other():
    for kind in ("dev", "docs"):
        differ = {n: (v, pins(kind)[n]) for n, v in pins("base").items() if pins(kind).get(n) != v}
        assert not differ, f"{kind}: run script/lock"
    both = set(pins("dev")) & set(pins("docs"))
    assert {name for name in both if pins("dev")[name] != pins("docs")[name]} == set()


@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts_can_be_run_and_read_by_bash(script):
    path = ROOT / script
    assert path.stat().st_mode & 0o111
    assert path.read_text("utf-8").startswith("#!/usr/bin/env bash\n")
    subprocess.run(["bash", "-n", path], check=True)


@pytest.fixture
def checkout(tmp_path):
    """A copy of what set-up reads, and a PATH without Python, apt-get and sudo."""
    copy = tmp_path / "a checkout"
    for folder in ("script", "requirements"):
        shutil.copytree(ROOT / folder, copy / folder)
    shutil.copy(ROOT / "pyproject.toml", copy)
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ("bash", "env", "dirname", "cat", "sha256sum", "cut", "id", "flock", "mktemp", "rm"):
        found = shutil.which(tool)
        if found is not None:
            (tools / tool).symlink_to(found)

    def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(copy / script), *arguments],
            env={"PATH": str(tools)},
            cwd="/",
            capture_output=True,
            text=True,
        )

    run.copy, run.tools = copy, tools
    return run


def pretend(path: Path, lines: str) -> None:
    """Write a program."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/usr/bin/env bash\n{lines}\n")
    path.chmod(0o755)


def test_without_a_python_that_fits_one_line_says_what_to_install(checkout):
    pretend(checkout.tools / "python3", "exit 1  # too old")
    done = checkout("script/fly")
    assert done.stderr == (
        "noctule set-up: no Python 3.11, 3.12 or 3.13 found; install one: "
        "sudo apt-get install python3.11 python3.11-venv\n"
    )
    assert done.stdout == ""
    assert done.returncode == 1


def test_without_the_venv_module_one_line_says_what_to_install(checkout):
    python = checkout.tools / "python3"
    pretend(python, 'case "$2" in *ensurepip*) exit 1 ;; *print*) echo 3.12 ;; esac')
    done = checkout("script/test")
    assert done.stderr == (
        f"noctule set-up: {python} has no venv module; install it: sudo apt-get install python3.12-venv\n"
    )
    assert done.returncode == 1


def pretend_environment(checkout, renders: bool) -> None:
    """Pretend a .venv whose Python notes how it is called."""
    lines = 'echo "$*" >>"$(dirname "$0")/calls"\n'
    lines += f'case "$*" in *mujoco*) exit {0 if renders else 1} ;; *"noctule fly"*) exit 7 ;; esac'
    pretend(checkout.copy / ".venv" / "bin" / "python", lines)


def test_without_opengl_one_line_says_what_to_install(checkout):
    pretend_environment(checkout, renders=False)
    done = checkout("script/fly")
    assert done.stderr.splitlines()[-1] == (
        "noctule set-up: pictures cannot be rendered off screen; install OpenGL: "
        "sudo apt-get install libegl1 libgl1-mesa-dri libgles2"
    )
    assert done.returncode == 1


def test_fly_passes_its_arguments_and_its_exit_code_and_sets_up_only_once(checkout):
    pretend_environment(checkout, renders=True)
    calls = checkout.copy / ".venv" / "bin" / "calls"
    first = checkout("script/fly", "--seed", "3", "a b")
    assert first.returncode == 7
    assert first.stdout == ""
    assert first.stderr.splitlines()[-1] == "noctule set-up: done"
    assert "--require-hashes" in calls.read_text()
    calls.unlink()
    second = checkout("script/fly", "--seed", "3", "a b")
    assert (second.returncode, second.stderr) == (7, "")
    assert calls.read_text() == "-m noctule fly --seed 3 a b\n"


def test_set_up_runs_again_when_a_requirement_changes(checkout):
    pretend_environment(checkout, renders=True)
    checkout("script/fly")
    with (checkout.copy / "requirements" / "base.txt").open("a") as file:
        file.write("# changed\n")
    assert "installing the pinned packages (base)" in checkout("script/fly").stderr


def test_an_unknown_kind_of_set_up_is_refused(checkout):
    done = checkout("script/setup", "all")
    assert done.stderr == "noctule set-up: unknown kind 'all', expected 'base' or 'dev'\n"
    assert done.returncode == 2


def test_continuous_integration_runs_what_a_developer_runs():
    assert "../script/test" in (ROOT / ".ci" / "run").read_text("utf-8")
