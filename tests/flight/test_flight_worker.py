"""The matching worker beside the loop."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from noctule.flight.worker import MatchWorker
from noctule.messages import MatchRequest, MatchResult, Picture


def picture(stamp: float) -> Picture:
    return Picture(stamp, np.zeros((2, 2, 3), dtype=np.uint8))


def echo(seen: Picture, index: int) -> MatchResult:
    point = np.array([[seen.stamp, index]], dtype=np.float32)
    return MatchResult(seen.stamp, index, point, point)


@pytest.fixture
def simulated():
    worker = MatchWorker(echo, delay=0.15)
    yield worker
    worker.close()


def test_a_simulated_result_arrives_its_delay_after_the_request_and_not_before(simulated):
    simulated.submit(MatchRequest(2), picture(1.0), 1.0)
    assert simulated.collect(1.14) == ()
    (result,) = simulated.collect(1.15)
    assert (result.key_index, result.stamp) == (2, 1.0)
    assert simulated.collect(9.0) == ()


def test_simulated_requests_are_served_one_after_the_other(simulated):
    for k in range(3):
        simulated.submit(MatchRequest(k), picture(0.0), 0.0)
    assert [[r.key_index for r in simulated.collect(t)] for t in (0.15, 0.2, 0.3, 0.45)] == [
        [0],
        [],
        [1],
        [2],
    ]


def test_a_late_look_finds_all_that_was_due_oldest_first(simulated):
    for k in range(3):
        simulated.submit(MatchRequest(k), picture(0.0), 0.0)
    assert [r.key_index for r in simulated.collect(5.0)] == [0, 1, 2]


def test_the_simulated_delay_does_not_depend_on_how_long_the_matcher_takes():
    release = threading.Event()

    def slow(seen: Picture, index: int) -> MatchResult:
        release.wait(5.0)
        return echo(seen, index)

    worker = MatchWorker(slow, delay=0.15)
    worker.submit(MatchRequest(0), picture(0.0), 0.0)
    assert worker.collect(0.14) == ()
    threading.Timer(0.05, release.set).start()
    assert len(worker.collect(0.15)) == 1  # waits for the thread
    worker.close()


def test_results_are_exactly_what_a_recording_will_hold(simulated):
    simulated.submit(MatchRequest(1), picture(0.1), 0.0)
    (result,) = simulated.collect(1.0)
    assert result.p_ref.dtype == np.float64
    assert result.p_ref.shape == (1, 2)


def test_in_real_life_a_newer_request_replaces_one_that_has_not_begun():
    begun, release = threading.Event(), threading.Event()

    def gated(seen: Picture, index: int) -> MatchResult:
        begun.set()
        release.wait(5.0)
        return echo(seen, index)

    worker = MatchWorker(gated, delay=None)
    worker.submit(MatchRequest(0), picture(0.0), 0.0)
    begun.wait(5.0)
    worker.submit(MatchRequest(1), picture(0.1), 0.1)
    worker.submit(MatchRequest(2), picture(0.2), 0.2)
    assert worker.collect(0.3) == ()
    release.set()
    results: list[MatchResult] = []
    for _ in range(500):
        results += worker.collect(1.0)
        if len(results) == 2:
            break
        threading.Event().wait(0.01)
    assert [r.key_index for r in results] == [0, 2]
    worker.close()


def test_a_matcher_that_fails_is_heard_of_when_its_result_is_collected():
    def broken(seen: Picture, index: int) -> MatchResult:
        raise ZeroDivisionError("a fault of the matcher")

    worker = MatchWorker(broken, delay=0.1)
    worker.submit(MatchRequest(0), picture(0.0), 0.0)
    with pytest.raises(ZeroDivisionError):
        worker.collect(0.1)
    worker.close()
