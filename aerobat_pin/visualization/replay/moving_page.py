"""Replay any motion of any Pinocchio model, with forces as arrows, as one HTML page that needs no network.

    page = record(model, visual_model, time, q, {"tool": force}).html()

A `Replay` can also show several kinds of force in different colours, mark stretches of time on the time bar and on
the path of the robot, and show a sheet that trails behind the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.signal import savgol_filter

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, frame_id, shaped
from aerobat_pin.records import FAR_AWAY
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.scene import (
    HALO_OPACITY,
    LONGEST_ARROW,
    SHEET_OPACITY,
    LegendLine,
    Scene,
    Sheet,
    Zone,
    box_corners,
    round_number_above,
)
from aerobat_pin.visualization.template import base64_text, fill_template

KEYFRAMES_PER_SECOND = 120.0  # per second of recorded time: 25 per flap at 4.75 Hz
MOST_KEYFRAMES = 7201  # one minute, a page of 34 MB; a lower rate would distort the motion
CAMERA_SMOOTHING = 0.5  # [s]: the camera follows the path of a free base, smoothed over this time
CAMERA = (0.7, -1.1, 0.55)  # position of the camera relative to the point it looks at, in sizes of the robot

PlaceParts = Callable[[pin.GeometryModel, int], None]


@dataclass(frozen=True, eq=False)
class _Arrows:
    """One kind of force at the keyframes: frame -> start of the arrow (m, 3) [m], and frame -> force (m, 3) [N]."""

    label: str
    colour: str
    inner: bool
    choice: str
    start: dict[str, Array]
    force: dict[str, Array]


class Replay:
    """The replay of a motion: `html` returns it as a page.

    Args:
        model: any model; the camera follows its base if the base is free.
        visual_model: visible parts of the model.
        time: (n,) times [s], never decreasing.
        q: (n, nq) configurations.
        title: a line about what is shown.
        floor: height of the ground [m]; when omitted the lowest point that the robot reaches.
        move: function that moves parts which no joint moves. It is called with a copy of `visual_model` and the number
            of a row of `q`, before the parts are placed for that row.

    Attributes:
        index: (m,) rows of `time` and `q` that are keyframes: about 120 per second, in the first minute only. If the
            motion is longer, the title of the page says so.
        sheet: sheet that trails behind the robot, or None.
        rate: speed in multiples of real time at which a notebook plays it.
        scale: of the arrows [N/cm]; when None, the smallest round one with which the longest fit.
        subtitle: another line below the title; empty for none.
        report: address of the report that belongs to the flight; empty for none.
        size: size of the robot: half the diagonal of its bounding box, or, if its base is fixed, of the box of all
            points that it reaches [m].

    Raises:
        ShapeError: `time` or `q` has the wrong shape or contains NaN, or time decreases or never changes.
    """

    def __init__(
        self,
        model: pin.Model,
        visual_model: pin.GeometryModel,
        time: ArrayLike,
        q: ArrayLike,
        *,
        title: str = "",
        floor: float | None = None,
        move: PlaceParts | None = None,
    ) -> None:
        self.model, self.visual_model, self.title, self.subtitle = model, visual_model.copy(), title, ""
        self.report = ""
        self._time: Array = np.asarray(time, float)
        if self._time.ndim != 1 or len(self._time) < 2 or not np.all(np.diff(self._time) >= 0.0):
            raise ShapeError("time: at least two rows were expected, never decreasing")
        self._q = shaped(q, (len(self._time), model.nq), "q")
        if not np.all(np.isfinite(self._q)):
            raise ShapeError("q holds NaN or infinity")
        wanted = np.arange(self._time[0], self._time[-1], 1.0 / KEYFRAMES_PER_SECOND)
        rows = np.append(np.searchsorted(self._time, wanted - 1e-9), len(self._time) - 1)
        self.index = rows[np.unique(self._time[rows], return_index=True)[1]][:MOST_KEYFRAMES]
        if len(self.index) < 2:
            raise ShapeError("time: it is the same in all rows")
        self._data = model.createData()
        self._free = model.njoints > 1 and model.joints[1].nq == 7
        if self._free and np.linalg.norm(start := self._q[self.index[0], :3]) > FAR_AWAY:
            self._q = self._q - np.append(start, np.zeros(model.nq - 3))
            floor = None if floor is None else floor - float(start[2])
        self._placements, low, high = self._place(move)
        self._floor = float(low[:, 2].min()) if floor is None else floor
        self._path: Array = self._q[self.index, :3] if self._free else 0.5 * (low + high)
        box = high - low if self._free else high.max(axis=0) - low.min(axis=0)
        self.size = 0.5 * float(np.linalg.norm(box, axis=-1).max()) or 1.0
        self._arrows: list[_Arrows] = []
        self.zones: list[Zone] = []
        self.sheet: Sheet | None = None
        self.rate = 1.0
        self.scale: float | None = None

    @property
    def time(self) -> Array:
        """Times (m,) of the keyframes [s]."""
        return np.asarray(self._time[self.index])

    @property
    def duration(self) -> float:
        """Time from the first keyframe to the last [s]."""
        return float(self.time[-1] - self.time[0])

    def add_forces(
        self, label: str, colour: str, forces: Mapping[str, ArrayLike], *, inner: bool = False, choice: str = ""
    ) -> None:
        """Show forces as arrows that begin at frames.

        Args:
            label: text in the legend.
            colour: colour of the arrows, hexadecimal.
            forces: frame -> (n, 3) force at each row in world axes [N], or (n - 1, 3) force in each interval between
                rows.
            inner: draw slim arrows that remain visible inside the arrows of another kind.
            choice: name of this kind among others that have a `choice` too. One of them is shown at a time, at first
                the one that was added first; the page lets people choose.

        Raises:
            FrameNotFoundError: the model has no such frame.
            ShapeError: the forces have another shape.
        """
        n, frames, chosen = len(self._time), {}, {}
        for name, values in forces.items():
            frames[name] = frame_id(self.model, name)
            rows = np.asarray(values, float)
            rows = np.vstack([rows, rows[-1:]]) if rows.shape == (n - 1, 3) else rows
            chosen[name] = np.nan_to_num(shaped(rows, (n, 3), f"force at {name}")[self.index])
        start: dict[str, Array] = {name: np.empty((len(self.index), 3)) for name in forces}
        for row, k in enumerate(self.index):
            pin.framesForwardKinematics(self.model, self._data, self._q[k])
            for name, frame in frames.items():
                start[name][row] = self._data.oMf[frame].translation
        self._arrows.append(_Arrows(label, colour, inner, choice, start, chosen))

    def add_zone(self, start: float, end: float, label: str, colour: str) -> None:
        """Mark a stretch of time, from `start` to `end` [s], with a label; `end` can be infinite."""
        self.zones.append(Zone(start, end, label, colour))

    @property
    def newtons_per_centimetre(self) -> float:
        """Scale of the arrows [N/cm]: 1, 2 or 5 times a power of ten."""
        if self.scale is not None:
            return self.scale
        hidden = [kind for kind in self._arrows if kind.choice][1:]
        shown = [rows for kind in self._arrows if kind not in hidden for rows in kind.force.values()]
        norms = [np.linalg.norm(rows, axis=1) for rows in shown]
        largest = max((float(np.percentile(norm, 99.0)) for norm in norms), default=0.0) or 1.0
        return round_number_above(largest / (100.0 * LONGEST_ARROW * self.size))

    def _repr_html_(self) -> str:
        """Return the page within a frame, as a notebook shows it."""
        page = escape(self.html(self.rate))
        return f'<iframe srcdoc="{page}" width="100%" height="480" style="border: 0" title="replay"></iframe>'

    def html(self, rate: float = 1.0) -> str:
        """Return the page as HTML; it starts to play at the speed `rate`, in multiples of real time."""
        scene = Scene(self.time - self._time[0])
        scene.move("world", position=-self._camera_path())
        scene.robot(self.model, self.visual_model, self._placements)
        legend = [*self._draw_arrows(scene), self._draw_ground(scene)]
        if self._free:
            inside = np.any([(self.time >= zone.start) & (self.time <= zone.end) for zone in self.zones], axis=0)
            steps = np.stack([self._path[:-1], self._path[1:]], axis=1)
            scene.segments("world/path", steps[~(inside[1:] & inside[:-1])] if self.zones else steps, style.PATH)
            legend.append(LegendLine("line", style.PATH, "path of the body"))
        for i, zone in enumerate(self.zones):
            if self._free:
                self._draw_zone(scene, f"world/zone/{i}", zone)
            until = f"{zone.start:g} s to {zone.end:g} s" if np.isfinite(zone.end) else f"from {zone.start:g} s on"
            legend.append(LegendLine("line", zone.colour, f"{zone.label}, {until}"))
        if (sheet := self.sheet) is not None:
            scene.move("world/air", position=sheet.drift)
            scene.sheet("world/air/sheet", sheet.points, sheet.colours)
            legend.append(LegendLine("bar", sheet.colour, sheet.label, SHEET_OPACITY))
        whole, title = float(self._time[-1] - self._time[0]), self.title
        if self.duration < whole:
            title += f" (the first {self.duration:.3g} s of {whole:.3g} s)"
        return fill_template(
            "replay.html",
            replay=self,
            title=title,
            legend=legend,
            rate=rate,
            scene={
                "commands": [base64_text(command) for command in scene.commands(self.size * np.array(CAMERA))],
                "start": float(self.time[0]),
                "truth": style.TRUTH,
                "rate": rate,
                "step": self.duration / (len(self.time) - 1),
                "times": [round(time, 6) for time in (self.time - self.time[0]).tolist()],
                "sheet": sheet and {"faces": 2 * (sheet.points.shape[1] - 1), "lasting": sheet.lasting},
            },
        )

    def _place(self, move: PlaceParts | None) -> tuple[Array, Array, Array]:
        """Return the parts' placements (m, parts, 7) at every keyframe, and both ends (m, 3) of the box around them."""
        visible, placed = self.visual_model, self.visual_model.createData()
        corners = np.array([box_corners(part) for part in visible.geometryObjects]).reshape(-1, 8, 3)
        placements = np.empty((len(self.index), len(corners), 7))
        low, high = np.empty((2, len(self.index), 3))
        for row, k in enumerate(self.index):
            if move is not None:
                move(visible, int(k))
            pin.updateGeometryPlacements(self.model, self._data, visible, placed, self._q[k])
            placements[row] = np.reshape([pin.SE3ToXYZQUAT(placement) for placement in placed.oMg], (-1, 7))
            points = [
                placement.rotation @ box.T + placement.translation[:, None]
                for placement, box in zip(placed.oMg, corners, strict=True)
            ] or [joint.translation[:, None] for joint in self._data.oMi]  # without visible parts, use the joints
            everything = np.hstack(points)
            low[row], high[row] = everything.min(axis=1), everything.max(axis=1)
        return placements, low, high

    def _camera_path(self) -> Array:
        """Return the points (m, 3) that the camera looks at: the smoothed path, or the middle of a fixed robot."""
        if not self._free:
            return np.tile(self._path.mean(axis=0), (len(self._path), 1))
        step = float(np.median(np.diff(self.time)))
        window = min(max(3, 2 * round(0.5 * CAMERA_SMOOTHING / step) + 1), len(self._path) - 1 + len(self._path) % 2)
        if window < 3:
            return self._path
        return np.asarray(savgol_filter(self._path, window, min(2, window - 1), axis=0))

    def _draw_arrows(self, scene: Scene) -> list[LegendLine]:
        """Draw the forces; in the legend, the kind that was added last comes first."""
        scale = self.newtons_per_centimetre
        legend = [LegendLine("", "", f"arrows: {scale:g} N per cm")] if self._arrows else []
        options = [(kind.label, kind.choice) for kind in self._arrows if kind.choice]
        for kind in self._arrows:
            for name, start in kind.start.items():
                node, force = f"world/force/{kind.label}/{name}", kind.force[name]
                scene.arrow(node, kind.colour, start, force, scale, self.size, inner=kind.inner)
            text, choices = kind.label, []
            if kind.choice and len(options) > 1:
                if kind.label != options[0][0]:
                    scene.viewer[f"world/force/{kind.label}"].set_property("visible", False)  # until the page shows it
                    continue
                text, choices = text.replace(f"({kind.choice})", "").strip(), options
            legend.insert(0, LegendLine("bar", kind.colour, text, 1.0 if kind.inner else HALO_OPACITY, choices))
        return legend

    def _draw_zone(self, scene: Scene, node: str, zone: Zone) -> None:
        """Draw a stretch of time on the path, with balls at its start and end if these are within the replay."""
        first, last = np.clip([zone.start, zone.end], self.time[0], self.time[-1])
        if first == last:
            return
        inside = self.time[(self.time > first) & (self.time < last)]
        way = self._path_at(np.concatenate([[first], inside, [last]]))
        scene.segments(f"{node}/way", np.stack([way[:-1], way[1:]], axis=1), zone.colour)
        for name, time in (("onset", zone.start), ("end", zone.end)):
            if first <= time <= last:
                scene.ball(f"{node}/{name}", self._path_at(np.array([time]))[0], 0.03 * self.size, zone.colour)

    def _path_at(self, time: Array) -> Array:
        """Return the points (k, 3) of the path at times (k,), interpolated between the keyframes."""
        return np.column_stack([np.interp(time, self.time, along) for along in self._path.T])

    def _draw_ground(self, scene: Scene) -> LegendLine:
        """Draw a grid on the ground."""
        spacing, floor = round_number_above(0.5 * self.size), self._floor
        low, high = self._path.min(axis=0) - 6.0 * self.size, self._path.max(axis=0) + 6.0 * self.size
        x, y = (spacing * np.arange(np.floor(low[i] / spacing), np.ceil(high[i] / spacing) + 1) for i in (0, 1))
        across = [[[at, y[0], floor], [at, y[-1], floor]] for at in x]
        along = [[[x[0], at, floor], [x[-1], at, floor]] for at in y]
        scene.segments("world/ground", np.array(across + along), style.FAINT)
        return LegendLine("grid", style.MUTED, f"ground, {spacing:g} m a square")


def record(
    model: pin.Model,
    visual_model: pin.GeometryModel,
    time: ArrayLike,
    q: ArrayLike,
    forces: Mapping[str, ArrayLike] | None = None,
    *,
    title: str = "",
) -> Replay:
    """Prepare the replay of a motion with one kind of force: frame -> (n, 3) in world axes [N]; the rest as `Replay`.

    Raises:
        FrameNotFoundError: the model has no such frame.
        ShapeError: an argument has the wrong shape, or the times are not those of a motion.
    """
    replay = Replay(model, visual_model, time, q, title=title)
    if forces:
        replay.add_forces("force", style.ESTIMATES[0], forces, inner=True)
    return replay
