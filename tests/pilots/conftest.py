import sys
from pathlib import Path

# The views of real photographs are those of the tests of vision.
sys.path.append(str(Path(__file__).parents[1] / "vision"))
