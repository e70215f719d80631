"""Read MCAP files and ROS 2 bags (and ROS 1 bags) as columns, without ROS: the package `rosbags`, extra `ros`."""

from __future__ import annotations

import struct
import threading
from array import array
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.records.columns import Clock, Columns, GrowingTable
from aerobat_pin.records.csv_columns import MOST_CELLS
from aerobat_pin.records.map_tables import LogTable
from aerobat_pin.records.messages import entries, stamp
from aerobat_pin.records.spool import Series, Spool
from aerobat_pin.records.unpacking import Unpacking, check_bag, check_chunks

LATEST_STAMP = 3600.0  # [s]: header stamps further from the recorder's are taken for another epoch, not for a delay
ROS_ENCODING = "cdr"  # encoding of ROS 2
KNOWN_SCHEMAS = ("", "ros2msg", "ros2idl", "omgidl")  # languages of schemas that `rosbags` reads
LARGEST_MESSAGE = 1_000_000  # bytes of a message with numbers
REORDERED = 10_000  # messages of a topic that are put in order together
MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHUNK = 0x02, 0x06
ROS_PROFILE = "ros2"  # of an MCAP file's header
RECORD_HEAD = 9  # bytes: opcode and length
CRC_IN_CHUNK = 24  # bytes of a content that are before its checksum
ONE_AT_A_TIME = threading.Lock()  # a bag, as functions of `rosbags` are replaced while it is open


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag with `rosbags`, let through the door for files of strangers; every failure is a LogError.

    `rosbags` stops at schemas of JSON or protobuf, and unpacks whatever a chunk holds before it looks at the size that
    the chunk states. Its functions for both are replaced while the bag is open.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.rosbag1 import reader as rosbag1
        from rosbags.rosbag2 import reader as rosbag2
        from rosbags.rosbag2 import storage_mcap
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(f"log {path}: reading bags needs the extra ros: pip install 'aerobat-pinocchio[ros]'") from error
    check_bag(path)
    kinds, ending = rosbag2.Reader.STORAGE_PLUGINS, path.suffix
    unpack, get_msgdef = Unpacking(path), storage_mcap.get_msgdef
    changes: tuple[tuple[Any, str, Any], ...] = (
        (storage_mcap, "read_string", lambda file: _string(file, storage_mcap.read_bytes)),
        (
            storage_mcap,
            "get_msgdef",
            lambda schema: get_msgdef(schema if not schema or schema.encoding in KNOWN_SCHEMAS else None),
        ),
        (storage_mcap, "DECOMPRESSORS", unpack.of_mcap),
        (rosbag2.Reader, "STORAGE_PLUGINS", {**kinds, ending: kinds.get(ending.lower())}),  # LOG.MCAP, too
        (rosbag1, "decompressors", unpack.of_rosbag1),
        (rosbag2, "zstd", SimpleNamespace(open=rosbag2.zstd.open, decompress=unpack.zstd)),
        (rosbag2, "shutil", SimpleNamespace(copyfileobj=unpack.copy)),
    )
    with ONE_AT_A_TIME, ExitStack() as stack:
        for module, name, value in changes:
            stack.callback(setattr, module, name, getattr(module, name))
            setattr(module, name, value)
        try:
            reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            reader.open()
            stack.callback(reader.close)
            check_chunks(path, reader)
            yield reader
        except LogError:
            raise
        except Exception as error:  # the reader raises errors of a dozen kinds for a damaged bag
            raise LogError(f"log {path}: cannot be read as a bag: {' '.join(str(error).split())[:200]}") from error


def read_bag_columns(path: Path, log: LogTable, wanted: Iterable[str] | None) -> Columns:
    """Read topics of a bag, as `read_columns`, with the stamps of `log.clock`. Raises LogError if one is missing."""
    with _opened(path) as reader:
        known = reader.typestore.fielddefs
        readable = [link for link in reader.connections if link.msgtype in known and _encoding(link) == ROS_ENCODING]
        kinds = {connection.topic: connection.msgtype for connection in readable}
        unread = {link.topic: _encoding(link) for link in reader.connections if link.topic not in kinds}
        topics = set(kinds) if wanted is None else {name.partition(".")[0] for name in wanted}
        for topic in sorted(topics & set(unread)):
            raise LogError(f"log {path}: {_unread(topic, unread[topic])}: a described ROS message was expected")
        read = [connection for connection in readable if connection.topic in topics]
        tables: dict[str, _Topic] = {}
        spool = Spool()
        for connection, arrival, raw in reader.messages(connections=read) if read else ():
            table = tables.setdefault(connection.topic, _Topic(spool, log.clock))
            if table.useless:
                continue
            if len(raw) > LARGEST_MESSAGE and wanted is not None:
                raise LogError(
                    f"log {path}: {connection.topic} has a message of {len(raw)} bytes: numbers were expected"
                )
            try:
                message = reader.deserialize(raw, connection.msgtype)
                numbers = entries(message) if len(raw) <= LARGEST_MESSAGE else None
            except Exception:
                if wanted is not None:
                    raise
                unread[connection.topic], numbers = connection.msgtype, None
            if numbers is None:
                table.useless = True
                continue
            table.add(stamp(message), 1e-9 * arrival, numbers)
    clocks: dict[str, Clock] = {}
    values, clock_of = {}, {}
    for topic, table in tables.items():
        if not table.useless:
            clocks[topic], columns = table.finished()
            for name, column in columns.items():
                values[f"{topic}.{name}"], clock_of[f"{topic}.{name}"] = column, topic
    names = tuple(values) if wanted is None else tuple(values) + tuple(sorted(set(kinds) - set(tables)))
    notes = tuple(f"{_unread(topic, how)}: left out" for topic, how in unread.items())
    return Columns(path, names, clocks, clock_of, values, kinds, log.clock, notes=notes)


