"""Serve a live page to browsers on this machine, until Ctrl-C.

Who does not know the token of the address, asks for another host (a foreign name that was made to lead here) or comes
from another page, gets neither page nor socket. Messages leave at a fixed rate, whatever a browser draws; it gets no
further one while the last is on its way.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import signal
from collections.abc import Callable, Mapping
from contextlib import suppress
from time import monotonic
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from aerobat_pin.aerobat import place_bars, visual_model_with_bars
from aerobat_pin.errors import AerobatError, ExtraError, OutputError, raising
from aerobat_pin.experiments import LIVE_OBSERVERS, LiveFlight, LiveRow, LiveSource
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.any_robot import visible_parts
from aerobat_pin.visualization.replay.scene import box_corners, round_number_above
from aerobat_pin.visualization.replay.serve import LOCALHOST
from aerobat_pin.visualization.template import fill_template

PERIOD = 0.04  # [s] between messages
SHARE = 0.6  # of a period that the robot may take, at most
ROW_PERIOD = 0.02  # [s] between points of a curve
LONGEST_TIME = 10_000.0  # [s] that a page counts before it begins anew: messages hold single precision
PICTURE_FOLLOWS = 0.1  # share by which the picture follows a robot that flies, from message to message
LARGEST_WISH = 10_000  # bytes of a message from a page
PAGE_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; frame-ancestors 'none'"
SIMPLE = 1200  # triangles up to which a mesh is drawn as it is; of others the hull is drawn
HULL_POINTS = 80  # of a hull, at most
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)


class _Picture:
    """What is drawn of a robot."""

    def __init__(self, source: LiveSource) -> None:
        self.source, self._begun = source, source.time
        if isinstance(source, LiveFlight):
            self.visual = visual_model_with_bars(source.robot)
        else:
            self.visual = visible_parts(source.urdf, source.model, source.title)[1]
        self._data, self._placed = source.model.createData(), self.visual.createData()
        self._frames = [frame_id(source.model, point) for point in source.points]
        self._free = source.model.joints[1].nq == 7
        self._place()
        placed = zip(self._placed.oMg, self.visual.geometryObjects, strict=True)
        corners = [at.rotation @ box_corners(part).T + at.translation[:, None] for at, part in placed]
        low, high = (end(np.hstack(corners), axis=1) for end in (np.min, np.max))
        self.size, self._target = 0.5 * float(np.linalg.norm(high - low)) or 1.0, 0.5 * (low + high)

    def _place(self) -> None:
        source = self.source
        if isinstance(source, LiveFlight):
            place_bars(source.robot, self.visual, source.crank)
        pin.updateGeometryPlacements(source.model, self._data, self.visual, self._placed, source.q)
        pin.updateFramePlacements(source.model, self._data)

    def message(self, rows: list[LiveRow], pace: float) -> bytes:
        """Return a message as the page reads it: numbers in single precision, times since the robot's first."""
        source = self.source
        if abs(source.time - self._begun) > LONGEST_TIME:
            self._begun = source.time
        now = source.time - self._begun
        self._place()
        if self._free:
            self._target = self._target + PICTURE_FOLLOWS * (source.q[:3] - self._target)
        parts = [pin.SE3ToXYZQUAT(place) for place in self._placed.oMg]
        points = [self._data.oMf[frame].translation for frame in self._frames]
        curves = [np.concatenate([[row.time - self._begun], row.true.ravel(), row.estimate.ravel()]) for row in rows]
        whole = [[now, pace, len(rows)], self._target, source.force.ravel(), *parts, *points, *curves]
        return np.concatenate([np.ravel(part) for part in whole]).astype("<f4").tobytes()


