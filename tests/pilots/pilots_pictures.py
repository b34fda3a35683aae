"""A visual path of real photographs, and what a camera sees of it."""

from functools import cache

import numpy as np
from vision_photographs import HEIGHT, WIDTH, motion, view

from noctule.camera import CameraMount, PinholeCamera
from noctule.estimation.odometry import Odometry
from noctule.messages import FlightState, MatchResult, Observation, Picture, VehicleState
from noctule.pilots.factory import link_estimates
from noctule.pilots.perception import Perception, match_key_image
from noctule.pilots.settings import PilotSettings
from noctule.pilots.visual_path import KeyImage, KeyLink, VisualPath
from noctule.vision.features import detect

CAMERA = PinholeCamera.centred(WIDTH, HEIGHT, 510.0)
DT = 1.0 / 30.0


@cache
def picture_of(name, right=0.0, down=0.0, scale=1.0):
    return view(name, motion(scale, right=right, down=down), seed=int(7 * right + 11 * down) % 1000)


@cache
def path_of(*names, stabilised=True):
    """A path of one key image for each photograph; its links share nothing worth having."""
    pixels = [view(name, motion(), seed=5) for name in names]
    images = tuple(KeyImage(n, p, detect(p)) for n, p in zip(names, pixels, strict=True))
    links = tuple(KeyLink(np.empty((0, 2)), np.empty((0, 2))) for _ in images[1:])
    return VisualPath(CAMERA, CameraMount(stabilised=stabilised), images, links)


def state_at(stamp, roll=None, pitch=None, yaw=None):
    return VehicleState(stamp, FlightState.FLYING, roll, pitch, yaw)


class Watcher:
    """Shows pictures to a perception tick by tick, as the loop does."""

    def __init__(self, path, method="upright", **settings):
        self.path, self.settings = path, PilotSettings.model_validate(settings)
        self.perception = Perception(
            link_estimates(path, self.settings.attitude_sd_deg), self.settings, method
        )
        self.odometry = Odometry()
        self.tick = 0
        self.shown = {}  # stamp -> Picture

    @property
    def now(self):
        return self.tick * DT

    def show(self, pixels, *matches, wanted=(0, 1), share=None, roll=0.0, pitch=0.0, yaw=None):
        """Return the views of a tick; `pixels` None: no new picture came. `share` points for each image."""
        self.tick += 1
        self.odometry.step(self.now, np.zeros(4), None, yaw, (roll, pitch))
        picture = None if pixels is None else Picture(self.now, pixels)
        if picture is not None:
            self.shown[picture.stamp] = picture
        observation = Observation(self.now, state_at(self.now, roll, pitch, yaw), picture, matches)
        most = share or self.settings.max_points
        return self.perception.step(observation, self.odometry, dict.fromkeys(wanted, most))

    def ask(self, current=0, following=None, search=()):
        return [r.key_index for r in self.perception.requests(self.now, current, following, search)]

    def match(self, index=0, stamp=None) -> MatchResult:
        """What the worker finds in the picture of `stamp`, the newest unless told."""
        return match_key_image(self.path, self.settings, self.shown[stamp or self.now], index)

    def begin(self, pixels, index=0):
        """Show a picture, match it, and show it again: afterwards it is tracked."""
        self.show(pixels)
        assert self.ask(index) == [index]
        return self.show(pixels, self.match(index))
