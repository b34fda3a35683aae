"""The visual pilot: one target image or a path of them, whatever the law.

Phases: `matching` (hover until the first image is recognised, or every image was looked for to find the
nearest), `flying`, `searching` (the image was lost: hover, look for all key images, go on with the nearest
along the path, or give up with a reason), `done`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from noctule.control.limiter import limit_command
from noctule.estimation.odometry import Odometry
from noctule.geometry import Array
from noctule.messages import (
    ColumnBox,
    Command,
    Decision,
    Diagnostics,
    Limits,
    Observation,
    Outcome,
)
from noctule.pilots.law import Answer, Law, Scene
from noctule.pilots.perception import Perception
from noctule.pilots.relocation import Sweep, distinct, nearest_in_order, outward
from noctule.pilots.settings import PilotSettings
from noctule.vision.columns import ColumnColour, detect_columns


@dataclass(slots=True)
class VisualPilot:
    """Joins perception and a law into a deterministic state machine."""

    settings: PilotSettings
    limits: Limits
    perception: Perception
    law: Law
    tick: float  # [s], expected time between ticks, for the first one
    phase: str = "matching"
    odometry: Odometry = field(init=False)
    _command: Array = field(default_factory=lambda: np.zeros(4))
    _last: float | None = None  # [s], stamp of the last tick
    _lost_since: float | None = None
    _sweep: Sweep | None = field(init=False)
    _boxes: tuple[ColumnBox, ...] = ()

    def __post_init__(self) -> None:
        """Expect the vehicle to answer as the settings say."""
        self.odometry = Odometry(self.settings.vehicle_lag)
        nearest = self.settings.start == "nearest"
        self._sweep = Sweep(distinct(self.perception.path)) if nearest else None

    def step(self, observation: Observation) -> Decision:
        """Answer one observation."""
        dt = self.tick if self._last is None else observation.stamp - self._last
        scene = self._look(observation, dt)
        self._last = observation.stamp
        if self.phase == "done":
            return self._hover(scene, None)
        if self._sweep is not None:
            return self._find_start(scene, self._sweep)
        oldest = self.settings.picture_max_age_s + self.settings.picture_latency_s
        blind = observation.stamp - self.perception.picture_stamp > oldest
        answer = None
        if blind:
            self.law.pause(scene)
        else:
            answer = self.law.step(scene)
        if answer is None:
            return self._search(scene, blind)
        self._lost_since, self.phase = None, "flying"
        if self.law.arrived:
            self.phase = "done"
            return self._hover(scene, answer, Outcome.REACHED, "the last image is reached")
        self._command = answer.command
        return self._decision(scene, answer, answer.command)

    def _find_start(self, scene: Scene, sweep: Sweep) -> Decision:
        """Hover until every image was looked for, then begin with the nearest."""
        sweep.note(scene.views)
        self.law.pause(scene)
        left = sweep.left(set(self.perception.reasons))
        if left:
            return self._hover(scene, None, search=left)
        nearest = sweep.nearest()
        if nearest is not None:
            self.law.jump(nearest)
        self._sweep = None
        return self._hover(scene, None)

    def _look(self, observation: Observation, dt: float) -> Scene:
        state = observation.state
        attitude = (state.roll or 0.0, state.pitch or 0.0)
        pose = self.odometry.step(observation.stamp, self._command, state.v_body, state.yaw, attitude)
        target = self.law.target
        most = self.settings.max_points
        # The next image is only to be known in time; once it is the target it gets its full share.
        few = max(most // 2, self.settings.min_points)
        wanted = {target: most, target + 1: few}
        if self._lost_since is not None or self._sweep is not None:
            wanted = dict.fromkeys(range(len(self.perception.path.images)), few) | {target: most}
        views = self.perception.step(observation, self.odometry, wanted)
        columns = None
        if observation.picture is not None and self.settings.column_hue_deg is not None:
            colour = ColumnColour(hue=self.settings.column_hue_deg)
            columns = self._boxes = detect_columns(observation.picture.pixels, colour)
        exposed = None if observation.picture is None else self.odometry.at(observation.picture.stamp)
        return Scene(observation.stamp, dt, pose, self._command, views, columns, exposed)

    def _search(self, scene: Scene, blind: bool) -> Decision:
        """Hover and match again; give up after a while, with the reason."""
        if self._lost_since is None:
            self._lost_since = scene.stamp
        if self.phase == "flying":
            self.phase = "searching"
        waited = scene.stamp - self._lost_since
        if waited > self.settings.give_up_s:
            self.phase = "done"
            return self._hover(scene, None, Outcome.LOST, self._why(blind))
        if self.phase == "searching":
            found = nearest_in_order(scene.views, self.law.target)
            if found is not None and found != self.law.target:
                self.law.jump(found)
        # Before the first recognition only the beginning of the path is looked for.
        n = len(self.perception.path.images) if self.phase == "searching" else 1
        return self._hover(scene, None, search=outward(self.law.target, max(n, self.law.target + 1)))

    def _why(self, blind: bool) -> str:
        target = self.law.target
        name = self.perception.path.images[target].name
        if blind:
            return (
                f"no picture for {self.settings.give_up_s:g} s, one is expected every "
                f"{self.settings.picture_max_age_s:g} s at least; is the video stream running?"
            )
        found = self.perception.reasons.get(target, "")
        tracked = len(self.perception.tracks[target]) if target in self.perception.tracks else 0
        few = f"of {tracked} tracked points fewer than {self.settings.min_points} agree on one geometry"
        return (
            f"key image '{name}' was not found again within {self.settings.give_up_s:g} s: "
            f"{found or few}; start nearer to it or teach the path again"
        )

    def _hover(
        self,
        scene: Scene,
        answer: Answer | None,
        outcome: Outcome | None = None,
        reason: str = "",
        search: Sequence[int] = (),
    ) -> Decision:
        """Brake to a hover within the acceleration limit."""
        self._command = limit_command(np.zeros(4), self._command, self.limits, scene.dt)
        return self._decision(scene, answer or Answer(self._command), self._command, outcome, reason, search)

    def _decision(
        self,
        scene: Scene,
        answer: Answer,
        command: Array,
        outcome: Outcome | None = None,
        reason: str = "",
        search: Sequence[int] = (),
    ) -> Decision:
        target = self.law.target
        following = target + 1 if target + 1 < len(self.perception.path.images) else None
        requests = []
        if self.phase != "done":
            look = following if self.law.wants_next else None
            requests = self.perception.requests(scene.stamp, target, look, search)
        view = scene.views.get(target)
        diagnostics = Diagnostics(target_index=target, activations=answer.activations, columns=self._boxes)
        if view is not None:
            e = view.estimate
            diagnostics = Diagnostics(
                target,
                view.epsilon_px if isfinite(view.epsilon_px) else float("nan"),
                answer.error,
                e.t,
                e.yaw,
                answer.activations,
                view.p_current,
                view.p_ref,
                self._boxes,
                answer.task_errors,
            )
        return Decision(
            Command.from_array(command), self.phase, diagnostics, tuple(requests), outcome, reason
        )
