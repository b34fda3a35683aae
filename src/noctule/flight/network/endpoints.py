"""Where nodes listen and whom they connect to: named addresses only, this machine by default.

Every node connects to every other, so that no node is in charge and none has to pass on what others say.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from noctule.errors import NoctuleError
from noctule.estimation.framing import NAME_BYTES

PORTS = {"onboard": 17447, "depth": 17448, "markers": 17449, "fusion": 17450}
"""The port on 127.0.0.1 where a node of each role listens unless told otherwise."""

_ENDPOINT = re.compile(r"(?:tcp/)?(?P<host>\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+):(?P<port>[0-9]{1,5})")
_EVERYWHERE = ("0.0.0.0", "[::]")
_NAME = re.compile(rf"[a-z0-9][a-z0-9_-]{{0,{NAME_BYTES - 1}}}")


class EndpointError(NoctuleError):
    """An address that no node can listen on or connect to."""


class NodeNameError(NoctuleError):
    """A name that no node can have."""


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Addresses as tcp/HOST:PORT."""

    listen: tuple[str, ...]
    connect: tuple[str, ...]


def endpoints(role: str, listen: Sequence[str] = (), connect: Sequence[str] = ()) -> Endpoints:
    """Return the addresses of a node; what is left out are those of the roles on this machine.

    Raises EndpointError.
    """
    own = tuple(_checked(text, "--listen") for text in listen) or (_loopback(role),)
    others = tuple(_checked(text, "--connect") for text in connect)
    if not connect:
        others = tuple(_loopback(other) for other in PORTS)
    return Endpoints(own, tuple(address for address in others if address not in own))


def is_name(name: str) -> bool:
    """Return whether a node can have this name."""
    return _NAME.fullmatch(name) is not None


def checked_name(name: str) -> str:
    """Return a node's name; raises NodeNameError."""
    if not is_name(name):
        raise NodeNameError(
            f"node: its name is {name!r}, expected 1 to {NAME_BYTES} of a to z, 0 to 9, - and _; "
            "give another with --name"
        )
    return name


def _loopback(role: str) -> str:
    return f"tcp/127.0.0.1:{PORTS[role]}"


def _checked(text: str, option: str) -> str:
    found = _ENDPOINT.fullmatch(text)
    if found is None or not 1 <= int(found["port"]) <= 65535:
        raise EndpointError(f"node: {option} is {text!r}, expected HOST:PORT, for example 192.168.1.7:17450")
    if found["host"] in _EVERYWHERE:
        raise EndpointError(
            f"node: {option} is {text!r}, which is every interface; name the address of one, "
            "for example 192.168.1.7:17450"
        )
    return f"tcp/{found['host']}:{found['port']}"
