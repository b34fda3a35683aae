"""Focal lengths, principal point and distortion of a camera, from pictures of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.errors import NoctuleError
from noctule.geometry import Array
from noctule.localization.calibration.board import BoardView, without_strays
from noctule.localization.calibration.lens import Lens

FEWEST_PICTURES = 8
WIDEST_EDGE = 4.5  # [px]
LARGEST_RESIDUAL = 0.5  # [px] rms
_STARTS = (0.6, 1.5)  # focal lengths to begin from, in widths of the picture
_OUTLIER = 3.0  # times the median picture's residual
_OUTLIER_LEAST = 0.15  # [px], no picture is an outlier below


class PictureSizesError(NoctuleError):
    """Pictures of several sizes: of several cameras, or cropped."""


class UndeterminedError(NoctuleError):
    """Pictures that no focal length can be found from."""


class TooFewPicturesError(NoctuleError):
    """Too few pictures show the board well; one line for each that does not."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A picture that was not used."""

    name: str
    reason: str  # what is wrong with it

    def __str__(self) -> str:
        """Return the line that a person reads."""
        return f"picture {self.name}: left out: {self.reason}"


@dataclass(frozen=True, slots=True)
class UsedPicture:
    """A picture that was used, and where its board was."""

    view: BoardView
    residuals: Array  # (n, 2) [px], found minus predicted
    R_camera_board: Array  # (3, 3)
    t_camera_board: Array  # (3,) [m]

    @property
    def residual(self) -> float:
        """The rms length of its residuals [px]."""
        return float(np.sqrt((self.residuals**2).sum(axis=1).mean()))

    @property
    def tilt(self) -> float:
        """The angle [rad] between the board's normal and the optical axis."""
        return float(np.arccos(np.clip(abs(self.R_camera_board[2, 2]), 0.0, 1.0)))


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """The intrinsics found, and how well they are known."""

    camera: PinholeCamera
    lens: Lens
    sd: Array  # (4,) [px], of fx, fy, cx, cy
    used: tuple[UsedPicture, ...]
    left_out: tuple[LeftOut, ...]

    @property
    def residual(self) -> float:
        """The rms length of all residuals [px]."""
        return float(np.sqrt(np.concatenate([(u.residuals**2).sum(axis=1) for u in self.used]).mean()))


def calibrate_intrinsics(views: Sequence[BoardView], missing: Sequence[LeftOut] = ()) -> Intrinsics:
    """Find the intrinsics from pictures of one board; see `intrinsics_faults` for whether they are any good.

    Blurred pictures, and those that fit far worse than the others, are left out. Least squares over
    all corners; the lens has k1, k2, p1, p2 (narrow lenses do not tell k3 from k2).

    Parameters
    ----------
    views
        The board in each picture.
    missing
        Pictures left out before, told with the others.

    Raises
    ------
    PictureSizesError
        When the pictures are not all of one size.
    TooFewPicturesError
        When fewer than FEWEST_PICTURES can be used.
    UndeterminedError
        When every picture shows the board square on.
    """
    _check_sizes(views)
    left_out, good = list(missing), list[BoardView]()
    for view in views:
        if view.edge_width > WIDEST_EDGE:
            left_out.append(
                LeftOut(
                    view.name,
                    f"blurred, its edges are {view.edge_width:.1f} px wide, expected {WIDEST_EDGE:g} or "
                    "less; retake it with board and camera still",
                )
            )
        else:
            good.append(view)
    while True:
        if len(good) < FEWEST_PICTURES:
            raise TooFewPicturesError(
                "\n".join(
                    [
                        f"calibration: {len(good)} of {len(good) + len(left_out)} pictures can be used, "
                        f"expected {FEWEST_PICTURES} or more; take more, 15 to 20 do well",
                        *map(str, left_out),
                    ]
                )
            )
        found = _solve(good, left_out)
        kept = [without_strays(one.view, one.residuals) for one in found.used]
        if any(len(a.p) != len(b.p) for a, b in zip(kept, good, strict=True)):
            good = kept
            continue
        residuals = np.array([one.residual for one in found.used])
        usual = float(np.median(residuals))
        worst = int(np.argmax(residuals))
        if residuals[worst] <= max(_OUTLIER * usual, _OUTLIER_LEAST):
            return found
        left_out.append(
            LeftOut(
                good.pop(worst).name,
                f"its residual is {residuals[worst]:.2f} px, the others' {usual:.2f} px; retake it with a "
                "flat board that nobody moves",
            )
        )


