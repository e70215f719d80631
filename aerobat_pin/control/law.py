"""The law: from a sample to the commands of the six thrusters. This file is the whole of it, as compiled kernels.

    velocity   less the bias b that its integral gains on the position        see below
    forces     F = m (w^2 e + 2 z w e') + integral - disturbance              forward, left, up of the course
    smoothing  one pole each for F_left and F_up                              of noise that thrusters would follow
    bank       roll_ref = -asin(F_left / (m g)), limited                      the thrusters cannot push sideways
    nose       down by what they leave of F_forward / (m g), slowly, limited  they hardly push forward
    moments    M = J (w^2 e_R + 2 z w e_omega) + integral - disturbance + c x its force sideways
    wrench     (F_forward, 0, F_up / R_zz, M) about the nominal wrench        body axes, at the body's centre of mass
    lead       (1 + lag s) / (1 + lag s / lead) of the wrench                 against the thrusters' lag
    steering   the pitching moment against the flaps, as much ahead as the thrusters are late
    thrusts    bounded least squares with priorities                          see `allocation`

e is reference less measurement. The references swing with the crank, as the nominal flight does: what each flap does
to the body and takes back is no error, and an answer through a lag of the thrusters would come too late for it, and
make it larger. e_R is twice the vector part of the quaternion from the body to its reference, which is the rotation
vector for small errors. c leads from the body's centre of mass, about which moments count, to the robot's: about that
one, an unknown force sideways that the thrusters leave has no moment. w and z are natural frequency and share of
critical damping. An integral stands still while its component cannot be realised.

An attitude that is off by 2 degrees shows 0.1 m/s sideways at 3 m/s. A Luenberger observer with both poles at beta
finds such a bias b, along world axes; it costs no margin, since it keeps still where velocity and position agree:

    p' = v - b + 2 beta (p_measured - p)        b' = -beta^2 (p_measured - p)

The observer of the disturbance is told v - b, too. A velocity that is late unnoticed is (beta / (s + beta))^2 of it the
position's rate, which is not late: at beta = 30, 30 ms cost little, where at 10 the robot swings sideways for good.
"""

from __future__ import annotations

from math import asin, cos, sin
from typing import Annotated, NamedTuple

from aerobat_pin.control.allocation import Limited, limited_thrusts
from aerobat_pin.control.nominal_wrench import PITCHING
from aerobat_pin.control.sensed_channels import product, rotate_vector, write_turn
from aerobat_pin.numerics import Array, fields_of, inner, kernel, saturated

UNREALISED = 1.0e-6  # [N, N m]: more than rounding


