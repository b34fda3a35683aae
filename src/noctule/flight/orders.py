"""What a person may order in flight, from any thread; the supervisor obeys at the next tick."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Orders:
    """Set an event to give its order. Only `hover` can be taken back, by clearing it."""

    emergency: threading.Event = field(default_factory=threading.Event)  # cut the motors
    land: threading.Event = field(default_factory=threading.Event)
    hover: threading.Event = field(default_factory=threading.Event)