class _Life:
    """The robot's time, and the browsers that watch."""

    def __init__(self, source: LiveSource, save: Callable[[], str]) -> None:
        self.source, self.picture, self.save = source, _Picture(source), save
        self.watchers: dict[Any, Any] = {}  # socket -> its last message, on its way
        self.paused, self._row, self._wanted, self._seen = False, -np.inf, False, False

    def welcome(self, socket: Any) -> None:
        """Tell a page that has come what there is, and show how it stands."""
        self._seen, self.watchers[socket] = True, None
        socket.write_message(self._greeting())
        self._send(socket, self.picture.message([], 0.0))

    def _greeting(self) -> str:
        source = self.source
        greeting = {
            "title": source.title,
            "parts": live_parts(self.picture.visual),
            "points": source.points,
            "size": self.picture.size,
            "limit": round_number_above(source.limit) if source.limit else 0.0,
            "knobs": source.knobs,
            "observers": LIVE_OBSERVERS,
            "observer": source.observer,
            "gain": source.gain,
            "noise": source.noise,
            "wind": source.wind.tolist(),
            "paused": self.paused,
        }
        return json.dumps(greeting)

    def wish(self, text: str | bytes) -> None:
        """Do what a page asks for."""
        try:
            values = json.loads(text)
            if not isinstance(values, Mapping):
                raise ValueError
            self.paused = bool(values.get("paused", self.paused))
            self._wanted = self._wanted or bool(values.get("save"))
            self.source.change(values)
        except AerobatError as error:
            self.tell(f"error: {error}")
        except (TypeError, ValueError):
            self.tell("error: a message that cannot be read")

    def tell(self, line: str) -> None:
        """Let all pages show a line."""
        for socket in self.watchers:
            self._send(socket, json.dumps({"said": line}))

    def _send(self, socket: Any, message: str | bytes) -> None:
        with suppress(Exception):  # it has just left
            self.watchers[socket] = socket.write_message(message, binary=isinstance(message, bytes))

    async def live(self, ended: Callable[[], bool]) -> None:
        """Go on, message by message, until that says so."""
        due, begun, budget = monotonic(), monotonic(), SHARE * PERIOD
        while not ended():
            due = max(due + PERIOD, monotonic() + 0.1 * PERIOD)
            await asyncio.sleep(due - monotonic())
            late, begun = monotonic() - begun - 1.05 * PERIOD, monotonic()
            budget = min(max(budget - 0.2 * late, 0.1 * PERIOD), SHARE * PERIOD)  # so that messages leave in time
            if self._wanted:
                self._wanted = False
                self.tell("saving ...")
                await asyncio.sleep(PERIOD)
                try:
                    self.tell(f"saved in {self.save()}")
                except AerobatError as error:
                    self.tell(f"error: {error}")
            if self.paused or not (self._seen or self.source.unseen):
                continue
            before = self.source.time
            rows = self.source.advance(PERIOD, budget)
            if self.source.said:
                self.tell(self.source.said)
                self.source.said, self.paused = "", self.source.ended
            kept = []
            for row in rows:
                if row.time >= self._row + ROW_PERIOD - 1e-9 or row.time < self._row:
                    self._row = row.time
                    kept.append(row)
            message = self.picture.message(kept, (self.source.time - before) / PERIOD)
            for socket, sent in list(self.watchers.items()):
                if sent is None or sent.done():
                    self._send(socket, message)


