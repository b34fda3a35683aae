"""What the figures of a flight are worked out from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from noctule.flight.reader import Tick
from noctule.messages import Command, Truth, Whereabouts


@dataclass(slots=True)
class Samples:
    """What the figures of a flight are worked out from; filled while it lasts, or from its recording."""

    times: list[float] = field(default_factory=list)  # [s], the ticks at which the pilot was asked
    tick_ms: list[float] = field(default_factory=list)  # [ms], the same ticks
    epsilons: list[float] = field(default_factory=list)  # [px], the same ticks
    targets: list[int] = field(default_factory=list)  # index of the image flown to, the same ticks
    truths: list[Truth] = field(default_factory=list)  # the same ticks, empty without a referee
    whereabouts: list[Whereabouts | None] = field(default_factory=list)  # the same ticks
    phases: list[str] = field(default_factory=list)  # the same ticks
    sent: list[Command] = field(default_factory=list)  # all ticks, the braking at the end included


def samples_of(ticks: Sequence[Tick]) -> Samples:
    """Return the samples of recorded ticks."""
    samples = Samples()
    for tick in ticks:
        samples.sent.append(tick.sent)
        if tick.decision is not None:
            samples.times.append(tick.stamp)
            samples.tick_ms.append(tick.tick_ms)
            samples.epsilons.append(tick.decision.diagnostics.epsilon_px)
            samples.targets.append(tick.decision.diagnostics.target_index)
            samples.whereabouts.append(tick.decision.whereabouts)
            samples.phases.append(tick.decision.phase)
            if tick.truth is not None:
                samples.truths.append(tick.truth)
    return samples
