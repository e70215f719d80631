"""Fly by the six thrusters with and without an observer; then the same controller through the gymnasium environment."""

import numpy as np

from aerobat_pin import load_scenario, run
from aerobat_pin.control import Controller, loop_margins

SHORT = ["simulation.duration=1.2", 'observers.names=["momentum"]']

for title, law in (
    ("PD", ["control.integral=false", "control.feedforward=false"]),
    ("PD + integral", ["control.feedforward=false"]),
    ("PD + integral + observer", []),
):
    metrics = run(load_scenario("paper_left_closed_loop", [*SHORT, *law])).metrics
    off, control = metrics["flight"]["rms"], metrics["control"]
    print(
        f"{title:<25} {1e3 * off['y']:5.1f} mm off sideways, roll {np.degrees(off['roll']):.1f} deg, "
        f"commands change by {control['slew_rms']:.0f} N/s, Ms {control['margins']['roll']['ms']:.2f}"
    )

margins = loop_margins(load_scenario("paper_left_closed_loop", ["thrusters.delay=0.05"]))["roll"]
print(f"with 50 ms of delay the loop would be {'stable' if margins.stable else 'unstable'}")

try:
    from aerobat_pin.control import AerobatEnv
except ImportError as error:
    raise SystemExit(str(error)) from None

# Six numbers from -1 (off) to 1 (full thrust) every 10 ms. A learning agent would take the controller's place.
env = AerobatEnv("hover_closed_loop", ["simulation.duration=1.0"])
pilot = Controller(env.scenario)
seen, info = env.reset(seed=1)
pilot.begin(info["time"], info["q"], info["v"], info["crank_angle"])
reward, over = 0.0, False
while not over:
    thrust = pilot.command(info["time"], info["q"], info["v"], info["crank_angle"])
    seen, more, fallen, ended, info = env.step(2.0 * thrust / pilot.thrusters.limit - 1.0)
    reward, over = reward + more, fallen or ended
print(f"hovering at 100 Hz: {'fallen' if fallen else 'still up'} after {info['time']:.2f} s, reward {reward:.1f}")
