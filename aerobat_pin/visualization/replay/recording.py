"""Replay any motion of any Pinocchio model, with forces as arrows, as one HTML page that needs no network.

    page = record(model, visual_model, time, q, {"tool": force}).html()

A `Recording` takes more: several kinds of force in their own colours, stretches of time that are marked on the time
bar and on the way of the robot, and a sheet that trails behind it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.signal import savgol_filter

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, frame_id, shaped
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.page import LegendLine, Zone, replay_page
from aerobat_pin.visualization.replay.scene import FADED, HALO, Scene

FRAMES_PER_SECOND = 120.0  # of the recorded time: 25 a flap at 4.75 Hz
MOST_FRAMES = 7201  # a minute, 34 MB of a page; fewer a second would show another motion than there was
FOLLOWED = 0.5  # [s]: what the camera follows of a free base is its way, smoothed by as much
CAMERA = (0.7, -1.1, 0.55)  # from where it looks, in sizes of the robot
BOUNDLESS = 1e3  # [m]: planes are larger
LONGEST = 0.6  # at most, of the largest arrow, in sizes of the robot

Move = Callable[[pin.GeometryModel, int], None]


@dataclass(frozen=True)
class _Forces:
    label: str
    colour: str
    inner: bool
    start: dict[str, Array]
    force: dict[str, Array]


@dataclass(frozen=True)
class _Sheet:
    label: str
    colour: str
    points: Array
    colours: Array
    drift: Array
    lasting: float


class Recording:
    """A motion to be looked at.

    Args:
        model: any model; the camera follows a base that is free.
        visual_model: its visible parts.
        time: (n,) [s], not falling.
        q: (n, nq) configurations.
        title: a line about what is seen.
        floor: height of the ground [m]; the lowest point that the robot reaches when omitted.
        move: called with a copy of `visual_model` and a row's number before that row is placed; may set the placement
            of parts that no joint moves.

    Attributes:
        index: (m,) rows of `time` and `q` that are keyframes, about 120 a second; no more than a minute of them, and
            then the page says so.
        size: of the robot, half its bounding box's diagonal; of a fixed one, of all that it reaches [m].

    Raises:
        ShapeError: times or configurations that are no motion.
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
        move: Move | None = None,
    ) -> None:
        self.model, self.visual_model, self.title = model, visual_model.copy(), title
        self._time: Array = np.asarray(time, float)
        if self._time.ndim != 1 or len(self._time) < 2 or not np.all(np.diff(self._time) >= 0.0):
            raise ShapeError("time: two rows or more were expected, not falling")
        self._q = shaped(q, (len(self._time), model.nq), "q")
        if not np.all(np.isfinite(self._q)):
            raise ShapeError("q holds NaN or infinity")
        wanted = np.arange(self._time[0], self._time[-1], 1.0 / FRAMES_PER_SECOND)
        rows = np.append(np.searchsorted(self._time, wanted - 1e-9), len(self._time) - 1)
        self.index = rows[np.unique(self._time[rows], return_index=True)[1]][:MOST_FRAMES]
        if len(self.index) < 2:
            raise ShapeError("time: it does not pass")
        self._data = model.createData()
        self._placements, low, high = self._place(move)
        self._floor = float(low[:, 2].min()) if floor is None else floor
        self._way: Array = 0.5 * (low + high)
        self._free = model.njoints > 1 and model.joints[1].nq == 7
        box = high - low
        if self._free:
            self._way = self._q[self.index, :3]
        else:
            box = high.max(axis=0) - low.min(axis=0)
        self.size = 0.5 * float(np.linalg.norm(box, axis=-1).max()) or 1.0
        self._forces: list[_Forces] = []
        self._zones: list[Zone] = []
        self._sheet: _Sheet | None = None

    @property
    def time(self) -> Array:
        """Times (m,) of the keyframes [s]."""
        return np.asarray(self._time[self.index])

    @property
    def duration(self) -> float:
        """From the first keyframe to the last [s]."""
        return float(self.time[-1] - self.time[0])

    def add_forces(self, label: str, colour: str, forces: Mapping[str, ArrayLike], *, inner: bool = False) -> None:
        """Show forces as arrows that begin at frames.

        Args:
            label: what they are.
            colour: hexadecimal.
            forces: frame -> (n, 3) [N] in world axes; the force of the n - 1 intervals between rows will do.
            inner: draw slim arrows, to be seen inside others.

        Raises:
            FrameNotFoundError: the model has no such frame.
            ShapeError: forces of another shape.
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
        self._forces.append(_Forces(label, colour, inner, start, chosen))

    def add_zone(self, start: float, end: float, label: str, colour: str) -> None:
        """Mark a stretch of time [s], in which something happens; it ends at infinity where it goes on."""
        self._zones.append(Zone(start, end, label, colour))

    def add_sheet(self, label: str, colour: str, points: Array, colours: Array, drift: Array, lasting: float) -> None:
        """Trail a translucent sheet, a row of points a keyframe; each row is seen for a while after its own time.

        Args:
            label: what it is.
            colour: for the legend.
            points: (m, k, 3) in world axes, at time 0 of the drift [m].
            colours: (m, k, 3), from 0 to 1.
            drift: (m, 3) by which the whole sheet has moved at the keyframes [m].
            lasting: [s].
        """
        self._sheet = _Sheet(label, colour, points, colours, drift, lasting)

    @property
    def newtons_per_centimetre(self) -> float:
        """Length of the arrows: 1, 2 or 5 times a power of ten, so that the largest is nearly a robot's size."""
        sizes = [np.linalg.norm(rows, axis=1) for kind in self._forces for rows in kind.force.values()]
        largest = max((float(np.percentile(one, 99.0)) for one in sizes), default=0.0) or 1.0
        return _round_up(largest / (100.0 * LONGEST * self.size))

    def html(self, rate: float = 1.0) -> str:
        """Return the page, which starts to play at a rate, of real time."""
        scene = Scene(self.time - self._time[0])
        scene.move("world", position=-self._followed())
        scene.robot(self.model, self.visual_model, self._placements)
        spacing = self._ground(scene)
        keys = [LegendLine("grid", style.MUTED, f"ground, {spacing:g} m a square")]
        if self._free:
            inside = np.any([(self.time >= zone.start) & (self.time <= zone.end) for zone in self._zones], axis=0)
            steps = np.stack([self._way[:-1], self._way[1:]], axis=1)
            scene.segments("world/path", steps[~(inside[1:] & inside[:-1])] if self._zones else steps, style.PATH)
            keys.append(LegendLine("line", style.PATH, "path of the body"))
        for i, zone in enumerate(self._zones):
            if self._free:
                self._mark(scene, f"world/zone/{i}", zone)
            until = f"{zone.start:g} s to {zone.end:g} s" if np.isfinite(zone.end) else f"from {zone.start:g} s on"
            keys.append(LegendLine("line", zone.colour, f"{zone.label}, {until}"))
        scale = self.newtons_per_centimetre
        for kind in self._forces:
            for name, force in kind.force.items():
                start = kind.start[name]
                tip = start + force / (100.0 * scale)
                scene.arrow(f"world/force/{kind.label}/{name}", kind.colour, start, tip, self.size, inner=kind.inner)
            keys.insert(0, LegendLine("bar", kind.colour, kind.label, 1.0 if kind.inner else HALO))
        if self._forces:
            keys.insert(len(self._forces), LegendLine("", "", f"arrows: {scale:g} N per cm"))
        sheet = None
        if self._sheet is not None:
            one = self._sheet
            scene.move("world/air", position=one.drift)
            scene.sheet("world/air/sheet", one.points, one.colours)
            keys.append(LegendLine("bar", one.colour, one.label, FADED))
            sheet = (2 * (one.points.shape[1] - 1), one.lasting)
        commands = scene.commands(self.size * np.array(CAMERA))
        whole, title = float(self._time[-1] - self._time[0]), self.title
        if self.duration < whole:
            title += f" (the first {self.duration:.3g} s of {whole:.3g} s)"
        return replay_page(commands, title, keys, self._zones, self.time, rate, sheet)

    def _place(self, move: Move | None) -> tuple[Array, Array, Array]:
        """Return placements (m, parts, 7) of the visible parts, and the box around them (m, 3), (m, 3)."""
        model, visible = self.model, self.visual_model
        placed, items = visible.createData(), list(visible.geometryObjects)
        corners = np.array([_corners(item) for item in items]).reshape(-1, 8, 3)
        placements = np.empty((len(self.index), len(items), 7))
        low, high = np.empty((2, len(self.index), 3))
        for row, k in enumerate(self.index):
            if move is not None:
                move(visible, int(k))
            pin.updateGeometryPlacements(model, self._data, visible, placed, self._q[k])
            placements[row] = [pin.SE3ToXYZQUAT(one) for one in placed.oMg]
            there = [
                one.rotation @ box.T + one.translation[:, None] for one, box in zip(placed.oMg, corners, strict=True)
            ]
            ways = np.hstack(there or [one.translation[:, None] for one in self._data.oMi])  # nothing visible: joints
            low[row], high[row] = ways.min(axis=1), ways.max(axis=1)
        return placements, low, high

    def _followed(self) -> Array:
        """Return where the camera looks (m, 3): the middle of a fixed robot, the smoothed way of a free one."""
        if not self._free:
            return np.tile(self._way.mean(axis=0), (len(self._way), 1))
        step = float(np.median(np.diff(self.time)))
        window = min(max(3, 2 * round(0.5 * FOLLOWED / step) + 1), len(self._way) - 1 + len(self._way) % 2)
        if window < 3:
            return self._way
        return np.asarray(savgol_filter(self._way, window, min(2, window - 1), axis=0))

    def _mark(self, scene: Scene, node: str, zone: Zone) -> None:
        """Draw a stretch of time on the way, with a ball where it begins and one where it ends, as far as is seen."""
        first, last = np.clip([zone.start, zone.end], self.time[0], self.time[-1])
        if first == last:
            return
        inside = self.time[(self.time > first) & (self.time < last)]
        ends = {"onset": zone.start, "end": zone.end}
        scene.line(f"{node}/way", self._at(np.concatenate([[first], inside, [last]])), zone.colour)
        for name, time in ends.items():
            if first <= time <= last:
                scene.ball(f"{node}/{name}", self._at(np.array([time]))[0], 0.03 * self.size, zone.colour)

    def _at(self, time: Array) -> Array:
        """Return the way (k, 3) at times (k,), straight between the keyframes."""
        return np.column_stack([np.interp(time, self.time, along) for along in self._way.T])

    def _ground(self, scene: Scene) -> float:
        """Draw a grid and return its spacing [m]."""
        spacing = _round_up(0.5 * self.size)
        low, high = self._way.min(axis=0) - 6.0 * self.size, self._way.max(axis=0) + 6.0 * self.size
        x, y = (spacing * np.arange(np.floor(low[i] / spacing), np.ceil(high[i] / spacing) + 1) for i in (0, 1))
        floor = self._floor
        across = [[[one, y[0], floor], [one, y[-1], floor]] for one in x]
        along = [[[x[0], one, floor], [x[-1], one, floor]] for one in y]
        scene.segments("world/ground", np.array(across + along), style.FAINT)
        return spacing


def record(
    model: pin.Model,
    visual_model: pin.GeometryModel,
    time: ArrayLike,
    q: ArrayLike,
    forces: Mapping[str, ArrayLike] | None = None,
    *,
    title: str = "",
) -> Recording:
    """Record a motion, with forces [N] in world axes by frame, (n, 3) each. Raises as `Recording` and `add_forces`."""
    made = Recording(model, visual_model, time, q, title=title)
    if forces:
        made.add_forces("force", style.ESTIMATES[0], forces, inner=True)
    return made


def _corners(item: pin.GeometryObject) -> Array:
    """Return the corners (8, 3) of a part's box in its own axes [m]; of what has no end, its origin."""
    item.geometry.computeLocalAABB()
    box = item.geometry.aabb_local
    ends = np.array([box.min_, box.max_]) * item.meshScale
    if not np.all(np.abs(ends) < BOUNDLESS):
        ends = np.zeros((2, 3))
    return np.array(list(itertools.product(*ends.T)))


def _round_up(value: float) -> float:
    """Return the next number that is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(one * power for one in (1.0, 2.0, 5.0, 10.0) if one * power >= value * (1.0 - 1e-9)))
