"""Tracks made by hand are those that the flight's judge is tested with."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "flight"))
