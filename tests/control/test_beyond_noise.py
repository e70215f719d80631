"""Of what an observer sees, only what passes the noise of its sensors counts."""

from __future__ import annotations

import numpy as np

from aerobat_pin.control.disturbance import beyond_noise

GAIN, DT, DEVIATION = 10.0, 1e-3, 0.02  # [1/s], [s], of the momentum's samples [N s]
FOLLOW = np.full(6, 1.0 - np.exp(-GAIN * DT))


def test_white_noise_of_the_momentum_leaves_the_stated_variance() -> None:
    """K^2 s / (s + K)^2 of white noise of density s^2 dt has the variance s^2 K^3 dt / 4, by Parseval's theorem."""
    momentum = np.random.default_rng(0).normal(scale=DEVIATION, size=(200_000, 6))
    slow, seen, state, smooth = np.zeros(6), np.zeros(6), np.zeros((3, 6)), []
    for sample in momentum:
        slow += FOLLOW * (sample - slow)
        seen[:] = GAIN * (sample - slow)  # the residual of a momentum observer
        beyond_noise(seen, FOLLOW, np.zeros((2, 6)), state, np.empty(6))
        smooth.append(state[0].copy())
    np.testing.assert_allclose(np.var(smooth), DEVIATION**2 * GAIN**3 * DT / 4.0, rtol=0.05)


def test_the_first_sample_fades_as_stated_and_a_push_counts_but_for_its_noise() -> None:
    """K t exp(-K t) after a time t; and 1 - variance / smooth^2 of what is seen, nothing below the variance."""
    state, counted, always = np.array([np.zeros(6), np.ones(6), np.zeros(6)]), np.empty(6), np.full(6, 0.04)
    pushes = np.array([0.1, 0.19, 0.4, 1.0, 2.0, -2.0])
    for _ in range(100):
        beyond_noise(pushes, FOLLOW, np.array([always, np.zeros(6)]), state, counted)
    np.testing.assert_allclose(state[2], GAIN * 0.1 * np.exp(-GAIN * 0.1), rtol=0.02)
    for _ in range(2000):
        beyond_noise(pushes, FOLLOW, np.array([always, np.zeros(6)]), state, counted)
    np.testing.assert_allclose(counted, [0.0, 0.0, 0.3, 0.96, 1.98, -1.98], rtol=1e-6)
