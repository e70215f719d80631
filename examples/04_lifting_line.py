"""Use the lifting line alone: matrices, steady lift, step and harmonic response, wings that flap, pitch, or move."""

import numpy as np

from aerobat_pin.aerodynamics import Halves, LiftingLine, Stroke, fly

speed, incidence, span, root = 4.0, np.radians(5.0), 0.4, 0.1
line = LiftingLine(span, lambda y: root * np.sqrt(1.0 - (2.0 * y / span) ** 2), strips=16)
lift, drag = line.steady_coefficients(incidence)
aspect = span**2 / line.area
print(f"elliptic wing: CL {lift:.5f}, closed form {2 * np.pi * incidence / (1 + 2 / aspect):.5f}; CDi {drag:.5f}")

air = line.state_space(speed)
print(f"{len(air.A)} states, slowest time constant {-1.0 / np.linalg.eigvals(air.A).real.max():.3f} s")

chords = np.array([0.0, 1.0, 5.0, 20.0])
after = line.step_response(chords * root / speed, speed, speed * incidence) @ line.width
for distance, force in zip(chords, after, strict=True):
    print(f"after {distance:4.1f} chords: CL {force / (0.5 * line.air_density * speed**2 * line.area):.4f}")

frequency = 2.0 * np.pi * 5.0
answer = line.frequency_response(frequency, speed, speed * incidence) @ line.width
print(f"incidence of 5 deg at 5 Hz: lift {abs(answer):.3f} N, phase {np.degrees(np.angle(answer)):.0f} deg")

tapered = LiftingLine(
    span, ([-0.2, 0.0, 0.2], [0.05, 0.12, 0.05]), quarter_chord=([-0.2, 0.0, 0.2], [-0.03, 0.0, -0.03])
)
flight = fly(tapered, Stroke(speed, incidence, frequency=5.0, flap=np.radians(30.0)), np.linspace(0.0, 1.0, 501))
thrust, _, lift = flight.force[-100:].T
print(f"tapered, swept and flapping: mean lift {lift.mean():.3f} N, mean thrust {thrust.mean():.3f} N")

pitching = Stroke(speed, frequency=5.0, plunge=0.03, pitch=np.radians(5.0), pitch_axis=-0.01, pitch_phase=np.pi / 2.0)
flight = fly(tapered, pitching, [0.0, *np.linspace(0.8, 1.0, 101)], about=(-0.01, 0.0, 0.0))
nose_up = -flight.moment[1:-1, 1]  # a moment about y is positive nose down
thrust = flight.force[1:-1, 0].mean()
print(f"plunging and pitching: mean thrust {thrust:.4f} N, moment up to {1e3 * nose_up.max():.1f} mN m")
print(f"no strip carries more than {1e3 * np.linalg.norm(flight.strip_force, axis=2).max():.0f} mN")


def gust_of_sink(time: float) -> Halves:
    """Fly level, and sink for a moment: rotation and twist of both halves are all that a motion has to say."""
    sink = 0.5 * np.exp(-(((time - 0.5) / 0.05) ** 2))
    return Halves(np.stack([np.eye(3)] * 2), np.tile([speed, 0.0, -sink, 0.0, 0.0, 0.0], (2, 1)))


lift = fly(tapered, gust_of_sink, np.linspace(0.0, 1.0, 201)).force[:, 2]
print(f"a sink of 0.5 m/s for 0.1 s: lift up to {lift.max():.3f} N, then down to {lift.min():.3f} N")
