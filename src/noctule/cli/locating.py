"""`noctule locate`: where the drone is, live and recorded, from any depth camera."""

from __future__ import annotations

import csv
import math
import shutil
import sys
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median, pstdev
from typing import IO, TYPE_CHECKING, Any

from noctule.cli.depth_options import SourceOptions, depth_source
from noctule.cli.depth_stream import require_same_camera
from noctule.cli.options import out_folder
from noctule.cli.show import as_json

if TYPE_CHECKING:
    from noctule.geometry import Pose
    from noctule.localization.locator import Located

SECONDS = 30.0
_SHOW_EVERY = 0.1  # [s] of wall time, on a terminal
_SAY_EVERY = 1.0  # [s] of the stream, elsewhere
_COLUMNS = (
    "stamp_s", "x_m", "y_m", "z_m", "yaw_deg", "sd_x_m", "sd_y_m", "sd_z_m", "sd_yaw_deg", "score",
    "heading_certain", "reason", "frame_ms",
)  # fmt: skip


def locate_drone(
    options: SourceOptions, site: Path, detector: str, frames: bool, out: Path | None, json: bool
) -> int:
    """Locate the drone in every frame, tell and record it; 0 when it was seen at all."""
    from noctule.localization.site import load_site, locator_of, straightening

    known = load_site(site)
    camera = known.camera.camera

    from noctule.flight.depth_recording import DepthRecorder
    from noctule.flight.interrupt import interruptible

    source = depth_source(options, "locate", "path", SECONDS)
    require_same_camera(source, camera)
    locator, straight = locator_of(known, detector=detector), straightening(known.camera)
    folder = out_folder(out, "locate")
    tally, status = Tally(source.truth), Status(json)
    with (
        interruptible() as stopped,
        DepthRecorder(folder / "located.mcap", camera) as recorder,
        (folder / "located.csv").open("w", newline="", encoding="utf-8") as file,
    ):
        table = csv.writer(file)
        table.writerow(_COLUMNS)
        for taken in source.frames():
            frame = straight(taken)
            begin = time.perf_counter()
            located = locator.step(frame)
            frame_ms = 1e3 * (time.perf_counter() - begin)
            # As it came: whoever locates it again takes the lens out then.
            if frames and taken.depth.dtype == "uint16" and taken.depth.ndim == 2:
                recorder.frame(taken)
            ratio = located.diagnostics.ratio
            score = ratio if math.isfinite(ratio) else None
            recorder.located(frame.stamp, located.measurement, located.reason, score, frame_ms)
            table.writerow(_row(located, frame_ms))
            tally.add(located, frame_ms)
            status.show(located)
            if stopped.is_set():
                break
    status.end()
    summary = {
        **tally.summary(),
        "recording": folder / "located.mcap",
        "table": folder / "located.csv",
    }
    print(as_json(summary) if json else in_words(summary, source.name))
    return 0 if tally.tracked else 1


def _row(located: Located, frame_ms: float) -> list[str]:
    seen = located.measurement
    values = [""] * 8
    if seen is not None:
        sd = [math.sqrt(float(seen.covariance[i, i])) for i in range(4)]
        values = [f"{float(x):.5f}" for x in seen.position]
        values += [
            f"{math.degrees(seen.yaw):.3f}",
            *(f"{s:.5f}" for s in sd[:3]),
            f"{math.degrees(sd[3]):.3f}",
        ]
    ratio = located.diagnostics.ratio
    return [
        repr(located.stamp),
        *values,
        f"{ratio:.3f}" if math.isfinite(ratio) else "",
        "yes" if located.heading_certain else "no",
        located.reason,
        f"{frame_ms:.3f}",
    ]


class Status:
    """The live line: rewritten on a terminal, one a second of the stream elsewhere, none before JSON."""

    def __init__(self, json: bool, out: IO[str] | None = None) -> None:
        self._out = out or sys.stdout
        self._live = self._out.isatty()
        self._silent = json
        self._shown = -math.inf

    def show(self, located: Located) -> None:
        """Show what was found in a frame, if it is time."""
        if self._silent:
            return
        now = time.monotonic() if self._live else located.stamp
        if now - self._shown < (_SHOW_EVERY if self._live else _SAY_EVERY - 1e-6):
            return
        self._shown = now
        line = status_line(located)
        if not self._live:
            print(line, file=self._out)
            return
        width = shutil.get_terminal_size().columns
        print(f"\r\x1b[K{line[: width - 1]}", end="", file=self._out, flush=True)

    def end(self) -> None:
        """Leave the live line."""
        if self._live and not self._silent:
            print(file=self._out)


