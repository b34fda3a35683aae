"""The [pilot] group of a mission file: which law flies, and its gains."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from noctule.settings import Settings


class PublishedGains(Settings):
    """Gains of the published law, named as in section 5 of Toro-Arcila et al."""

    lambda_0: float = Field(2.8, gt=0, le=20, description="gain at zero error, eq. (4) [1/s]")
    lambda_inf: float = Field(0.1, gt=0, le=20, description="gain at large error, eq. (4) [1/s]")
    lambda_slope: float = Field(5.0, gt=0, le=100, description="slope of the gain at zero error, eq. (4)")
    lambda_lateral_extra: float = Field(2.5, ge=0, le=20, description="added to the lateral gain [1/s]")
    lambda_yaw_ratio: float = Field(0.5, gt=0, le=5, description="yaw gain as a fraction of lambda")
    lambda_avoid: float = Field(0.01, gt=0, le=10, description="gain of the avoidance task, eq. (9) [1/s]")
    lambda_visibility: float = Field(0.2, gt=0, le=10, description="gain of the visibility task, eq. (12)")
    sigma: float = Field(0.05, gt=0, le=1, description="width at which avoidance begins, eq. (8)")
    activation_s: float = Field(1.0, gt=0, le=10, description="time over which a task fades in, eq. (20) [s]")
    transition_s: float = Field(1.6, gt=0, le=10, description="blending after a switch, eq. (29) [s]")
    h_0: float = Field(0.2, ge=0, le=1, description="share of the new command right after a switch, eq. (29)")
    epsilon_intermediate_px: float = Field(12.0, gt=0, le=200, description="threshold on the way, eq. (7)")
    epsilon_last_px: float = Field(6.0, gt=0, le=200, description="threshold at the last image, eq. (7)")
    feed_forward: float | None = Field(
        None,
        ge=0,
        le=1,
        description="gamma of eq. (32), scale of the feed-forward; none: no feed-forward",
    )
    feed_forward_weight: float = Field(
        0.5,
        ge=0,
        le=1,
        description="p of eq. (31), the share of servoing beside feed-forward",
    )
    change_on_rise: bool = Field(
        True, description="with feed-forward, an image is also passed when the error has risen five times"
    )
    column_distance: float = Field(0.8, gt=0, le=10, description="assumed distance z of a column [m]")
    scene_distance: float = Field(3.0, gt=0, le=50, description="assumed distance z of the scene [m]")

    @model_validator(mode="after")
    def _falling_gain(self) -> Self:
        if self.lambda_inf > self.lambda_0:
            raise ValueError(
                f"lambda_inf is {self.lambda_inf:g} and lambda_0 {self.lambda_0:g}; "
                "the gain at large error must not be the larger one"
            )
        return self


class ProgressGains(Settings):
    """Gains of the law `noctule`: flight by progress."""

    cruise: float = Field(0.45, gt=0, le=2, description="speed along the path [m/s]")
    position: float = Field(1.6, gt=0, le=5, description="gain on the distance to the last image [1/s]")
    cross: float = Field(1.4, gt=0, le=10, description="gain on the distance from the path [1/s]")
    yaw: float = Field(1.5, gt=0, le=5, description="gain on the heading [1/s]")
    switch_ahead: float = Field(0.08, ge=0, le=1, description="an image is passed this far before it [m]")
    arrive_m: float = Field(0.012, gt=0, le=0.5, description="the last image is reached within this [m]")
    arrive_deg: float = Field(0.3, gt=0, le=20, description="and within this heading [deg]")
    arrive_hold_s: float = Field(0.4, ge=0, le=10, description="for this long [s]")


class DetourSettings(Settings):
    """Avoidance of the law `noctule`."""

    margin: float = Field(0.17, ge=0.02, le=1, description="free space to keep from a column [m]")
    reach: float = Field(1.2, gt=0, le=5, description="a column farther ahead than this does not matter [m]")
    fade_s: float = Field(0.4, gt=0, le=5, description="time over which the task fades in and out [s]")
    forget_s: float = Field(6.0, gt=0, le=60, description="a column out of sight is forgotten after this [s]")
    assumed_width: float = Field(0.08, gt=0, le=1, description="width of a column before it is measured [m]")


class PilotSettings(Settings):
    """Everything a pilot may be told in a mission file."""

    law: Literal["published", "noctule"] = Field("noctule", description="control law")
    published: PublishedGains = PublishedGains()
    progress: ProgressGains = ProgressGains()
    detour: DetourSettings = DetourSettings()
    features: Literal["sift", "orb"] = Field("sift", description="feature detector for matching")
    column_hue_deg: float | None = Field(
        None, ge=0, lt=360, description="hue of the columns to avoid [deg]; none: no columns are looked for"
    )
    body_radius: float = Field(0.2, gt=0, le=1, description="half the width of the vehicle [m]")
    vehicle_lag: float = Field(0.3, gt=0, le=2, description="response time of the vehicle [s]")
    picture_latency_s: float = Field(
        0.034, ge=0, le=2, description="known age of a picture when it arrives [s]"
    )
    command_latency_s: float = Field(
        0.0, ge=0, le=2, description="known time from a command to its effect, beside the lag [s]"
    )
    attitude_sd_deg: float = Field(
        0.0, ge=0, le=5, description="error of the attitude that comes with a picture [deg]; 0: stabilised"
    )
    min_points: int = Field(
        16, ge=8, le=200, description="fewer tracked points than this: stop and match again"
    )
    max_points: int = Field(60, ge=16, le=400, description="points tracked at the most")
    start: Literal["first", "nearest"] = Field(
        "first", description="begin with the first key image, or with the nearest one of all"
    )
    hover_at: tuple[int, ...] = Field(
        (), description="images to stop and hover at, counted from 0 in the order flown (law noctule)"
    )
    hover_s: float = Field(5.0, ge=0, le=600, description="for how long [s]")
    rematch_s: float = Field(0.7, gt=0, le=10, description="time between matches to the key image [s]")
    give_up_s: float = Field(6.0, gt=0, le=120, description="lost for this long: give up [s]")
    picture_max_age_s: float = Field(
        0.3, gt=0, le=5, description="pictures that are late by more than this are not flown on [s]"
    )

    @model_validator(mode="after")
    def _enough_points(self) -> Self:
        if self.max_points < self.min_points:
            raise ValueError(
                f"min_points is {self.min_points} and max_points {self.max_points}; "
                "at least min_points have to be tracked"
            )
        return self
