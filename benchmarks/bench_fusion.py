"""Time and agreement of the fusion on one core, beside the same mathematics in other hands.

Run: python benchmarks/bench_fusion.py

filterpy and Stone Soup are run on the same measurements when they can be imported. They are no dependencies
of noctule: install them into an environment of their own together with it. Times are the best of five rounds,
and in that comparison those of the processor.
"""

from __future__ import annotations

import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")

import datetime
import time
from collections.abc import Callable

import numpy as np
from timing import ROUNDS, least, measure

from noctule.estimation.contributions import contribution_of, from_bytes, to_bytes
from noctule.estimation.delayed import DelayedFilter, FilterSettings
from noctule.estimation.filter_state import StateEstimate
from noctule.estimation.information_filter import InformationState, assimilate, information_predict
from noctule.estimation.kalman_filter import correct, predict
from noctule.estimation.measurements import Measurement, linearise
from noctule.estimation.network import Network, Node
from noctule.estimation.network_study import made_up_flight
from noctule.estimation.vehicle_model import ProcessNoise, VehicleModel, process_covariance, transition

STEPS = 2000
MODEL, NOISE, NOTHING = VehicleModel.identified(), ProcessNoise(), np.zeros(4)
PARAMETERS = (NOTHING, MODEL.input_gains, MODEL.drags, NOISE.densities)


def parts() -> None:
    """Print the times of the pieces for 8 and 11 states, with a pose of four numbers."""
    print(f"{'':52s}{'median':>10s}{'p95':>10s}  [us]")
    for n in (8, 11):
        flight = made_up_flight(100, 0, MODEL, NOISE, n)
        x, P = flight.start.x, flight.start.P
        pose = next(z for z in flight.measurements if z.source == "depth")
        information = InformationState.of(flight.start)
        shared = contribution_of(x, pose)
        message = to_bytes(shared)

        def step(x=x, P=P, pose=pose):
            x, P = predict(x, P, 0.01, *PARAMETERS)
            return correct(x, P, *linearise(x, pose.components, pose.z), pose.R)

        def information_step(state=information, part=shared):
            y, Y = information_predict(state.y, state.Y, 0.01, *PARAMETERS)
            return y + part.i, Y + part.I

        cases: dict[str, Callable[[], object]] = {
            "predict and correct": step,
            "predict and correct, plain numpy": lambda x=x, P=P, pose=pose: numpy_step(x, P, 0.01, pose),
            "predict and add a contribution, y and Y": information_step,
            "add a contribution to mean and covariance": lambda x=x, P=P, c=shared: assimilate(
                x, P, c.i, c.I
            ),
            "contribution to bytes": lambda c=shared: to_bytes(c),
            "contribution from bytes, checked": lambda m=message: from_bytes(m),
        }
        for name, call in cases.items():
            median, p95 = measure(call)
            print(f"{f'{n} states: {name}':52s}{median:10.1f}{p95:10.1f}")


def network_steps(nodes: int, gate: bool) -> tuple[float, float]:
    """Return median and 95th percentile [us] of a measurement used and shared with all nodes, in order."""
    return least(_network_times(nodes, gate) for _ in range(ROUNDS))


def _network_times(nodes: int, gate: bool) -> list[float]:
    settings = FilterSettings() if gate else FilterSettings(gate=None)
    flight = made_up_flight(STEPS, 1, MODEL, NOISE)
    names = ("onboard", "depth", "markers")[:nodes]
    network = Network([Node(name, flight.start, MODEL, settings) for name in names])
    times = []
    for z in flight.measurements:
        start = time.perf_counter_ns()
        network.measure(z.source, z, z.stamp)
        network.deliver(z.stamp)
        for node in network.nodes.values():
            node.estimate(z.stamp)
        times.append((time.perf_counter_ns() - start) * 1e-3)
    return times


def delayed_steps() -> tuple[float, float]:
    """Return median and 95th percentile [us] of a gated measurement as it arrives, 40 to 90 ms late."""
    return least(_delayed_times() for _ in range(ROUNDS))


def _delayed_times() -> list[float]:
    model = VehicleModel.identified(delay=0.02)
    flight = made_up_flight(STEPS, 2, model, NOISE)
    filter_, commands, times = DelayedFilter(flight.start, model), list(reversed(flight.inputs)), []
    for m in np.argsort(flight.arrivals, kind="stable"):
        now = float(flight.arrivals[m])
        while commands[-1:] and commands[-1].stamp <= now:
            filter_.insert(commands.pop())
        start = time.perf_counter_ns()
        filter_.insert(flight.measurements[m])
        filter_.estimate(now)
        times.append((time.perf_counter_ns() - start) * 1e-3)
    return times


def numpy_step(x: np.ndarray, P: np.ndarray, dt: float, z: Measurement) -> tuple[np.ndarray, np.ndarray]:
    """Predict and correct as the textbook writes it, in numpy; the model's own functions are shared."""
    x1, F = transition(x, dt, NOTHING, MODEL.input_gains, MODEL.drags)
    P = F @ P @ F.T + process_covariance(0.5 * (x[3] + x1[3]), dt, MODEL.drags, NOISE.densities, x.size)
    residual, H = linearise(x1, z.components, z.z)
    S = H @ P @ H.T + z.R
    K = np.linalg.solve(S, H @ P).T
    A = np.eye(x.size) - K @ H
    return x1 + K @ residual, A @ P @ A.T + K @ z.R @ K.T


def by_noctule(start: StateEstimate, measurements: tuple[Measurement, ...]) -> list[np.ndarray]:
    x, P, now, found = start.x, start.P, start.stamp, []
    for z in measurements:
        x, P = predict(x, P, z.stamp - now, *PARAMETERS)
        x, P = correct(x, P, *linearise(x, z.components, z.z), z.R)
        now = z.stamp
        found.append(x)
    return found


