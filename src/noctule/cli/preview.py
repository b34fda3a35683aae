"""What a person who flies by keys sees: the front camera in half blocks, and a line on how it stands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

from noctule.flight.hand_chooser import Reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from noctule.flight.teach_by_hand import Status

WIDEST = 80  # columns
HELP = "w/s a/d r/f move, q/e turn, x hover, space image, u undo, enter finish, esc leave"
_PLAIN, _BOLD, _YELLOW, _RED = "\x1b[0m", "\x1b[1m", "\x1b[1;33m", "\x1b[1;31m"


def half_blocks(pixels: NDArray[np.uint8], columns: int, rows: int) -> list[str]:
    """Return a picture (height, width, 3) RGB as lines of a truecolour terminal, two pixels a character.

    As large as fits into `columns` and `rows` without changing its shape.
    """
    height, width = pixels.shape[:2]
    scale = min(columns / width, 2.0 * rows / height)
    columns, rows = max(1, round(width * scale)), max(1, round(height * scale / 2.0))
    small = cv2.resize(pixels, (columns, 2 * rows), interpolation=cv2.INTER_AREA).tolist()
    return [_line(small[2 * row], small[2 * row + 1]) for row in range(rows)]


def _line(above: list[list[int]], below: list[list[int]]) -> str:
    parts, before = [], None
    for top, bottom in zip(above, below, strict=True):
        if (top, bottom) != before:  # colours hold until they are changed
            (r, g, b), (u, v, w) = top, bottom
            parts.append(f"\x1b[38;2;{r};{g};{b};48;2;{u};{v};{w}m")
            before = (top, bottom)
        parts.append("\N{UPPER HALF BLOCK}")
    return "".join(parts) + _PLAIN


def status_line(status: Status) -> str:
    """Return where the vehicle is, how many images were taken, and what is shared with the newest."""
    x, y, z = status.pose.position
    where = (
        f"x {x:5.2f}  y {y:5.2f}  z {z:4.2f} m  heading {math.degrees(status.pose.yaw):+4.0f}\N{DEGREE SIGN}"
    )
    images, link = status.shared.images, status.shared.link
    taken = f"{images} image{'' if images == 1 else 's'}"
    if link is None or images == 0:
        return f"{where}  {taken}"
    return f"{where}  {taken}  shares {link.shared} points with image {images - 1}"


def warning(status: Status) -> str:
    """Return what the person must know now, the most urgent only; empty where all is well."""
    if status.stopped_by:
        return f"stopped: {', '.join(status.stopped_by)} in the way; turn or fly back"
    newest = status.shared.images - 1
    if status.shared.reach is Reach.LOST:
        return f"too far: an image here cannot be reached from image {newest}; fly back"
    if status.shared.reach is Reach.SOON:
        return f"soon too far from image {newest}: take an image (space) or fly back"
    return ""


def below_picture(status: Status, columns: int) -> list[str]:
    """Return the lines under the preview, cut to the width of the terminal."""
    warned = warning(status)
    colour = _RED if status.stopped_by or status.shared.reach is Reach.LOST else _YELLOW
    said = f"{colour}{warned[:columns]}{_PLAIN}" if warned else status.shared.news[:columns]
    return [f"{_BOLD}{status_line(status)[:columns]}{_PLAIN}", said, HELP[:columns]]


def one_line(status: Status, columns: int) -> str:
    """Return all of it in a line, for terminals without a preview."""
    said = warning(status) or status.shared.news
    return f"{status_line(status)}  {said}".rstrip()[:columns]
