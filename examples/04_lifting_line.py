"""Use the lifting line alone: steady lift of an elliptic wing, and lift after an impulsive start."""

import numpy as np
from scipy.linalg import expm

from aerobat_pin.aerodynamics import LiftingLine

speed, incidence, span, root = 4.0, np.radians(5.0), 0.4, 0.1
line = LiftingLine(span, lambda y: root * np.sqrt(1.0 - (2.0 * y / span) ** 2), strips=16)
area = np.pi / 4.0 * span * root
circulation = line.steady_circulation(speed * incidence)
steady = 2.0 * float(line.width @ circulation) / (speed * area)
aspect = span**2 / area
print(f"steady CL {steady:.5f}, closed form {2 * np.pi * incidence / (1 + 2 / aspect):.5f}")

air = line.state_space(speed)
normal_velocity = np.full(line.strips, speed * incidence)
for chords in (0.0, 1.0, 5.0, 20.0):
    time = chords * root / speed
    state = np.linalg.solve(air.A, (expm(air.A * time) - np.eye(len(air.A))) @ air.B @ normal_velocity)
    lift = float(line.width @ (air.C @ state + air.D @ normal_velocity))
    print(f"after {chords:4.1f} chords: CL {lift / (0.5 * line.air_density * speed**2 * area):.4f}")
