"""Close the Kinetic Sculpture over a turn: ranges, transmission, crank torque, and sensitivity to bar lengths."""

import numpy as np

from aerobat_pin.linkage import KineticSculpture

crank = np.radians(np.arange(0.0, 360.0, 0.5))
linkage = KineticSculpture()
closure = linkage.solve(crank, crank_velocity=2 * np.pi * 4.75)
for name, angle in (("shoulder", closure.theta_s), ("elbow", closure.theta_e)):
    print(f"{name:<9} {np.degrees(angle.min()):8.2f} .. {np.degrees(angle.max()):6.2f} deg")
for pin, opening in closure.transmission.items():
    print(f"transmission at {pin:<4} {np.degrees(opening.min()):6.1f} .. {np.degrees(opening.max()):6.1f} deg")
torque = closure.crank_torque(shoulder_torque=0.01, elbow_torque=0.0)
print(f"10 mN m at the shoulder ask the crank for {1e3 * torque.min():.2f} .. {1e3 * torque.max():.2f} mN m")
speed = np.abs(closure.rate(closure.points["J10"]))
print(f"J10 moves at {speed.min():.2f} .. {speed.max():.2f} m/s")
for bar, by in linkage.sensitivity(crank).items():
    joints = ", ".join(
        f"{name} by {np.degrees(1e-3 * turn.min()):.1f} .. {np.degrees(1e-3 * turn.max()):.1f} deg"
        for name, turn in (("shoulder", by.theta_s), ("elbow", by.theta_e))
        if np.ptp(turn) > 1e-6
    )
    print(f"{bar} 1 mm longer turns {joints}")
