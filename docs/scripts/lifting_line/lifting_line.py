"""Write docs/lifting_line.md and its figures: the lifting line alone, rung by rung; `--check` compares the page."""

from __future__ import annotations

from collections.abc import Iterator

import ladder
import matplotlib as mpl
import moments
import on_the_robot
import shed
import strips
from support.pages import ROOT, Part, run

from aerobat_pin.visualization import style

RUNGS = (*ladder.RUNGS[:3], moments.pitch, *ladder.RUNGS[3:], moments.cases)
PAGE, FIGURES = "docs/lifting_line.md", ROOT / "docs" / "figures" / "lifting_line"

INTRODUCTION = """# The lifting line alone

`make docs` writes this page: the numbers under a figure come from the run that drew it, the tolerances are those of the
tests.

`LiftingLine` is Wagner's indicial lift (1925, in R. T. Jones's form of 1938) on Prandtl's lifting line, after Boutet &
Dimitriadis (2018) and Sihite et al. (2022, [arXiv 2207.12353](https://arxiv.org/abs/2207.12353)). It takes any planform and
knows no robot. The equations stand at the top of
[`lifting_line.py`](../aerobat_pin/aerodynamics/lifting_line.py); nothing in them divides by the airspeed, so a wing at rest,
or one strip at rest, is no exception. The last two parts before the limits put it on the robot.

| you want | call |
|---|---|
| a wing | `LiftingLine(span, chord, quarter_chord=..., strips=16)`; lengths as a number, a function of y, a polyline `(stations, values)`, or a number for each strip |
| xi' = A xi + B w_n, lift = C xi + D w_n | `line.state_space(airspeed)` |
| steady flow | `line.steady_circulation(normal_velocity)`, `line.steady_coefficients(incidence)` for CL and CDi |
| lift after a step, under a harmonic | `line.step_response(time, airspeed, normal_velocity)`, `line.frequency_response(frequency, airspeed, normal_velocity)`; both exact |
| the air that is carried along | `line.added_mass` [kg/m]: the force per span is minus this times the rate of the normal velocity at mid-chord; open tips have less |
| a wing that plunges, flaps, pitches, or moves as you say | `fly(line, Stroke(airspeed, frequency=..., flap=..., pitch=...), time)` in `aerobat_pin.aerodynamics.flapping_wing`; a motion of your own returns `Halves(rotation, twist)`, and `fly` differentiates it |

[examples/04_lifting_line.py](../examples/04_lifting_line.py) does all of it. The closed forms below are in
`tests/support/references.py`, the tests in `tests/aerodynamics/`: `test_lifting_line_ladder.py`, `test_flapping_wing.py`,
`test_section_law.py`, `test_lifting_line.py`, `test_lattice_cases.py`, `test_robot_air_flow.py`.

## What it is held to

Each rung of this ladder is a case with a known answer; a test holds the line to it within the last column. A rung that
names no k holds for every reduced frequency.

| rung | held to | within |
|---|---|---|
| step, two dimensions | R. T. Jones (1938); Wagner (1925) | 1e-6; 1.1 % |
| harmonic, two dimensions | C(k) of Jones; of Theodorsen (1935) | 1e-8; 2.34 % |
| plunge, two dimensions, k = 0.39, lift without and with added mass | Theodorsen (1935) | 1 % |
| plunge, two dimensions, k = 0.39, thrust; efficiency | Garrick (1936) | 1 %; 1.5 % |
| steady flat plate, two dimensions, any incidence | d'Alembert, Kutta and Joukowski | 1e-6 |
| pitch about three axes, two dimensions, k from 0.05 to 2, lift and moment | Theodorsen with the C(k) of Jones; his own | 0.1 %; 2.34 % |
| the same, mean thrust | Garrick with the C(k) of Jones | 0.1 % of lift times angle |
| added mass: elliptic discs; rectangular plates of aspect ratio 1 to 10 | Lamb, art. 373; Blevins, table 14-1 | 0.6 %; 0.5 % |
| steady elliptic wing, CL and CDi | Prandtl | 1e-10 |
| steady rectangular wing, CL and CDi, 16 strips | Glauert (1926) | 1e-3 |
| impulsive start, aspect ratio 4 | unsteady vortex lattice | 11, 5, 2, 0.5, 0.5 % at s = 0.25, 1, 2, 5, 10 |
| impulsive start, elliptic wings, aspect ratio 3; 6 | R. T. Jones (1940) | 17 %; 9 % |
| flapping, plunging and pitching rectangle, k = 0.39, rms error of lift; thrust | PteraSoftware 5.1.0, 192 panels | 6.5 %; 12 % |
| the same, moment about the leading edge | PteraSoftware 5.1.0, 192 panels | 9 to 27 % more |
| on the robot: steady plate, two dimensions, normal force; drag | the attached plate's; its closed form | 1e-8; 1e-6 |
| on the robot: small incidence | the line's own equations | incidence^2 |
| on the robot: pitch about three axes, two dimensions, k = 0.05, 0.39, 2 | as above | as above |
| on the robot: flapping rectangle, k = 0.39, lift; thrust | PteraSoftware 5.1.0, 192 panels | 8 %; 28 % less |
| on the robot: mean lift of 16 to 32 strips over a flap | 96 strips | 1 % |
| shed wake: vertical impulse of a steady wing's; of the flapping rectangle's; of the flapping robot's | mean lift | 1 %; 5 %; 12 % |
| air at rest, hover, one strip at rest, 90 deg, flow from behind | finite, no warning | |
| mirrored wing and motion; power | mirrored wrenches; force times velocity and moment times rate | 1e-6; 1e-9 |
"""