def status_line(located: Located) -> str:
    """Return position, heading and score of a frame, or why there are none."""
    seen = located.measurement
    if seen is None:
        return f"{located.stamp:8.2f} s  {located.state}: {located.reason}"
    x, y, z = (float(v) for v in seen.position)
    unsure = "" if located.heading_certain else " or turned round"
    return (
        f"{located.stamp:8.2f} s  x {x:+.3f}  y {y:+.3f}  z {z:.3f} m  heading "
        f"{math.degrees(seen.yaw):+6.1f} deg{unsure}  score {located.diagnostics.ratio:.2f}"
    )


@dataclass(slots=True)
class Tally:
    """What came of all frames."""

    truth: Mapping[float, Pose]
    frames: int = 0
    tracked: int = 0
    certain: int = 0
    slips: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    frame_ms: list[float] = field(default_factory=list)
    off: list[tuple[float, float, float, float]] = field(default_factory=list)  # x, y, z [m], yaw [rad]

    def add(self, located: Located, frame_ms: float) -> None:
        """Count a frame."""
        from noctule.geometry import wrap_angle
        from noctule.localization.health import name_of

        self.frames += 1
        self.frame_ms.append(frame_ms)
        self.slips += located.slipped
        seen = located.measurement
        if seen is None:
            self.reasons[name_of(located.reason)] += 1
            return
        self.tracked += 1
        self.certain += located.heading_certain
        true = self.truth.get(located.stamp)
        if true is not None:
            x, y, z = (float(v) for v in seen.position - true.position)
            self.off.append((x, y, z, wrap_angle(seen.yaw - true.yaw)))

    def summary(self) -> dict[str, Any]:
        """Return the figures; errors only where the truth is known."""
        from noctule.geometry import wrap_angle

        figures: dict[str, Any] = {
            "frames": self.frames,
            "tracked": self.tracked,
            "tracked_share": self.tracked / self.frames if self.frames else math.nan,
            "heading_certain": self.certain,
            "slips": self.slips,
            "reasons": dict(self.reasons.most_common()),
            "frame_ms": median(self.frame_ms) if self.frame_ms else math.nan,
        }
        if self.off:
            x, y, z, yaw = (list(values) for values in zip(*self.off, strict=True))
            turn = math.atan2(fmean(map(math.sin, yaw)), fmean(map(math.cos, yaw)))
            figures["errors"] = {
                "position_rms_m": math.sqrt(fmean(a * a + b * b + c * c for a, b, c, _ in self.off)),
                **{f"{name}_mean_m": fmean(v) for name, v in (("x", x), ("y", y), ("z", z))},
                **{f"{name}_sd_m": pstdev(v) for name, v in (("x", x), ("y", y), ("z", z))},
                "yaw_mean_deg": math.degrees(turn),
                "yaw_sd_deg": math.degrees(math.sqrt(fmean(wrap_angle(a - turn) ** 2 for a in yaw))),
            }
        return figures


def in_words(summary: Mapping[str, Any], source: str) -> str:
    """Return the summary as a person reads it."""
    lines = [f"located: {summary['tracked']} of {summary['frames']} frames of {source}"]
    if summary["tracked"]:
        lines[0] += f", the heading certain in {summary['heading_certain']}"
    if summary["slips"]:
        lines.append(f"slips: the heading was turned round {summary['slips']} times")
    lines += [f"not located: {count} frames, {reason}" for reason, count in summary["reasons"].items()]
    errors = summary.get("errors")
    if errors:
        xyz = ", ".join(f"{1e3 * errors[f'{name}_mean_m']:+.1f}" for name in "xyz")
        sd = ", ".join(f"{1e3 * errors[f'{name}_sd_m']:.1f}" for name in "xyz")
        lines.append(f"against the truth: x, y, z {xyz} mm with sd {sd} mm")
        lines.append(f"heading {errors['yaw_mean_deg']:+.2f} deg with sd {errors['yaw_sd_deg']:.2f} deg")
    if summary["frames"]:
        lines.append(f"time: {summary['frame_ms']:.2f} ms a frame (median)")
    return "\n".join([*lines, f"table: {summary['table']}", f"recording: {summary['recording']}"])
