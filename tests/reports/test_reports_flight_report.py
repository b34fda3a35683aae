import re
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_flight import make_log, without_truth

from noctule.reports.flight_report import ReportWriteError, draw_figures, flight_page, write_flight
from noctule.reports.page import Drawing, drawing, escape, png_size
from noctule.reports.progress import with_progress
from noctule.reports.summary import flight_rows

LOG = make_log(90)
TINY = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 3, 2)


def placeholders(log):
    """The figures of a report without the time it takes to draw them."""
    return [Drawing("errors", "Errors", "What went wrong.", TINY)]


def page(log):
    return flight_page(log, placeholders(log))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "not" / "yet"
    return write_flight(LOG, out)


def test_the_report_is_one_page_and_a_png_per_figure(written):
    names = sorted(path.name for path in written.parent.iterdir())
    assert names == [
        "camera.png",
        "clearance.png",
        "errors.png",
        "report.html",
        "tasks.png",
        "ticks.png",
        "velocities.png",
        "views.png",
    ]


def test_every_png_is_wide_enough_to_be_read_at_900_pixels(written):
    for path in written.parent.glob("*.png"):
        width, height = png_size(path.read_bytes())
        assert width == 1350
        assert 300 <= height <= 3000


def test_the_page_holds_its_figures_itself_and_needs_nothing_else(written):
    text = written.read_text(encoding="utf-8")
    assert text.count('src="data:image/png;base64,') == 7
    assert not re.search(r"""(src|href)=["'](?!data:)""", text)
    assert "<script" not in text
    assert "http:" not in text
    assert "https:" not in text
    assert "$" not in re.sub(r"base64,[^\"]*", "", text)


def test_the_same_flight_gives_the_same_report_byte_for_byte(written, tmp_path):
    again = write_flight(LOG, tmp_path)
    for path in written.parent.iterdir():
        assert (again.parent / path.name).read_bytes() == path.read_bytes()


def test_every_row_of_the_table_is_on_the_page():
    text = page(LOG)
    for row in flight_rows(LOG.summary):
        assert f'<th scope="row">{row.label}</th><td class="number">{row.value}</td>' in text


def test_the_page_says_what_flew_and_how_it_ended():
    text = page(LOG)
    assert "Noctule flight · law noctule · seed 7" in text
    assert '<h1>two-columns<span class="badge good">reached</span></h1>' in text
    assert "The drone reached the last image after 21.4 s" in text


def test_an_outcome_that_was_not_wanted_is_marked_as_such():
    assert '<span class="badge bad">collided</span>' in page(replace(LOG, summary={"outcome": "collided"}))
    assert '<span class="badge ">no outcome</span>' in page(replace(LOG, summary={}))


def test_markup_in_a_recording_stays_text():
    evil = '<script>alert("x")</script>&'
    log = replace(
        LOG,
        summary={**LOG.summary, "outcome": evil, "reason": evil, evil: evil},
        about={"mission": evil, "law": evil, "seed": evil, evil: evil},
        mission_text=evil,
        notes=(evil,),
    )
    text = page(log)
    assert "<script" not in text
    assert text.count(escape(evil)) >= 9


def test_a_dollar_in_a_mission_is_not_taken_for_a_place_to_fill():
    assert "cost = $title" in page(replace(LOG, mission_text="cost = $title"))


def test_sections_without_truth_say_why_they_are_empty(tmp_path):
    log = without_truth(make_log(30))
    text = write_flight(log, tmp_path).read_text(encoding="utf-8")
    assert not (tmp_path / "views.png").exists()
    assert not (tmp_path / "clearance.png").exists()
    assert (tmp_path / "errors.png").exists()
    assert (
        text.count("There is no truth in this recording (a real drone has none), so this is left out.") == 2
    )
    assert '<p class="note" role="note">no truth in this recording: error in metres not available</p>' in text
    row = '<th scope="row">Position error at the end</th><td class="number">not available</td>'
    assert row in text


def test_figures_that_were_not_measured_have_no_tile():
    assert page(LOG).count('class="tile"') == 5
    assert page(without_truth(LOG)).count('class="tile"') == 2


def test_a_flight_without_pictures_tasks_or_times_says_so():
    bare = replace(make_log(30), snapshots=(), task_errors={}, tick_ms=LOG.tick_ms[:0])
    missing = {d.name: d.missing for d in draw_figures(bare) if d.png is None}
    assert missing == {
        "camera": "There are no pictures in this recording.",
        "tasks": "This recording holds no errors of tasks.",
        "ticks": "This recording holds no times of ticks.",
    }


def test_the_page_knows_the_size_of_its_figures_before_it_draws_them():
    assert 'width="3" height="2"' in drawing(placeholders(LOG)[0])


def test_a_folder_that_cannot_be_made_gives_one_line(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("a file")
    with pytest.raises(ReportWriteError) as error:
        write_flight(make_log(2, snapshots=0), taken)
    assert str(error.value) == (
        f"report {taken}: cannot be written (File exists), expected a folder with room for a few MB; "
        "name another with --out"
    )


def test_a_full_disk_gives_one_line(tmp_path, monkeypatch):
    def no_space(path: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", no_space)
    with pytest.raises(ReportWriteError) as error:
        write_flight(make_log(2, snapshots=0), tmp_path)
    assert str(error.value) == (
        f"report {tmp_path}: cannot be written (No space left on device), expected a folder with room for "
        "a few MB; name another with --out"
    )


@pytest.mark.parametrize("patience", [0.0, 1e9])
def test_progress_gives_every_item_once_and_in_order(patience, capsys):
    assert list(with_progress([1, 2, 3], "counting", patience)) == [1, 2, 3]
    assert capsys.readouterr().out == ""
