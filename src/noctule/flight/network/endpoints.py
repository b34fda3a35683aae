"""Where nodes listen and whom they connect to: named addresses only, this machine by default.

Every node connects to every other, so that no node is in charge and none has to pass on what others say.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Sequence
from dataclasses import dataclass

from noctule.errors import NoctuleError
from noctule.estimation.framing import NAME_BYTES

PORTS = {"onboard": 17447, "depth": 17448, "markers": 17449, "fusion": 17450}
"""The port on 127.0.0.1 where a node of each role listens unless told otherwise."""

_ENDPOINT = re.compile(r"(?:tcp/)?(?P<host>\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+):(?P<port>[0-9]{1,5})")
_LISTEN, _CONNECT = "--listen", "--connect"
_NAME = re.compile(rf"[a-z0-9][a-z0-9_-]{{0,{NAME_BYTES - 1}}}")

_Number = ipaddress.IPv4Address | ipaddress.IPv6Address


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
    own = tuple(_checked(text, _LISTEN) for text in listen) or (_loopback(role),)
    others = tuple(_checked(text, _CONNECT) for text in connect)
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
        raise _no_address(text, option)
    host, port = found["host"], int(found["port"])
    if host.startswith("["):
        try:
            number: _Number | None = ipaddress.IPv6Address(host[1:-1])
        except ValueError:
            raise _no_address(text, option) from None
    else:
        number = _ipv4(host)
    numbers = _resolved(host) if number is None and option == _LISTEN else (number,)
    if any(one is not None and _is_everywhere(one) for one in numbers):
        raise EndpointError(
            f"node: {option} is {text!r}, which is every interface; name the address of one, "
            "for example 192.168.1.7:17450"
        )
    if number is not None:  # as it is usually written: 127.1 is 127.0.0.1
        host = f"[{number}]" if number.version == 6 else str(number)
    return f"tcp/{host}:{port}"


def _no_address(text: str, option: str) -> EndpointError:
    return EndpointError(f"node: {option} is {text!r}, expected HOST:PORT, for example 192.168.1.7:17450")


def _ipv4(host: str) -> ipaddress.IPv4Address | None:
    """Return the address that is written in numbers, in any of the forms that a system takes: 0, 127.1."""
    try:
        return ipaddress.IPv4Address(socket.inet_aton(host))
    except OSError:
        return None


def _resolved(name: str) -> list[_Number]:
    """Return the addresses of a name; none when nobody knows it, which the wire tells."""
    try:
        return [ipaddress.ip_address(found[4][0]) for found in socket.getaddrinfo(name, None)]
    except (OSError, UnicodeError, ValueError):
        return []


def _is_everywhere(number: _Number) -> bool:
    mapped = number.ipv4_mapped if isinstance(number, ipaddress.IPv6Address) else None
    return number.is_unspecified or (mapped is not None and mapped.is_unspecified)
