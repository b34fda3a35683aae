"""What travels between rooms, to and from the protobuf messages of a recording, without loss."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from noctule.flight.proto import flight_pb2
from noctule.geometry import Array, Pose
from noctule.messages import (
    ColumnBox,
    Command,
    Decision,
    Diagnostics,
    Doubt,
    FlightState,
    MatchRequest,
    MatchResult,
    Outcome,
    Picture,
    PoseMeasurement,
    Truth,
    VehicleState,
    Whereabouts,
)

pb: Any = flight_pb2  # its classes are made when it is imported, no type checker sees them

_OPTIONAL = ("roll", "pitch", "yaw", "height", "battery", "link_quality")


@cache
def schema(name: str) -> bytes:
    """Return the serialised FileDescriptorSet that describes message `name` of noctule.flight."""
    if name not in pb.DESCRIPTOR.message_types_by_name:
        raise KeyError(name)
    return file_schema(pb.DESCRIPTOR)


def file_schema(descriptor: Any) -> bytes:
    """Return the serialised FileDescriptorSet of a .proto file that imports no other."""
    files = FileDescriptorSet()
    descriptor.CopyToProto(files.file.add())
    return bytes(files.SerializeToString(deterministic=True))


def _flat(rows: Array) -> list[float]:
    values: list[float] = np.asarray(rows, dtype=np.float64).ravel().tolist()
    return values


def _rows(values: Any) -> Array:
    return np.array(values, dtype=np.float64).reshape(-1, 2)


def encode_command(command: Command) -> Any:
    """Return pb.Command."""
    return pb.Command(forward=command.forward, left=command.left, up=command.up, yaw_rate=command.yaw_rate)


def decode_command(message: Any) -> Command:
    """Return what `encode_command` was given."""
    return Command(message.forward, message.left, message.up, message.yaw_rate)


def encode_observation(
    stamp: float,
    state: VehicleState,
    picture: Picture | None,
    matches: tuple[MatchResult, ...],
    depth_stamp: float | None = None,
    sent: Command | None = None,
) -> Any:
    """Return pb.Observation; pixels and depth travel on their own."""
    given = {name: getattr(state, name) for name in _OPTIONAL if getattr(state, name) is not None}
    return pb.Observation(
        stamp=stamp,
        state=pb.VehicleState(
            stamp=state.stamp,
            flight_state=str(state.flight_state),
            v_body=None if state.v_body is None else _flat(state.v_body),
            **given,
        ),
        picture_stamp=None if picture is None else picture.stamp,
        matches=[
            pb.MatchResult(
                stamp=m.stamp,
                key_index=m.key_index,
                p_ref=_flat(m.p_ref),
                p_current=_flat(m.p_current),
                reason=m.reason,
            )
            for m in matches
        ],
        depth_stamp=depth_stamp,
        sent=None if sent is None else encode_command(sent),
    )


def decode_state(message: Any) -> VehicleState:
    """Return the VehicleState that `encode_observation` was given."""
    given = {name: getattr(message, name) for name in _OPTIONAL if message.HasField(name)}
    v_body = np.array(message.v_body, dtype=np.float64) if message.v_body else None
    return VehicleState(message.stamp, FlightState(message.flight_state), v_body=v_body, **given)


def decode_matches(message: Any) -> tuple[MatchResult, ...]:
    """Return the match results of a pb.Observation."""
    return tuple(
        MatchResult(m.stamp, m.key_index, _rows(m.p_ref), _rows(m.p_current), m.reason)
        for m in message.matches
    )


def encode_decision(stamp: float, decision: Decision, tick_ms: float) -> Any:
    """Return pb.Decision."""
    d = decision.diagnostics
    return pb.Decision(
        stamp=stamp,
        command=encode_command(decision.command),
        phase=decision.phase,
        diagnostics=pb.Diagnostics(
            target_index=d.target_index,
            epsilon_px=d.epsilon_px,
            error=_flat(d.error),
            translation=_flat(d.translation),
            yaw_error=d.yaw_error,
            activations={name: float(h) for name, h in d.activations.items()},
            points_current=_flat(d.points_current),
            points_ref=_flat(d.points_ref),
            columns=[
                pb.ColumnBox(
                    left=c.left, top=c.top, right=c.right, bottom=c.bottom, p1=_flat(c.p1), p2=_flat(c.p2)
                )
                for c in d.columns
            ],
            task_errors={name: float(e) for name, e in d.task_errors.items()},
        ),
        requests=[r.key_index for r in decision.requests],
        outcome="" if decision.outcome is None else str(decision.outcome),
        reason=decision.reason,
        tick_ms=tick_ms,
        whereabouts=None if decision.whereabouts is None else encode_whereabouts(decision.whereabouts),
    )


def decode_decision(message: Any) -> Decision:
    """Return the Decision that `encode_decision` was given."""
    d = message.diagnostics
    columns = tuple(
        ColumnBox(c.left, c.top, c.right, c.bottom, np.array(c.p1), np.array(c.p2)) for c in d.columns
    )
    diagnostics = Diagnostics(
        target_index=d.target_index,
        epsilon_px=d.epsilon_px,
        error=np.array(d.error, dtype=np.float64),
        translation=np.array(d.translation, dtype=np.float64),
        yaw_error=d.yaw_error,
        activations=dict(sorted(d.activations.items())),
        points_current=_rows(d.points_current),
        points_ref=_rows(d.points_ref),
        columns=columns,
        task_errors=dict(sorted(d.task_errors.items())),
    )
    return Decision(
        decode_command(message.command),
        message.phase,
        diagnostics,
        tuple(MatchRequest(k) for k in message.requests),
        Outcome(message.outcome) if message.outcome else None,
        message.reason,
        _decode_whereabouts(message.whereabouts) if message.HasField("whereabouts") else None,
    )


def encode_whereabouts(known: Whereabouts) -> Any:
    """Return pb.Whereabouts."""
    m = known.measured
    return pb.Whereabouts(
        stamp=known.stamp,
        position=_flat(known.position),
        yaw=known.yaw,
        velocity=_flat(known.velocity),
        position_sd=known.position_sd,
        yaw_sd=known.yaw_sd,
        wanted=_flat(known.wanted),
        path_time=known.path_time,
        s=known.s,
        holding=known.holding,
        doubt=str(known.doubt),
        doubt_reason=known.doubt_reason,
        measured=None
        if m is None
        else pb.PoseMeasurement(
            stamp=m.stamp,
            position=_flat(m.position),
            yaw=m.yaw,
            covariance=_flat(m.covariance),
            source=m.source,
        ),
        unseen_reason=known.unseen_reason,
    )


def _decode_whereabouts(message: Any) -> Whereabouts:
    m = message.measured
    return Whereabouts(
        stamp=message.stamp,
        position=np.array(message.position, dtype=np.float64),
        yaw=message.yaw,
        velocity=np.array(message.velocity, dtype=np.float64),
        position_sd=message.position_sd,
        yaw_sd=message.yaw_sd,
        wanted=np.array(message.wanted, dtype=np.float64),
        path_time=message.path_time,
        s=message.s,
        holding=message.holding,
        doubt=Doubt(message.doubt),
        doubt_reason=message.doubt_reason,
        measured=PoseMeasurement(
            m.stamp, np.array(m.position), m.yaw, np.array(m.covariance).reshape(4, 4), m.source
        )
        if message.HasField("measured")
        else None,
        unseen_reason=message.unseen_reason,
    )


def encode_truth(truth: Truth) -> Any:
    """Return pb.Truth."""
    return pb.Truth(
        stamp=truth.stamp,
        position=_flat(truth.pose.position),
        yaw=truth.pose.yaw,
        roll=truth.pose.roll,
        pitch=truth.pose.pitch,
        v_world=_flat(truth.v_world),
        clearance=truth.clearance,
        contacts=list(truth.contacts),
    )


def decode_truth(message: Any) -> Truth:
    """Return the Truth that `encode_truth` was given."""
    pose = Pose(np.array(message.position, dtype=np.float64), message.yaw, message.roll, message.pitch)
    v_world = np.array(message.v_world, dtype=np.float64)
    return Truth(message.stamp, pose, v_world, message.clearance, tuple(message.contacts))


def encode_pose(pose: Pose) -> str:
    """Return a pose as JSON, for the recording's notes."""
    return json.dumps([*_flat(pose.position), pose.yaw, pose.roll, pose.pitch])


def decode_pose(text: str) -> Pose:
    """Return the pose that `encode_pose` was given."""
    x, y, z, yaw, roll, pitch = json.loads(text)
    return Pose(np.array([x, y, z], dtype=np.float64), yaw, roll, pitch)
