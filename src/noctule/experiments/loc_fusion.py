"""`loc-fusion`: 6.3 of the paper on localization, how true every sensor is and how true all of them together.

The vehicle is flown by hand (`hand_flight`) below the ceiling camera: depth at 30 Hz, 40 ms late; navdata
irregular, late and lossy; colour markers in every fifth frame, as the paper's ground truth or as a third
node, never both. What the network fuses is handed to the locator as its prediction. The vehicle was
identified, and its reports calibrated, in flights before; "uncalibrated" is the same network without the
latter. As the camera alone knows the heading well, two more networks lose it for 5 of every 20 s: there one
sees what the calibration is worth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from noctule.estimation.identification import identify
from noctule.estimation.reports import Reports
from noctule.estimation.sensor_calibration import calibrate_onboard
from noctule.estimation.sensors import Sensors
from noctule.estimation.vehicle_model import VehicleModel
from noctule.experiments.ceiling import RATE, TaughtCamera, teach_camera
from noctule.experiments.hand_flight import GUSTS, SECONDS, HandFlight, fly_by_hand
from noctule.experiments.judging import Errors, judge_estimate, judge_heading, judge_pose, judge_report
from noctule.experiments.loc_identification import axis_flights, axis_inputs, fly_inputs
from noctule.flight.depth_scene import passer_by
from noctule.flight.sensor_recording import SensorRecorder
from noctule.geometry import Array, wrap_angle
from noctule.localization.fusion import Fusion
from noctule.localization.heading.markers import MarkerHeading
from noctule.localization.heading.near import heading_near
from noctule.localization.locator import Located
from noctule.messages import DepthFrame, HeadingMeasurement, PoseMeasurement, Truth, VehicleState
from noctule.settings import Settings

LATE = 0.04  # [s], from exposure to delivery
SETTLED = 2.0  # [s], that the network has before it is judged
NOISE = 0.06  # [m/s, rad/s], of the velocities that the vehicle is identified from
_COLOUR_EVERY = 5  # frames
_TICK = 1.0 / 30.0  # [s], at which the fusion is judged, as a pilot would ask it
_OUTAGE, _OUTAGE_EVERY = 5.0, 20.0  # [s], for which the camera is lost, at the end of every so many
CALIBRATING, JUDGED = 0, 1
"""The flights of a seed."""

Role = Literal["truth", "node"]
Progress = Callable[[int], None]


class FusionOptions(Settings):
    """What `loc-fusion` may be asked."""

    hull: bool = Field(False, description="the drone wears its indoor hull")
    person: bool = Field(False, description="somebody walks by, at 0.6 m from the path")
    markers: Role = Field("truth", description="what the markers' heading is: judged against, or fused")
    seconds: float = Field(SECONDS, ge=40.0, le=600.0, description="of each flight [s]")

    @property
    def frames(self) -> int:
        """How many frames the camera delivers in a flight."""
        return int((self.seconds - LATE) * RATE + 1e-9) + 1


@dataclass(frozen=True, slots=True)
class Exposure:
    """A depth frame, by its number and the time at which it was exposed."""

    number: int
    stamp: float  # [s]


Happening = tuple[float, Array | VehicleState | Exposure | None]
"""When [s], and what: a command is sent, a report or a frame arrives; None: the fusion is judged."""


@dataclass(slots=True)
class Sensed:
    """What was measured in a flight, and what all were off by."""

    sources: dict[str, Errors] = field(default_factory=dict)
    without_camera: dict[str, Errors] = field(default_factory=dict)
    located: list[Located] = field(default_factory=list)
    headings: list[HeadingMeasurement] = field(default_factory=list)
    against_markers: list[float] = field(default_factory=list)  # [rad], fused less markers
    turned: int = 0  # frames whose half turn the fusion held to be the other one
    mended: int = 0  # times that the fusion found its own half turn wrong
    refusals: dict[str, int] = field(default_factory=dict)

    @property
    def poses(self) -> list[PoseMeasurement]:
        """Where the depth camera saw the vehicle, its half turn as the fusion chose it."""
        return [one.measurement for one in self.located if one.measurement is not None]


def measure_fusion(seed: int, options: FusionOptions, progress: Progress = lambda _: None) -> dict[str, Any]:
    """Return the figures of one seed, a mapping for every source."""
    return figures_of(_sensed(seed, options, progress)[1])


def keep_fusion(seed: int, options: FusionOptions, folder: Path) -> Path:
    """Leave what all sensors measured in a seed's flight, and the truth, in sensors.mcap; return it."""
    flight, sensed = _sensed(seed, options, lambda _: None)
    file = folder / "sensors.mcap"
    with SensorRecorder(file) as recorder:
        for state in (state for _, state in flight.reports):
            recorder.state(state)
        for one in sensed.located:
            recorder.located(one.stamp, one.measurement, one.reason)
        for heading in sensed.headings:
            recorder.heading(heading)
        for row, stamp in zip(flight.truth[::10], flight.stamps[::10], strict=True):
            recorder.truth(Truth(float(stamp), flight.pose(float(stamp)), row[4:7], float("nan")))
    return file


