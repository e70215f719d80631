"""What the sensors say of q, v and crank angle: each channel is checked before anything stores it, and carried to now.

A sample that is not finite, that has not changed for longer than its sensor's period, or that is farther from where the
channel must be than the robot can get, is not used, and counted. What takes its place is the last good sample, carried
on; a sample that is late by the delay of its sensor, or waits for the next one, is carried on in the same way:

    estimate(t) = sample + carrier(t) - carrier(t taken)

The carrier of the position is the integral of the velocity; of the attitude, the product of exp(omega dt); of the
velocity (world axes), the swing with the crank (`Nominal.swing`); of the body rate, the swing and the integral of J^-1
(thrusters' moment - nominal one + disturbance, while the gyro is believed); of the joints, the closed linkage at the
crank's angle; of the crank, its believed rate times time. Of all but velocity and rate, the mean of the last samples is
carried on, with the time constant `ANCHOR`. While the gyro shows nothing good, the attitude corrects the body rate, and
the position a velocity that is missing, by observers whose poles are `RATE_POLES` and `SPEED_POLES`. A gyro that jumps
by more than noise is on trial: the first sample waits for the next one to confirm it, since a single wrong one does not
last; then it is believed, until the attitude has turned as it says or as was expected, at odds of `SURE_OF_RATE`. So a
blow costs one sample, and a gyro that is wrong some ten. A channel that jumps is believed again where it comes back
within `REACH` of all that, or after `JUMP_BELIEVED`: then the world has changed, and not a sample. A punctual good
sample is passed on as it is, to the bit.
"""

from __future__ import annotations

from math import ceil, cos, isfinite, pi, sin

import numpy as np

from aerobat_pin.aerobat import Aerobat
from aerobat_pin.control.law import add_waves
from aerobat_pin.control.nominal_wrench import Nominal
from aerobat_pin.control.sensed_channels import (
    ATTITUDE,
    CHANNELS,
    GYRO_CHANNEL,
    JOINT_CHANNEL,
    POSITION,
    RATES,
    VELOCITY,
    Senses,
    add_channel,
    believed,
    follow_attitude,
    follow_position,
    gyro,
    is_good,
    judge_attitude,
    judge_crank,
    product,
    rotate_vector,
    taken_at,
    write_turn,
)
from aerobat_pin.linkage import joint_series, joints_at
from aerobat_pin.numerics import Array, Viewed, copy_values, fields_of, inner, kernel, new_state
from aerobat_pin.scenario import Scenario, SensorSection

ANCHOR = 0.02  # [s]
RATE_POLES, SPEED_POLES = 50.0, 80.0  # [rad/s]
DOUBTED, SLACK, SURE_OF_SAMPLE = 0.01, 0.05, 5.0  # [s], [rad/s], deviations: gyro and attitude agree in the mean
UNKNOWN_SPIN = 20.0  # [rad/s2]: what the body rate may gain beside what is known, before the gyro is on trial
LEAST_ATTITUDE_NOISE = 1e-3  # [rad] of the attitude
MOST_DEVIATIONS = 8.0  # standard deviations of a sensor's noise that a sample may be off
# Beside the noise, a sample may be off by the first from where it must be; by the second per second between samples
# (a blow of 10 ms and 25 mN s on a wing turns the body by 200 rad/s2 more than is known, and one of five times that is
# a blow, too); by the third per second without any.
REACH = {
    "position": (0.03, 0.0, 1.0),  # [m]
    "attitude": (0.06, 0.0, 1.0),  # [rad]
    "velocity": (0.05, 60.0, 3.0),  # [m/s]
    "gyro": (0.05, 1000.0, 10.0),  # [rad/s]
    "joint_angle": (0.2, 0.0, 0.0),  # [rad]
    "joint_rate": (5.0, 0.0, 0.0),  # [rad/s]
    "crank_angle": (0.3, 0.0, 3.0),  # [rad]
}


