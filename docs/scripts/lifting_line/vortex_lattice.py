"""Fly a rectangular wing with PteraSoftware 5.1.0: harmonics of its loads, as they stand in tests/support/references.py.

PteraSoftware is no dependency of this project: `pip install pterasoftware==5.1.0` in an environment of its own, then
`python docs/scripts/lifting_line/vortex_lattice.py`. A case takes a minute.

Wing 0.40 x 0.10 m, NACA 0002, 8 x 12 uniform panels a side, prescribed wake, 5 Hz, 4 m/s, 1.225 kg/m3, 64 steps a
cycle, third cycle. Motion A sin(wt). Lift and thrust in wind axes, moment nose up about the leading edge of the root at
rest. The halves hinge at the root, 10 micrometres off the middle, since the solver wants two wings where halves turn
against each other.
"""

import sys

import numpy as np
import pterasoftware as ps

SPAN, CHORD, FREQUENCY, SPEED, STEPS, CYCLES = 0.40, 0.10, 5.0, 4.0, 64, 3
CASES = {
    "flap 30 deg": {"flap": 30.0},
    "flap 30 deg, incidence 5 deg": {"flap": 30.0, "incidence": 5.0},
    "flap 5 deg": {"flap": 5.0},
    "plunge 10 mm": {"plunge": 0.010},
    "pitch 5 deg about the quarter chord": {"pitch": 5.0},
}


def loads(flap=0.0, pitch=0.0, plunge=0.0, incidence=0.0):
    """Return lift, thrust and nose-up moment about the root's leading edge over the last cycle (3, steps)."""
    sections = [
        ps.geometry.wing_cross_section.WingCrossSection(
            airfoil=ps.geometry.airfoil.Airfoil(name="naca0002"),
            chord=CHORD,
            num_spanwise_panels=panels,
            spanwise_spacing=None if panels is None else "uniform",
            Lp_Wcsp_Lpp=(0.0, y, 0.0),
            control_surface_symmetry_type="symmetric",
        )
        for panels, y in ((12, 0.0), (None, SPAN / 2.0))
    ]
    wing = ps.geometry.wing.Wing(
        sections,
        Ler_Gs_Cgs=(0.0, 1e-5, 0.0),
        symmetric=True,
        symmetryNormal_G=(0.0, 1.0, 0.0),
        symmetryPoint_G_Cg=(0.0, 0.0, 0.0),
        num_chordwise_panels=8,
        chordwise_spacing="uniform",
    )
    airplane, period = ps.geometry.airplane.Airplane(wings=[wing]), 1.0 / FREQUENCY
    angles, height = np.array([flap, pitch, 0.0]), np.array([0.0, 0.0, plunge])
    movements = [
        ps.movements.wing_movement.WingMovement(
            base_wing=each,
            wing_cross_section_movements=[
                ps.movements.wing_cross_section_movement.WingCrossSectionMovement(base_wing_cross_section=section)
                for section in each.wing_cross_sections
            ],
            ampLer_Gs_Cgs=height,
            periodLer_Gs_Cgs=period * (height > 0.0),
            ampAngles_Gs_to_Wn_ixyz=angles,
            periodAngles_Gs_to_Wn_ixyz=period * (angles > 0.0),
            rotationPointOffset_Gs_Ler=(CHORD / 4.0 if pitch else 0.0, 0.0, 0.0),
        )
        for each in airplane.wings
    ]
    point = ps.operating_point.OperatingPoint(rho=1.225, vCg__E=SPEED, alpha=incidence)
    movement = ps.movements.movement.Movement(
        [ps.movements.airplane_movement.AirplaneMovement(base_airplane=airplane, wing_movements=movements)],
        ps.movements.operating_point_movement.OperatingPointMovement(base_operating_point=point),
        delta_time=period / STEPS,
        num_steps=CYCLES * STEPS,
    )
    problem = ps.problems.UnsteadyProblem(movement)
    solver = ps.unsteady_ring_vortex_lattice_method.UnsteadyRingVortexLatticeMethodSolver(problem)
    solver.run(prescribed_wake=True, calculate_streamlines=False, show_progress=False)
    last = [step.airplanes[0] for step in problem.steady_problems[-STEPS:]]
    force, moment = (np.array([getattr(each, name) for each in last]) for name in ("forces_W", "moments_W_CgP1"))
    return np.array([-force[:, 2], force[:, 0], moment[:, 1]])  # wind axes: x forward, y right, z down


def main() -> None:
    """Print for each case: lift, moment (first harmonic: size, phase [deg] as a cosine; mean) and mean thrust."""
    for name, case in CASES.items():
        if any(word not in name for word in sys.argv[1:]):
            continue
        lift, thrust, moment = loads(**case)
        harmonic = np.exp(-2j * np.pi * (np.arange(STEPS) + (CYCLES - 1) * STEPS) / STEPS) * 2.0 / STEPS
        first = [complex(signal @ harmonic) for signal in (lift, moment)]
        shown = ", ".join(f"{abs(each):.6f} at {np.degrees(np.angle(each)):.2f} deg" for each in first)
        print(f"{name}: lift and moment {shown}; means {lift.mean():.6f}, {thrust.mean():.6f}, {moment.mean():.6f}")
        print("  lift", np.array2string(lift, precision=5, max_line_width=100000, separator=","), flush=True)


if __name__ == "__main__":
    main()
