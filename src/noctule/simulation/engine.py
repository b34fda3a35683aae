"""Imports MuJoCo for drawing without a display, and says what to install when OpenGL is missing."""

from __future__ import annotations

import os
import sys

from noctule.errors import NoctuleError


class OpenGLError(NoctuleError):
    """The OpenGL libraries that draw the simulated pictures cannot be used."""

    def __init__(self, found: object) -> None:
        line = " ".join(str(found).split())
        super().__init__(
            f"simulation: OpenGL cannot draw (MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}): {line}; "
            "install it, on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri libgles2"
        )


# MuJoCo reads this when it is imported.
if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")

try:
    import mujoco as mujoco
except ModuleNotFoundError:
    raise
except (AttributeError, ImportError, OSError, RuntimeError) as error:
    # A missing libEGL shows as: 'NoneType' object has no attribute 'eglQueryString'.
    raise OpenGLError(error) from None
