"""Sensors that agree without a centre: nodes, each a whole filter, and links that may fail them.

Every node keeps the full state. A node with a sensor linearises its measurement at its own estimate for the
measurement's time, adds the contribution (i, I) to its own filter and sends it to all others, who add it
where its stamp belongs: (36) to (44) of "Indoor low-cost localization system" as corrected in
`information_filter`. Contributions are shared, never estimates: an estimate holds what others already have.

Who gates: the node that measured, once, against all that it knows. What it lets in is shared and added by
everyone as it is, with the jump of a gate that had widened; what it refuses nobody hears of. A receiver
that gated again would drop what others keep, and the nodes would no longer agree even with every message
delivered. A node is trusted to be honest, not to be alive: late, doubled and missing messages do no harm.
Nor does a node that is broken: what no measurement can have made is refused wherever it turns up, and the
filters of all nodes leave out, by the same numbers, what would move them beyond all reason.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import itemgetter

import numpy as np
from pydantic import Field

from noctule.estimation.contributions import Contribution, ContributionError, check, contribution_of
from noctule.estimation.delayed import DEFAULTS, DelayedFilter, FilterSettings
from noctule.estimation.events import Input
from noctule.estimation.filter_state import FilterError, StateEstimate, start_at
from noctule.estimation.gating import Streak, judge
from noctule.estimation.measurements import Measurement
from noctule.estimation.vehicle_model import VehicleModel
from noctule.settings import Settings


class Node:
    """A filter with or without a sensor."""

    def __init__(
        self,
        name: str,
        start: StateEstimate,
        model: VehicleModel | None = None,
        settings: FilterSettings = DEFAULTS,
    ) -> None:
        self.name = name
        self.filter = DelayedFilter(start, model, settings)
        self.refusals: Counter[str] = Counter()  # by this node's own gates: "depth: yaw gate"
        self._since: Mapping[str, Streak] = {}

    def measure(self, measurement: Measurement, now: float | None = None) -> Contribution | None:
        """Use the node's own measurement and return what to share; None when there is nothing to.

        Nothing: it came too late or twice, the gates refuse it, or nobody would take it (see
        `contributions.check`). `now` [s] is the caller's time.
        """
        prior = self.filter.before(measurement)
        gate = self.filter.settings.gate
        kept: Measurement | None = measurement
        jump, since = None, self._since
        refused: tuple[str, ...] = ()
        if gate is not None:
            verdict = judge(prior.x, prior.P, measurement, since, gate)
            kept, jump = verdict.kept, verdict.jump
            refused, since = verdict.refused, verdict.since
        shared = contribution_of(prior.x, kept, jump) if kept is not None else None
        if shared is not None and not self.insert(shared, now):
            return None
        self._since = since
        if refused:
            self.refusals.update(f"{measurement.source}: {reason}" for reason in refused)
        return shared

    def insert(self, own: Contribution, now: float | None = None) -> bool:
        """Use a contribution of its own; return whether it was of use and can be shared."""
        try:
            check(own)
        except ContributionError:
            self.refusals[f"{own.source}: beyond what any sensor says"] += 1
            return False
        return self.filter.insert(own, now)

    def receive(self, message: Contribution | Input, now: float | None = None) -> bool:
        """Take what another node shared, or a command that was sent; return whether it was of use.

        Raises ContributionError for what no measurement can have made; nothing has changed then.
        """
        if isinstance(message, Contribution):
            check(message)
        return self.filter.insert(message, now)

    def estimate(self, stamp: float | None = None) -> StateEstimate:
        """Return what the node knows at `stamp` [s], by default at its newest event."""
        return self.filter.estimate(stamp)

    def rejoin(self, other: Node) -> None:
        """Begin again from what another node knows, ids included; for a node that was restarted."""
        own = self.filter
        self.filter = DelayedFilter.of_snapshot(other.filter.snapshot(), own.model, own.settings)
        self._since = {}


class LinkSettings(Settings):
    """What happens to messages on their way."""

    loss: float = Field(0.0, ge=0.0, le=1.0, description="share that never arrives")
    duplicates: float = Field(0.0, ge=0.0, le=1.0, description="share that arrives twice")
    delay: float = Field(0.0, ge=0.0, le=10.0, description="least time on the way [s]")
    jitter: float = Field(0.0, ge=0.0, le=10.0, description="mean of the exponential time on top of it [s]")


PERFECT = LinkSettings()


_COMMANDER = "commander"  # where commands come from; no node


class Link:
    """A way from one node to another that loses, delays and doubles; the same seed, the same fate."""

    def __init__(self, settings: LinkSettings, seed: np.random.SeedSequence) -> None:
        self._settings = settings
        self._perfect = settings == PERFECT
        self._rng = np.random.default_rng(seed)
        self.on_the_way: list[tuple[float, int, Contribution | Input]] = []  # a heap: when, which, what
        self._sent = 0

    def send(self, message: Contribution | Input, now: float) -> None:
        """Put a message on its way at `now` [s]."""
        if self._perfect:
            heapq.heappush(self.on_the_way, (now, self._sent, message))
            self._sent += 1
            return
        # Every message draws as many numbers, so that its fate does not hang on those before it.
        fate, again, *times = self._rng.random(4).tolist()
        copies = int(fate >= self._settings.loss) * (1 + int(again < self._settings.duplicates))
        for share in times[:copies]:
            late = self._settings.delay - self._settings.jitter * np.log1p(-share)
            heapq.heappush(self.on_the_way, (now + float(late), self._sent, message))
            self._sent += 1

    def due(self, now: float) -> list[tuple[float, Contribution | Input]]:
        """Return what has arrived by `now` [s] and when, in the order of arrival, and forget it."""
        arrived = []
        while self.on_the_way and self.on_the_way[0][0] <= now:
            at, _, message = heapq.heappop(self.on_the_way)
            arrived.append((at, message))
        return arrived


class Network:
    """Nodes in one process, every two joined by a link each way; deterministic."""

    def __init__(
        self, nodes: Sequence[Node], links: LinkSettings = PERFECT, seed: int | Sequence[int] = 0
    ) -> None:
        self.nodes = {node.name: node for node in nodes}
        if len(self.nodes) != len(nodes) or not nodes:
            raise FilterError(
                f"network of nodes {[node.name for node in nodes]}; expected at least one, each name once"
            )
        pairs = [(a, b) for b in self.nodes for a in self.nodes if a != b]
        seeds = np.random.SeedSequence(seed).spawn(len(pairs))
        self._to: dict[str, dict[str, Link]] = {name: {} for name in self.nodes}  # receiver -> sender -> link
        for (sender, receiver), s in zip(pairs, seeds, strict=True):
            self._to[receiver][sender] = Link(links, s)
        # Senders repeat commands until they are through, so none is lost; a frozen node hears them late too.
        for inward in self._to.values():
            inward[_COMMANDER] = Link(PERFECT, np.random.SeedSequence(0))

    def measure(self, name: str, measurement: Measurement, now: float) -> Contribution | None:
        """Hand a node its sensor's measurement at `now` [s]; what it shares goes on its way."""
        shared = self.nodes[name].measure(measurement, now)
        if shared is not None:
            for other, inward in self._to.items():
                if other != name:
                    inward[name].send(shared, now)
        return shared

    def command(self, sent: Input, now: float) -> None:
        """Tell every node at `now` [s] a command that was sent to the vehicle."""
        for inward in self._to.values():
            inward[_COMMANDER].send(sent, now)

    def deliver(self, now: float, frozen: frozenset[str] = frozenset()) -> None:
        """Hand out what has arrived by `now` [s], first come first; what is for `frozen` nodes waits."""
        for name, node in self.nodes.items():
            if name in frozen:
                continue
            busy = [link for link in self._to[name].values() if link.on_the_way]
            if not busy:
                continue
            arrived = [pair for link in busy for pair in link.due(now)]
            if len(busy) > 1:
                arrived.sort(key=itemgetter(0))
            for at, message in arrived:
                node.receive(message, at)


def warm_up(size: int = 11) -> None:
    """Compile, or load from its cache, all that a node of `size` numbers runs: seconds that no flight has."""
    start = start_at(0.0, np.zeros(3), 0.0, size=size)
    nodes = [Node(name, start, VehicleModel.velocity_loop(0.3)) for name in ("a", "b")]
    network = Network(nodes)
    network.command(Input(0.0, np.zeros(4)), 0.0)
    network.deliver(0.0)
    for k, components in enumerate(([0, 1, 2, 3], [4, 5, 6, 2, 7], [3])):
        m = len(components)
        z = Measurement(0.1 * (k + 1), np.array(components, dtype=np.int64), np.zeros(m), np.eye(m), "a", k)
        network.measure("a", z, z.stamp)
        network.deliver(z.stamp)
        nodes[1].filter.insert(replace(z, source="raw"))
    nodes[1].estimate(1.0)
