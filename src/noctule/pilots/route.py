"""Routes over a visual path: laps, backwards, any order of its images.

A route is the list of the images in the order in which they are flown. `unroll` makes of it a path of its
own, so that nothing that flies a path has to know of routes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from noctule.errors import NoctuleError
from noctule.pilots.visual_path import KeyLink, VisualPath
from noctule.vision.matching import match_robust

FEWEST = 16
"""Points that two images which are no neighbours must share to follow each other."""


class RouteError(NoctuleError):
    """A route over a path that cannot be flown."""


def laps(n_images: int, n_laps: int) -> tuple[int, ...]:
    """Return the route that flies a closed path `n_laps` times, always from its first image to its last."""
    return tuple(range(n_images)) * n_laps


def backwards(route: Sequence[int]) -> tuple[int, ...]:
    """Return the route from its end to its beginning; headings stay, so the vehicle flies tail first."""
    return tuple(reversed(route))


def unroll(path: VisualPath, route: Sequence[int]) -> VisualPath:
    """Return the path whose images are those of `route`, in that order; images may repeat.

    Neighbours keep their link, turned round where the route goes back; others are matched now.

    Raises
    ------
    RouteError
        For an image that the path does not have or that follows itself, and for two that follow each other
        and share fewer than `FEWEST` points.
    """
    if not route:
        raise RouteError("route: it has no images, expected one at least; name the images to fly")
    for k in route:
        if not 0 <= k < len(path.images):
            raise RouteError(
                f"route: there is no image {k}, the path has the images 0 to {len(path.images) - 1}; "
                "take one of those"
            )
    if tuple(route) == tuple(range(len(path.images))):
        return path
    known: dict[tuple[int, int], KeyLink] = {}
    for pair in pairwise(route):
        if pair not in known:
            known[pair] = _link(path, *pair)
    links = tuple(known[pair] for pair in pairwise(route))
    return VisualPath(path.camera, path.mount, tuple(path.images[k] for k in route), links)


def _link(path: VisualPath, a: int, b: int) -> KeyLink:
    if b == a + 1:
        return path.links[a]
    if b == a - 1:
        return KeyLink(path.links[b].p_next, path.links[b].p_ref)
    here, ahead = path.images[a], path.images[b]
    if a == b:
        raise RouteError(
            f"route: image '{here.name}' would follow itself, expected another one; "
            "laps need a path of two images at least"
        )
    found = match_robust(here.features, ahead.features, path.camera, fewest=FEWEST)
    if not len(found):
        raise RouteError(
            f"route: image '{ahead.name}' cannot follow '{here.name}', they show different places: "
            f"{found.reason}; for laps teach a path that ends where it begins"
        )
    return KeyLink(found.p_ref, found.p_current)
