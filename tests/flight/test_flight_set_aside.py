from noctule.flight.mission_flight import set_aside


def test_an_earlier_recording_is_kept_under_the_next_free_name(tmp_path):
    recording = tmp_path / "flight.mcap"
    for text in ("first", "second"):
        recording.write_text(text)
        assert set_aside(recording) == recording
        assert not recording.exists()
    assert (tmp_path / "flight-1.mcap").read_text() == "first"
    assert (tmp_path / "flight-2.mcap").read_text() == "second"


def test_nothing_is_done_where_there_is_no_recording(tmp_path):
    assert set_aside(tmp_path / "flight.mcap") == tmp_path / "flight.mcap"
    assert list(tmp_path.iterdir()) == []
