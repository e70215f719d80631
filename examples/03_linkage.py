"""Close the Kinetic Sculpture over a turn of the crank: ranges, transmission angles, and the torque at the crank."""

import numpy as np

from aerobat_pin.linkage import KineticSculpture

crank = np.radians(np.arange(0.0, 360.0, 0.5))
closure = KineticSculpture().solve(crank, crank_velocity=2 * np.pi * 4.75)
for name, angle in (("shoulder", closure.theta_s), ("elbow", closure.theta_e)):
    print(f"{name:<9} {np.degrees(angle.min()):8.2f} .. {np.degrees(angle.max()):6.2f} deg")
for pin, opening in closure.transmission.items():
    print(f"transmission at {pin:<4} {np.degrees(opening.min()):6.1f} .. {np.degrees(opening.max()):6.1f} deg")
torque = closure.crank_torque(shoulder_torque=0.01, elbow_torque=0.0)
print(f"10 mN m at the shoulder ask the crank for {1e3 * torque.min():.2f} .. {1e3 * torque.max():.2f} mN m")
