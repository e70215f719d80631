"""Analyse a push on an arm: when it began, how large it was and where it acted, and which gain to use.

An arm holds still for 13 s. Its joint sensors are noisy and its torque sensors have a small bias. For one second, a
force of about 6 N acts 50 mm beside the tool. The first ten seconds are known to be without any push.
"""

import numpy as np
import pinocchio as pin

from aerobat_pin.observers import (
    Application,
    ForceLevelObserver,
    SensorNoise,
    bias_of,
    calibrate_level,
    gain_for_deviation,
    gain_for_lag,
    locate,
    locate_series,
    predict,
)

DT, FREE, SAMPLES = 1e-3, 10000, 13000  # time step [s], number of samples before the push is possible, of all samples
TOOL, LIFT = "effector_body", "effector_body.Fz'"  # a frame, and the component to watch, in axes of the frame
np.set_printoptions(precision=4, suppress=True)

# The recorded data: q and v at every sample, tau as the mean between two samples.
model = pin.buildSampleModelManipulator()
q, time = np.full(model.nq, 0.4), np.arange(SAMPLES + 1) * DT
noise = SensorNoise(joint_rate=1e-4)  # [rad/s] per sample
v = 1e-4 * np.random.default_rng(1).normal(size=(SAMPLES + 1, model.nv))
J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId(TOOL))
angle = np.linspace(-0.5, 0.5, 1000)[:, None]  # the force turns during the push
force = 6.0 * np.hstack([0.3 + 0.0 * angle, np.sin(angle), np.cos(angle)])
wrench = np.zeros((SAMPLES, 6))
wrench[11000:12000] = np.hstack([force, np.cross([0.05, 0.0, 0.0], force)])
gravity = pin.computeGeneralizedGravity(model, model.createData(), q)
tau = gravity + 0.02 * (1.0 + np.arange(model.nv)) - wrench @ J  # the sensors have a bias of 20 to 120 mN m

# Which gain: low enough for the wanted noise, or high enough for the wanted lag.
observer = ForceLevelObserver(model, [Application(TOOL, "wrench", "frame")])
quiet = gain_for_deviation(observer, q, DT, noise, LIFT, 0.1)
quick = gain_for_lag(observer, DT, 10e-3)
print(f"gain      {quiet:.0f} 1/s for 0.1 N of noise in {LIFT}, {quick:.0f} 1/s for a lag of 10 ms")
gain = min(quiet, quick)
observer = ForceLevelObserver(model, [Application(TOOL, "wrench", "frame")], gain)
expected = predict(observer, q, DT, noise)
print(f"expected  noise {expected.deviation} N and N m, lag {1e3 * expected.lag:.1f} ms at {gain:.0f} 1/s")

# The seconds without a push give the bias of the estimate and its covariance.
estimate = observer.run(time, np.tile(q, (SAMPLES + 1, 1)), v, tau)
free = estimate.components[500:FREE]  # without the first half second, in which the filter starts
bias, covariance = bias_of(free), np.cov(free.T)
print(f"bias      {bias.mean} +- {bias.standard_error} N and N m")

# When: a threshold that noise exceeds once in 1000 s.
detector = calibrate_level(time[500 : FREE + 1], estimate.component(LIFT)[500:FREE], 1e-3, 1.0 / gain)
for event in detector.detect(time, estimate.component(LIFT)):
    if event.onset > 0.5:
        print(
            f"push      from {event.onset:.3f} s to {event.end:.3f} s, known at {event.alarm:.3f} s, {event.peak:.2f} N"
        )

# Where: a line of action from one instant, and a point from the second during which the force turned.
found = bias.remove(estimate.components)
line = locate(found[11500], covariance)
outline = [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]]  # a plate on the tool [m]
crossing = line.cross(outline)
print(f"line      {line.verdict}; it crosses the plate at {crossing.point} m, {crossing.verdict} of the outline")
place = locate_series(found[11200:11990], covariance)
print(f"place     {place.verdict} at {place.point} +- {np.sqrt(np.diag(place.covariance))} m")
