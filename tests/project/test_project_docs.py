"""What the documentation says can be pasted."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import shlex
from pathlib import Path
from types import ModuleType

import pytest

from noctule.cli.app import build
from noctule.flight.mission import parse_mission

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "DEVELOPMENT.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(language: str) -> list[tuple[str, str]]:
    """Return (page, text) of every fenced block in a language."""
    fence = re.compile(rf"^```{language}\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
    return [(page.name, text) for page in PAGES for text in fence.findall(page.read_text("utf-8"))]


def commands() -> list[str]:
    """Return every `noctule` command that stands in a block of the shell's."""
    lines = [line for _, text in blocks("sh") for line in text.splitlines()]
    parts = [part.strip() for line in lines for part in line.split("#")[0].split("&&")]
    return sorted({part for part in parts if part.startswith("noctule ")} - {"noctule report flights/..."})


@pytest.mark.parametrize("command", commands())
def test_every_command_in_the_documentation_is_understood(command):
    build().parse_args(shlex.split(command)[1:], exit_on_error=False, print_error=False)


def test_there_are_commands_and_examples_to_check():
    assert len(commands()) >= 10
    assert len(blocks("python")) >= 5
    assert blocks("toml")


@pytest.mark.parametrize(("page", "text"), blocks("python"))
def test_what_the_examples_import_is_there(page, text):
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module or "")
            assert all(hasattr(module, alias.name) for alias in node.names), page


def test_the_missions_that_the_documentation_shows_are_valid():
    seen, located = [text for page, text in blocks("toml") if page == "mission-file.md"]
    assert parse_mission(seen, "mission-file.md").name == "one-column"
    assert parse_mission(located, "mission-file.md").space_plan().total > 1.0


def script(name: str) -> ModuleType:
    """Return a script of the repository as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "script" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_reference_of_the_mission_file_is_up_to_date():
    page = (ROOT / "docs" / "mission-reference.md").read_text("utf-8")
    assert page == script("write_reference").page(), "the settings changed: run script/reference"


def test_the_picture_of_the_frames_is_drawn_with_the_rotations_of_today():
    assert (ROOT / "docs" / "img" / "frames.svg").read_text("utf-8") == script("draw_frames").draw()
