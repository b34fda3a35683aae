"""Visual servoing: from a homography, or a turn and a translation, to a velocity.

X_cur = R X_ref + t, H = R + t n'/d and m_cur ~ H m_ref, with n the unit normal and d the distance of the
plane in the reference frame. Twists are (v, w), the velocity of the camera in its own RDF axes. Equation
numbers are those of Toro-Arcila et al.
"""

from __future__ import annotations

import numpy as np

from noctule.geometry import R_BODY_CAMERA, Array, skew

_R_FRD_CAMERA: Array = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_R_FRD_CAMERA.setflags(write=False)
_FLU_OF_FRD = np.array([1.0, -1.0, -1.0])  # forward stays, right becomes left, down becomes up


def _vee(A: Array) -> Array:
    """Return (A32, A13, A21) of A (3, 3)."""
    return np.array([A[2, 1], A[0, 2], A[1, 0]])


def _homogeneous(m: Array) -> Array:
    """Return (x, y, 1) of a normalised point (2,) or (3,)."""
    return np.array([m[0], m[1], 1.0])


def homography_error(H: Array, m_ref: Array) -> Array:
    """Return e = (e_v, e_w), (6,), as published in (2): e_v = (H - I) m*, [e_w]x = H - H'.

    `H` (3, 3) takes reference to current and has a median singular value of 1; `m_ref` (2,) or (3,) is a
    normalised point of the plane in the reference image. H - H' is skew, so e_w = (A32, A13, A21). Turning
    mixes into e_v and translation into e_w; `compensated_error` takes both apart.
    """
    return np.concatenate([(H - np.eye(3)) @ _homogeneous(m_ref), _vee(H - H.T)])


def compensated_error(H: Array, R: Array, m_ref: Array) -> Array:
    """Return e = (e_v, e_w), (6,), with the turn taken out: e_v = (H - R) m*, [e_w]x = R - R'.

    Eq. (2) corrected: (H - I) m* turns yaw into sideways motion, so curves are cut, and H - H' holds t n' - n
    t'. `R` (3, 3) is the estimated rotation, reference to current.
    """
    return np.concatenate([(H - R) @ _homogeneous(m_ref), _vee(R - R.T)])


def upright_error(t: Array, yaw: float) -> Array:
    """Return e = (e_v, e_w), (6,), of the upright unknowns: e_v = t, e_w = (0, 2 sin yaw, 0).

    `t` (3,) in mean depths and `yaw` [rad] are of X_cur = R_y(yaw) X_ref + t: yaw is positive when the camera
    has turned left. It equals `compensated_error` of H = R_y(yaw) + t e3'.
    """
    return np.array([t[0], t[1], t[2], 0.0, 2.0 * np.sin(yaw), 0.0])


def interaction_at_zero(m_ref: Array, n_over_d: Array) -> Array:
    """Return L0, (6, 6), with e_dot = L0 nu_c at e = 0 for `homography_error`.

    L0 = [[-(n.m*) I, [m*]x], [-[n]x, -2 I]], `n_over_d` (3,) [1/m] the plane's normal over its distance.
    """
    m = _homogeneous(m_ref)
    return np.block([[-(n_over_d @ m) * np.eye(3), skew(m)], [-skew(n_over_d), -2.0 * np.eye(3)]])


def camera_twist(error: Array, gains: Array | float) -> Array:
    """Return the camera's twist nu_c = +Lambda e, (6,), in camera axes.

    `gains` [1/s] is the diagonal of Lambda, (6,), or one number. Eq. (3) corrected: the printed minus belongs
    to the inverse homography; with H from reference to current every eigenvalue of L0 is negative, so minus
    diverges.
    """
    return np.asarray(gains * error, dtype=np.float64)


def camera_twist_matrix(t_body_camera: Array) -> Array:
    """Return B, (6, 4): the camera's twist in its own axes is B @ (forward, left, up, yaw rate).

    `t_body_camera` (3,) [m] is the camera's place on the body, FLU. A turn moves a camera that is not on the
    axis: v = R' (v_body + w x t).
    """
    R = R_BODY_CAMERA.T
    up = np.array([0.0, 0.0, 1.0])
    B = np.zeros((6, 4))
    B[:3, :3] = R
    B[:3, 3] = R @ np.cross(up, t_body_camera)
    B[3:, 3] = R @ up
    return B


def body_velocity(nu_c: Array, t_body_camera: Array) -> Array:
    """Return (forward, left, up, yaw rate), (4,), of a camera twist (6,): eqs. (5) and (6).

    The paper's robot frame {e} is forward-right-down, so both vectors of (5) are taken there and the result
    back to FLU: right and down change sign, and so does a yaw rate about down. Corrected: (6) drops the roll
    and pitch rates but keeps their lever arm; they are dropped before the arm, so that this undoes
    `camera_twist_matrix` exactly.
    """
    t_frd = _FLU_OF_FRD * t_body_camera
    v_frd = _R_FRD_CAMERA @ nu_c[:3]
    w_frd = np.array([0.0, 0.0, (_R_FRD_CAMERA @ nu_c[3:])[2]])
    v_flu = _FLU_OF_FRD * (v_frd + skew(t_frd) @ w_frd)
    return np.array([v_flu[0], v_flu[1], v_flu[2], -w_frd[2]])


def mean_distance(p: Array, p_ref: Array) -> float:
    """Return epsilon [px], the mean distance of points (n, 2) to those of the reference image; NaN for none.

    Eq. (7); corrected: the text calls it a mean square. It is a weak certificate: yaw trades against lateral
    motion, so 6 px may still be 0.2 m.
    """
    if len(p) == 0:
        return float("nan")
    return float(np.linalg.norm(np.asarray(p) - p_ref, axis=1).mean())
