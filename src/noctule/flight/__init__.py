"""The flight: the loop that owns time and safety, the mission file, path folders, the recording."""

from noctule.flight.flown import Aborted, Flown
from noctule.flight.loop import LoopSettings, fly
from noctule.flight.mission import (
    Mission,
    MissionFileError,
    UnknownMissionError,
    bundled_missions,
    load_mission,
    parse_mission,
)
from noctule.flight.mission_flight import FlightResult, fly_mission
from noctule.flight.orders import Orders
from noctule.flight.path_folder import load_path, load_truth, save_path
from noctule.flight.reader import Recording, RecordingFileError, read_recording
from noctule.flight.recording import FlightRecorder, RecordingError
from noctule.flight.rig import Rig
from noctule.flight.summary import pool, summary_of
from noctule.flight.teach import teach

__all__ = [
    "Aborted",
    "FlightRecorder",
    "FlightResult",
    "Flown",
    "LoopSettings",
    "Mission",
    "MissionFileError",
    "Orders",
    "Recording",
    "RecordingError",
    "RecordingFileError",
    "Rig",
    "UnknownMissionError",
    "bundled_missions",
    "fly",
    "fly_mission",
    "load_mission",
    "load_path",
    "load_truth",
    "parse_mission",
    "pool",
    "read_recording",
    "save_path",
    "summary_of",
    "teach",
]