def _encoding(connection: Any) -> str:
    """Return how the messages of a connection are encoded; those of a ROS 1 bag do not say."""
    return str(getattr(connection.ext, "serialization_format", ROS_ENCODING))


def _string(file: BinaryIO, read_bytes: Callable[[BinaryIO], bytes]) -> str:
    """Return a text of an MCAP file; whatever profile its header begins with, channels say what they are.

    A channel's metadata, which nobody needs, begins with a text, too.
    """
    first, text = file.tell() == 0, read_bytes(file).decode(errors="replace")
    return ROS_PROFILE if first else text


def _unread(topic: str, how: str) -> str:
    """Return that messages of a topic cannot be read, which are encoded in some way or have a type."""
    return f"topic {topic} has messages without a description" if how == ROS_ENCODING else f"topic {topic} is {how}"


class _Topic:
    """The messages of one topic: stamps and columns, which may begin late (a joint that is named late).

    A recorder writes messages as they arrive, not as they were stamped: they are put in order within the last
    `REORDERED` ones; one that is later still goes back in time. Where some have no stamp (0), as before a simulated
    clock runs, these are left out; where none of the first ones has one, all stand by the recorder's.
    """

    def __init__(self, spool: Spool, chosen: str) -> None:
        self.rows, self.useless, self._chosen = GrowingTable(spool), False, chosen
        self._stamped = False  # whether one of the messages of the first flush is
        self._largest_delay = 0.0
        self._header, self._arrival = array("d"), array("d")
        self._table: dict[str, array[float]] = {}

    def add(self, header: float, arrival: float, numbers: dict[str, float]) -> None:
        """Append a message."""
        count = len(self._arrival)
        self._header.append(header)
        self._arrival.append(arrival)
        for name, value in numbers.items():
            column = self._table.get(name)
            if column is None:
                if count and len(self._table) >= MOST_CELLS:
                    raise LogError(f"a topic has more than {MOST_CELLS} columns")
                column = self._table[name] = array("d", [np.nan] * count)
            column.append(value)
        if len(numbers) < len(self._table):
            for column in self._table.values():
                column.extend([np.nan] * (count + 1 - len(column)))
        if count >= 2 * REORDERED:
            self.flush(REORDERED)

    def flush(self, kept: int) -> None:
        """Hand on all messages but the `kept` last ones by the chosen stamps."""
        header, arrival = np.array(self._header), np.array(self._arrival)
        if not len(self.rows):
            self._stamped = bool(np.any(header > 0.0))
        stamped = np.where(header > 0.0, header, np.nan)
        time = stamped if self._chosen == "header" and self._stamped else arrival
        order = np.argsort(np.nan_to_num(time, nan=-np.inf), kind="stable")  # those without a stamp wait for nobody
        done, waiting = order[: len(order) - kept], order[len(order) - kept :]
        late = arrival - header
        self._largest_delay = max(self._largest_delay, float(np.max(np.abs(late[np.isfinite(time)]), initial=0.0)))
        columns = {name: np.array(column) for name, column in self._table.items()}
        self.rows.add(time[done], {name: column[done] for name, column in columns.items()}, late[done])
        self._header, self._arrival = array("d", header[waiting]), array("d", arrival[waiting])
        self._table = {name: array("d", column[waiting]) for name, column in columns.items()}

    def finished(self) -> tuple[Clock, dict[str, Series]]:
        """Return stamps and columns, with the recorder's delays if the headers have stamps of the same epoch."""
        self.flush(0)
        return self.rows.finished(late=self._stamped and self._largest_delay < LATEST_STAMP)


def mcap_is_sealed(path: Path) -> bool:
    """Return whether damage to the messages of an MCAP file would be noticed; True for what is no MCAP file."""
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return True
        for opcode, begin, _ in mcap_records(file):
            if opcode == CHUNK:
                file.seek(begin + CRC_IN_CHUNK)
                if file.read(4) == bytes(4):
                    return False
    return True


def mcap_records(file: BinaryIO) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the content of each record of a file, as far as it is whole."""
    opcode, end = 0, len(MAGIC)
    while opcode != FOOTER:
        file.seek(end)
        head = file.read(RECORD_HEAD)
        if len(head) < RECORD_HEAD:
            return
        opcode, length = struct.unpack("<BQ", head)
        begin = end + RECORD_HEAD
        end = begin + length
        yield opcode, begin, end