WHY_SIXTEEN = """A strip that lies across a joint is shared between the links under it, by length: its velocity is the mean of its pieces'
velocities, weighted by the shares, and each link carries its share of the force and of the added mass
([`divide`](../aerobat_pin/aerodynamics/robot_air.py)). So the robot's error falls with the number of strips, however the
joints fall among them. With each strip on the link under its station alone it was +4.8 % with 16 strips, +5.4 with 20 and
-1.3 with 32.

16 strips stay the default: twice as many would cost four times the downwash and ask for four times the steps.
"""

SECTION_LAW = """`RobotAir` flies this line with another section law, by choice. `fly` drives the line with w, the velocity across the plate,
and applies all of the suction at the leading edge: potential flow, without drag. The robot's strips drive the line with
w |u| / U and scale the suction by c (3 - c^2) / 2, where c = u / U ([`strip_forces.py`](../aerobat_pin/aerodynamics/strip_forces.py)).
The normal force of a steady wing is then exactly that of attached flow, at any incidence, and the suction falls faster than
the square of the cosine. At small incidence the two laws differ by the square of the incidence. In ordinary flapping the
wing tips pass 40 to 60 degrees of incidence, where full suction is not believable: this law lies between attached and
stalled flow. The price is thrust. [Design note 6](design/0006-added-mass.md) tells what flights would be with w itself.
"""

LIMITS = """## Limits

* **Attached flow.** Nothing stalls. The flapping rectangle above reaches incidences at which a real wing does; `fly` returns the
  incidence of each strip.
* **A straight line.** Sweep and `quarter_chord` move the points where velocity is taken and force acts, not the downwash.
  At aspect ratio 4 and below, the lift of a lifting line is too large.
* **Moments.** The steady centre of pressure of the line lies at the quarter chord of each section; that of a wing of
  aspect ratio 4 at 0.205 c.
* **Added mass** of finite wings is exact for plunging, and for the total force of any motion along the normal. Moments of
  inertia are not: against flapping 6 % too large at aspect ratio 4, against pitching about 8 % too small.
* **Reduced frequency.** Wagner's function in Jones's fit: errors by k stand under the pitching section. In three dimensions
  everything was compared at k = 0.39 alone.
* **Flow from behind** reverses the suction, but the points where velocity is taken and force acts stay where they are;
  `state_space` refuses such flow.
"""


def write() -> None:
    """Draw every rung and write the page."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        rungs, grid, stable = [draw() for draw in RUNGS], strips.grid(), strips.stable_step()
        law, wake = on_the_robot.law(), shed.shed()
        for rung in (*rungs, grid, stable, law, wake):
            rung.figure.savefig(FIGURES / f"{rung.name}.png", metadata={"Software": None})
    sections = [
        INTRODUCTION,
        *map(section, rungs),
        section(grid),
        WHY_SIXTEEN,
        section(stable),
        section(law),
        SECTION_LAW,
        section(wake),
        LIMITS,
    ]
    (ROOT / PAGE).write_text("\n".join(sections), encoding="utf-8")


def section(rung: ladder.Rung) -> str:
    """Return a rung as a part of the page."""
    return f"## {rung.title}\n\n![{rung.title}](figures/lifting_line/{rung.name}.png)\n\n{rung.caption}\n"


def parts() -> Iterator[Part]:
    """Yield the page's prose and all rungs but the number of strips, of which a part, and the wake, which take longer."""
    prose = {"introduction": INTRODUCTION, "why sixteen": WHY_SIXTEEN, "section law": SECTION_LAW, "limits": LIMITS}
    for name, text in prose.items():
        yield Part(PAGE, name, text)
    for draw in (*RUNGS, strips.stable_step, on_the_robot.law):
        rung = draw()
        yield Part(PAGE, rung.title, section(rung))
    for name, text in strips.quick_parts():
        yield Part(PAGE, name, text)


if __name__ == "__main__":
    run(write, parts)
