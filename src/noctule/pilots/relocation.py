"""Which key images to look for when the target is not in sight."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from noctule.pilots.law import View
from noctule.pilots.visual_path import VisualPath


def outward(target: int, n: int) -> list[int]:
    """Return the indices 0 to n - 1, the nearest to `target` first, ahead before behind."""
    return sorted(range(n), key=lambda i: (abs(i - target), i < target))


def distinct(path: VisualPath) -> list[int]:
    """Return the first index of every different image: a path of several laps holds each more than once."""
    first: dict[str, int] = {}
    for i, image in enumerate(path.images):
        first.setdefault(image.name, i)
    return list(first.values())


def nearest_in_order(views: dict[int, View], target: int) -> int | None:
    """Return the recognised image that is nearest to `target` along the path, None when there is none."""
    return min(views, key=lambda i: (abs(i - target), i < target), default=None)


@dataclass(slots=True)
class Sweep:
    """Looks at every image once to find where on the path the flight begins."""

    images: list[int]
    distance: dict[int, float] = field(default_factory=dict)  # index -> |t| [mean depths]

    def note(self, views: dict[int, View]) -> None:
        """Take the views of a tick."""
        for i, view in views.items():
            self.distance[i] = float(np.linalg.norm(view.estimate.t))

    def left(self, answered: set[int]) -> list[int]:
        """Return the images that nobody has looked for yet; `answered` are those that were matched or not."""
        return [i for i in self.images if i not in answered and i not in self.distance]

    def nearest(self) -> int | None:
        """Return the image that is nearest in space, None when none was recognised."""
        return min(self.distance, key=lambda i: self.distance[i], default=None)