def _sensed(seed: int, options: FusionOptions, progress: Progress) -> tuple[HandFlight, Sensed]:
    taught = teach_camera(seed, options.hull, markers=True)
    sensors = calibrated(fly_by_hand(seed, CALIBRATING, options.seconds))
    flight = fly_by_hand(seed, JUDGED, options.seconds)
    return flight, sense(taught, flight, identified(seed), sensors, options, progress)


def identified(seed: int) -> VehicleModel:
    """Return the vehicle's model, its inputs normalised, from a flight of each axis alone in gusts."""
    return identify(axis_flights(fly_inputs(seed, axis_inputs(), NOISE, gusts=GUSTS))).model()


def calibrated(flight: HandFlight) -> Sensors:
    """Return the calibration of the vehicle's reports, from a flight with ground truth."""
    onboard, _ = calibrate_onboard(Reports.of_states([s for _, s in flight.reports]), flight.reference())
    return Sensors(onboard=onboard)


def sense(
    taught: TaughtCamera,
    flight: HandFlight,
    model: VehicleModel,
    sensors: Sensors,
    options: FusionOptions,
    progress: Progress = lambda _: None,
) -> Sensed:
    """Let the camera see a flight and the network fuse it by a model; judge every source by the truth."""
    nodes = ("onboard", "depth", "markers") if options.markers == "node" else ("onboard", "depth")
    known, unknown = Sensors(onboard=sensors.onboard), Sensors()
    seeing = {"fused": Fusion(nodes, model, known), "fused_uncalibrated": Fusion(nodes, model, unknown)}
    blind = {"calibrated": Fusion(nodes, model, known), "uncalibrated": Fusion(nodes, model, unknown)}
    fusions, fused = (*seeing.values(), *blind.values()), seeing["fused"]
    camera = _Watching(taught, flight, options.person)
    found = Sensed(
        {name: Errors() for name in ("onboard", "depth", "markers", *seeing)},
        {name: Errors() for name in blind},
    )
    judged_from = np.inf
    for now, what in happenings(flight):
        lost = now % _OUTAGE_EVERY >= _OUTAGE_EVERY - _OUTAGE
        if isinstance(what, np.ndarray):
            for fusion in fusions:
                fusion.command(now, what)
        elif isinstance(what, VehicleState):
            judge_report(found.sources["onboard"], flight.at(what.stamp), what)
            for fusion in fusions:
                fusion.report(what, now)
        elif what is None:
            if now < judged_from:
                continue
            true = flight.at(now)
            judged = [(found.sources[name], fusion) for name, fusion in seeing.items()]
            if lost:
                judged += [(found.without_camera[name], fusion) for name, fusion in blind.items()]
            for errors, fusion in judged:
                if fusion.begun:  # one that mends its half turn begins anew
                    judge_estimate(errors, true, fusion.estimate(now))
        else:
            told = tuple(seeing.values()) if lost else fusions
            located, heading = camera.look(what, fused)
            if located.measurement is None:
                found.located.append(located)
            else:
                pose = fused.faced(located.measurement)
                found.located.append(replace(located, measurement=pose))
                found.turned += abs(wrap_angle(pose.yaw - located.measurement.yaw)) > 1.0
                judge_pose(found.sources["depth"], flight.at(what.stamp), pose)
                for fusion in told:
                    fusion.pose(located.measurement, located.heading_certain, now)
                if fused.begun:
                    judged_from = min(judged_from, now + SETTLED)
            if heading is not None:
                found.headings.append(heading)
                judge_heading(found.sources["markers"], flight.at(what.stamp), heading)
                if options.markers == "node":
                    for fusion in told:
                        fusion.heading(heading, now)
                elif now > judged_from and fused.begun:
                    found.against_markers.append(wrap_angle(fused.estimate(what.stamp).yaw - heading.yaw))
            progress(what.number + 1)
    found.refusals, found.mended = fused.refusals, fused.turns
    return found


