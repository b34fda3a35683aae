"""The papers' experiments, exactly; each seed draws its own room, columns, start, noise and gusts."""

from noctule.experiments.oval import OVALS, OvalExperiment, OvalOptions
from noctule.experiments.servo import EXPERIMENTS as SERVO
from noctule.experiments.servo import Experiment

EXPERIMENTS: dict[str, Experiment] = {**SERVO, **OVALS}
"""The experiments by the name that `noctule experiment` takes."""

__all__ = ["EXPERIMENTS", "Experiment", "OvalExperiment", "OvalOptions"]
