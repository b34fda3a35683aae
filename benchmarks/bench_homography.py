"""Print the error tables of the homography estimators, and their times beside OpenCV's.

Run: python benchmarks/bench_homography.py [TRIALS]   (default 200; every table has its own fixed seed)
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "vision"))

from vision_homography_scenes import angle_deg, make_pair

from noctule.vision.homography import estimate_homography, refine_upright

DEGREE = np.radians(1.0)
CASES = [  # name, kind, points, attitude_sd [deg], scene
    ("0.17 m, yaw to 16 deg", "room", 80, 0.0, {"baseline": 0.17}),
    ("1.5 m, yaw to 16 deg", "room", 80, 0.0, {"baseline": 1.5}),
    ("1.5 m, yaw to 30 deg", "room", 80, 0.0, {"baseline": 1.5, "yaw_max": 30 * DEGREE}),
    ("cloud, 0.17 m", "cloud", 80, 0.0, {"baseline": 0.17}),
    ("wall and near things, 0.17 m", "two", 80, 0.0, {"baseline": 0.17}),
    ("planar, 0.17 m", "planar", 80, 0.0, {"baseline": 0.17}),
    ("planar, 1.5 m", "planar", 80, 0.0, {"baseline": 1.5}),
    ("8 points, 0.17 m", "room", 8, 0.0, {"baseline": 0.17}),
    ("8 points, 0.17 m, 0.1 px", "room", 8, 0.0, {"baseline": 0.17, "noise_px": 0.1}),
    ("16 points, 0.17 m, 1 px", "room", 16, 0.0, {"baseline": 0.17, "noise_px": 1.0}),
    ("200 points, 0.17 m", "room", 200, 0.0, {"baseline": 0.17}),
    ("0.17 m, 1 px", "room", 80, 0.0, {"baseline": 0.17, "noise_px": 1.0}),
    ("0.17 m, 0.1 px", "room", 80, 0.0, {"baseline": 0.17, "noise_px": 0.1}),
    ("30 % outliers, 0.3 m", "room", 80, 0.0, {"baseline": 0.3, "outliers": 0.3}),
    ("50 % outliers, 0.3 m", "room", 80, 0.0, {"baseline": 0.3, "outliers": 0.5}),
    ("planar, 30 % outliers, 0.3 m", "planar", 80, 0.0, {"baseline": 0.3, "outliers": 0.3}),
    ("turn only", "room", 80, 0.0, {"baseline": 0.0}),
    ("turn only, 8 points", "room", 8, 0.0, {"baseline": 0.0}),
    ("turn only, 20 points, 1 px", "room", 20, 0.0, {"baseline": 0.0, "noise_px": 1.0}),
    ("0.02 m", "room", 80, 0.0, {"baseline": 0.02}),
    *[
        (f"attitude {error} deg, {'free' if free else 'held'}, 0.3 m", "room", 80, error * free or 0.5 * free,
         {"baseline": 0.3, "attitude": error * DEGREE})
        for error in (0.0, 0.5, 1.0, 2.0) for free in (0, 1)
    ],
    ("attitude 1 deg free, 30 % outliers", "room", 80, 1.0,
     {"baseline": 0.3, "attitude": DEGREE, "outliers": 0.3}),
    ("attitude 1 deg free, 20 points", "room", 20, 1.0, {"baseline": 0.3, "attitude": DEGREE}),
    ("attitude 1 deg free, planar, 0.3 m", "planar", 80, 1.0, {"baseline": 0.3, "attitude": DEGREE}),
]  # fmt: skip


def summary(values: list[float]) -> str:
    if not values:
        return "-".ljust(18)
    return f"{np.median(values):.2f} / {np.percentile(values, 95):.2f} / {max(values):.2f}".ljust(18)


def table_of_upright(trials: int) -> None:
    print(f"upright, {trials} trials: errors in degrees, median / 95th percentile / worst")
    print(f"{'case':38}{'yaw':20}{'direction':20}{'best answer':20}|t| ratio  NEES  undefined")
    for name, kind, n, attitude_sd, scene in CASES:
        rng = np.random.default_rng(1)
        yaw, direction, best, size, nees, undefined = [], [], [], [], [], 0
        for _ in range(trials):
            pair = make_pair(kind, n, rng, **scene)
            r = estimate_homography(pair.m_ref, pair.m_cur, "upright", attitude_sd * DEGREE)
            yaw.append(abs(float(np.degrees(r.yaw - pair.yaw))))
            if scene["baseline"] > 0.0:
                direction.append(angle_deg(r.t, pair.t))
                best.append(min(angle_deg(x.t, pair.t) for x in (r, *r.alternatives)))
                size.append(np.linalg.norm(r.t) / np.linalg.norm(pair.t))
            e = np.array([r.yaw - pair.yaw, *(r.t - pair.t)])
            nees.append(e @ np.linalg.solve(r.covariance, e))
            undefined += not r.t_defined
        ratio = f"{np.median(size):.3f}" if size else "-"
        print(
            f"{name:38}{summary(yaw):20}{summary(direction):20}{summary(best):20}{ratio:11}"
            f"{np.mean(nees):<6.1f}{undefined / trials:.2f}",
            flush=True,
        )


def table_of_warm_starts(trials: int) -> None:
    print("\nwarm starts of upright, 60 points, 0.5 m: share within 1 deg of the cold start's answer")
    for yaw_off, t_off in ((0.5, 0.01), (1.5, 0.03), (3.0, 0.1), (6.0, 0.2)):
        for kind, attitude_sd in (("room", 0.0), ("room", DEGREE), ("planar", 0.0), ("planar", DEGREE)):
            rng, same, anew = np.random.default_rng(2), 0, 0
            for _ in range(trials):
                pair = make_pair(kind, 60, rng, baseline=0.5, attitude=attitude_sd)
                cold = estimate_homography(pair.m_ref, pair.m_cur, "upright", attitude_sd)
                off = cold.parameters.copy()
                v = rng.normal(size=3)
                off[0] += rng.choice([-1, 1]) * yaw_off * DEGREE
                off[1:4] += t_off * v / np.linalg.norm(v)
                warm = refine_upright(pair.m_ref, pair.m_cur, replace(cold, parameters=off), attitude_sd)
                same += angle_deg(warm.t, cold.t) < 1.0
                anew += bool(warm.note)
            free = "free" if attitude_sd else "held"
            print(
                f"  off {yaw_off} deg, {t_off}, {kind}, {free}: {same / trials:.2f}, new {anew / trials:.2f}"
            )


def milliseconds(function, repeats: int = 200) -> str:
    function()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - begin)
    return f"{np.median(seconds) * 1e3:7.3f} ms"


def table_of_times() -> None:
    pair = make_pair("room", 60, np.random.default_rng(0), baseline=0.3, attitude=0.5 * DEGREE)
    a, b = pair.m_ref, pair.m_cur
    print("\ntime of one estimate, 60 points, median")
    moved = b + 0.004  # two pixels of motion since the last tick
    for sd, label in ((0.0, "held"), (DEGREE, "free")):
        start = estimate_homography(a, b, "upright", sd)
        cold = milliseconds(lambda sd=sd: estimate_homography(a, b, "upright", sd))
        warm = milliseconds(lambda sd=sd, start=start: refine_upright(a, moved, start, sd))
        print(f"  upright, {label}, cold   {cold}\n  upright, {label}, warm   {warm}")
    print(f"  planar                {milliseconds(lambda: estimate_homography(a, b, 'planar'))}")
    print(f"  generic               {milliseconds(lambda: estimate_homography(a, b, 'generic'))}")
    p, q = a * 510.0, b * 510.0
    print(f"  cv2.findHomography    {milliseconds(lambda: cv2.findHomography(p, q, cv2.USAC_MAGSAC, 1.5))}")
    essential = {"method": cv2.USAC_MAGSAC, "prob": 0.999, "threshold": 1.5 / 510.0}
    print(
        f"  cv2.findEssentialMat  {milliseconds(lambda: cv2.findEssentialMat(a, b, np.eye(3), **essential))}"
    )


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    table_of_upright(count)
    table_of_warm_starts(max(count // 2, 1))
    table_of_times()