class _Watching:
    """The depth camera, its locator and the search for markers."""

    def __init__(self, taught: TaughtCamera, flight: HandFlight, person: bool) -> None:
        self._taught, self._flight = taught, flight
        self._people = [passer_by()] if person else []
        self._locator, self._markers = taught.locator(), MarkerHeading()

    def look(self, at: Exposure, fused: Fusion) -> tuple[Located, HeadingMeasurement | None]:
        """Draw a frame and return what it says of the drone, looked for where `fused` expects it."""
        things = [person.at(at.stamp) for person in self._people]
        coloured = at.number % _COLOUR_EVERY == 0
        # The sensor's errors are drawn by the stamp: those of this flight are not the lessons'.
        stamp = self._taught.stamp + at.stamp
        drawn = self._taught.stage.frame(stamp, self._flight.pose(at.stamp), things, coloured)
        frame = DepthFrame(at.stamp, drawn.depth, drawn.colour)
        located = self._locator.step(frame, fused.prediction(at.stamp))
        seen = located.measurement
        if seen is None or not coloured:
            return located, None
        room = self._taught
        return located, heading_near(self._markers, frame, seen.position, room.background, room.camera)


def happenings(flight: HandFlight) -> Iterator[Happening]:
    """Yield what happens in a flight in the order of time; at the same time commands come first."""
    end = float(flight.stamps[-1])
    stamps = [k / RATE for k in range(int((end - LATE) * RATE + 1e-9) + 1)]
    frames: list[Happening] = [(stamp + LATE, Exposure(k, stamp)) for k, stamp in enumerate(stamps)]
    # Between two frames, so that it counts how old the newest is.
    ticks: list[Happening] = [((k + 0.5) * _TICK, None) for k in range(int(end / _TICK - 0.5))]
    together: list[Happening] = [*flight.commands, *flight.reports, *frames, *ticks]
    yield from sorted(together, key=lambda happening: happening[0])


def figures_of(sensed: Sensed) -> dict[str, Any]:
    """Return the figures as JSON has them."""
    figures: dict[str, Any] = {
        "located_share": len(sensed.poses) / max(len(sensed.located), 1),
        "slips": sum(one.slipped for one in sensed.located),
        "half_turn_wrong_share": sensed.turned / max(len(sensed.poses), 1),
        "half_turns_mended": sensed.mended,
        "refused": sum(sensed.refusals.values()),
        **{name: errors.figures() for name, errors in sensed.sources.items()},
        "without_camera": {name: errors.figures() for name, errors in sensed.without_camera.items()},
    }
    if sensed.against_markers:
        off = np.degrees(np.array(sensed.against_markers))
        figures["fused_less_markers"] = {
            "yaw_mean_deg": float(off.mean()),
            "yaw_sd_deg": float(off.std()),
        }
    return figures
