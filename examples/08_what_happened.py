"""Find out what pushed on an arm: when it began, how large it was, where, and which gain to take.

An arm holds still for 13 s. Its joint sensors are noisy and its torque sensors are a little off. For one second some
6 N push 50 mm beside its tool. The first ten seconds are known to be free of any push.
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

DT, FREE, SAMPLES = 1e-3, 10000, 13000  # [s], samples that are known to be free, all samples
TOOL, LIFT = "effector_body", "effector_body.Fz'"  # a frame, and the component that is watched, in the frame's axes
np.set_printoptions(precision=4, suppress=True)

# What is recorded: q and v at every sample, tau as the mean between two.
model = pin.buildSampleModelManipulator()
q, time = np.full(model.nq, 0.4), np.arange(SAMPLES + 1) * DT
noise = SensorNoise(joint_rate=1e-4)  # [rad/s] per sample
v = 1e-4 * np.random.default_rng(1).normal(size=(SAMPLES + 1, model.nv))
J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId(TOOL))
angle = np.linspace(-0.5, 0.5, 1000)[:, None]  # the push turns while it lasts
force = 6.0 * np.hstack([0.3 + 0.0 * angle, np.sin(angle), np.cos(angle)])
wrench = np.zeros((SAMPLES, 6))
wrench[11000:12000] = np.hstack([force, np.cross([0.05, 0.0, 0.0], force)])
gravity = pin.computeGeneralizedGravity(model, model.createData(), q)
tau = gravity + 0.02 * (1.0 + np.arange(model.nv)) - wrench @ J  # the sensors are off by 20 to 120 mN m

# Which gain: slow enough for the noise that is wanted, or fast enough for the delay that is wanted.
observer = ForceLevelObserver(model, [Application(TOOL, "wrench", "frame")])
quiet = gain_for_deviation(observer, q, DT, noise, LIFT, 0.1)
quick = gain_for_lag(observer, DT, 10e-3)
print(f"gain      {quiet:.0f} 1/s for 0.1 N of noise in {LIFT}, {quick:.0f} 1/s for a lag of 10 ms")
gain = min(quiet, quick)
observer = ForceLevelObserver(model, [Application(TOOL, "wrench", "frame")], gain)
expected = predict(observer, q, DT, noise)
print(f"expected  noise {expected.deviation} N and N m, lag {1e3 * expected.lag:.1f} ms at {gain:.0f} 1/s")

# What the free seconds say: how far off the estimate is, and how much it wanders.
estimate = observer.run(time, np.tile(q, (SAMPLES + 1, 1)), v, tau)
free = estimate.components[500:FREE]  # without the first half second, in which the filter starts
bias, covariance = bias_of(free), np.cov(free.T)
print(f"bias      {bias.mean} +- {bias.standard_error} N and N m")

# When: a threshold that the free run passes once in 1000 s.
detector = calibrate_level(time[500 : FREE + 1], estimate.component(LIFT)[500:FREE], 1e-3, 1.0 / gain)
for event in detector.detect(time, estimate.component(LIFT)):
    if event.onset > 0.5:
        print(
            f"push      from {event.onset:.3f} s to {event.end:.3f} s, known at {event.alarm:.3f} s, {event.peak:.2f} N"
        )

# Where: one line of action from one instant, one point from the second in which the force turned.
found = bias.remove(estimate.components)
line = locate(found[11500], covariance)
outline = [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]]  # a plate on the tool [m]
crossing = line.cross(outline)
print(f"line      {line.verdict}; it crosses the plate at {crossing.point} m, {crossing.verdict} of the outline")
place = locate_series(found[11200:11990], covariance)
print(f"place     {place.verdict} at {place.point} +- {np.sqrt(np.diag(place.covariance))} m")