class SensedMotion(Viewed):
    """The motion that sensors show, checked and carried to now.

    Args:
        scenario: the believed sensors, course and crank.
        robot: the believed robot.
        nominal: its nominal flight.

    Attributes:
        q, v: (nq,), (nv,) configuration and velocity; the next sample is written over them.
        error: (6,) position off the course, world axes [m], and attitude off the level one, body axes [rad]; likewise.
        faults: (7, 3) counts of samples that were not used: rows as `CHANNELS`, columns as `FAULTS`.
        beyond: (7,) intervals by which each channel's last good sample is older than its period; likewise.
    """

    def __init__(self, scenario: Scenario, robot: Aerobat, nominal: Nominal) -> None:
        """Translate what is believed of the sensors into ticks; `restart` begins a flight."""
        dt, sensors, flight = scenario.simulation.dt, scenario.believed_sensors, scenario.flight
        fitted = [getattr(sensors, name) or SensorSection() for name in CHANNELS]
        delay = [ceil(sensor.delay / dt - 1e-6) for sensor in fitted]  # it is shown at the first sample after it
        series = joint_series(robot.linkage)
        sizes = {"waves": len(nominal.swing) // 2, "harmonics": len(series), "rows": max(delay) + 1}
        self._memory = new_state(Senses, nq=robot.model.nq, nv=robot.model.nv, **sizes)
        self._view()
        fields = self._fields
        fields.joints[:], fields.series[:] = (robot.idx_q, robot.idx_v), series
        fields.start[:], fields.course[:], fields.level[:] = flight.position, flight.velocity, nominal.quaternion
        fields.swing[:], fields.rate[...] = nominal.swing, 2.0 * pi * scenario.crank.frequency
        fields.wrench[:], fields.steering[:], fields.inertia[:] = nominal.wrench, nominal.steering, nominal.inertia
        fields.tick[...], fields.delay[:] = dt, delay
        fields.first[...] = np.radians(scenario.crank.start_deg)
        periods = [dt if sensor.rate is None else max(dt, 1.0 / sensor.rate) for sensor in fitted]
        fields.period[:] = np.ceil(np.array(periods) / dt - 1e-6)
        stands = scenario.crank.frequency == 0.0  # and with it the joints
        constant = [
            sensor.quantum > 0.0 or (stands and name in CHANNELS[4:])
            for name, sensor in zip(CHANNELS, fitted, strict=True)
        ]
        fields.still[:] = np.where(constant, fields.period, np.iinfo(np.intp).max // 2)
        for row, name, sensor, period in zip(fields.reach, CHANNELS, fitted, periods, strict=True):
            off, per_period, since = REACH[name]
            noise = max(sensor.noise) + sensor.quantum + sensor.walk
            row[:] = MOST_DEVIATIONS * noise + off + per_period * period, since * dt
            anchored = name not in ("velocity", "gyro")
            fields.share[CHANNELS.index(name)] = 1.0 - np.exp(-period / ANCHOR) if anchored else 1.0
        for k, (poles, period) in enumerate(((RATE_POLES, periods[ATTITUDE]), (SPEED_POLES, periods[POSITION]))):
            first = min(2.0 * poles * period, 0.8)
            fields.correct[k] = first, first**2 / 4.0 / period
        self._set_trust(fitted[ATTITUDE], fitted[GYRO_CHANNEL], periods[ATTITUDE], periods[GYRO_CHANNEL])

    def _set_trust(self, attitude: SensorSection, gyro: SensorSection, every: float, gyro_every: float) -> None:
        """Set how gyro and attitude judge each other; only if neither is late and both have one period [s]."""
        trust, correct = self._fields.trust, self._fields.correct[0, 0]
        punctual = attitude.delay == gyro.delay == 0.0 and every == gyro_every
        trust[0] = part = 1.0 - np.exp(-gyro_every / DOUBTED)
        spread = correct / every * np.sqrt(part / 2.0) * max(attitude.noise)
        jump = MOST_DEVIATIONS * np.sqrt(2.0) * max(gyro.noise) + UNKNOWN_SPIN * gyro_every
        trust[1:3] = (SLACK + SURE_OF_SAMPLE * spread, jump) if punctual else np.inf
        trust[3] = max(max(attitude.noise), LEAST_ATTITUDE_NOISE) ** 2

    def _view(self) -> None:
        self._fields = fields = fields_of(self._memory, Senses)
        self.q, self.v, self.error, self.faults = fields.q, fields.v, fields.error, fields.faults
        self.beyond = fields.beyond

    def restart(self) -> None:
        """Begin a flight: the first good sample of each channel is believed, wherever it is."""
        fields = self._fields
        fields.ticks[:] = fields.faults[:] = fields.age[:] = fields.trial[:] = 0

    def take(self, q: Array, v: Array, crank_angle: float, thrust: Array, push: Array) -> float:
        """Take a sample and return the crank angle [rad].

        Args:
            q: (nq,) configuration as the sensors show it.
            v: (nv,) velocity likewise.
            crank_angle: likewise [rad].
            thrust: (6,) mean wrench of the thrusters since the last sample, as believed.
            push: (6,) unknown wrench, as far as it is known; both at the body's centre of mass, body axes.
        """
        sense(self._memory, q, v, crank_angle, thrust, push)
        return float(self._fields.estimate[21])


@kernel
def sense(memory: Array, q: Array, v: Array, crank_angle: float, thrust: Array, push: Array) -> None:
    """Take a sample, see `SensedMotion.take`."""
    s = fields_of(memory, Senses)
    now, estimate = s.now, s.estimate
    row = s.ticks[0] % s.carriers.shape[0]
    at = s.carriers[row]
    copy_values(q, now[:7])
    copy_values(v, now[7:13])
    now[21] = crank_angle
    for i in range(4):
        now[13 + i], now[17 + i] = q[s.joints[0, i]], v[s.joints[1, i]]
    for c in range(7):
        s.age[c] += 1
    carry(s, at)

    judge_crank(s, at)
    close_for_crank(s, at)
    turn_on(s, at, thrust, push)
    seen = judge_attitude(s, at)
    gyro(s, at)
    if seen:
        follow_attitude(s, at)
    velocity(s, at)
    add_channel(s, POSITION, at)
    if s.age[POSITION] == 0:
        follow_position(s)
    add_channel(s, JOINT_CHANNEL, at)
    add_channel(s, RATES, at)

    copy_values(q, s.q)
    copy_values(v, s.v)
    copy_values(estimate, s.q[:7])
    copy_values(estimate[7:], s.v[:6])
    for i in range(4):
        s.q[s.joints[0, i]], s.v[s.joints[1, i]] = estimate[13 + i], estimate[17 + i]
    for i in range(3):
        s.error[i] = s.start[i] + s.course[i] * s.ticks[0] * s.tick[()] + s.reference[i] - estimate[i]
    product(estimate[3:7], s.level, -1.0, s.a)  # seen from the world
    for i in range(3):
        s.error[3 + i] = (-2.0 if s.a[3] >= 0.0 else 2.0) * s.a[i]
    for c in range(7):
        s.beyond[c] = max(s.age[c] - s.period[c], 0)
    copy_values(now, s.raw)
    s.ticks[0] += 1


@inner
def carry(s: Senses, at: Array) -> None:
    """Carry all that follows from the last estimate on by a tick: position, attitude, crank; at first, begin."""
    estimate, offset = s.estimate, s.offset
    if s.ticks[0] == 0:
        at[:], offset[:] = 0.0, 0.0
        at[6] = 1.0
        estimate[21] = s.now[21] if isfinite(s.now[21]) else s.first[()]
        add_waves(s.swing, estimate[21], s.reference)
        for i in range(3):
            offset[i] = s.start[i] + s.reference[i]
        copy_values(s.level, offset[3:7])
        copy_values(s.course, offset[7:10])
        offset[21] = estimate[21]
    else:
        before = s.carriers[(s.ticks[0] - 1) % s.carriers.shape[0]]
        dt = s.tick[()]
        rotate_vector(estimate[3:7], estimate[7:10], 1.0, s.a)
        for i in range(3):
            at[i] = before[i] + dt * s.a[i]
            s.place[i] += dt * s.a[i]
        write_turn(dt * estimate[10], dt * estimate[11], dt * estimate[12], s.a)
        product(before[3:7], s.a, 1.0, at[3:7])
        product(s.followed, s.a, 1.0, s.b)
        s.followed[:] = s.b
        at[21] = before[21] + s.rate[()] * dt
    for i in range(3):
        estimate[i] = offset[i] + at[i]
    product(offset[3:7], at[3:7], 1.0, estimate[3:7])


@inner
def close_for_crank(s: Senses, at: Array) -> None:
    """Write the carriers that follow from the crank, and the estimates that follow from them."""
    add_waves(s.swing, s.estimate[21], s.reference)
    joints_at(s.series, s.estimate[21], s.closed)
    for i in range(3):
        at[7 + i], at[10 + i] = s.reference[3 + i], s.reference[9 + i]
    for i in range(4):
        at[13 + i], at[17 + i] = s.closed[0, i % 2], s.closed[1, i % 2] * s.rate[()]
    if s.ticks[0] == 0:
        for other in range(s.carriers.shape[0]):
            copy_values(at, s.carriers[other])
    for i in range(13, 21):
        s.estimate[i] = s.offset[i] + at[i]


@inner
def turn_on(s: Senses, at: Array, thrust: Array, push: Array) -> None:
    """Add to the carrier of the body rate what the moments have done since the last sample.

    The observer sees the push in this very rate, so once a second sample of the gyro is missing it would only feed
    itself; a push that is given from outside is left out likewise.
    """
    seen = 1.0 if s.age[GYRO_CHANNEL] <= 2 * s.period[GYRO_CHANNEL] else 0.0
    steered = s.steering[0] * cos(s.estimate[21]) + s.steering[1] * sin(s.estimate[21])
    for i in range(3):
        if s.ticks[0] > 0:
            moment = thrust[3 + i] - s.wrench[3 + i] - (steered if i == 1 else 0.0) + seen * push[3 + i]
            s.turned[i] += s.tick[()] * moment / s.inertia[i]
        else:
            s.turned[i] = 0.0
        at[10 + i] += s.turned[i]
        s.estimate[10 + i] = s.offset[10 + i] + at[10 + i]


@inner
def velocity(s: Senses, at: Array) -> None:
    """Judge the velocity: its sample has the body's axes, its carrier those of the world."""
    late = s.carriers[taken_at(s, VELOCITY)]
    now, estimate = s.now, s.estimate
    for i in range(3):
        s.a[i] = s.offset[7 + i] + at[7 + i]
    rotate_vector(estimate[3:7], s.a, -1.0, estimate[7:10])
    if not is_good(s, VELOCITY):
        return
    product(estimate[3:7], at[3:7], -1.0, s.b)
    product(s.b, late[3:7], 1.0, s.a)  # the attitude when the sample was taken
    rotate_vector(s.a, now[7:10], 1.0, s.b)
    for i in range(3):
        s.a[i] = s.b[i] + at[7 + i] - late[7 + i]
    rotate_vector(estimate[3:7], s.a, -1.0, s.candidate[7:10])
    off = 0.0
    for i in range(7, 10):
        off = max(off, abs(s.candidate[i] - estimate[i]))
    if believed(s, VELOCITY, off):
        for i in range(3):
            s.offset[7 + i] = s.b[i] - late[7 + i]
            estimate[7 + i] = now[7 + i] if s.delay[VELOCITY] == 0 else s.candidate[7 + i]
