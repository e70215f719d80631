"""Write docs/lifting_line.md and its figures: the lifting line alone, rung by rung."""

from __future__ import annotations

from pathlib import Path

import ladder
import matplotlib as mpl
import on_the_robot
import shed
import strips

from aerobat_pin.visualization import style

INTRODUCTION = """# The lifting line alone

Written by `make docs`: the numbers under a figure come from the run that drew it, the tolerances are those of the tests.

`LiftingLine` is Wagner's indicial lift (1925, in R. T. Jones's form of 1938) on Prandtl's lifting line, after Boutet &
Dimitriadis (2018) and Sihite et al. (2022, [arXiv 2207.12353](https://arxiv.org/abs/2207.12353)). It takes any planform and
knows no robot. The equations stand at the top of
[`lifting_line.py`](../aerobat_pin/aerodynamics/lifting_line.py); nothing in them divides by the airspeed, so a wing at rest,
or one strip at rest, is no exception. The last two parts put it on the robot.

| you want | call |
|---|---|
| a wing | `LiftingLine(span, chord, quarter_chord=..., strips=16)`; lengths as a number, a function of y, a polyline `(stations, values)`, or a number for each strip |
| xi' = A xi + B w_n, lift = C xi + D w_n | `line.state_space(airspeed)` |
| steady flow | `line.steady_circulation(normal_velocity)`, `line.steady_coefficients(incidence)` for CL and CDi |
| lift after a step, under a harmonic | `line.step_response(time, airspeed, normal_velocity)`, `line.frequency_response(frequency, airspeed, normal_velocity)`; both exact |
| the air that is carried along | `line.added_mass` [kg/m]: the force per span is minus this times the rate of the normal velocity at mid-chord |
| a wing that plunges, flaps, or moves as you say | `fly(line, Stroke(airspeed, frequency=..., flap=...), time)` in `aerobat_pin.aerodynamics.flapping_wing` |

[examples/04_lifting_line.py](../examples/04_lifting_line.py) does all of it. The closed forms below are in
`tests/support/references.py`, the tests in `tests/test_lifting_line_ladder.py` and `tests/test_stroke.py`.

## What it is held to

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

WHY_SIXTEEN = """A strip rides on one link, that of its station (`Wing.attach`). With 16 strips a single one carries each proximal panel, and
which strip falls beside a joint changes with their number: the robot's error is no smooth function of it, changes sign,
and is no smaller with 20 than with 16. More strips are not the remedy. Sharing a strip that straddles a joint between its
two links by their overlap is, and is future work: [design note 6](design/0006-added-mass.md).

16 strips stay the default. What a rectangle or the planform's kinks lose by them is little; what the joints cost is less than
what the section law leaves out ([below](#on-the-robot)), and a belief with the same strips shares it; the reference flights
were trimmed with them; and twice as many would allow a quarter of the step.
"""

SECTION_LAW = """`RobotAir` flies this line with another section law, by choice. `fly` drives the line with w, the velocity across the plate,
and pulls with all of the suction: potential flow, without drag. The robot's strips drive it with w |u| / U and scale suction by
c (3 - c^2) / 2, c = u / U ([`strips.py`](../aerobat_pin/aerodynamics/strips.py)). The normal force of a steady wing is then the attached one at any incidence,
exactly, and suction falls with the square of the cosine and more. At small incidence the two are one, up to its square. In
ordinary flapping wing tips pass 40 to 60 degrees, where full suction is not believable: this law lies between attached and
stalled flow. The price is thrust. [Design note 6](design/0006-added-mass.md) says what flights would be with w itself.
"""

LIMITS = """## Limits

* **Attached flow.** Nothing stalls. The flapping rectangle above reaches incidences at which a real wing does; `fly` returns the
  incidence of each strip.
* **A straight line.** Sweep and `quarter_chord` move the points where velocity is taken and force acts, not the downwash.
  At aspect ratio 4 and below, a lifting line carries too much.
* **Added mass is that of endless sections**, pi rho b^2. At the tips there is less; `fly` takes a factor on it. The moment of inertia that turning air adds, pi rho b^4 / 8, is left out.
* **Suction** answers to the velocity at the 3/4 chord: exact for plunging and flapping, without Garrick's pitch-rate term.
* **Flow from behind** reverses the suction but leaves the points where they are; `state_space` refuses it.
"""


def write(docs: Path) -> None:
    """Draw every rung into `figures/lifting_line` below `docs` and write the page."""
    folder = docs / "figures" / "lifting_line"
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        rungs, grid, stable = [draw() for draw in ladder.RUNGS], strips.grid(), strips.stable_step()
        law, wake = on_the_robot.law(), shed.shed()
        for rung in (*rungs, grid, stable, law, wake):
            rung.figure.savefig(folder / f"{rung.name}.png", metadata={"Software": None})
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
    (docs / "lifting_line.md").write_text("\n".join(sections), encoding="utf-8")


def section(rung: ladder.Rung) -> str:
    """Return a rung as a part of the page."""
    return f"## {rung.title}\n\n![{rung.title}](figures/lifting_line/{rung.name}.png)\n\n{rung.caption}\n"
