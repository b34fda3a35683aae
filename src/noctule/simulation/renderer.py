"""Draws what the camera sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from noctule.camera import CameraMount, PinholeCamera
from noctule.geometry import R_BODY_CAMERA, Array, Pose
from noctule.simulation.engine import OpenGLError, mujoco


class Renderer:
    """An off-screen renderer of a scene in which nothing moves but the camera.

    Use it from one thread. Its pictures follow `PinholeCamera`: (0, 0) is the centre of the top left
    pixel, so the frustum of a centred camera is symmetric.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: PinholeCamera, mount: CameraMount | None = None
    ) -> None:
        self._mount = CameraMount() if mount is None else mount
        model.vis.global_.offwidth = camera.width
        model.vis.global_.offheight = camera.height
        try:
            self._renderer = mujoco.Renderer(model, camera.height, camera.width, max_geom=model.ngeom + 8)
        except (AttributeError, ImportError, OSError, RuntimeError, mujoco.FatalError) as error:
            raise OpenGLError(error) from None
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._renderer.update_scene(data)
        self._sample_nearest_mipmap()
        for flag in ("HAZE", "SHADOW", "SKYBOX", "REFLECTION"):
            self._renderer.scene.flags[int(getattr(mujoco.mjtRndFlag, f"mjRND_{flag}"))] = 0
        near = model.vis.map.znear * model.stat.extent
        for eye in self._renderer.scene.camera:
            eye.frustum_center = near * ((camera.width - 1) / 2.0 - camera.cx) / camera.fx
            # Half the width of the near plane; 0 would take it from the aspect, right for fx = fy only.
            eye.frustum_width = near * camera.width / 2.0 / camera.fx
            eye.frustum_top = near * (camera.cy + 0.5) / camera.fy
            eye.frustum_bottom = near * (camera.cy + 0.5 - camera.height) / camera.fy

    def _sample_nearest_mipmap(self) -> None:
        """Blend four texels for a pixel, not the eight of two mipmap levels: a third of the drawing time."""
        from OpenGL import GL  # needs a platform, which is chosen by MUJOCO_GL

        context = self._renderer._mjr_context
        for texture in context.texture[: context.ntexture]:
            GL.glBindTexture(GL.GL_TEXTURE_2D, int(texture))
            GL.glTexParameteri(GL.GL_TEXTURE_2D, GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR_MIPMAP_NEAREST)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)

    def draw(self, R_world_camera: Array, t_world_camera: Array) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) RGB seen by a camera (RDF) with this pose."""
        for eye in self._renderer.scene.camera:
            eye.pos = t_world_camera
            eye.forward = R_world_camera[:, 2]
            eye.up = -R_world_camera[:, 1]
        return np.asarray(self._renderer.render(), dtype=np.uint8)

    def draw_from(self, body: Pose) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) RGB of the camera on a body at this pose."""
        return self.draw(*camera_pose(body, self._mount.t_body_camera, self._mount.stabilised))

    def close(self) -> None:
        """Free the OpenGL context; idempotent."""
        self._renderer.close()


def camera_pose(body: Pose, t_body_camera: Array, stabilised: bool) -> tuple[Array, Array]:
    """Return (R_world_camera (3, 3), t_world_camera (3,)) of a front camera.

    A stabilised camera sees neither roll nor pitch and sits where it would on a level body.
    """
    R_world_body = (body.levelled if stabilised else body).R_world_body
    return R_world_body @ R_BODY_CAMERA, body.position + R_world_body @ t_body_camera
