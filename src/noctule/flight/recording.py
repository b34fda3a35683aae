"""Writes a flight to an MCAP file: what the pilot was told and answered, what was sent, and the truth."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from foxglove.channels import CompressedImageChannel
from foxglove.mcap import MCAPCompression
from foxglove.messages import CompressedImage

from noctule.flight import codec
from noctule.flight.depth_image import DepthChannels, drawn_at, pb
from noctule.flight.mcap_recorder import McapRecorder, RecordingError
from noctule.flight.recording_pictures import encode_picture
from noctule.messages import Command, Decision, DepthFrame, MatchResult, Picture, Truth, VehicleState

__all__ = ["FORMAT", "FlightRecorder", "McapRecorder", "RecordingError", "encode_picture", "sent_message"]

FORMAT = "noctule-flight-1"


class FlightRecorder(McapRecorder):
    """Writes one flight to one file; raises as `McapRecorder` does.

    With `depth` every depth frame is kept whole, 4 to 6 MB for a second of flight; else only its stamp.
    """

    def __init__(
        self, path: Path, *, lossless: bool = False, jpeg_quality: int = 80, depth: bool = False
    ) -> None:
        super().__init__(path, FORMAT, MCAPCompression.Zstd if depth else None)
        self._lossless, self._jpeg_quality = lossless, jpeg_quality
        self._camera = CompressedImageChannel("/camera", context=self._context)
        self._channels = {
            name: self._channel(getattr(codec.pb, name))
            for name in ("Observation", "Decision", "Sent", "Truth")
        }
        self._depth: DepthChannels | None = None
        if depth:
            exposure = self._channel(pb.Exposure)
            self._depth = DepthChannels(self._context, exposure, lossless, jpeg_quality)

    def _log(self, name: str, message: Any, time_ns: int) -> None:
        data = message.SerializeToString(deterministic=True)
        self._jobs.put(lambda: self._channels[name].log(data, log_time=time_ns))

    def _log_picture(self, picture: Picture, time_ns: int) -> None:
        data = encode_picture(picture, self._lossless, self._jpeg_quality)
        message = CompressedImage(
            timestamp=drawn_at(picture.stamp)[1],  # for viewers; the exact stamp is in the observation
            frame_id="camera",
            data=data,
            format="png" if self._lossless else "jpeg",
        )
        self._camera.log(message, log_time=time_ns)

    def tick(
        self,
        stamp: float,
        state: VehicleState,
        picture: Picture | None,
        matches: tuple[MatchResult, ...],
        truth: Truth | None,
        sent: Any,
        decision: Decision | None = None,
        tick_ms: float = 0.0,
        depth: DepthFrame | None = None,
        sent_before: Command | None = None,
    ) -> None:
        """Write one tick of the loop; without `decision` the pilot was not asked.

        `sent` is a pb.Sent, see `sent_message`; `depth` and `sent_before` are the observation's `depth` and
        `sent`. Pictures and frames must not change after they are handed in.
        """
        self._check()
        time_ns = round(stamp * 1e9)
        if picture is not None:
            self._jobs.put(lambda: self._log_picture(picture, time_ns))
        if depth is not None and self._depth is not None:
            self._jobs.put(partial(self._depth.log, depth, time_ns))
        exposed = None if depth is None else depth.stamp
        told = codec.encode_observation(stamp, state, picture, matches, exposed, sent_before)
        self._log("Observation", told, time_ns)
        if decision is not None:
            self._log("Decision", codec.encode_decision(stamp, decision, tick_ms), time_ns)
        if truth is not None:
            self._log("Truth", codec.encode_truth(truth), time_ns)
        # Always the last of its tick: the reader takes a tick without it for cut short.
        self._log("Sent", sent, time_ns)
        self._flush_each_second(stamp)


def sent_message(
    stamp: float, asked: Command, sent: Command, supervisor_state: str, action: str, reason: str
) -> Any:
    """Return pb.Sent: what was asked, what was sent, and why they differ."""
    return codec.pb.Sent(
        stamp=stamp,
        asked=codec.encode_command(asked),
        sent=codec.encode_command(sent),
        supervisor_state=supervisor_state,
        action=action,
        reason=reason,
    )
