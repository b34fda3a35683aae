"""Draws docs/img/frames.svg, the picture of the conventions page, with the package's own rotations.

Run it from the repository: .venv/bin/python script/draw_frames.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from noctule.geometry import R_BODY_CAMERA, Array, Pose, rot_x, rot_z

WIDTH, HEIGHT, SCALE = 960, 500, 150.0  # [px], [px], [px/m]
RED, GREEN, BLUE, INK, PALE = "#c8324b", "#2c8a4b", "#2b62c4", "#2a2f3a", "#c9ced8"
DRONE = Pose(np.array([2.3, 0.5, 1.15]), np.radians(28.0))
# The eye is behind and to the right of the start and looks down on the room.
R_EYE_WORLD = rot_x(np.radians(-66.0)) @ rot_z(np.radians(38.0))


def flat(x_world: Array) -> tuple[float, float]:
    """Project a point (3,) [m] in parallel to the drawing [px]."""
    x, y, _ = R_EYE_WORLD @ (np.asarray(x_world) - np.array([1.7, 0.2, 0.55]))
    return 330.0 + SCALE * x, 255.0 - SCALE * y


def line(a: Array, b: Array, colour: str, width: float = 1.0, more: str = "") -> str:
    """Return a line between two points in the world."""
    (x1, y1), (x2, y2) = flat(a), flat(b)
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
        f'stroke-width="{width}" {more}/>'
    )


def text(x: float, y: float, words: str, colour: str = INK, more: str = "") -> str:
    """Return words at a place of the drawing [px]."""
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" {more}>{words}</text>'


def frame(origin: Array, rotation: Array, length: float, names: tuple[str, str, str]) -> list[str]:
    """Return three arrows: the columns of `rotation` (3, 3) at `origin` (3,) [m], red x, green y, blue z."""
    drawn = []
    for axis, (colour, name) in enumerate(zip((RED, GREEN, BLUE), names, strict=True)):
        tip = origin + length * rotation[:, axis]
        drawn.append(line(origin, tip, colour, 3.0, f'marker-end="url(#tip{axis})"'))
        x, y = flat(origin + (length + 0.16) * rotation[:, axis])
        drawn.append(text(x, y + 4, name, colour, 'text-anchor="middle" font-weight="600"'))
    return drawn


def ground() -> list[str]:
    """Return a grid on the floor, one line every half metre."""
    along = [line(np.array([x, -1.0, 0]), np.array([x, 1.0, 0]), PALE) for x in np.arange(-0.5, 4.1, 0.5)]
    across = [line(np.array([-0.5, y, 0]), np.array([4.0, y, 0]), PALE) for y in np.arange(-1.0, 1.1, 0.5)]
    return along + across


def drone() -> list[str]:
    """Return the hull with its nose, its shadow, and the arc of its heading."""
    ring = [DRONE.position + 0.2 * np.array([np.cos(a), np.sin(a), 0]) for a in np.linspace(0, 2 * np.pi, 49)]
    hull = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(flat, ring))
    below = DRONE.position * np.array([1, 1, 0])
    arc = [below + 0.55 * np.array([np.cos(a), np.sin(a), 0]) for a in np.linspace(0, DRONE.yaw, 20)]
    bend = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(flat, arc))
    x, y = flat(below + 0.72 * np.array([np.cos(DRONE.yaw / 2), np.sin(DRONE.yaw / 2), 0]))
    return [
        line(DRONE.position, below, INK, 1.0, 'stroke-dasharray="3 4"'),
        line(below, below + np.array([0.7, 0, 0]), INK, 1.0, 'stroke-dasharray="3 4"'),
        line(below, below + 0.7 * DRONE.R_world_body[:, 0], INK, 1.0, 'stroke-dasharray="3 4"'),
        f'<polyline points="{bend}" fill="none" stroke="{INK}" stroke-width="1.6" marker-end="url(#tip3)"/>',
        text(x, y + 4, "yaw", INK, 'text-anchor="middle" font-style="italic"'),
        f'<polygon points="{hull}" fill="#8d97aa" fill-opacity="0.45" stroke="{INK}"/>',
    ]


def picture() -> list[str]:
    """Return the picture plane: pixels count from the top left, normalised coordinates from its centre."""
    x, y, w, h = 664, 150, 260, 146
    arrow = 'stroke-width="3" marker-end="url(#tip{})"'
    return [
        f'<rect x="{x}" y="{y}" width="{w}" height="{h}" fill="#eef1f6" stroke="{INK}"/>',
        text(x + w / 2, y - 34, "the picture", INK, 'text-anchor="middle" font-weight="600"'),
        text(x - 4, y - 10, "p = (0, 0) [px]", INK),
        f'<circle cx="{x}" cy="{y}" r="4" fill="{INK}"/>',
        f'<circle cx="{x + w / 2}" cy="{y + h / 2}" r="4" fill="{INK}"/>',
        text(x + w / 2 - 10, y + h / 2 - 12, "m = (0, 0)", INK, 'text-anchor="end"'),
        f'<path d="M{x + w / 2} {y + h / 2}h70" stroke="{RED}" {arrow.format(0)}/>',
        f'<path d="M{x + w / 2} {y + h / 2}v48" stroke="{GREEN}" {arrow.format(1)}/>',
        text(x + w / 2 + 88, y + h / 2 + 4, "x", RED, 'font-weight="600"'),
        text(x + w / 2 + 8, y + h - 10, "y", GREEN, 'font-weight="600"'),
        text(x, y + h + 30, "m = K\u207b\u00b9 p: right and down, as the camera"),
    ]


def markers() -> str:
    """Return the arrow heads."""
    heads = "".join(
        f'<marker id="tip{i}" viewBox="0 0 8 8" refX="6" refY="4" '
        'markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{colour}"/></marker>'
        for i, colour in enumerate((RED, GREEN, BLUE, INK))
    )
    return f"<defs>{heads}</defs>"


def draw() -> str:
    """Return the whole drawing as SVG."""
    R = DRONE.R_world_body
    lens = DRONE.position + R @ np.array([0.9, 0.0, 0.0])  # far ahead of its place, so that it can be seen
    body = DRONE.position
    parts = [*ground(), *drone(), line(body, lens, INK, 1.0, 'stroke-dasharray="2 3"')]
    parts += frame(np.zeros(3), np.eye(3), 0.8, ("x", "y", "z"))
    parts += frame(body, R, 0.42, ("x", "y", "z"))
    parts += frame(lens, R @ R_BODY_CAMERA, 0.42, ("x", "y", "z"))
    bold = 'font-weight="600"'
    for point, dx, dy, title, axes in (
        (np.zeros(3), -70, 34, "world, ENU", "x along the room, y left, z up"),
        (body, -190, -62, "body, FLU", "x forward, y left, z up"),
        (lens, 30, 60, "camera, RDF", "x right, y down, z forward"),
    ):
        x, y = flat(point)
        parts += [text(x + dx, y + dy, title, INK, bold), text(x + dx, y + dy + 18, axes)]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" '
            f'height="{HEIGHT}" font-family="sans-serif" font-size="14" role="img">',
            "<title>World, body, camera and picture axes</title>",
            markers(),
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
            *parts,
            *picture(),
            "</svg>",
            "",
        ]
    )


if __name__ == "__main__":
    (Path(__file__).parents[1] / "docs" / "img" / "frames.svg").write_text(draw(), encoding="utf-8")
