"""`noctule path show` and `noctule path check`: look at a path, and judge whether it can be repeated."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.show import as_json

if TYPE_CHECKING:
    from noctule.flight.path_check import Fault
    from noctule.pilots.visual_path import VisualPath
    from noctule.vision.links import LinkQuality

_HEAD = f"{'images':>9}  {'shared':>6}  {'parts':>5}  {'one motion':>10}  {'baseline':>8}  {'turn':>8}  "


def show_path(folder: Path, out: Path | None, json: bool) -> int:
    """Draw the contact sheet of a path and print its table; 0 when it could be read."""
    from noctule.flight.path_folder import load_path

    shown = describe(load_path(folder, refuse=False), folder, out or folder / "contact-sheet.png")
    print(as_json({"path": folder, **shown.figures}) if json else f"{shown.text}\nsheet: {shown.sheet}")
    return 0


def check_path_folder(folder: Path, mission: str | None, json: bool) -> int:
    """Print one line per fault of a path; 0 for none, 2 otherwise."""
    from noctule.flight.mission import load_mission
    from noctule.flight.path_check import check_folder

    faults = check_folder(folder, None if mission is None else load_mission(mission))
    report_faults(faults)
    if json:
        found = [{"images": fault.images, "what": fault.what} for fault in faults]
        print(as_json({"path": folder, "ok": not faults, "faults": found}))
    elif not faults:
        print(f"path {folder}: it can be repeated")
    return 2 if faults else 0


def report_faults(faults: Sequence[Fault]) -> None:
    """Print one line per fault on standard error."""
    for fault in faults:
        print(f"noctule: {fault}", file=sys.stderr)


class Shown:
    """A path as a person and as a program read it."""

    def __init__(self, text: str, figures: dict[str, Any], sheet: Path) -> None:
        self.text, self.figures, self.sheet = text, figures, sheet


def describe(path: VisualPath, folder: Path, sheet: Path) -> Shown:
    """Measure a path, draw its contact sheet into `sheet`, and return its table."""
    from noctule.flight.path_check import check_path, measure_path
    from noctule.reports.contact_sheet import weakest_link, write_contact_sheet

    links, faults = measure_path(path), check_path(path)
    names = [image.name for image in path.images]
    faulty = [names.index(fault.images[0]) for fault in faults]
    write_contact_sheet(path, links, f"{folder.name}: {len(names)} key images", sheet, faulty)
    weakest = weakest_link(links)
    lines = [f"path {folder}: {len(names)} key images of {path.camera.width}x{path.camera.height} px"]
    if links:
        lines.append(_HEAD.rstrip())
    for k, link in enumerate(links):
        note = "cannot be flown" if k in faulty else "weakest" if k == weakest else ""
        lines.append(_row(k, link, note))
    figures = {
        "images": names,
        "links": [_link_figures(link) for link in links],
        "weakest_link": weakest,
        "faults": [str(fault) for fault in faults],
        "contact_sheet": sheet,
    }
    return Shown("\n".join(lines), figures, sheet)


def _row(k: int, link: LinkQuality, note: str) -> str:
    turn = f"{math.degrees(link.yaw):+.1f}\N{DEGREE SIGN}"
    row = f"{f'{k} - {k + 1}':>9}  {link.shared:>6}  {link.cells:>5}  {link.share:>10.0%}"
    return f"{row}  {link.baseline:>8.2f}  {turn:>8}  {note}".rstrip()


def _link_figures(link: LinkQuality) -> dict[str, Any]:
    return {
        "shared": link.shared,
        "parts": link.cells,
        "one_motion": link.share,
        "noise_px": link.noise,
        "displacement_px": link.displacement,
        "baseline_mean_depths": link.baseline,
        "turn_deg": math.degrees(link.yaw),
    }
