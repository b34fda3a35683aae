"""`noctule doctor`: can this machine fly the simulator? Each check is one line that says what to do."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from noctule.cli.options import out_folder
from noctule.errors import NoctuleError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LEAST_DISK = 500_000_000  # [bytes], some eight minutes of recording
_PACKAGES = (
    "mujoco",
    "numba",
    "numpy",
    "opencv-python-headless",
    "mcap",
    "foxglove-sdk",
    "pydantic",
    "cyclopts",
)


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at."""

    name: str
    ok: bool
    found: str  # what was found and, where it is not ok, what to do


def examine(seed: int, out: Path | None, json: bool) -> int:
    """Run every check and print them; 0 when all are well, otherwise 1."""
    from noctule.cli.show import as_json

    folder = out_folder(out, "doctor") if out is not None else None
    checks = [
        check_python(sys.version_info[:2]),
        check_packages(metadata.version),
        check_numba_cache(),
        check_disk(folder or Path.cwd(), lambda path: shutil.disk_usage(path).free),
        check_drawing(seed, folder),
    ]
    ok = all(check.ok for check in checks)
    if json:
        print(as_json({"ok": ok, "checks": [asdict(check) for check in checks]}))
    else:
        for check in checks:
            print(f"{'ok  ' if check.ok else 'FAIL'} {check.name}: {check.found}")
        print("all well: try `noctule fly`" if ok else "not well: mend the lines that say FAIL")
    return 0 if ok else 1


def check_python(version: tuple[int, int]) -> Check:
    """Check that `version` is one that Noctule is tested with."""
    found = f"{version[0]}.{version[1]} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    ok = (3, 11) <= version <= (3, 13)
    return Check("Python", ok, found if ok else f"{found}; expected 3.11 to 3.13, install one of them")


def check_packages(version_of: Callable[[str], str]) -> Check:
    """Check that the packages are installed; `version_of` gives a package's version."""
    found, missing = [], []
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version_of(name)}")
        except metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return Check(
            "packages", False, f"missing: {', '.join(missing)}; run script/fly, or pip install noctule"
        )
    return Check("packages", True, ", ".join(found))


def check_numba_cache() -> Check:
    """Check that compiled functions can be kept, so that only the first flight waits for the compiler."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else Path(__file__).resolve().parents[1]
    if os.access(folder, os.W_OK):
        return Check("compiled code", True, f"kept in {folder}")
    if given is None and os.access(Path.home(), os.W_OK):
        return Check("compiled code", True, f"kept in the home folder ({folder} is read-only)")
    return Check(
        "compiled code", False, f"{folder} cannot be written; set NUMBA_CACHE_DIR to a folder of yours"
    )


def check_disk(folder: Path, free_bytes: Callable[[Path], int]) -> Check:
    """Check that a few flights can be recorded into `folder`."""
    free = free_bytes(folder)
    found = f"{free / 1e9:.1f} GB free in {folder}"
    if free < LEAST_DISK:
        return Check(
            "disk", False, f"{found}, expected {LEAST_DISK / 1e9:.1f} GB; free some, or use --out elsewhere"
        )
    return Check("disk", True, found)


def check_drawing(seed: int, folder: Path | None) -> Check:
    """Draw the room of `seed` off screen and, when `folder` is given, leave the picture there."""
    try:
        import numpy as np

        pixels = _draw_room(seed)
    except NoctuleError as error:
        return Check("drawing", False, str(error))
    height, width = pixels.shape[:2]
    if float(np.std(pixels)) < 1.0:
        return Check(
            "drawing", False, f"a picture of {width}x{height} came out blank; is the OpenGL driver whole?"
        )
    found = f"a picture of {width}x{height} without a display (MUJOCO_GL={os.environ.get('MUJOCO_GL', '')})"
    if folder is not None:
        import cv2

        path = folder / f"room-{seed}.png"
        cv2.imwrite(str(path), np.ascontiguousarray(pixels[:, :, ::-1]))
        found += f", in {path}"
    return Check("drawing", True, found)


def _draw_room(seed: int) -> NDArray[np.uint8]:
    import numpy as np

    from noctule.geometry import Pose
    from noctule.simulation import RoomSpec, SimulatedWorld, WorldSpec

    with SimulatedWorld.from_spec(WorldSpec(room=RoomSpec(seed=seed))) as world:
        return world.photograph(Pose(np.array([0.0, 0.0, 1.0]), 0.0)).pixels
