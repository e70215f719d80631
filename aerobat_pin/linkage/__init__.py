"""Sigma_K: the Kinetic Sculpture, the planar linkage that drives shoulder and elbow from one crank.

Seven bars L1..L7 and ten pins J1..J10 have one degree of freedom, the crank angle t1. A dyad is a pair of bars that
meet at a pin. The three dyads at J4, J7 and J10 are closed one after the other (paper, section II-A), with e(t) the
unit vector at angle t and R(t) the rotation by t:

    J4:   P2 + L2a e(t2) = P5 + R(t5 - alpha3) [-L3b, L3c]     P2 = P1 + L1 e(t1)
    J7:   P3 + L4 e(t3)  = P8 + R(t8) [-L5a, L5b]              P3 = P2 + R(t2) [L2b, L2c]
    J10:  P9 + L6 e(t9)  = P6 + R(t6) [L7b, L7c]               P9 = P8 + R(t8) [L5c, L5d]

A point of the plane is a complex number, outboard + i up, so a rotation is a product. The plane is that of the left
wing; the right wing is its mirror image. Angles are absolute and counter-clockwise. The shoulder angle is theta_s = t5,
the elbow angle theta_e = t6 - t5.

`KineticSculpture` computes the closed linkage at any crank angle; `joint_series` gives its joint angles as Fourier
series, which the kernel `joints_at` evaluates. `SculptureDynamics` is the form in the paper:
angular accelerations that an integrator turns into angles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