class Law(NamedTuple):
    """Memory of the law. Forces are forward, left, up; then moments are roll, pitch, yaw. Mass m, J, lag are believed.

    Constants: `start` (3,) [m] and `velocity` (3,) [m/s] of the course, `heading` (2,) its cosine and sine, `level`
    (4,) the attitude to keep, `nominal` (6,) wrench, `centre` (3,) is c, `weight` () [N], `gains` (6, 3) stiffness,
    damping, and stiffness of the integral per second; `limits` (2,) sines of the largest bank and pitch; `swing`
    (2 n, 12) as in `Nominal`, `steering` (2,) as there, but ahead; `compensates` () whether the disturbance counts;
    `beta` () as above [1/s], `smoothing` () share by which smoothed forces follow in a tick;
    `tick` () time between samples [s], `settled` () share by which the nose follows in it; `lead` () and `follow` ()
    share by which the lead's slow part follows; `limited` the allocation.

    State: `place`, `bias` (3,) p and b, `smooth` (2,) forces left and up, `integral` (6,), `slow` (6,) of the lead,
    `begun` () ticks so far, `nose_down` () [rad].

    Results: `disturbance` (6,) given from outside, `wanted`, `unrealised` (6,) wrenches, `command` (m,) thrusts.
    Scratch: `reference` (12,), as the columns of `swing`, and what follows. Sizes: m thrusters, n waves in the swing.
    """

    start: Annotated[Array, "3"]
    velocity: Annotated[Array, "3"]
    heading: Annotated[Array, "2"]
    level: Annotated[Array, "4"]
    nominal: Annotated[Array, "6"]
    centre: Annotated[Array, "3"]
    weight: Annotated[Array, ""]
    gains: Annotated[Array, "6, 3"]
    limits: Annotated[Array, "2"]
    swing: Annotated[Array, "2 * waves, 12"]
    steering: Annotated[Array, "2"]
    compensates: Annotated[Array, ""]
    beta: Annotated[Array, ""]
    smoothing: Annotated[Array, ""]
    tick: Annotated[Array, ""]
    settled: Annotated[Array, ""]
    lead: Annotated[Array, ""]
    follow: Annotated[Array, ""]
    place: Annotated[Array, "3"]
    bias: Annotated[Array, "3"]
    smooth: Annotated[Array, "2"]
    integral: Annotated[Array, "6"]
    slow: Annotated[Array, "6"]
    begun: Annotated[Array, ""]
    nose_down: Annotated[Array, ""]
    disturbance: Annotated[Array, "6"]
    wanted: Annotated[Array, "6"]
    unrealised: Annotated[Array, "6"]
    command: Annotated[Array, "m"]
    reference: Annotated[Array, "12"]
    force: Annotated[Array, "3"]
    errors: Annotated[Array, "3"]
    rates: Annotated[Array, "3"]
    pushed: Annotated[Array, "3"]
    aim: Annotated[Array, "4"]
    turned: Annotated[Array, "4"]
    limited: Limited


@kernel
def law_wrench(memory: Array, since: float, q: Array, v: Array, crank_angle: float, out: Array) -> None:
    """Write the wrench that is wanted for a sample, before lead and steering; integrals and nose move on.

    In `Law`, `disturbance` is what acts now, `unrealised` what was left of the last wrench. Configuration q (nq,) and
    velocity v (nv,), whose bases count, and the crank's angle are as the sensors show them `since` seconds after the
    begin. The wrench `out` (6,) is at the body's centre of mass, in body axes [N, N m].
    """
    law = fields_of(memory, Law)
    gains, force, nominal, centre, reference = law.gains, law.force, law.nominal, law.centre, law.reference
    errors, rates, pushed, aim, turned = law.errors, law.rates, law.pushed, law.aim, law.turned
    attitude, push, acts = q[3:7], law.disturbance, law.compensates[()]
    add_waves(law.swing, crank_angle, reference)

    # Errors of position and velocity, and the disturbance, along world axes; then along the course.
    rotate_vector(attitude, v[:3], 1.0, rates)
    rotate_vector(attitude, push[:3], 1.0, pushed)
    for i in range(3):
        errors[i] = law.start[i] + law.velocity[i] * since + reference[i] - q[i]
        rates[i] = law.velocity[i] + reference[3 + i] - unbiased(law, i, q[i], rates[i])
    along, across = law.heading[0], law.heading[1]
    for values in (errors, rates, pushed):
        values[0], values[1] = along * values[0] + across * values[1], along * values[1] - across * values[0]
    for i in range(3):
        add_error(law, i, errors[i])
        force[i] = gains[i, 0] * errors[i] + gains[i, 1] * rates[i] + law.integral[i] - acts * pushed[i]
    for i in range(2):
        share = law.smoothing[()] if law.begun[()] != 0.0 else 1.0
        law.smooth[i] += share * (force[1 + i] - law.smooth[i])

    # Pushing to the left takes a roll to the left, which is negative: the right wing is up then.
    bank = -asin(saturated(law.smooth[0] / law.weight[()], law.limits[0]))
    asked = saturated(law.unrealised[0] / law.weight[()], law.limits[1])
    law.nose_down[()] += law.settled[()] * (asked - law.nose_down[()])
    write_turn(0.0, float(law.nose_down[()]), 0.0, turned)
    product(law.level, turned, 1.0, aim)
    write_turn(bank, 0.0, 0.0, turned)
    product(aim, turned, 1.0, aim)
    write_turn(reference[6], reference[7], reference[8], turned)
    product(aim, turned, 1.0, aim)
    turned[0], turned[1], turned[2], turned[3] = -q[3], -q[4], -q[5], q[6]
    product(turned, aim, 1.0, aim)  # from the body to the reference
    twice = 2.0 if aim[3] >= 0.0 else -2.0
    for i in range(3):
        error = twice * aim[i]
        add_error(law, 3 + i, error)
        answer = gains[3 + i, 0] * error + gains[3 + i, 1] * (reference[9 + i] - v[3 + i])
        out[3 + i] = nominal[3 + i] + answer + law.integral[3 + i] - acts * push[3 + i]

    # The thrusters make no force sideways, so the unknown one turns the robot about its own centre of mass.
    out[3] -= acts * centre[2] * push[1]
    out[5] += acts * centre[0] * push[1]
    out[0] = nominal[0] + force[0]
    out[1] = 0.0
    out[2] = (nominal[2] + law.smooth[1]) / max(1.0 - 2.0 * (q[3] * q[3] + q[4] * q[4]), 0.5)


