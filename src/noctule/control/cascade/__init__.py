"""The cascade of a kinematic law and a dynamic compensator, with the delay of commands predicted away."""

from noctule.control.cascade.disturbance import (
    disturbance_after,
    disturbance_at,
    nothing_learnt,
    on_body_axes,
)
from noctule.control.cascade.law import cascade, compensator, kinematic_law, saturated
from noctule.control.cascade.prediction import moved, predict_over_delay, remember
from noctule.control.cascade.settings import CascadeSettings, DelayTooLongError

__all__ = [
    "CascadeSettings",
    "DelayTooLongError",
    "cascade",
    "compensator",
    "disturbance_after",
    "disturbance_at",
    "kinematic_law",
    "moved",
    "nothing_learnt",
    "on_body_axes",
    "predict_over_delay",
    "remember",
    "saturated",
]
