"""The walk of the forces, their white noise and the crank's jerk, chosen by the likelihood of the innovations.

The likelihood of all samples is climbed along one logarithm at a time, with steps that become shorter; the last step of
each climb goes to the top of the parabola through three points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from aerobat_pin.numerics import Array

STEPS = (1.2, 0.5, 0.25)  # of the logarithms, one round of all of them for each
MOST_STEPS = 5  # along one logarithm in one round


def most_likely(
    score: Callable[[Array], float], start: Array, order: Sequence[int], least: Array, most: Array
) -> Array:
    """Return the logarithms (c,) at which the score is highest, as far as the rounds of steps reach.

    Args:
        score: log-likelihood as a function of the logarithms.
        start: (c,) where to begin.
        order: which may change, in the order of a round.
        least: (c,) lower limits.
        most: (c,) upper limits.
    """
    here, best = start.copy(), score(start)
    for step in STEPS:
        for i in order:
            here, best = _climb(score, here, best, i, step, least, most)
    return here


def _climb(
    score: Callable[[Array], float], here: Array, best: float, i: int, step: float, least: Array, most: Array
) -> tuple[Array, float]:
    """Climb along logarithm i; return the highest place found and its score."""

    def at(value: float) -> tuple[Array, float]:
        place = here.copy()
        place[i] = min(max(value, least[i]), most[i])
        return place, score(place)

    points = {float(here[i]): best}
    for sign in (1.0, -1.0):
        moved = False
        for _ in range(MOST_STEPS):
            value = here[i] + sign * step
            if value > most[i] + 1e-9 or value < least[i] - 1e-9:
                break
            place, found = at(value)
            points[float(place[i])] = found
            if found <= best:
                break
            here, best, moved = place, found, True
        if moved:
            break
    around = [here[i] - step, here[i], here[i] + step]
    seen = [next((s for p, s in points.items() if abs(p - a) < 1e-9), None) for a in around]
    if seen[0] is not None and seen[1] is not None and seen[2] is not None:
        bend = seen[0] - 2.0 * seen[1] + seen[2]
        if bend < 0.0:
            place, found = at(here[i] + 0.5 * step * (seen[0] - seen[2]) / bend)
            if found > best:
                here, best = place, found
    return here, best