@kernel
def write_commands(memory: Array, wrench: Array, crank_angle: float) -> None:
    """Write `wanted`, `command` and `unrealised` for the wrench (6,) that a law wants."""
    law = fields_of(memory, Law)
    wanted, slow, lead = law.wanted, law.slow, law.lead[()]
    for i in range(6):
        if law.begun[()] == 0.0:
            slow[i] = wrench[i]
        wanted[i] = lead * wrench[i] - (lead - 1.0) * slow[i]
        slow[i] += law.follow[()] * (wrench[i] - slow[i])
    law.begun[()] += 1.0
    wanted[PITCHING] += law.steering[0] * cos(crank_angle) + law.steering[1] * sin(crank_angle)
    limited_thrusts(law.limited, wanted, law.command)
    for i in range(6):
        reached = 0.0
        for j in range(law.command.shape[0]):
            reached += law.limited.map[i, j] * law.command[j]
        law.unrealised[i] = wanted[i] - reached


@inner
def add_waves(coefficients: Array, crank_angle: float, out: Array) -> None:
    """Write the sum of waves of the crank angle, with coefficients (2 n, c) as in `Nominal.swing`: (c,)."""
    a, b = cos(crank_angle), sin(crank_angle)
    c, s = a, b
    out[:] = 0.0
    for wave in range(coefficients.shape[0] // 2):
        for i in range(out.shape[0]):
            out[i] += c * coefficients[2 * wave, i] + s * coefficients[2 * wave + 1, i]
        c, s = a * c - b * s, a * s + b * c


@inner
def add_error(law: Law, i: int, error: float) -> None:
    """Add to an integral, unless that asks for more of what the limits leave already; left is made by rolling."""
    lacking = -law.unrealised[3] if i == 1 else law.unrealised[i]
    rate = law.gains[i, 2] * error
    if not (abs(lacking) > UNREALISED and lacking * rate > 0.0):
        law.integral[i] += rate * law.tick[()]


@inner
def unbiased(law: Law, i: int, place: float, velocity: float) -> float:
    """Return a measured velocity less its bias, along a world axis, and find more of the bias.

    At first p is the mean of the samples so far: the noise of a single one would look like a bias.
    """
    tick, beta, ahead = law.tick[()], law.beta[()], place - law.place[i]
    follow, mean = 2.0 * beta * tick, 1.0 / (law.begun[()] + 1.0)
    if follow >= mean:
        law.bias[i] -= tick * beta * beta * ahead
    law.place[i] += tick * (velocity - law.bias[i]) + max(follow, mean) * ahead
    return float(velocity - law.bias[i])
