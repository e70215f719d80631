"""Take the pictures of docs/replay.md, and the animated one of README.md, under 3 MB; needs a Chromium."""

import io
from pathlib import Path

import numpy as np
import pinocchio as pin
from PIL import Image

from aerobat_pin.errors import BrowserError
from aerobat_pin.experiments import estimate_dataset, run
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization import SLOW_MOTION, Replay, linkage_animation, record, replay_flight, snapshots
from aerobat_pin.visualization.style import BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION, rgb

FIGURES = Path(__file__).resolve().parents[1] / "figures"
SIZE = (960, 600)  # pixels
TALL, CROP, SHOWN = (960, 640), (0, 130, 960, 640), (720, 382)  # pixels of the animation: sky above is left out
BEGINNING, FLAPS, FRAMES = 0.9, 2, 48  # [s], 0.1 s before the step
COLOURS, PACE, LARGEST = 90, 80, 3_000_000  # of the palette; [ms] a frame; bytes
TURN = 2.0  # [s], of the animated linkage


def flight(name: str) -> Replay:
    """Return the replay of a shipped scenario."""
    made = run(load_scenario(name))
    estimates = estimate_dataset(made.estimates)
    return replay_flight(made.robot, made.log, made.scenario.air, estimates, made.metrics["note"])


def walker() -> Replay:
    """Return Pinocchio's sample humanoid, pulled at its left hand."""
    model = pin.buildSampleModelHumanoid()
    time = np.linspace(0.0, 2.0, 241)
    q = np.tile(pin.neutral(model), (len(time), 1))
    q[:, 0] = 0.6 * time
    for name, lead in (("lleg_shoulder2_joint", 0.0), ("rleg_shoulder2_joint", np.pi)):
        q[:, model.joints[model.getJointId(name)].idx_q] = 0.4 * np.sin(5.0 * time + lead)
    pull = np.column_stack([30.0 * np.ones_like(time), 0.0 * time, 20.0 + 10.0 * np.sin(5.0 * time)])
    parts = pin.buildSampleGeometryModelHumanoid(model)
    return record(model, parts, time, q, {"larm_effector_body": pull}, title="sample humanoid")


def palette_of(shown: list[Image.Image]) -> Image.Image:
    """Return the colours of a picture in the middle, and those of arrows and wings, which cover few pixels of it."""
    common = np.array(shown[len(shown) // 2].quantize(COLOURS).convert("RGB")).reshape(-1, 3)
    paint = 255.0 * np.array([rgb(one) for one in (ORANGE, SKY_BLUE, GREEN, BLUE, VERMILLION, PURPLE)])
    blends = [share * paint + (1.0 - share) * ground for share in (1.0, 0.75, 0.5) for ground in (60.0, 235.0)]
    colours = np.unique(np.vstack([common, np.concatenate(blends).astype(np.uint8)]), axis=0)
    palette = Image.new("P", (1, 1))
    palette.putpalette([int(value) for value in colours.ravel()])
    return palette


def animate(replay: Replay, frequency: float, path: Path) -> None:
    """Save two flaps of a flight, with the beginning of the step, as an animated picture."""
    times = (BEGINNING + np.arange(FRAMES) / FRAMES * FLAPS / frequency).tolist()
    pictures = snapshots(replay.html(SLOW_MOTION), times, TALL)
    shown = [picture(one).crop(CROP).resize(SHOWN, Image.Resampling.LANCZOS) for one in pictures]
    palette = palette_of(shown)
    first, *rest = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in shown)
    first.save(path, save_all=True, append_images=rest, duration=PACE, loop=0, optimize=True)
    if path.stat().st_size > LARGEST:
        raise SystemExit(f"{path.name} has {path.stat().st_size / 1e6:.1f} MB, more than {LARGEST / 1e6:.0f} MB")


def picture(data: bytes) -> Image.Image:
    """Return a PNG as a picture without transparency."""
    return Image.open(io.BytesIO(data)).convert("RGB")


def main() -> None:
    """Rewrite the pictures, or say why not."""
    folder = FIGURES / "replay"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "linkage.svg").write_text(linkage_animation(KineticSculpture(), TURN), encoding="utf-8")
    paper, dive = flight("paper"), flight("paper_open_loop")
    wanted = (("page", paper, 1.11, True), ("dive", dive, 1.68, False), ("humanoid", walker(), 0.95, False))
    try:
        for name, replay, time, controls in wanted:
            [taken] = snapshots(replay.html(SLOW_MOTION), [time], SIZE, controls=controls)
            picture(taken).save(folder / f"{name}.png", optimize=True)
        animate(paper, load_scenario("paper").crank.frequency, FIGURES / "replay.gif")
    except BrowserError as error:
        print(f"docs/figures/replay and replay.gif stay as they are: {error}")


if __name__ == "__main__":
    main()
