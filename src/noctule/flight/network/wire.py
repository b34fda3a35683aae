"""The wire between nodes: a zenoh session that scouts nowhere, and all that arrives in one queue.

Callbacks of the session only put what came into the queue; the node's own thread looks at it. A peer that
crashed is known at once by its connection; one that hangs by its lease, 0.6 s.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from dataclasses import dataclass
from enum import StrEnum
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from noctule.errors import NoctuleError
from noctule.flight.network.endpoints import Endpoints

if TYPE_CHECKING:
    import zenoh

LEASE_MS = 600  # a peer that says nothing for so long is taken for hung
_ROOT = "noctule/1"  # the version of what is said
_INBOX = 4096  # messages that wait for the node's thread
_MOST_BYTES = 2 << 20  # of a message; a snapshot of a full window has less than 1 MB
_PATIENCE = 1.0  # [s], for answers


class NoNetworkError(NoctuleError):
    """The optional package of the network is not installed."""


class PortTakenError(NoctuleError):
    """Somebody else listens at a node's address."""


class NameTakenError(NoctuleError):
    """Another node of the same name, that was there before."""


class WireError(NoctuleError):
    """A session that cannot be opened."""


class Kind(StrEnum):
    """What arrived."""

    CONTRIBUTION = "contribution"
    COMMANDS = "commands"
    BEAT = "beat"
    SNAPSHOT = "snapshot"  # the answer of a peer
    ASKED = "asked"  # a peer asks for a snapshot
    ALIVE = "alive"  # a peer is connected
    GONE = "gone"  # it no longer is


SHARED = (Kind.CONTRIBUTION, Kind.COMMANDS, Kind.BEAT)


@dataclass(frozen=True, slots=True)
class Received:
    """What came from a peer."""

    kind: Kind
    peer: str
    data: bytes = b""
    query: Any = None  # of ASKED, to be handed back to `answer`


class Wire:
    """A node's connection to all others; a context manager.

    Raises
    ------
    NoNetworkError, PortTakenError, WireError
        When it is entered.
    """

    def __init__(self, name: str, endpoints: Endpoints) -> None:
        self.name = name
        self.endpoints = endpoints
        self.inbox: queue.Queue[Any] = queue.Queue(_INBOX)  # of Received, and of what the node itself puts
        self.overruns = 0  # messages that found the queue full
        # When nodes of the same name that are there began, before this one and after it.
        self.namesakes: set[str] = set()
        self.younger: set[str] = set()
        self._born = f"{time.time_ns():020d}"
        self._lock = threading.Lock()
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []  # the session forgets what nobody holds

    def __enter__(self) -> Self:
        """Open the session and be seen."""
        zenoh = _zenoh()
        try:
            self._session = session = zenoh.open(_configuration(zenoh, self.endpoints))
        except zenoh.ZError as error:
            raise _refused(self.name, self.endpoints, str(error)) from None
        remote = zenoh.Locality.REMOTE
        for kind in SHARED:
            self._declared.append(
                session.declare_subscriber(
                    f"{_ROOT}/{kind}/*", lambda sample, k=kind: self._heard(k, sample), allowed_origin=remote
                )
            )
        snapshots = f"{_ROOT}/{Kind.SNAPSHOT}/{self.name}"
        self._declared.append(session.declare_queryable(snapshots, self._asked, allowed_origin=remote))
        liveliness = session.liveliness()
        self._declared.append(liveliness.declare_token(f"{_ROOT}/{Kind.ALIVE}/{self._born}/{self.name}"))
        self._declared.append(
            liveliness.declare_subscriber(f"{_ROOT}/{Kind.ALIVE}/*/*", self._lively, history=True)
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave; the others know at once."""
        session, self._session = self._session, None
        self._declared.clear()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def share(self, kind: Kind, data: bytes) -> None:
        """Send `data` to all others; never waits for one that does not take it."""
        if self._session is not None:
            drop = _zenoh().CongestionControl.DROP
            self._session.put(f"{_ROOT}/{kind}/{self.name}", data, congestion_control=drop, express=True)

    def ask(self) -> None:
        """Ask all others for what they know; their answers arrive as SNAPSHOT."""
        if self._session is not None:
            zenoh = _zenoh()
            self._session.get(
                f"{_ROOT}/{Kind.SNAPSHOT}/*",
                self._answered,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_PATIENCE,
                allowed_destination=zenoh.Locality.REMOTE,
            )

    def answer(self, received: Received, data: bytes) -> None:
        """Answer one who asked."""
        try:
            received.query.reply(f"{_ROOT}/{Kind.SNAPSHOT}/{self.name}", data)
        except _zenoh().ZError:
            return  # whoever asked is gone
        finally:
            received.query.drop()

    def decline(self, received: Received) -> None:
        """Let one who asked know that nothing is answered."""
        received.query.drop()

    def _put(self, received: Received) -> None:
        try:
            self.inbox.put_nowait(received)
        except queue.Full:
            with self._lock:
                self.overruns += 1

    def _heard(self, kind: Kind, sample: zenoh.Sample) -> None:
        self._put(Received(kind, _peer(sample), sample.payload.to_bytes()))

    def _lively(self, sample: zenoh.Sample) -> None:
        there = sample.kind == _zenoh().SampleKind.PUT
        _, born, name = str(sample.key_expr).rsplit("/", 2)
        if name != self.name:
            self._put(Received(Kind.ALIVE if there else Kind.GONE, name))
        elif born != self._born:
            others = self.namesakes if born < self._born else self.younger
            (others.add if there else others.discard)(born)

    def require_own_name(self) -> None:
        """Raise NameTakenError while another node that began before has the same name."""
        if self.namesakes:
            raise NameTakenError(
                f"node {self.name!r}: another node of this name is there; stop it, or give this one another "
                "with --name"
            )

    def _asked(self, query: zenoh.Query) -> None:
        self._put(Received(Kind.ASKED, "", query=query))

    def _answered(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._put(Received(Kind.SNAPSHOT, _peer(reply.ok), reply.ok.payload.to_bytes()))


def _peer(sample: zenoh.Sample) -> str:
    return str(sample.key_expr).rsplit("/", 1)[-1]


def _zenoh() -> Any:
    try:
        import zenoh
    except ImportError:
        raise NoNetworkError(
            'node: the package eclipse-zenoh is not installed; install it: pip install "noctule[network]"'
        ) from None
    return zenoh


def _configuration(zenoh: Any, endpoints: Endpoints) -> Any:
    # The library's own defaults scout on every interface.
    values = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": endpoints.listen,
        "connect/endpoints": endpoints.connect,
        "connect/timeout_ms": 0,
        "open/return_conditions": {"connect_scouted": False, "declares": False},
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": _MOST_BYTES,
        "transport/shared_memory/enabled": False,
    }
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _refused(name: str, endpoints: Endpoints, said: str) -> NoctuleError:
    own = " and ".join(endpoints.listen)
    if "in use" in said:
        return PortTakenError(
            f"node {name!r}: {own} is taken; does this node already run? stop it, or name another address "
            "with --listen, and tell the others with --connect"
        )
    cause = said.split("[", 1)[-1].split(" at /", 1)[0].strip(" []")  # without the library's source files
    return WireError(f"node {name!r}: cannot listen at {own} ({cause}); name an address of this machine")
