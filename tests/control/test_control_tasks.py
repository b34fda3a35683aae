import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from noctule.control.hierarchy import solve_hierarchy
from noctule.control.servoing import camera_twist_matrix
from noctule.control.tasks import (
    CollisionAvoidance,
    SafetyBox,
    Task,
    TaskError,
    Visibility,
    point_interaction,
)

B = camera_twist_matrix(np.array([0.09, 0.0, 0.0]))
COORDINATE = st.floats(-0.8, 0.8)
POINT = st.tuples(COORDINATE, COORDINATE, st.floats(0.3, 5.0)).map(np.array)  # x, y normalised, depth [m]


def avoidance(m1, m2, z1=1.0, z2=1.0, sigma=0.05, gain=0.5, activation=1.0):
    return CollisionAvoidance(
        m1=np.array(m1), m2=np.array(m2), z1=z1, z2=z2, sigma=sigma, gain=gain, activation=activation
    )


def visibility(points, centroid_ref=(0.0, 0.0), depth=1.0, gain=0.2):
    return Visibility(points=np.array(points), centroid_ref=np.array(centroid_ref), depth=depth, gain=gain)


def moved(X, nu_c, dt):
    """Points (n, 3) in the camera after the camera moved with nu_c for a tiny dt."""
    return X + dt * (-nu_c[:3] - np.cross(nu_c[3:], X))


def project(X):
    return X[:, :2] / X[:, 2:]


def numeric_jacobian(error_of_points, X, step=1e-6):
    """Central differences of an error of the points X (n, 3) for the six twists."""
    columns = [
        (error_of_points(moved(X, nu_c, step)) - error_of_points(moved(X, nu_c, -step))) / (2 * step)
        for nu_c in np.eye(6)
    ]
    return np.column_stack(columns)


def in_space(point):
    return np.array([point[0] * point[2], point[1] * point[2], point[2]])


@given(POINT)
def test_the_point_interaction_matches_finite_differences(point):
    numeric = numeric_jacobian(lambda X: project(X)[0], in_space(point)[None])
    np.testing.assert_allclose(point_interaction(point[:2], point[2]), numeric, atol=1e-7)


@given(POINT, POINT)
def test_the_avoidance_jacobian_matches_finite_differences(a, b):
    X = np.array([in_space(a), in_space(b)])
    if np.linalg.norm(a[:2] - b[:2]) < 0.02:
        return

    def error(X):
        m = project(X)
        return avoidance(m[0], m[1], X[0, 2], X[1, 2]).error()

    task = avoidance(a[:2], b[:2], a[2], b[2])
    np.testing.assert_allclose(task.jacobian(), numeric_jacobian(error, X), atol=1e-5)


@given(POINT)
def test_the_visibility_jacobian_matches_finite_differences_at_its_virtual_point(point):
    numeric = numeric_jacobian(lambda X: visibility(project(X)).error(), in_space(point)[None])
    task = visibility(point[None, :2], depth=point[2])
    np.testing.assert_allclose(task.jacobian(), numeric, atol=1e-7)


def test_the_visibility_jacobian_misses_the_spread_of_a_cloud_in_yaw_as_documented():
    rng = np.random.default_rng(3)
    m = rng.uniform(-0.5, 0.5, (40, 2))
    X = np.column_stack([m, np.ones(40)]) * 2.0
    numeric = numeric_jacobian(lambda X: visibility(project(X)).error(), X)
    x = m[:, 0].mean()
    assert numeric[0, 4] == pytest.approx(-(1.0 + x**2 + m[:, 0].var()), rel=1e-6)
    np.testing.assert_allclose(visibility(m, depth=2.0).jacobian()[:, :3], numeric[:, :3], atol=1e-8)


def test_the_avoidance_error_is_zero_at_the_reference_width():
    assert avoidance([0.02, 0.1], [-0.03, 0.1], sigma=0.05).error() == pytest.approx(0.0)


def test_the_avoidance_has_no_lateral_term_for_equal_depths_and_heights():
    J = (avoidance([0.1, 0.0], [0.2, 0.0]).jacobian() @ camera_twist_matrix(np.zeros(3)))[0]
    assert J[1] == 0.0
    assert J[0] > 0.0


def test_the_avoidance_turns_toward_a_column_on_the_left():
    # The weakness of the published law: widths grow toward the border, so the task looks at the column.
    nu = solve_hierarchy([avoidance([-0.3, 0.0], [-0.1, 0.0]).rows(B)], np.zeros(4))
    assert nu[0] < 0.0
    assert nu[3] > 0.0


