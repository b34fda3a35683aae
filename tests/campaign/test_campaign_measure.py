"""Measurements over seeds: in order, each once, and what they say together."""

import pytest

from noctule.campaign import CampaignError
from noctule.campaign.measure import measure_seeds, together


def measured(seed):
    """Figures of a seed: a number, a group, and a number that only odd seeds have."""
    figures = {"error": float(seed), "methods": {"a": {"rate": seed / 10.0}}, "note": "text"}
    return {**figures, "odd": 1.0} if seed % 2 else figures


def test_runs_come_in_the_order_of_the_seeds_with_the_bar_told_of_each():
    told = []
    found = measure_seeds(measured, range(3, 6), jobs=2, note=told.append)
    assert [run["seed"] for run in found["runs"]] == [3, 4, 5]
    assert told == [1, 2, 3]


def test_numbers_are_pooled_within_their_groups():
    found = together([{"seed": k, **measured(k)} for k in (2, 3, 4)])
    assert found["summary"] == {"error": 3.0, "methods": {"a": {"rate": pytest.approx(0.3)}}, "odd": 1.0}
    assert found["least"]["error"] == 2.0
    assert found["most"]["methods"]["a"]["rate"] == 0.4


@pytest.mark.parametrize(("seeds", "jobs"), [((), None), ((1, 1), None), ((1,), 0)])
def test_what_cannot_be_measured_is_refused(seeds, jobs):
    with pytest.raises(CampaignError):
        measure_seeds(measured, seeds, jobs)
