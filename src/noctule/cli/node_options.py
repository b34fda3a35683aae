"""Options that all nodes of the network share, and the node that they make."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from noctule.errors import NoctuleError

if TYPE_CHECKING:
    from noctule.flight.network.drill import Drill
    from noctule.flight.network.endpoints import Endpoints
    from noctule.flight.network.member import Member
    from noctule.flight.network.pacing import Schedule
    from noctule.flight.network.senses import Senses

Addresses = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]
_POSITION_SD, _YAW_SD = 2.0, 2.0  # [m], [rad], at first: anywhere in a room, turned anyhow
_START = (0.0, 0.0, 1.0)  # [m]
_DAY = 86_400.0  # [s]


class NodeOptionsError(NoctuleError):
    """Options of a node that do not go together."""


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class NodeOptions:
    """Where a node listens, whom it connects to, and how it predicts.

    Attributes
    ----------
    name
        What the others call it, when two nodes have the same task. Left out, its task.
    listen
        HOST:PORT to listen at; may be repeated. Left out, a port of this machine that belongs to its task.
    connect
        HOST:PORT of every other node; repeat it. Left out, the ports of all tasks on this machine.
    site
        The folder of the site. Its sensors.toml (see `noctule calibrate sensors`) says what is wrong with the
        sensors; the same for all nodes.
    vehicle
        The identified model of the vehicle (vehicle.toml), the same for all nodes. Left out, none.
    begin
        When the recording, the simulation or the drill begins: seconds as `date +%s` prints them, the same
        for all nodes, at most a day ahead. Left out, now.
    from_
        The stamp of the recording [s] that is played at that time. Left out, its first.
    drill
        Try the network without a drone: the made-up flight of this seed. Each node measures its part of it,
        and tells at the end whether it knew its errors.
    drill_seconds
        How long the made-up flight is, the same for all nodes.
    """

    name: str | None = None
    listen: Addresses = ()
    connect: Addresses = ()
    site: Path | None = None
    vehicle: Path | None = None
    begin: float | None = None
    from_: Annotated[float | None, Parameter(name="--from")] = None
    drill: int | None = None
    drill_seconds: float = 30.0


NODE = NodeOptions()


@dataclass(frozen=True, slots=True)
class Prepared:
    """A node that is about to begin."""

    name: str
    role: str
    member: Member
    senses: Senses
    endpoints: Endpoints
    begin: float  # [s], shared clock
    given: float | None  # [s], the beginning that was asked for
    from_: float | None
    drill: Drill | None

    def schedule(self, first: float) -> Schedule:
        """Return when a recording is played whose first stamp is `first` [s]; asked for once it is read."""
        from noctule.flight.network.pacing import Schedule

        begin = time.time() if self.given is None else self.given
        return Schedule(begin, first if self.from_ is None else self.from_)


def prepare(role: str, options: NodeOptions) -> Prepared:
    """Return the node of a role. Raises NoctuleError for options that no node can have."""
    import numpy as np

    from noctule.estimation.delayed import DEFAULTS
    from noctule.estimation.filter_state import Prior, start_at
    from noctule.estimation.network import warm_up
    from noctule.estimation.sensors import Sensors, tuned
    from noctule.flight.network.drill import made_up
    from noctule.flight.network.endpoints import checked_name, endpoints
    from noctule.flight.network.member import Member
    from noctule.flight.network.senses import Senses
    from noctule.localization.sensors_file import sensors_of
    from noctule.localization.vehicle_file import load_vehicle_model

    _check_times(options)
    name = checked_name(role if options.name is None else options.name)
    addresses = endpoints(role, options.listen, options.connect)
    if options.drill is not None and (options.site or options.vehicle or options.from_ is not None):
        raise NodeOptionsError("node: --drill does not go with --site, --vehicle and --from; leave them out")
    if options.drill is not None and options.drill < 0:
        raise NodeOptionsError(f"node: --drill is {options.drill}, expected a seed of 0 or more")
    if not 0.0 < options.drill_seconds <= 600.0:
        raise NodeOptionsError(
            f"node: --drill-seconds is {options.drill_seconds:g}, expected above 0, up to 600"
        )
    model = None if options.vehicle is None else load_vehicle_model(options.vehicle).model()
    sensors = Sensors() if options.site is None else sensors_of(options.site)
    warm_up()
    now = time.time()
    begin = now if options.begin is None else options.begin
    if options.drill is not None:
        drill = made_up(options.drill, options.drill_seconds, begin)
        own = Member(name, drill.start, drill.model, drill.settings)
        return Prepared(name, role, own, Senses(name), addresses, begin, begin, None, drill)
    prior = Prior(position=_POSITION_SD, yaw=_YAW_SD)
    start = start_at(now, np.array(_START), 0.0, prior)
    own = Member(name, start, model, tuned(DEFAULTS, sensors))
    senses = Senses(name, sensors)
    return Prepared(name, role, own, senses, addresses, begin, options.begin, options.from_, None)


def _check_times(options: NodeOptions) -> None:
    if options.begin is not None and not 0.0 <= options.begin <= time.time() + _DAY:
        raise NodeOptionsError(
            f"node: --begin is {options.begin:g}, expected seconds as `date +%s` prints them, "
            "at most a day ahead"
        )
    if options.from_ is not None and not math.isfinite(options.from_):
        raise NodeOptionsError(f"node: --from is {options.from_:g}, expected a stamp of the recording [s]")


def require_within(from_: float | None, first: float, last: float, what: str, role: str) -> None:
    """Raise NodeOptionsError when `what` is over before the stamp `from_` [s] that is to be played."""
    if from_ is not None and from_ > last:
        raise NodeOptionsError(
            f"node {role}: --from is {from_:g}, {what} holds {first:.3f} to {last:.3f} s; "
            "give a stamp within them"
        )