def test_the_rows_hold_the_four_degrees_of_freedom_and_minus_gain_times_error():
    task = avoidance([0.3, 0.0], [0.1, 0.0], gain=0.5, activation=0.4)
    J, demand, activation = task.rows(B)
    np.testing.assert_allclose(J, task.jacobian() @ B)
    np.testing.assert_allclose(demand, [-0.5 * 0.15])
    assert activation == 0.4


@given(st.floats(-0.3, 0.3), st.floats(0.5, 3.0), st.floats(-0.4, 0.4), st.floats(-0.8, 0.8))
def test_the_top_active_tasks_error_decreases(centre, depth, forward, turn):
    X = np.array([[centre - 0.1, 0.02, 1.0], [centre + 0.1, 0.02, 1.0]]) * depth
    task = avoidance(*project(X), z1=depth, z2=depth)
    below = visibility([[0.3, 0.2]]).rows(B)
    nu = solve_hierarchy([task.rows(B), below], np.array([forward, 0.1, 0.0, turn]))
    after = avoidance(*project(moved(X, B @ nu, 1e-4)), z1=depth, z2=depth)
    assert abs(after.error()[0]) < abs(task.error()[0])


def test_a_wrong_depth_still_lets_the_visibility_error_decrease():
    X = np.array([[0.5, 0.2, 1.0], [0.4, 0.1, 1.0], [0.45, 0.3, 1.0]]) * 2.0
    task = visibility(project(X), depth=1.0)  # half the true depth
    nu = solve_hierarchy([task.rows(B)], np.zeros(4))
    after = visibility(project(moved(X, B @ nu, 1e-3)))
    assert np.linalg.norm(after.error()) < np.linalg.norm(task.error())


def test_a_new_task_needs_only_an_error_and_a_jacobian():
    class KeepDistance(Task):
        __slots__ = ()

        def error(self):
            return np.array([0.2])

        def jacobian(self):
            return np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]])

    task = KeepDistance(gain=2.0)
    assert task.name == "KeepDistance"
    assert task.activation == 1.0
    np.testing.assert_allclose(solve_hierarchy([task.rows(B)], np.zeros(4)), [0.4, 0.0, 0.0, 0.0])


def test_a_task_without_its_two_methods_cannot_be_made():
    with pytest.raises(TypeError, match="abstract"):
        Task(gain=1.0)


def test_the_safety_box_tells_points_inside_from_points_outside():
    box = SafetyBox(10.0, 20.0, 100.0, 80.0)
    inside = box.contains(np.array([[50.0, 50.0], [9.9, 50.0], [50.0, 80.1], [10.0, 80.0]]))
    assert inside.tolist() == [True, False, False, True]


def test_the_safety_box_takes_the_centroid_of_the_reference_points_that_it_holds():
    box = SafetyBox(0.0, 0.0, 100.0, 100.0)
    np.testing.assert_allclose(
        box.centroid_of(np.array([[10.0, 20.0], [30.0, 40.0], [500.0, 0.0]])), [20, 30]
    )
    assert box.centroid_of(np.array([[500.0, 0.0]])) is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: avoidance([0.1, 0.0], [0.1, 0.0]),
            "CollisionAvoidance: both edges at [0.1, 0.0], expected two points",
        ),
        (
            lambda: avoidance([0.1, 0.0], [0.2, 0.0], z2=-1.0),
            "CollisionAvoidance: depth is -1 m, expected more than 0; give an estimate",
        ),
        (
            lambda: avoidance([0.1, 0.0], [0.2, 0.0], gain=0.0),
            "CollisionAvoidance: gain is 0, expected more than 0; or leave it out",
        ),
        (
            lambda: avoidance([0.1, 0.0], [0.2, 0.0], activation=1.5),
            "CollisionAvoidance: activation 1.5, expected 0 to 1; take Activation.h",
        ),
        (
            lambda: visibility(np.empty((0, 2))),
            "Visibility: points have shape (0, 2), expected (n, 2) with n of 1 or more",
        ),
        (
            lambda: visibility([[0.0, 0.0]], depth=float("nan")),
            "Visibility: depth is nan m, expected more than 0; give an estimate",
        ),
        (
            lambda: SafetyBox(10.0, 0.0, 5.0, 8.0),
            "SafetyBox: (10, 0) to (5, 8) px is empty, expected left < right and top < bottom",
        ),
    ],
)
def test_a_task_of_bad_numbers_says_what_is_wrong(make, message):
    with pytest.raises(TaskError) as caught:
        make()
    assert str(caught.value) == message