def by_numpy(start: StateEstimate, measurements: tuple[Measurement, ...]) -> list[np.ndarray]:
    x, P, now, found = start.x, start.P, start.stamp, []
    for z in measurements:
        x, P = numpy_step(x, P, z.stamp - now, z)
        now = z.stamp
        found.append(x)
    return found


def by_filterpy(start: StateEstimate, measurements: tuple[Measurement, ...]) -> list[np.ndarray]:
    from filterpy.kalman import ExtendedKalmanFilter

    class Vehicle(ExtendedKalmanFilter):
        def predict_x(self, u=0):
            self.x = self.ahead

    ekf, now, found = Vehicle(start.x.size, 4), start.stamp, []
    ekf.x, ekf.P = start.x.copy(), start.P.copy()
    for z in measurements:
        dt = z.stamp - now
        ekf.ahead, ekf.F = transition(ekf.x, dt, NOTHING, MODEL.input_gains, MODEL.drags)
        ekf.Q = process_covariance(
            0.5 * (ekf.x[3] + ekf.ahead[3]), dt, MODEL.drags, NOISE.densities, ekf.x.size
        )
        ekf.predict()
        parts = z.components
        ekf.update(
            z.z,
            lambda x, parts=parts, m=z.z: linearise(x, parts, m)[1],
            lambda x, parts=parts, m=z.z: m - linearise(x, parts, m)[0],
            R=z.R,
        )
        now = z.stamp
        found.append(ekf.x.copy())
    return found


def by_stonesoup(start: StateEstimate, measurements: tuple[Measurement, ...]) -> list[np.ndarray]:
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.nonlinear import GaussianTransitionModel
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    n = start.x.size

    def flat(state) -> np.ndarray:
        return np.asarray(state.state_vector, dtype=float).ravel()

    class Motion(GaussianTransitionModel):
        @property
        def ndim_state(self):
            return n

        def function(self, state, noise=False, time_interval=None, **_):
            dt = time_interval.total_seconds()
            return StateVector(transition(flat(state), dt, NOTHING, MODEL.input_gains, MODEL.drags)[0])

        def jacobian(self, state, time_interval=None, **_):
            x, dt = flat(state), time_interval.total_seconds()
            ahead, F = transition(x, dt, NOTHING, MODEL.input_gains, MODEL.drags)
            self.yaw = 0.5 * (x[3] + ahead[3])  # the predictor asks for the covariance next, without a state
            return F

        def covar(self, prior=None, time_interval=None, **_):
            dt = time_interval.total_seconds()
            return process_covariance(self.yaw, dt, MODEL.drags, NOISE.densities, n)

        def pdf(self, *_, **__):
            raise NotImplementedError

        rvs = pdf

    class Sensor(NonLinearGaussianMeasurement):
        z: Measurement = Property(doc="what was measured")

        @property
        def ndim_meas(self):
            return self.z.z.size

        def function(self, state, noise=False, **_):
            return StateVector(self.z.z - linearise(flat(state), self.z.components, self.z.z)[0])

        def jacobian(self, state, **_):
            return linearise(flat(state), self.z.components, self.z.z)[1]

    def sensor(z: Measurement) -> Sensor:
        return Sensor(ndim_state=n, mapping=tuple(range(z.z.size)), noise_covar=z.R, z=z)

    epoch = datetime.datetime(2026, 1, 1)
    predictor, updater, found = ExtendedKalmanPredictor(Motion()), ExtendedKalmanUpdater(), []
    state = GaussianState(StateVector(start.x), start.P, timestamp=epoch)
    for z in measurements:
        at = epoch + datetime.timedelta(seconds=z.stamp)
        prediction = predictor.predict(state, timestamp=at)
        detection = Detection(StateVector(z.z), timestamp=at, measurement_model=sensor(z))
        state = updater.update(SingleHypothesis(prediction, detection))
        found.append(flat(state))
    return found


def compare() -> None:
    """Run everybody on one flight and print time, error and difference to noctule."""
    flight = made_up_flight(STEPS, 0, MODEL, NOISE)
    others = {
        "noctule, compiled": by_noctule,
        "numpy": by_numpy,
        "filterpy": by_filterpy,
        "Stone Soup": by_stonesoup,
    }
    reference = np.array(by_noctule(flight.start, flight.measurements))
    print(f"\n{STEPS} measurements of three sensors, 11 states, no commands known")
    print(f"{'':24s}{'us a step':>10s}{'rms [mm]':>10s}{'largest difference':>20s}")
    for name, run in others.items():
        try:
            run(flight.start, flight.measurements[:20])
        except ImportError as missing:
            print(f"{name:24s} not installed ({missing.name})")
            continue
        taken = np.inf
        for _ in range(ROUNDS):
            begun = time.process_time()
            found = np.array(run(flight.start, flight.measurements))
            taken = min(taken, (time.process_time() - begun) / STEPS * 1e6)
        rms = 1e3 * np.sqrt(np.mean(np.sum((found - flight.truths)[STEPS // 4 :, :3] ** 2, axis=1)))
        print(f"{name:24s}{taken:10.1f}{rms:10.1f}{np.abs(found - reference).max():20.1e}")


if __name__ == "__main__":
    parts()
    for label, result in {
        "11 states: three nodes, one measurement, no gates": network_steps(3, False),
        "11 states: three nodes, one measurement, gated": network_steps(3, True),
        "11 states: one filter, measurements 40 to 90 ms late": delayed_steps(),
    }.items():
        print(f"{label:52s}{result[0]:10.1f}{result[1]:10.1f}")
    compare()
