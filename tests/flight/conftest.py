"""Pictures are rendered off-screen."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")