def _check_sizes(views: Sequence[BoardView]) -> None:
    sizes: dict[tuple[int, int], list[str]] = {}
    for view in views:
        sizes.setdefault(view.size, []).append(view.name)
    if len(sizes) > 1:
        common = max(sizes, key=lambda size: len(sizes[size]))
        other = next(size for size in sizes if size != common)
        raise PictureSizesError(
            f"calibration: picture {sizes[other][0]} is {other[0]}x{other[1]} px, most are "
            f"{common[0]}x{common[1]} px; expected pictures of one camera at one size, not cropped"
        )


def _solve(views: Sequence[BoardView], left_out: Sequence[LeftOut]) -> Intrinsics:
    """Solve from a wide and from a long lens: how far the answers differ, the focal length is unknown."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # several add up in another order each time, and give other digits
    try:
        answers = [found for start in _STARTS if (found := _solve_from(views, start)) is not None]
    finally:
        cv2.setNumThreads(threads)
    if not answers:
        raise UndeterminedError(
            f"calibration: the {len(views)} pictures do not tell the focal length at all; retake them with "
            "the board tilted by 30 to 45 degrees, each time another way"
        )
    answers.sort(key=lambda found: found.residual)
    best = answers[0]
    apart = np.zeros(4)
    for other in answers[1:]:
        apart = np.abs(np.concatenate([other.camera.focal - best.camera.focal, np.zeros(2)]))
    return replace(best, sd=np.maximum(best.sd, apart), left_out=tuple(left_out))


def _solve_from(views: Sequence[BoardView], start: float) -> Intrinsics | None:
    width, height = views[0].size
    x = [view.x_board.astype(np.float32).reshape(-1, 1, 3) for view in views]
    p = [view.p.astype(np.float32).reshape(-1, 1, 2) for view in views]
    guess = PinholeCamera.centred(width, height, start * width).K
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    try:
        _, K, bend, rotations, translations, sd, _, _ = cv2.calibrateCameraExtended(
            x, p, (width, height), guess, np.zeros(5), flags=flags
        )
    except cv2.error:
        return None
    if not (np.isfinite(K).all() and K[0, 0] > 0.0 and K[1, 1] > 0.0 and np.isfinite(bend).all()):
        return None
    coefficients = np.asarray(bend, dtype=np.float64).ravel()[:4]
    fx, fy, cx, cy = (float(K[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    used = []
    for view, r, t in zip(views, rotations, translations, strict=True):
        predicted, _ = cv2.projectPoints(view.x_board.reshape(-1, 1, 3), r, t, K, coefficients)
        R = np.asarray(cv2.Rodrigues(r)[0], dtype=np.float64)
        t_camera_board = np.asarray(t, dtype=np.float64).ravel()
        used.append(UsedPicture(view, view.p - predicted.reshape(-1, 2), R, t_camera_board))
    deviations = np.asarray(sd, dtype=np.float64).ravel()[:4]
    deviations = np.where(np.isfinite(deviations) & (deviations > 0.0), deviations, np.inf)
    camera, lens = PinholeCamera(width, height, fx, fy, cx, cy), Lens(*map(float, coefficients))
    return Intrinsics(camera, lens, deviations, tuple(used), ())


def coverage(found: Intrinsics, columns: int = 8, rows: int = 6) -> NDArray[np.int64]:
    """Return how many corners were seen in each of (rows, columns) equal parts of the picture."""
    p = np.concatenate([one.view.p for one in found.used])
    counts, _, _ = np.histogram2d(
        p[:, 1],
        p[:, 0],
        (rows, columns),
        ((-0.5, found.camera.height - 0.5), (-0.5, found.camera.width - 0.5)),
    )
    return np.asarray(counts, dtype=np.int64)
