"""The prose of docs/raw_sensors.md; `raw_sensors.py` fills in the figures."""

TEXT = """# Forces from raw sensors

Written by `benchmarks/raw_sensors.py`. A laboratory has motion capture, an inertial unit, a crank encoder and
torques, and no velocities. The joint smoother finds motion and forces together from their samples; how to use it is
in [recorded.md](recorded.md).

State: pose error on SE(3), twist error, bias of gyro and accelerometer, angle, rate and acceleration of the crank, and
for each point a force that walks, its slope that walks too, and a force that is white; if asked for also factors of
mass and air. What the forces have in common and how they differ walk by sizes of their own. The joints follow the
linkage. The dynamics are linear about a nominal motion (Pinocchio's derivatives of inverse dynamics at the middle of
each interval, the air flown along the motion and along shifted ones, the added mass as inertia); every sample is an
update at its own time; a backward pass smooths; and the whole is repeated about the result until it no longer changes.
Walks and white noise of the forces, per world axis, and the crank's jerk are chosen by the likelihood of the samples,
and printed; values that you state are kept. A force may jump where that makes the samples likelier by a factor of e^10
or more.

Sensors: poses at 100 Hz (1 mm, 3 mrad), gyro (3 mrad/s, bias 2 mrad/s), accelerometer (0.05 m/s2, bias 0.05 m/s2),
encoder (4096 counts) and four joint torques (0.5 mN m) at 1 kHz. "paper" is the scenario `raw_sensors`; "benchmark" is
`observer_benchmark`, "guard" the same forces on the 92 g robot at 4.75 Hz. Worse wing and worst of the seeds, against
the true force without its noise; "motor": only the torque at the crank is known. In the row "no torque", the force is
the sum of both wings. "From a table" is read from a CSV as [recorded.md](recorded.md) describes it. All flights but
those with the step on one wing have equal forces on both wings, mirrored in "paper", which the likelihood finds.

## What is found

NEES is the error squared over the stated covariance, per component (1 if the deviations are true; range over the
seeds); the next column is the ratio of the stated deviation to the rms error, for the component where it is largest.
The cost is CPU time on one core for 2 s of flight, choice of the walk included. The figures of the causal filter leave
out its first 0.1 s."""
HEAD = """
| flight | R2 of Fx/Fy/Fz | rms error [mN] | NEES | deviation/error | cost |
|---|---|---|---|---|---|"""
OWN = """
## Are the deviations true?

Truths and samples drawn from the smoother's own linear model (first second of each flight, slow forces of both wings):

| flight | NEES | inside 1.96 deviations |
|---|---|---|"""
MOUNT = """
## The accelerometer's place and turn

"Off" means 5 mm along x and half a degree about every axis from what is stated; "calibrated", that `aerobat calibrate`
has found it from 2 s of a flight without unknown forces that starts with 6 rad/s of roll and yaw. The errors are the
rms over {flights} such flights, the deviations those that it states.

| paper, all | R2 of Fx/Fy/Fz | error of place x/y/z [mm] | deviation | error of turn roll/pitch/yaw [deg] | deviation |
|---|---|---|---|---|---|"""
COST = """## What it costs, and what it does not see

* With given walks, 2 s of flight take {given:.1f} s of CPU. Records beyond 5 s are smoothed in overlapping parts: 10 s
  need {short:.0f} MB beyond the log, 60 s need {long:.0f} MB.
* The filter for streams (`aerobat_pin.aerobat.raw.JointFilter`) takes a set of samples at a time. A quarter of its
  time flies the air seven times, for its derivative by the twist.
* Poses may come to that filter up to 50 ms late: it carries them along its own motion since their stamp. Other sensors'
  samples must come before the next update.
* Fx on the paper's flight has a signal of 9 mN; without an accelerometer its error is half of that.
* If motor torque and poses alone must tell forces of the two wings apart that differ, the deviations are too small: the
  rows with the step on one wing.
* An accelerometer off its stated place or turn is hardly seen in the innovations, and makes Fx worse:
  calibrate it.
* The air's derivative by the body's twist is that of a lasting shift; on flights far beyond stall more linearisations
  are needed, and a warning tells if they did not settle."""
