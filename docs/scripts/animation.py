"""Make the animated picture of README.md from the replay of `paper`; needs a Chromium. Under 3 MB, or an error."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from aerobat_pin.errors import BrowserError
from aerobat_pin.experiments import estimate_dataset, run
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import SLOW_MOTION, replay_flight, snapshots
from aerobat_pin.visualization.style import BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION, rgb

PICTURE = Path(__file__).resolve().parents[1] / "figures" / "replay.gif"
SIZE = (960, 640)  # pixels of the browser
CROP = (0, 130, 960, 640)  # the sky above the robot is left out
SHOWN = (720, 382)  # pixels of the picture
FLAPS, FRAMES, COLOURS = 2, 48, 90
BEGINNING = 0.9  # [s], 0.1 s before the step
PACE = 80  # [ms] each frame is shown
LARGEST = 3_000_000  # bytes


def frames() -> list[Image.Image]:
    """Return the pictures: two flaps of the flight, with the beginning of the step."""
    made = run(load_scenario("paper"))
    estimates = estimate_dataset(made.estimates)
    recording = replay_flight(made.robot, made.log, made.scenario.air, estimates, made.metrics["note"])
    times = BEGINNING + np.arange(FRAMES) / FRAMES * FLAPS / made.scenario.crank.frequency
    drawn = snapshots(recording.html(SLOW_MOTION), [float(time) for time in times], SIZE)
    return [
        Image.open(io.BytesIO(one)).convert("RGB").crop(CROP).resize(SHOWN, Image.Resampling.LANCZOS) for one in drawn
    ]


def palette_of(shown: list[Image.Image]) -> Image.Image:
    """Return the colours of a picture in the middle, and those of arrows and wings, which cover few pixels of it."""
    common = np.array(shown[len(shown) // 2].quantize(COLOURS).convert("RGB")).reshape(-1, 3)
    paint = 255.0 * np.array([rgb(one) for one in (ORANGE, SKY_BLUE, GREEN, BLUE, VERMILLION, PURPLE)])
    blends = [share * paint + (1.0 - share) * ground for share in (1.0, 0.75, 0.5) for ground in (60.0, 235.0)]
    colours = np.unique(np.vstack([common, np.concatenate(blends).astype(np.uint8)]), axis=0)
    palette = Image.new("P", (1, 1))
    palette.putpalette([int(value) for value in colours.ravel()])
    return palette


def main() -> None:
    """Rewrite the picture, or say why not."""
    try:
        shown = frames()
    except BrowserError as error:
        print(f"{PICTURE.name} stays as it is: {error}")
        return
    palette = palette_of(shown)
    first, *rest = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in shown)
    first.save(PICTURE, save_all=True, append_images=rest, duration=PACE, loop=0, optimize=True)
    size = PICTURE.stat().st_size
    if size > LARGEST:
        raise SystemExit(f"{PICTURE.name} has {size / 1e6:.1f} MB, more than {LARGEST / 1e6:.0f} MB")
    print(f"{PICTURE.name}: {len(shown)} frames, {size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
