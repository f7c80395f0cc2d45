"""How the messages of a bag's topic are read: by the definition that the bag brings, if it brings one."""

from __future__ import annotations

from typing import Any

from tempog._extras import need
from tempog.errors import MessageError
from tempog.ros.messages import Codec
from tempog.ros.raw import Topic

RELEASES = {"ros1": "ROS Noetic", "ros2": "ROS 2 Jazzy"}


def codec_of(topic: Topic) -> tuple[Codec, str]:
    """A codec for a topic, and what to note about it, if anything.

    The definition in the bag counts. Where that says what everybody's says, the codec is the usual one; also where
    there is none, as in ROS 2 bags before Iron.

    Raises
    ------
    MessageError
        Messages packed in a way that ROS does not, or of a type that nobody has defined.
    """
    if topic.version is None:
        raise MessageError(f"messages of {topic.name} are packed as {topic.encoding!r}; wanted cdr or ros1")
    usual = Codec(topic.version)
    known = topic.msgtype in usual.store.types
    try:
        types = _parsed(topic)
    except Exception as error:  # of a parser that is given any text
        if known:
            return usual, f"{topic.name}: its definition cannot be read; as of {RELEASES[topic.version]}"
        raise MessageError(f"{topic.name}: the definition of {topic.msgtype} cannot be read: {error}") from None
    if topic.msgtype not in types:
        if known:
            what = f"{topic.name}: its definition is of something else; as of {RELEASES[topic.version]}"
            return usual, what if topic.language else ""
        raise MessageError(f"{topic.name}: nobody has said what a {topic.msgtype} is made of")
    if all(usual.store.fielddefs.get(name, (0, 0))[1] == fields[1] for name, fields in types.items()):
        return usual, ""
    try:
        typesys = need("rosbags.typesys", "bags")
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        builtin = {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"}
        for name in builtin - set(types):
            types[name] = usual.store.fielddefs[name]
        store.register(types)
    except Exception as error:  # of a code generator that is given any definition
        raise MessageError(f"{topic.name}: the definition of {topic.msgtype} cannot be used: {error}") from None
    note = f"{topic.name}: its {topic.msgtype} is not the usual one; read as the bag says"
    return Codec(topic.version, store), note if known else ""


def _parsed(topic: Topic) -> dict[str, Any]:
    typesys = need("rosbags.typesys", "bags")
    if not topic.definition or not topic.language:
        return {}
    parse = typesys.get_types_from_idl if topic.language == "idl" else typesys.get_types_from_msg
    arguments = (topic.definition,) if topic.language == "idl" else (topic.definition, topic.msgtype)
    types: dict[str, Any] = parse(*arguments)
    return types
