"""The calibration board: a ChArUco board, how it is drawn, and where its corners are in a picture.

The board's frame: x along its printed rows, y up the page, z out of the paper; the origin is the lower left
corner of the lower left square. So a board that lies on the floor with its face up shares z with the world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.calibration.sharpness import edge_width

DICTIONARIES: dict[str, int] = {
    "4x4_50": cv2.aruco.DICT_4X4_50,
    "4x4_250": cv2.aruco.DICT_4X4_250,
    "5x5_50": cv2.aruco.DICT_5X5_50,
    "5x5_250": cv2.aruco.DICT_5X5_250,
    "6x6_50": cv2.aruco.DICT_6X6_50,
    "6x6_250": cv2.aruco.DICT_6X6_250,
}
"""The families of markers, by the cells of a marker and the number of markers."""

FEWEST_CORNERS = 8
_STRAY = 5.0  # times the median residual of a picture
_STRAY_LEAST = 0.4  # [px], no corner is a stray below
_WIDE = 1300  # [px], narrower pictures are enlarged: a far marker's cell is only two pixels wide


class BoardError(NoctuleError):
    """A description of a board that cannot be."""


class NoBoardError(NoctuleError):
    """A picture in which the board is not seen well enough; the message is the reason alone."""


@dataclass(frozen=True, slots=True)
class Board:
    """A ChArUco board. Raises BoardError when it cannot be.

    The default fits a sheet of 0.84 x 0.59 m (A1).
    """

    columns: int = 7  # squares along x
    rows: int = 5  # squares along y
    square: float = 0.10  # [m], side of a square
    marker: float = 0.075  # [m], side of a marker
    dictionary: str = "4x4_50"  # one of DICTIONARIES

    def __post_init__(self) -> None:
        if self.dictionary not in DICTIONARIES:
            raise BoardError(
                f"board: dictionary {self.dictionary!r} is unknown; expected one of {', '.join(DICTIONARIES)}"
            )
        sides = 3 <= self.columns <= 50 and 3 <= self.rows <= 50
        if not sides or (self.columns - 1) * (self.rows - 1) < FEWEST_CORNERS:
            raise BoardError(
                f"board: it has {self.columns}x{self.rows} squares; expected 3 to 50 along each side, and at "
                f"least {FEWEST_CORNERS} corners inside"
            )
        if not 0.005 <= self.square <= 1.0:
            raise BoardError(f"board: its squares are {self.square:g} m; expected 0.005 to 1 m")
        if not 0.3 * self.square <= self.marker <= 0.95 * self.square:
            raise BoardError(
                f"board: its markers are {self.marker:g} m in squares of {self.square:g} m; expected "
                f"{0.3 * self.square:g} to {0.95 * self.square:g} m, a white rim around each"
            )
        most = int(self.dictionary.rsplit("_", 1)[1])
        if self.markers > most:
            raise BoardError(
                f"board: {self.columns}x{self.rows} squares hold {self.markers} markers, the dictionary "
                f"{self.dictionary} has {most}; take a larger one"
            )

    @property
    def markers(self) -> int:
        """How many markers it has: one in each white square."""
        return self.columns * self.rows // 2

    @property
    def size(self) -> Array:
        """Length along x and y, (2,) [m]."""
        return np.array([self.columns, self.rows]) * self.square

    @property
    def outline(self) -> Array:
        """Its four corners in its own frame, (4, 3) [m], counterclockwise from the origin."""
        x, y = self.size
        return np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, y, 0.0], [0.0, y, 0.0]])

    def opencv(self) -> Any:
        """Return the cv2.aruco.CharucoBoard; its y points down the page, and its z into the paper."""
        family = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.dictionary])
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, family)

    def draw(self, per_square: int) -> NDArray[np.uint8]:
        """Return it without a margin, black and white, `per_square` pixels a square."""
        size = (self.columns * per_square, self.rows * per_square)
        return np.asarray(self.opencv().generateImage(size, marginSize=0), dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class BoardView:
    """The corners of a board in a picture."""

    name: str  # of the picture
    size: tuple[int, int]  # width, height of the picture [px]
    p: Array  # (n, 2) [px], as the lens shows them
    x_board: Array  # (n, 3) [m], the same corners on the board
    edge_width: float  # [px], of the edges between black and white, nan where none could be measured


def without_strays(view: BoardView, residuals: Array) -> BoardView:
    """Return the view without corners that fit far worse (`residuals` (n, 2) [px]) than its others.

    A corner now and then is found on a neighbouring edge. Where more than a tenth would go, the picture as a
    whole is at fault, and all stay.
    """
    lengths = np.hypot(*residuals.T)
    keep = lengths <= max(_STRAY * float(np.median(lengths)), _STRAY_LEAST)
    if keep.all() or keep.sum() < max(FEWEST_CORNERS, 0.9 * len(keep)):
        return view
    return replace(view, p=view.p[keep], x_board=view.x_board[keep])


def find_board(board: Board, grey: NDArray[np.uint8], name: str) -> BoardView:
    """Find the corners of `board` in a grey picture (height, width).

    Raises
    ------
    NoBoardError
        When fewer than FEWEST_CORNERS are seen, or all in one row; says why.
    """
    times = max(1, round(_WIDE / grey.shape[1]))
    large = grey
    if times > 1:
        enlarged = cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
        large = np.asarray(enlarged, dtype=np.uint8)
    charuco = board.opencv()
    corners, ids, _, marker_ids = _detector(charuco).detectBoard(large)
    count = 0 if corners is None else len(corners)
    if count < FEWEST_CORNERS:
        raise NoBoardError(_why_not(board, large, count, 0 if marker_ids is None else len(marker_ids)))
    x_page, p_large = charuco.matchImagePoints(corners, ids)
    x_page = np.asarray(x_page, dtype=np.float64).reshape(-1, 3)
    if np.linalg.matrix_rank(x_page[:, :2] - x_page[0, :2], tol=1e-6) < 2:
        raise NoBoardError(f"the {count} corners seen are all in one row; show more of the board")
    # The middle of the first pixel is (0, 0), in the enlarged picture too.
    p = (np.asarray(p_large, dtype=np.float64).reshape(-1, 2) + 0.5) / times - 0.5
    x_board = np.column_stack([x_page[:, 0], board.size[1] - x_page[:, 1], np.zeros(len(p))])
    cells = np.rint(x_board[:, :2] / board.square).astype(np.int64)
    rim = 0.5 * (1.0 - board.marker / board.square)
    size = (int(grey.shape[1]), int(grey.shape[0]))
    return BoardView(name, size, p, x_board, edge_width(grey, p, cells, rim))


def _detector(charuco: Any) -> Any:
    found, markers = cv2.aruco.CharucoParameters(), cv2.aruco.DetectorParameters()
    found.tryRefineMarkers = True  # a board far away loses a third of its corners without
    markers.perspectiveRemovePixelPerCell = 8
    return cv2.aruco.CharucoDetector(charuco, found, markers)


def _why_not(board: Board, large: NDArray[np.uint8], corners: int, markers: int) -> str:
    if corners:
        return f"only {corners} corners of the board are seen, expected {FEWEST_CORNERS}; show more of it"
    if markers >= 4:
        return (
            f"{markers} markers are seen, but they do not lie as on a board of {board.columns}x{board.rows} "
            "squares; is it another board?"
        )
    for name, number in DICTIONARIES.items():
        if name.split("_")[0] == board.dictionary.split("_")[0]:
            continue
        family = cv2.aruco.getPredefinedDictionary(number)
        _, ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(large)
        if ids is not None and len(ids) >= 4:
            return (
                f"its markers are of the dictionary {name}, the board's are of {board.dictionary}; "
                "is it another board?"
            )
    return "no board is seen; is it sharp, lit, whole, and near enough?"
