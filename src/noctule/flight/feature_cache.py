"""Features of key images and what neighbours share: computed once, kept beside the pictures."""

from __future__ import annotations

import os
import zipfile
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from noctule.camera import PinholeCamera
from noctule.errors import NoctuleError
from noctule.pilots.visual_path import KeyLink
from noctule.vision.features import Features, detect
from noctule.vision.matching import Matches, match_robust

FEWEST_SHARED = 16
_VERSION = 1  # raise it when features or matching change, so that no old cache is used


class NeighbourError(NoctuleError):
    """Two key images in a row that share too little to fly from one to the other."""


def features_and_links(
    cache: Path,
    key: str,
    pictures: list[NDArray[np.uint8]],
    names: list[str],
    camera: PinholeCamera,
    kind: str,
    refuse: bool = True,
) -> tuple[tuple[Features, ...], tuple[KeyLink, ...]]:
    """Return the features of every picture and the links between neighbours.

    They come from `cache` where that was made for the same `key`; otherwise they are computed and cached. A
    cache that cannot be written is done without. Raises NeighbourError when neighbours share fewer than 16
    points; without `refuse` such links are returned, and not cached.
    """
    key = f"{_VERSION}:{cv2.__version__}:{key}"
    cached = _load(cache, key, len(pictures), kind)
    if cached is None:
        features = tuple(detect(p, kind) for p in pictures)
        shared = [match_robust(a, b, camera) for a, b in pairwise(features)]
        weak = [i for i, found in enumerate(shared) if len(found) < FEWEST_SHARED]
        if weak and refuse:
            raise _too_few(shared[weak[0]], names[weak[0]], names[weak[0] + 1], cache.parent)
        links = tuple(KeyLink(found.p_ref, found.p_current) for found in shared)
        if not weak:
            _save(cache, key, features, links)
        return features, links
    return cached


def _too_few(shared: Matches, name_a: str, name_b: str, folder: Path) -> NeighbourError:
    why = f" ({shared.reason})" if shared.reason else ""
    return NeighbourError(
        f"path {folder}: images {name_a} and {name_b} share {len(shared)} points{why}, at least "
        f"{FEWEST_SHARED} are needed to fly from one to the other; take a picture between them"
    )


def _save(cache: Path, key: str, features: tuple[Features, ...], links: tuple[KeyLink, ...]) -> None:
    arrays: dict[str, NDArray[np.generic]] = {"key": np.array(key)}
    for i, f in enumerate(features):
        arrays[f"p{i}"], arrays[f"d{i}"] = f.p, f.descriptors
    for i, link in enumerate(links):
        arrays[f"a{i}"], arrays[f"b{i}"] = link.p_ref, link.p_next
    part = cache.with_name(f"{cache.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        part.replace(cache)
    except OSError:
        part.unlink(missing_ok=True)


def _load(
    cache: Path, key: str, count: int, kind: str
) -> tuple[tuple[Features, ...], tuple[KeyLink, ...]] | None:
    """Return what the cache holds, None when it is missing, damaged or made for something else."""
    try:
        with np.load(cache, allow_pickle=False) as arrays:
            if str(arrays["key"]) != key:
                return None
            features = tuple(Features(arrays[f"p{i}"], arrays[f"d{i}"], kind) for i in range(count))
            links = tuple(KeyLink(arrays[f"a{i}"], arrays[f"b{i}"]) for i in range(count - 1))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, EOFError):
        return None
    return features, links
