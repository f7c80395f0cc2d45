"""Messages of a ROS 2 bag in an SQLite file (.db3), in the order of the file.

Read by Python's own sqlite3: rosbags opens databases as immutable, and so misses what a recorder that crashed has
left in their write-ahead logs; and it reads nothing of one that was cut off.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from tempog.ros.raw import (
    ENCODINGS,
    LANGUAGES,
    MESSAGES_PER_NEWS,
    RawMessage,
    Reading,
    Topic,
    Wanted,
    type_name,
)

MOST_BLOB_BYTES = 2**28  # SQLite takes 4 times that for granted where a file is damaged
LEAST_ROW_BYTES = 4


def read_sqlite(path: Path, wants: Wanted, reading: Reading) -> Iterator[RawMessage]:
    """The messages of wanted topics; what is damaged is told to `reading`."""
    size = path.stat().st_size
    log = path.with_name(path.name + "-wal")
    # A write-ahead log holds what the recorder wrote last; without one, nothing is to be made beside the file.
    logged = log.stat().st_size if log.is_file() else 0
    how = "mode=ro" if logged else "mode=ro&immutable=1"
    place = str(path.absolute()).replace("%", "%25").replace("?", "%3f").replace("#", "%23")
    try:
        with closing(sqlite3.connect(f"file:{place}?{how}", uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BLOB_BYTES)
            try:
                database.execute("SELECT count(*) FROM topics").fetchone()
            except sqlite3.DatabaseError as error:
                reading.lose(f"SQLite says: {error}")
                database.execute("PRAGMA writable_schema = ON")  # so it reads what there is of a file cut off
            yield from _messages(database, size + logged, wants, reading)
    except (sqlite3.Error, UnicodeError, OverflowError) as error:
        n_read = sum(reading.n_messages.values())
        reading.lose(f"after {n_read} messages SQLite says: {error}", 0 if n_read else size)


def _messages(database: sqlite3.Connection, size: int, wants: Wanted, reading: Reading) -> Iterator[RawMessage]:
    topics = {}
    definitions = _definitions(database)
    for number, name, msgtype, encoding in database.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        if not all(isinstance(text, str) for text in (name, msgtype, encoding)):
            reading.lose(f"topic {number} has no name or type")
            continue
        topic = Topic(name, type_name(msgtype), ENCODINGS.get(encoding, encoding), *definitions.get(msgtype, ()))
        topics[number] = topic, wants(topic)
        reading.announce(topic)
    n_rows, n_bytes = 0, 0
    for number, log_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages"):
        n_rows += 1
        if n_rows > size // LEAST_ROW_BYTES:
            reading.lose(f"it claims more than {n_rows} messages, which it cannot hold")
            return
        known = topics.get(number)
        if known is None or not isinstance(log_ns, int) or not isinstance(data, bytes):
            reading.lose(f"message {n_rows} has no known topic, no time or no content")
            continue
        n_bytes += len(data)
        if n_rows % MESSAGES_PER_NEWS == 0:
            reading.moved_on(min(n_bytes, size))
        yield from reading.take(*known, log_ns, data)


def _definitions(database: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    """Texts and languages of types' definitions; bags before ROS 2 Iron hold none."""
    query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
    try:
        rows: list[Any] = database.execute(query).fetchall()
    except sqlite3.Error:
        return {}
    return {name: (text, LANGUAGES.get(language, "")) for name, text, language in rows if isinstance(text, str)}
