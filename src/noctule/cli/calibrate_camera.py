"""`noctule calibrate camera`: its options and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from noctule.cli.options import Flag

Several = Annotated[list[Path] | None, Parameter(consume_multiple=True, negative="")]
Places = Annotated[list[str] | None, Parameter(negative="", allow_leading_hyphen=True)]


def calibrate_camera(
    *pictures: Path,
    out: Path | None = None,
    extrinsics: Several = None,
    depth: Several = None,
    at: Places = None,
    thickness: float = 0.0,
    board: str = "7x5",
    square: float = 0.10,
    marker: float = 0.075,
    dictionary: str = "4x4_50",
    print_board: Path | None = None,
    json: Flag = False,
) -> int:
    """Calibrate a camera by pictures of a ChArUco board: its intrinsics, then where it hangs.

    A calibration that is not good enough is refused, with the pictures to retake, and nothing is kept of it
    but its figure.

    Parameters
    ----------
    pictures
        Pictures of the board held before the camera, or folders of them; 15 to 20, tilted each another way.
        Left out, the intrinsics are those found before.
    out
        The folder of the site: intrinsics.toml, camera.toml and their figures.
    extrinsics
        Pictures of the board lying on the floor, which say where the camera hangs.
    depth
        The depth image (16-bit PNG, millimetres) to each of the pictures of --extrinsics, in their order.
    at
        Where the board lay in each, as x,y,heading [m, m, deg] of its corner with the arrows; left out,
        0,0,0: the board is the origin of the world. Given once for each picture.
    thickness
        How high the board's face is above the floor [m].
    board
        Its squares, along and up the page.
    square
        The side of a square, as measured on the print [m].
    marker
        The side of a marker [m].
    dictionary
        The family of its markers: 4x4_50, 4x4_250, 5x5_50, 5x5_250, 6x6_50 or 6x6_250.
    print_board
        Draw the board, at its true size, into this .pdf or .png file.
    json
        End standard output with one JSON object.
    """
    from noctule.cli.camera_calibration import Asked, calibrate

    asked = Asked(
        pictures, out, tuple(extrinsics or ()), tuple(depth or ()), tuple(at or ()), thickness, print_board
    )
    return calibrate(asked, (board, square, marker, dictionary), json)
