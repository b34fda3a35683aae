import numpy as np
import pytest

from noctule.pilots import PilotSettings
from noctule.pilots.stability import MARGIN, LatencyError, check_delay, delay_limit, known_delay, most_delay


def swing(gain, lag, lead, delay, dt=0.002, seconds=60.0):
    """Return the ratio of the last swings to the first ones of the loop, by integration."""
    n, late = int(seconds / dt), round(delay / dt)
    x, v, commands, xs = 1.0, 0.0, [0.0] * (late + 1), []
    for _ in range(n):
        commands.append(-gain * (x + lead * v))
        v += (commands[-1 - late] - v) / lag * dt
        x += v * dt
        xs.append(abs(x))
    return max(xs[-n // 5 :]) / max(xs[n // 5 : 2 * n // 5])


@pytest.mark.parametrize(
    ("gain", "lag", "lead"), [(1.6, 0.3, 0.3), (1.4, 0.3, 0.0), (2.8, 0.3, 0.0), (0.8, 0.6, 0.2)]
)
def test_the_limit_is_where_a_simulated_loop_begins_to_grow(gain, lag, lead):
    limit = delay_limit(gain, lag, lead)
    assert swing(gain, lag, lead, 0.93 * limit) < 1.0
    assert swing(gain, lag, lead, 1.07 * limit) > 1.0


def test_a_pure_integrator_has_the_textbook_limit():
    assert delay_limit(2.0, 0.3, 0.3) == pytest.approx(np.pi / 4.0)


def test_the_shipped_defaults_may_be_flown_up_to_three_tenths_of_a_second():
    for law in ("noctule", "published"):
        check_delay(PilotSettings(law=law, picture_latency_s=0.3))
    check_delay(PilotSettings(law="noctule", command_latency_s=0.3))


def test_noctule_does_not_feel_the_pictures_delay_and_published_does():
    settings = {"picture_latency_s": 0.4, "command_latency_s": 0.1}
    assert known_delay(PilotSettings(law="noctule", **settings)) == pytest.approx(0.1)
    assert known_delay(PilotSettings(law="published", **settings)) == pytest.approx(0.5)


def test_a_delay_beyond_the_gains_is_refused_with_what_to_do():
    with pytest.raises(LatencyError) as told:
        check_delay(PilotSettings(law="noctule", command_latency_s=0.9))
    limit = most_delay(PilotSettings(law="noctule", command_latency_s=0.9))[0]
    assert str(told.value) == (
        "law 'noctule': commands and pictures are 0.90 s late, with pilot.progress.yaw = 1.5 at most "
        f"{limit:.2f} s can be flown; lower that gain to about {1.5 * limit / 0.9:.2g} or find a faster link"
    )


def test_lower_gains_allow_more_delay():
    slow = PilotSettings.model_validate(
        {"progress": {"position": 0.5, "cross": 0.5, "yaw": 0.5}, "command_latency_s": 0.9}
    )
    check_delay(slow)
    assert most_delay(slow)[0] > most_delay(PilotSettings())[0]
    assert 0.0 < MARGIN < 1.0
