"""The papers' experiments, exactly; each seed draws its own room, columns, start, noise and gusts."""

from noctule.experiments.servo import EXPERIMENTS, Experiment

__all__ = ["EXPERIMENTS", "Experiment"]
