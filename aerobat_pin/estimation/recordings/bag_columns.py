"""Read MCAP files and ROS 2 bags (and ROS 1 bags) as columns, without ROS: the package `rosbags`, extra `ros`."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.estimation.recordings.columns import Clock, Columns, increasing
from aerobat_pin.estimation.recordings.map_tables import LogTable
from aerobat_pin.estimation.recordings.messages import entries, stamp

LATEST_STAMP = 3600.0  # [s]: header stamps further from the recorder's are taken for another epoch, not for a delay


def rosbags_reader(path: Path) -> Any:
    """Return an opened reader of a bag. Raises LogError if it is none, or if `rosbags` is not installed."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(f"log {path}: reading bags needs the extra ros: pip install 'aerobat-pinocchio[ros]'") from error
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # the reader raises errors of a dozen kinds for a damaged bag
        raise LogError(f"log {path}: cannot be read as a bag: {' '.join(str(error).split())[:200]}") from error
    return reader


def read_bag_columns(path: Path, log: LogTable, wanted: Iterable[str] | None) -> Columns:
    """Read topics of a bag, with the stamps that `log.clock` names.

    Args:
        path: a file .mcap, .db3 or .bag, or the folder of a ROS 2 bag.
        log: the table `log` of the map.
        wanted: names of columns to read, such as `/imu.angular_velocity.x`; None reads all topics.

    Raises:
        LogError: the bag cannot be read or lacks a topic.
    """
    reader = rosbags_reader(path)
    try:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        topics = set(kinds) if wanted is None else {name.partition(".")[0] for name in wanted}
        read = [connection for connection in reader.connections if connection.topic in topics]
        tables: dict[str, _Topic] = {}
        for connection, recorded, raw in reader.messages(connections=read) if read else ():
            table = tables.setdefault(connection.topic, _Topic())
            if table.useless:
                continue
            message = reader.deserialize(raw, connection.msgtype)
            found = entries(message)
            if found is None:
                table.useless = True
                continue
            table.add(stamp(message), 1e-9 * recorded, found)
    except LogError:
        raise
    except Exception as error:  # damaged chunks, unknown types
        raise LogError(f"log {path}: cannot be read as a bag: {' '.join(str(error).split())[:200]}") from error
    finally:
        reader.close()
    clocks: dict[str, Clock] = {}
    values, clock_of = {}, {}
    for topic, table in tables.items():
        if not table.useless and len(table.recorded) > 0:
            clocks[topic], columns = table.columns(log.clock)
            for name, column in columns.items():
                values[f"{topic}.{name}"], clock_of[f"{topic}.{name}"] = column, topic
    names = tuple(values) if wanted is None else tuple(values) + tuple(sorted(set(kinds) - set(tables)))
    return Columns(path, names, clocks, clock_of, values, kinds, log.clock)


class _Topic:
    """The messages of one topic: stamps and columns, which may begin late (a joint that is named late)."""

    def __init__(self) -> None:
        self.header, self.recorded = array("d"), array("d")
        self.table: dict[str, array[float]] = {}
        self.useless = False

    def add(self, header: float, recorded: float, found: dict[str, float]) -> None:
        """Append a message."""
        count = len(self.recorded)
        self.header.append(header)
        self.recorded.append(recorded)
        for name, value in found.items():
            column = self.table.get(name)
            if column is None:
                column = self.table[name] = array("d", [np.nan] * count)
            column.append(value)
        if len(found) < len(self.table):
            for column in self.table.values():
                if len(column) == count:
                    column.append(np.nan)

    def columns(self, clock: str) -> tuple[Clock, dict[str, Any]]:
        """Return the clock and the columns, in the order of the chosen stamps."""
        header, recorded = np.array(self.header), np.array(self.recorded)
        stamped = bool(np.all(header > 0.0))
        time = header if clock == "header" and stamped else recorded
        late = recorded - header if stamped and np.max(np.abs(recorded - header)) < LATEST_STAMP else np.empty(0)
        order = np.argsort(time, kind="stable")  # a recorder writes messages as they arrive, not as they were stamped
        keep, repeated, backward = increasing(time[order])
        kept = order[keep]
        late = late[kept] if len(late) else late
        return Clock(time[kept], repeated, backward, late), {
            name: np.array(column)[kept] for name, column in self.table.items()
        }