def serve_live(source: LiveSource, announce: Callable[[str], None], save: Callable[[], str], port: int = 0) -> None:
    """Serve a live page until Ctrl-C; only browsers on this machine can open it, by the announced address.

    Args:
        source: the robot.
        announce: called with the address as soon as the page can be opened.
        save: writes what happened, and says where.
        port: port of this machine; 0 takes a free one.

    Raises:
        ExtraError: tornado is not installed.
        OutputError: the port is taken, or not free for this user.
    """
    try:
        from tornado.httpserver import HTTPServer
        from tornado.netutil import bind_sockets
        from tornado.web import Application, HTTPError, RequestHandler
        from tornado.websocket import WebSocketHandler
    except ImportError as error:
        raise ExtraError(f"live: {error}: pip install 'aerobat-pinocchio[live]' was expected") from error
    token, life = secrets.token_urlsafe(18), _Life(source, save)

    def refused(request: Any, *, socket: bool) -> bool:
        asked, given = request.headers.get_list("Host"), request.arguments.get("token", [b""])
        origins = request.headers.get_list("Origin")
        if len(asked) != 1 or asked[0] not in hosts or not secrets.compare_digest(given[-1], token.encode()):
            return True
        return (socket or bool(origins)) and origins != [f"http://{asked[0]}"]

    class Page(RequestHandler):
        def get(self) -> None:
            if refused(self.request, socket=False):
                raise HTTPError(403)
            policy = f"{PAGE_POLICY}; connect-src ws://{self.request.host}"
            self.set_header("Content-Security-Policy", policy)
            self.set_header("Referrer-Policy", "no-referrer")
            self.set_header("Cache-Control", "no-store")
            self.finish(page)

    class Socket(WebSocketHandler):
        def prepare(self) -> None:
            if refused(self.request, socket=True):
                raise HTTPError(403)

        def check_origin(self, origin: str) -> bool:
            return True  # `prepare` has seen to it

        def open(self, *_: str) -> None:
            life.welcome(self)

        def on_message(self, message: str | bytes) -> None:
            life.wish(message)

        def on_close(self) -> None:
            life.watchers.pop(self, None)

    page = fill_template("live.html", title=source.title, truth=style.TRUTH, estimate=style.ESTIMATES[0])
    hosts: list[str] = []

    async def run() -> None:
        limits: dict[str, Any] = {"websocket_max_message_size": LARGEST_WISH, "log_function": lambda handler: None}
        server = HTTPServer(Application([("/", Page), ("/live", Socket)], **limits), max_body_size=LARGEST_WISH)
        try:
            sockets = bind_sockets(port, LOCALHOST)
        except OSError as error:
            raise OutputError(f"live: --port {port}: {error.strerror}; another port, or none, was expected") from error
        server.add_sockets(sockets)
        hosts.extend(f"{name}:{sockets[0].getsockname()[1]}" for name in (LOCALHOST, "localhost"))
        announce(f"http://{hosts[0]}/?token={token}")
        await life.live(interrupted)

    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGPIPE])  # a page that is closed would end the program by it
    with suppress(KeyboardInterrupt), raising() as interrupted:
        asyncio.run(run())


def live_parts(visual_model: pin.GeometryModel) -> list[dict[str, Any]]:
    """Return points [m], triangles and colour of each part in its own axes, as the page reads them."""
    parts = []
    for item in visual_model.geometryObjects:
        points, faces = _outward_triangles(item.geometry)
        red, green, blue, opacity = np.asarray(item.meshColor, float).tolist()
        parts.append(
            {
                "points": np.round(points, 5).ravel().tolist(),
                "faces": faces.ravel().tolist(),
                "colour": [round(255.0 * share) for share in (red, green, blue)],
                "opacity": opacity,
            }
        )
    return parts


def _outward_triangles(shape: Any) -> tuple[Array, Any]:
    """Return points (n, 3) and triangles (m, 3), outward, of a shape; none of a plane."""
    if hasattr(shape, "tri_indices"):
        points = np.asarray(shape.vertices(), float)
        if shape.num_tris <= SIMPLE:
            triangles = (shape.tri_indices(k) for k in range(shape.num_tris))
            return points, np.array([[triangle[0], triangle[1], triangle[2]] for triangle in triangles])
        return _hull(points[np.unique(np.argmax(_directions() @ points.T, axis=1))])
    if isinstance(shape, coal.Box):
        return _hull(np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T * shape.halfSide)
    if isinstance(shape, coal.Sphere | coal.Ellipsoid):
        radii = shape.radii if isinstance(shape, coal.Ellipsoid) else np.full(3, shape.radius)
        return _hull(_directions() * radii)
    if isinstance(shape, coal.Cylinder | coal.Capsule | coal.Cone):
        ring = shape.radius * np.column_stack([np.cos(CIRCLE), np.sin(CIRCLE), 0.0 * CIRCLE])
        top = ring * (0.01 if isinstance(shape, coal.Cone) else 1.0)
        up, cap = np.array([0.0, 0.0, shape.halfLength]), np.zeros((0, 3))
        if isinstance(shape, coal.Capsule):
            cap = np.array([[0.0, 0.0, sign * (shape.halfLength + shape.radius)] for sign in (-1.0, 1.0)])
        return _hull(np.concatenate([ring - up, top + up, cap]))
    return np.zeros((0, 3)), np.zeros((0, 3), int)


def _directions() -> Array:
    """Return directions (n, 3) spread over a sphere."""
    k = np.arange(HULL_POINTS) + 0.5
    height, angle = 1.0 - 2.0 * k / HULL_POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])


def _hull(points: Array) -> tuple[Array, Any]:
    hull = ConvexHull(points, qhull_options="QJ Pp")
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inward = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0.0
    return points, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
