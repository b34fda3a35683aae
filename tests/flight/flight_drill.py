"""Nodes as processes of their own, for tests that kill and freeze them in a drill."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

PATIENCE = 60.0  # [s], for anything to happen on a busy machine


def free_ports(count: int) -> list[int]:
    """Return ports of 127.0.0.1 where nobody listens."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


class Drilled:
    """Four nodes in a drill; a context manager that leaves no process behind."""

    def __init__(self, folder: Path, seed: int, seconds: float, roles: tuple[str, ...]) -> None:
        self.folder, self.seed, self.seconds = folder, seed, seconds
        self.ports = dict(zip(roles, free_ports(len(roles)), strict=True))
        self.pids: dict[str, int] = {}
        self.begin = 0.0
        self._starts = 0
        self._outs: dict[str, Path] = {}

    def __enter__(self) -> Drilled:
        script = Path(__file__).with_name("flight_nursery.py")
        self._nursery = subprocess.Popen(
            [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._nursery.stdout is not None
        assert self._nursery.stdout.readline() == "ready\n"
        self.begin = time.time() + 1.0
        for role in self.ports:
            self.start(role)
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self.pids.values():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        assert self._nursery.stdin is not None
        assert self._nursery.stdout is not None
        self._nursery.stdin.close()
        self._nursery.wait(PATIENCE)
        self._nursery.stdout.close()

    def start(self, role: str) -> None:
        """Start a node."""
        self._starts += 1
        self._outs[role] = self.folder / f"{role}-{self._starts}.json"
        arguments = ["node", role, "--drill", str(self.seed), "--drill-seconds", str(self.seconds)]
        arguments += ["--begin", repr(self.begin), "--listen", f"127.0.0.1:{self.ports[role]}"]
        for other, port in self.ports.items():
            if other != role:
                arguments += ["--connect", f"127.0.0.1:{port}"]
        if role == "fusion":
            arguments += ["--out", str(self.folder)]
        asked = {"arguments": [*arguments, "--json"], "out": str(self._outs[role])}
        assert self._nursery.stdin is not None
        assert self._nursery.stdout is not None
        self._nursery.stdin.write(json.dumps(asked) + "\n")
        self._nursery.stdin.flush()
        self.pids[role] = int(self._nursery.stdout.readline())

    def signal(self, role: str, number: signal.Signals) -> None:
        """Kill, freeze or wake a node."""
        os.kill(self.pids[role], number)

    def wait_until(self, seconds: float) -> None:
        """Return so long after the beginning [s]."""
        time.sleep(max(0.0, self.begin + seconds - time.time()))

    def said(self, role: str) -> dict:
        """Wait for a node's end and return what it said."""
        give_up = time.time() + PATIENCE
        while time.time() < give_up:
            lines = self._outs[role].read_text().splitlines() if self._outs[role].exists() else []
            if lines:
                return json.loads(lines[-1])
            time.sleep(0.1)
        raise AssertionError(f"{role} did not end: {self.errors(role)}")

    def errors(self, role: str) -> str:
        """Return what a node wrote on standard error: its live lines."""
        return Path(f"{self._outs[role]}.err").read_text()
