"""Why a located pilot doubts, in plain words."""

from __future__ import annotations

REPORTS_REMAIN = " on what the vehicle measures itself"

_UNSEEN = {
    "occluded": "too little of it is seen",
    "outside the picture": "it is outside the picture",
    "low score": "what is there does not look like it",
    "another shape": "what is there has another shape, as a person has",
    "in doubt": "too little of it fits, as when somebody stands beside or over it",
    "jump": "what is seen is not where the drone must be",
    "nothing in view": "nothing is in view",
    "no drone in view": "nothing in view looks like it",
    "confirming": "it has just come into view again",
    "moved camera": "the camera is no longer where it was calibrated",
    "covered view": "something is held before it",
    "wrong resolution": "its pictures have another size",
    "wrong unit": "its depth comes in another unit",
    "all zero": "no pixel has a depth",
    "too few readings": "hardly a pixel has a depth",
}
"""By the name of the locator's reason: what stands before its colon."""


def in_words(why: str) -> str:
    """Return the locator's reason in plain words; its own where there are none."""
    return _UNSEEN.get(why.split(":", 1)[0], why) or "what it saw was not believed"


def because_unseen(age: float, why: str) -> str:
    """Return the words for a camera that has not seen the drone for `age` [s]."""
    return f"the ceiling camera has not seen the drone for {age:.1f} s ({in_words(why)})"


def because_silent(age: float) -> str:
    """Return the words for a vehicle that has not reported for `age` [s]."""
    return f"the vehicle has reported nothing for {age:.1f} s"


def because_blind(age: float) -> str:
    """Return the words for neither camera nor report for `age` [s]."""
    return f"neither the ceiling camera nor the vehicle has told anything for {age:.1f} s"


def because_unsure(by: str, age: float, why: str) -> str:
    """Return the words for an estimate that may be off `by` so much."""
    unseen = f"; {because_unseen(age, why)}" if age > 0.5 else ""
    return f"the estimate may be off by {by}{unseen}"


def because_jumped(jump: float) -> str:
    """Return the words for an estimate that was moved by `jump` [m] at once."""
    return f"the drone was found {jump:.2f} m from where it must have been"


def because_turned() -> str:
    """Return the words for a half turn that was wrong."""
    return "the drone's heading was held half a turn wrong; its estimate begins anew"


def not_found(limit: float, why: str) -> str:
    """Return the words for a search that found no drone within its `limit` [s]."""
    seen = in_words(why)
    return f"the drone was not found within {limit:.0f} s ({seen}); is it in view of the ceiling camera?"
