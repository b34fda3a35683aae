"""`noctule fly` and `missions` with flights below a depth camera: what they say."""

from __future__ import annotations

from pathlib import Path

from cli_pretended import pretended_summary

from noctule.cli.show import flight_text

FIGURES = {
    "cross_track_max_m": 0.02,
    "cross_track_mean_m": 0.0065,
    "cross_track_p95_m": 0.0135,
    "hover_rms_m": 0.009,
    "position_rms_m": 0.005,
    "lost_s": 0.0,
    "epsilon_px": None,  # no points of key images were tracked
}


def test_a_located_flight_is_told_by_its_path_not_by_images():
    text = flight_text({**pretended_summary("reached", Path("flight.mcap")), **FIGURES})
    assert "The drone flew its path to the end in 12.5 s, 6.5 mm from it on average." in text
    assert "image" not in text.split("\n\n")[0]
    assert "13.5 mm" in text
    assert "9.0 mm" in text


def test_one_that_was_handed_over_is_told_by_its_last_image_first():
    handed_over = {**pretended_summary("reached", Path("flight.mcap")), **FIGURES, "epsilon_px": 0.8}
    words = flight_text(handed_over).splitlines()[1]
    assert words.startswith("The drone reached the last image after 12.5 s")
    assert words.endswith("Before that it followed its path in space, 6.5 mm from it on average.")


def test_one_that_is_lost_says_that_it_landed_and_why():
    lost = {
        **pretended_summary("reached", Path("flight.mcap")),
        **FIGURES,
        "outcome": "lost",
        "reason": "nothing was seen",
    }
    text = flight_text(lost)
    assert "The drone did not know where it was and landed after 12.5 s: nothing was seen." in text


def test_missions_below_the_camera_are_listed(noctule):
    said = noctule("missions")
    assert "ellipse\n  Located by a depth camera on the ceiling" in said.out
    assert "  noctule fly handover\n" in said.out


def test_what_is_about_key_images_is_refused_where_there_are_none(noctule):
    for option, value in (("--law", "published"), ("--attitude-sd", "0.5")):
        said = noctule("fly", "ellipse", option, value)
        assert said.code == 2
        assert said.err == (
            f"noctule: {option} is of flights along a visual path, and ellipse has none; leave it out\n"
        )
