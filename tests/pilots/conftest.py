import sys
from pathlib import Path

from hypothesis import settings

# The views of real photographs are those of the tests of vision.
sys.path.append(str(Path(__file__).parents[1] / "vision"))

# A busy machine is no failure.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
