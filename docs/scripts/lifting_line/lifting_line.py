"""Write docs/lifting_line.md and its figures: the lifting line alone, rung by rung; `--check` compares the page."""

from __future__ import annotations

from collections.abc import Iterator

import ladder
import matplotlib as mpl
import on_the_robot
import shed
import strips
from support.pages import ROOT, Part, run

from aerobat_pin.visualization import style

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
| the air that is carried along | `line.added_mass` [kg/m]: the force per span is minus this times the rate of the normal velocity at mid-chord |
| a wing that plunges, flaps, or moves as you say | `fly(line, Stroke(airspeed, frequency=..., flap=...), time)` in `aerobat_pin.aerodynamics.flapping_wing` |

[examples/04_lifting_line.py](../examples/04_lifting_line.py) does all of it. The closed forms below are in
`tests/support/references.py`, the tests in `tests/aerodynamics/test_lifting_line_ladder.py` and
`tests/aerodynamics/test_flapping_wing.py`.

## What it is held to

Each rung of this ladder is a case with a known answer; a test holds the line to it within the last column.

| rung | held to | within |
|---|---|---|
| step, two dimensions | R. T. Jones (1938); Wagner (1925) | 1e-6; 1.1 % |
| harmonic, two dimensions | C(k) of Jones; of Theodorsen (1935) | 1e-8; 2.34 % |
| plunge, two dimensions, lift without and with added mass | Theodorsen (1935) | 1 % |
| plunge, two dimensions, thrust; efficiency | Garrick (1936) | 1 %; 1.5 % |
| steady flat plate, two dimensions, any incidence | d'Alembert, Kutta and Joukowski | 1e-6 |
| pitch about three axes, two dimensions, with added mass | Theodorsen with the C(k) of Jones | 0.2 % |
| steady elliptic wing, CL and CDi | Prandtl | 1e-10 |
| steady rectangular wing, CL and CDi, 16 strips | Glauert (1926) | 1e-3 |
| impulsive start, aspect ratio 4 | unsteady vortex lattice | 11, 5, 2, 0.5, 0.5 % at s = 0.25, 1, 2, 5, 10 |
| flapping rectangle, lift; thrust | PteraSoftware 5.1.0, 192 panels | 2 %; 12 % |
| on the robot: steady plate, two dimensions, normal force; drag | the attached plate's; its closed form | 1e-8; 1e-6 |
| on the robot: small incidence | the line's own equations | incidence^2 |
| on the robot: flapping rectangle, lift; thrust | PteraSoftware 5.1.0, 192 panels | 8 %; 28 % less |
| shed wake: vertical impulse of a steady wing's; of the flapping rectangle's; of the flapping robot's | mean lift | 1 %; 5 %; 12 % |
| air at rest, hover, one strip at rest, 90 deg, flow from behind | finite, no warning | |
| mirrored wing and motion; power | mirrored wrenches; force times velocity and moment times rate | 1e-6; 1e-9 |
"""

WHY_SIXTEEN = """A strip rides on one link, the one that its station lies on (`Wing.attach`). With 16 strips a single one carries each
proximal panel, and which strip falls beside a joint changes with their number. So the robot's error is no smooth function
of that number: it changes sign, and is no smaller with 20 strips than with 16. More strips are not the remedy. The remedy
is to share a strip that lies across a joint between the two links, by its overlap with each; that is future work:
[design note 6](design/0006-added-mass.md).

16 strips stay the default. A rectangle, or a planform with kinks, loses little by them. What the joints cost is less than
what the section law leaves out ([below](#on-the-robot)), and an observer that believes in the same strips makes the same
error. The reference flights were trimmed with them. Twice as many would allow only a quarter of the time step.
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
* **Added mass is that of endless sections**, pi rho b^2. The tips have less; `fly` takes a factor for it. The moment of inertia
  that turning air adds, pi rho b^4 / 8, is left out.
* **Suction** follows from the velocity at the 3/4 chord. That is exact for plunging and flapping; Garrick's term of the pitch
  rate is left out.
* **Flow from behind** reverses the suction, but the points where velocity is taken and force acts stay where they are;
  `state_space` refuses such flow.
"""


def write() -> None:
    """Draw every rung and write the page."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        rungs, grid, stable = [draw() for draw in ladder.RUNGS], strips.grid(), strips.stable_step()
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
    for draw in (*ladder.RUNGS, strips.stable_step, on_the_robot.law):
        rung = draw()
        yield Part(PAGE, rung.title, section(rung))
    for name, text in strips.quick_parts():
        yield Part(PAGE, name, text)


if __name__ == "__main__":
    run(write, parts)
