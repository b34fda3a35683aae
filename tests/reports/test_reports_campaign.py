import re

import pytest
from synthetic_flight import make_log

from noctule.reports import CampaignResultsError, write_campaign_report
from noctule.reports.campaign_report import by_law, spread_figure
from noctule.reports.page import png_size
from noctule.reports.style import FORWARD, LEFT, house_style

BASE = make_log(2, snapshots=0).summary


def runs(outcomes, error=0.01):
    return [
        {**BASE, "seed": seed, "outcome": outcome, "position_error_m": error * (seed + 1)}
        for seed, outcome in enumerate(outcomes)
    ]


def part(outcomes, error=0.01):
    rates = {name: outcomes.count(name) / len(outcomes) for name in ("reached", "collided")}
    return {"runs": runs(outcomes, error), "summary": {**BASE, "outcome": rates, "position_error_m": 0.0207}}


GOOD, WORSE = part(["reached"] * 3), part(["reached", "collided", "collided"], 0.05)


def rows(text):
    """Every line of the page's tables as a list of its cells' words."""
    lines = re.findall(r"<tr>(.*?)</tr>", text, re.S)
    return [
        [re.sub(r"<[^>]+>", "", cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", line)] for line in lines
    ]


def test_both_laws_stand_side_by_side_with_noctule_first(tmp_path):
    path = write_campaign_report({"published": WORSE, "noctule": GOOD}, tmp_path)
    table = rows(path.read_text(encoding="utf-8"))
    assert ["", "noctule", "published"] in table
    assert ["flights", "3", "3"] in table
    assert ["outcomes", "reached 100 %", "reached 33 %, collided 67 %"] in table
    assert ["position error", "0.021 m", "0.021 m"] in table


def test_the_page_counts_outcomes_in_words(tmp_path):
    text = write_campaign_report({"published": WORSE, "noctule": GOOD}, tmp_path).read_text(encoding="utf-8")
    assert (
        "Law noctule: 3 of 3 flights reached the last image. "
        "Law published: 1 of 3 flights reached the last image, 2 collided."
    ) in text


def test_every_flight_has_a_line_with_its_figures(tmp_path):
    table = rows(write_campaign_report({"noctule": GOOD}, tmp_path).read_text(encoding="utf-8"))
    expected = ["21.4 s", "0.030 m", "0.22°", "1.8 px", "0.146 m", "0.033 m/s", "0.064 rad/s", "4.87 ms"]
    assert ["2", "reached", *expected] in table


def test_a_flight_that_failed_before_it_measured_anything_is_shown_with_dashes(tmp_path):
    failed = {**dict.fromkeys(BASE), "seed": 3, "outcome": "aborted", "tick_ms": {"p95": None}}
    results = {"runs": [*GOOD["runs"], failed], "summary": GOOD["summary"]}
    table = rows(write_campaign_report({"noctule": results}, tmp_path).read_text(encoding="utf-8"))
    assert ["3", "aborted", *["\u2013"] * 8] in table


def test_one_campaign_alone_is_taken_as_the_commands_print_it():
    assert by_law(GOOD) == {"noctule": GOOD}
    assert by_law({**GOOD, "law": "published"}) == {"published": {**GOOD, "law": "published"}}


@pytest.mark.parametrize(
    ("results", "found"),
    [
        ({}, "nothing"),
        ({"summary": {}}, "summary"),
        ({"runs": []}, "runs"),
        ({"noctule": {"runs": []}}, "noctule"),
    ],
)
def test_results_without_runs_give_one_line(results, found, tmp_path):
    with pytest.raises(CampaignResultsError) as error:
        write_campaign_report(results, tmp_path)
    assert str(error.value) == (
        f"campaign results: no runs, found {found}; expected 'runs' and 'summary', or these by law, as "
        "`--seeds 0:10 --json` prints them"
    )


def test_seeds_link_to_reports_of_the_same_campaign_only(tmp_path):
    inside, outside = tmp_path / "seed-0" / "report.html", tmp_path.parent / "other" / "report.html"
    results = part(["reached", "reached"])
    results["runs"][0]["report"], results["runs"][1]["report"] = str(inside), str(outside)
    text = write_campaign_report({"noctule": results}, tmp_path / "report").read_text(encoding="utf-8")
    assert re.findall(r'href="([^"]*)"', text) == ["../seed-0/report.html"]


def test_markup_in_results_stays_text(tmp_path):
    evil = "<script>x</script>"
    results = part(["reached"])
    results["runs"][0].update(outcome=evil, seed=evil, mission=evil)
    text = write_campaign_report({evil: results}, tmp_path).read_text(encoding="utf-8")
    assert "<script" not in text


def test_the_same_results_give_the_same_files(tmp_path):
    first = write_campaign_report({"noctule": GOOD, "published": WORSE}, tmp_path / "a")
    second = write_campaign_report({"noctule": GOOD, "published": WORSE}, tmp_path / "b")
    assert first.read_bytes() == second.read_bytes()
    spread = (tmp_path / "a" / "spread.png").read_bytes()
    assert spread == (tmp_path / "b" / "spread.png").read_bytes()
    assert png_size(spread)[0] == 1350


def test_flights_that_did_not_reach_are_drawn_hollow_and_the_bar_is_the_median():
    with house_style():
        axis = spread_figure({"noctule": GOOD, "published": WORSE}).axes[1]
    marks = [line for line in axis.lines if line.get_marker() not in ("", "None")]
    bars = [line for line in axis.lines if line.get_marker() in ("", "None")]
    faces = [line.get_markerfacecolor() for line in marks]
    assert faces == [FORWARD, FORWARD, FORWARD, LEFT, "white", "white"]
    assert [bar.get_ydata()[0] for bar in bars] == pytest.approx([0.02, 0.10])


def located_part(name_outcomes):
    flown = [
        {
            "seed": seed,
            "outcome": outcome,
            "cross_track_mean_m": 0.007 + 0.001 * seed,
            "cross_track_p95_m": 0.015,
            "hover_rms_m": 0.009,
            "heading_p95_deg": 2.1,
            "recovery_s": {"mean": 0.5, "max": 0.6},
            "position_rms_m": 0.0061,
            "yaw_sd_deg": 0.8,
            "lost_s": None,
            "min_clearance_m": 0.41,
        }
        for seed, outcome in enumerate(name_outcomes)
    ]
    shares = {"completed": 0.5, "landed_lost": 0.5}
    return {"runs": flown, "summary": {**flown[0], "outcome": shares}}


def test_located_flights_are_told_by_their_own_figures_and_their_experiments_names(tmp_path):
    part = located_part(["completed", "landed_lost"])
    text = write_campaign_report({"loc-1": part}, tmp_path).read_text(encoding="utf-8")
    table = rows(text)
    assert "loc-1: 1 of 2 flights completed their path, 1 landed lost." in text
    assert "Law" not in text
    assert ["outcomes", "completed 50 %, landed lost 50 %"] in table
    assert ["from the path, mean", "7.0 mm"] in table
    expected = ["8.0 mm", "15.0 mm", "9.0 mm", "0.6 s", "6.1 mm", "0.80°", "2.10°", "\u2013", "0.410 m"]
    assert ["1", "landed lost", *expected] in table


def test_what_is_asked_of_located_flights_is_dashed_in_their_panels():
    with house_style():
        figure = spread_figure({"loc-1": located_part(["completed"] * 2), "loc-2": located_part(["fence"])})
    dashed = [
        float(line.get_ydata()[0])
        for axis in figure.axes
        for line in axis.get_lines()
        if line.get_linestyle() == "--"
    ]
    assert dashed == [10.0, 20.0, 12.0, 0.8, 8.0, 1.2]
    assert len(figure.axes) == 6
